"""A page → the bytes of a PNG, SVG or PDF.

The same page gives the same bytes: no dates, names from a fixed seed, the library's own font, and
nothing of the user's settings.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon, Rectangle
from matplotlib.ticker import MaxNLocator

from replay.pictures import style
from replay.pictures.drawing.charts import draw_chart
from replay.pictures.drawing.marks import draw_mark
from replay.pictures.parts import Chart, Page, Panel
from replay.pictures.placing import Measure, Place, Placed, PlacedKey, PlacedText, place

_INCH_PT = 72.0
_NO_DATES: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def page_bytes(page: Page, form: str) -> bytes:
    """The page as a file: ``png``, ``svg`` or ``pdf``."""
    with _own_style():
        figure = Figure()
        FigureCanvasAgg(figure)
        placed = place(page, _measure(figure))
        figure.set_size_inches(placed.width, placed.height)
        for number, (panel, spot) in enumerate(zip(page.panels, placed.panels, strict=True)):
            axes = figure.add_axes(_fractions(spot, placed))
            if isinstance(panel, Chart):
                draw_chart(axes, panel)
            else:
                _draw_panel(axes, panel)
                if panel.in_metres:
                    _label_axes(axes, number, len(page.panels), placed.columns)
                else:
                    axes.set(xticks=[], yticks=[])
        for text in placed.texts:
            _draw_text(figure, placed, text)
        for key in placed.keys:
            _draw_key(figure, placed, key)
        file = io.BytesIO()
        quick: dict[str, Any] = {"pil_kwargs": {"compress_level": 4}} if form == "png" else {}
        figure.savefig(file, format=form, metadata=_metadata(page, form), **quick)
        return file.getvalue()


def measured_place(page: Page) -> Placed:
    """Where everything of a page stands, with the widths that its texts come to."""
    with _own_style():
        return place(page, _measure(Figure()))


@contextmanager
def _own_style() -> Iterator[None]:
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of letters that the font lacks: a box stands for them
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(style.STYLE_SHEET)
        yield


def _metadata(page: Page, form: str) -> dict[str, Any]:
    described = {"png": "Description", "svg": "Description", "pdf": "Subject"}[form]
    return {**_NO_DATES[form], "Title": page.named or page.title, described: page.caption}


def _measure(figure: Figure) -> Measure:
    renderer = RendererAgg(100, 100, figure.dpi)
    fonts: dict[tuple[float, bool], FontProperties] = {}

    def width(text: str, size_pt: float, bold: bool) -> float:
        font = fonts.get((size_pt, bold))
        if font is None:
            font = FontProperties(size=size_pt, weight="bold" if bold else "normal")
            fonts[size_pt, bold] = font
        pixels, _, _ = renderer.get_text_width_height_descent(text, font, ismath=False)
        return float(pixels) / figure.dpi

    return width


def _fractions(spot: Place, placed: Placed) -> tuple[float, float, float, float]:
    """A place as matplotlib counts: shares of the page, from the lower left."""
    bottom = placed.height - spot.y - spot.height
    return (
        spot.x / placed.width, bottom / placed.height,
        spot.width / placed.width, spot.height / placed.height,
    )  # fmt: skip


def _draw_panel(axes: Axes, panel: Panel) -> None:
    frame = panel.frame
    if panel.cells is not None:
        cells = panel.cells.within(frame)
        (x, y), (width, height) = cells.geometry.origin_m, cells.geometry.size_m
        axes.imshow(
            cells.pixels, extent=(x, x + width, y, y + height), origin="lower",
            interpolation="auto", zorder=0, aspect="auto",
        )  # fmt: skip
        axes.set_facecolor(style.NEVER_SEEN)
    for order, mark in enumerate(panel.marks, start=1):
        draw_mark(axes, mark, order, max(frame.width_m, frame.height_m))
    axes.set_xlim(frame.x0, frame.x1)
    axes.set_ylim(frame.y0, frame.y1)
    axes.set_aspect("equal", adjustable="box", anchor="NW")


def _label_axes(axes: Axes, number: int, count: int, columns: int) -> None:
    """Few round numbers; the unit once a row and once a column."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=7 if count == 1 else 5, steps=[1, 2, 5, 10]))
    if number + columns >= count:
        axes.set_xlabel("x, metres")
    if number % columns == 0:
        axes.set_ylabel("y, metres")


def _draw_text(figure: Figure, placed: Placed, text: PlacedText) -> None:
    figure.text(
        text.x / placed.width, 1.0 - text.y / placed.height, text.text, fontsize=text.size_pt,
        fontweight="bold" if text.bold else "normal", va="baseline", ha="left",
        color=style.PALE_INK if text.pale else style.INK, parse_math=False,
    )  # fmt: skip


def _draw_key(figure: Figure, placed: Placed, entry: PlacedKey) -> None:
    key, x, y = entry.key, entry.x, placed.height - entry.y
    inches = figure.dpi_scale_trans
    half = style.TEXT_PT / _INCH_PT * 0.42
    common: dict[str, Any] = {"transform": inches, "figure": figure}
    match key.shape:
        case "bar":
            xs = [x, x, x, x + entry.width, x + entry.width, x + entry.width]
            ys = [y - half, y + half, y, y, y + half, y - half]
            figure.add_artist(Line2D(xs, ys, color=key.colour, linewidth=1.4, **common))
        case "cells":
            box = Rectangle(
                (x, y - half), entry.width, 2 * half, facecolor=key.colour,
                edgecolor=style.PALE_INK, linewidth=0.6, **common,
            )  # fmt: skip
            figure.add_artist(box)
        case "area":
            corners = [(x, y), (x + entry.width, y + half), (x + entry.width, y - half)]
            area = Polygon(
                corners, closed=True, facecolor=(*key.colour, 0.25), edgecolor=key.colour,
                linewidth=0.9, **common,
            )  # fmt: skip
            figure.add_artist(area)
        case "robot":
            corners = [(x + 0.24, y), (x + 0.06, y + 0.08), (x + 0.1, y), (x + 0.06, y - 0.08)]
            figure.add_artist(Polygon(corners, closed=True, facecolor=key.colour, **common))
        case "dot":
            dot = Line2D(
                [x + entry.width / 2], [y], marker="o", markersize=5, color=key.colour,
                linestyle="none", markeredgewidth=0, **common,
            )  # fmt: skip
            figure.add_artist(dot)
        case _:
            line = Line2D(
                [x, x + entry.width], [y, y], color=key.colour, linewidth=2.2,
                linestyle=(0, (3, 2)) if key.shape == "dashes" else "-", **common,
            )  # fmt: skip
            figure.add_artist(line)
    text = PlacedText(key.label, x + entry.width + 0.10, entry.y + half * 0.9, style.TEXT_PT)
    _draw_text(figure, placed, text)
