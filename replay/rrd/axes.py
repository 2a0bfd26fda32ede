"""Metres beside a map: ticks with their numbers along two sides of what a view shows, and a bar."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mapping.artifacts import Started
from mapping.grid import GridGeometry
from replay.rrd import layout
from replay.rrd.sink import Sink

Floats = NDArray[np.float64]

WHOLE = "whole"  # the name of the frame that shows all of a grid
_INK = (236, 239, 246, 255)
_AIR = 0.06  # of the longer side, around what must be seen
_FOR_NUMBERS = 0.07  # of the longer side: room for the numbers of the ticks
_TICK, _AXIS_OUT = 0.012, 0.008  # of the longer side
_TICKS = 6  # about so many along the longer side
_NO_DOT = -0.1  # the viewer writes a label only where it draws a dot


@dataclass(frozen=True, slots=True)
class Frame:
    """A part of the map plane, metres; ``name`` is that of its axes."""

    name: str
    low_m: tuple[float, float]
    high_m: tuple[float, float]

    @property
    def longer_m(self) -> float:
        """Its longer side."""
        return max(self.high_m[0] - self.low_m[0], self.high_m[1] - self.low_m[1])

    @property
    def shown_m(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """From where to where in x and in y a view must reach to show it and its axes."""
        (x0, y0), (x1, y1) = self.low_m, self.high_m
        more = _FOR_NUMBERS * self.longer_m
        return (x0 - more, x1 + more / 2), (y0 - more, y1 + 1.2 * more)

    @property
    def bounds(self) -> rrb.VisualBounds2D:
        """The same in the viewer's plane, where y runs down."""
        (x0, x1), (y0, y1) = self.shown_m
        return rrb.VisualBounds2D(x_range=[x0, x1], y_range=[-y1, -y0])

    @property
    def entity(self) -> str:
        """Where its axes lie."""
        return f"{layout.AXES}/{self.name}"


def whole_frame(*geometries: GridGeometry) -> Frame:
    """All of some grids."""
    low = np.min([each.origin_m for each in geometries], axis=0)
    high = np.max([np.add(each.origin_m, each.size_m) for each in geometries], axis=0)
    return Frame(WHOLE, (float(low[0]), float(low[1])), (float(high[0]), float(high[1])))


def frame_of(*started: Started) -> Frame:
    """The path and the walls of some runs, with air around; all of their grids where not known."""
    known = [one.frame_m for one in started if one.frame_m is not None and np.ptp(one.frame_m) > 0]
    whole = whole_frame(*(one.geometry for one in started))
    if not known:
        return whole
    low = np.min([box[0] for box in known], axis=0)
    high = np.max([box[1] for box in known], axis=0)
    air = _AIR * float((high - low).max())
    low = np.maximum(low - air, whole.low_m)
    high = np.minimum(high + air, whole.high_m)
    return Frame("frame", (float(low[0]), float(low[1])), (float(high[0]), float(high[1])))


def set_up_axes(sink: Sink, frame: Frame) -> None:
    """Draw the axes of a frame and a bar that is as long as its label tells, once for all."""
    strips, places, numbers = axes_of(frame)
    bar, length_m = bar_of(frame)
    lines = rr.LineStrips2D(
        [*strips, bar], colors=[_INK], radii=[-0.6] * len(strips) + [-2.0],
        draw_order=layout.ORDER_AXES,
    )  # fmt: skip
    sink.log(frame.entity, lines)
    labels = [*numbers, f"{length_m:g} m"]
    dots = rr.Points2D(
        [*places, bar.mean(axis=0)], labels=labels, show_labels=True, radii=[_NO_DOT],
        colors=[_INK], draw_order=layout.ORDER_AXES,
    )  # fmt: skip
    sink.log(f"{frame.entity}/numbers", dots)


def axes_of(frame: Frame) -> tuple[list[Floats], list[Floats], list[str]]:
    """Two axes with their ticks as strips, where each number stands, and the numbers."""
    (x1, y1), out = frame.high_m, _AXIS_OUT * frame.longer_m
    x0, y0 = frame.low_m[0] - out, frame.low_m[1] - out
    tick, step = _TICK * frame.longer_m, nice_step(frame.longer_m / _TICKS)
    strips = [np.array([[x0, y1], [x0, y0], [x1, y0]])]
    places, numbers = [], []
    for x in ticks(frame.low_m[0], x1, step):
        strips.append(np.array([[x, y0], [x, y0 - tick]]))
        places.append(np.array([x, y0 - tick]))
        numbers.append(f"{x:g}")
    for y in ticks(frame.low_m[1], y1, step):
        strips.append(np.array([[x0 - tick, y], [x0, y]]))
        places.append(np.array([x0 - 2.5 * tick, y + tick]))
        numbers.append(f"{y:g}")
    return strips, places, numbers


def bar_of(frame: Frame) -> tuple[Floats, float]:
    """A bar (2, 2) above the right corner, and its length: a round number of metres."""
    length_m = nice_step(frame.longer_m / 5)
    y = frame.shown_m[1][1] - _TICK * frame.longer_m / 2
    return np.array([[frame.high_m[0] - length_m, y], [frame.high_m[0], y]]), length_m


def nice_step(at_least: float) -> float:
    """The next larger of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(at_least))
    return next(k * power for k in (1, 2, 5, 10) if k * power >= at_least * (1 - 1e-9))


def ticks(low: float, high: float, step: float) -> Sequence[float]:
    """The multiples of a step from low to high."""
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [round(number * step, 10) for number in range(first, last + 1)]
