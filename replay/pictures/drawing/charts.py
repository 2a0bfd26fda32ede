"""Plots of numbers: curves and bars with named axes."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from replay.pictures import style
from replay.pictures.parts import Bars, Chart, Curve


def draw_chart(axes: Axes, chart: Chart) -> None:
    """Draw a plot; what its parts mean stands in the page's legend."""
    for part in chart.parts:
        if isinstance(part, Curve):
            _draw_curve(axes, part)
        else:
            _draw_bars(axes, part)
    axes.set_xlabel(chart.x_label)
    axes.set_ylabel(chart.y_label)
    axes.grid(color=style.NEVER_SEEN, alpha=0.35, linewidth=0.5)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _draw_curve(axes: Axes, curve: Curve) -> None:
    x, y = curve.points.T
    axes.plot(
        x, y, color=curve.colour, linewidth=1.8, linestyle=(0, (4, 3)) if curve.dashed else "-"
    )
    if curve.filled:
        axes.fill_between(x, y, np.zeros_like(y), color=curve.colour, alpha=0.25, linewidth=0)


def _draw_bars(axes: Axes, bars: Bars) -> None:
    widths = np.diff(bars.edges)
    axes.bar(
        bars.edges[:-1], bars.heights, widths, align="edge", color=(*bars.colour, 0.55),
        edgecolor=bars.colour, linewidth=0.8,
    )  # fmt: skip
    if bars.named:
        for x, width, height in zip(bars.edges[:-1], widths, bars.heights, strict=True):
            axes.annotate(
                f"{height:.4f}", (x + width / 2, height), (0, 2), textcoords="offset points",
                ha="center", va="bottom", fontsize=style.SMALL_PT, zorder=5,
                bbox={"facecolor": style.FREE, "edgecolor": "none", "alpha": 0.8, "pad": 0.6},
            )  # fmt: skip
