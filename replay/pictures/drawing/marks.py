"""What lies over the cells of a map, one function a kind of mark."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon

from replay.pictures import style
from replay.pictures.parts import Area, Dots, Mark, RobotMark, Strokes, Trail, Words

_NOSE = 0.016  # of the frame's longer side: half the length of the robot's arrow


def draw_mark(axes: Axes, mark: Mark, order: float, frame_m: float) -> None:
    """Draw one mark, ``order`` above the cells; ``frame_m`` is the frame's longer side."""
    match mark:
        case Strokes():
            lines = LineCollection(
                list(mark.ends_m), colors=[mark.colour], linewidths=mark.width_pt, zorder=order,
                capstyle="round",
            )  # fmt: skip
            axes.add_collection(lines, autolim=False)
        case Trail():
            points = mark.points_m
            if mark.closed and len(points):
                points = np.vstack([points, points[:1]])
            axes.plot(
                points[:, 0], points[:, 1], color=mark.colour, linewidth=mark.width_pt,
                linestyle=(0, (4, 3)) if mark.dashed else "-", zorder=order,
                solid_joinstyle="round",
            )  # fmt: skip
        case Dots():
            axes.plot(
                mark.points_m[:, 0], mark.points_m[:, 1], linestyle="none", marker="o",
                markersize=mark.size_pt, color=mark.colour, markeredgewidth=0, zorder=order,
            )  # fmt: skip
        case Area():
            outline = Polygon(
                mark.outline_m, closed=True, facecolor=(*mark.colour, mark.opacity),
                edgecolor=(*mark.colour, 0.9), linewidth=0.9, zorder=order,
            )  # fmt: skip
            axes.add_patch(outline)
        case RobotMark():
            _draw_robot(axes, mark, order, _NOSE * frame_m)
        case Words():
            plate = {"facecolor": style.FREE, "edgecolor": "none", "alpha": 0.75, "pad": 0.8}
            axes.text(
                *mark.at_m, mark.text, color=mark.colour, fontsize=style.SMALL_PT, zorder=order,
                ha="center", va="center", bbox=plate, clip_on=True,
            )  # fmt: skip


def _draw_robot(axes: Axes, mark: RobotMark, order: float, size_m: float) -> None:
    """An arrow head whose middle is the middle of the robot."""
    pose = mark.world_from_base
    shape = np.array([[1.3, 0.0], [-0.8, 0.85], [-0.4, 0.0], [-0.8, -0.85]]) * size_m
    c, s = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    outline = shape @ np.array([[c, s], [-s, c]]) + [pose.x_m, pose.y_m]
    patch = Polygon(
        outline, closed=True, facecolor=mark.colour, edgecolor=style.FREE, linewidth=0.8,
        zorder=order,
    )  # fmt: skip
    axes.add_patch(patch)
