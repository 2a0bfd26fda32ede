"""What a ranger should have seen, by the walls that it saw at other times.

Cells in which at least two of its echoes lie, and no fewer than beams went through on their way to
an echo beyond, are its walls. A reading whose axis meets one well within reach expects an echo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.readings import Readings
from recorder.columns import Floats, Ints

_CELL_M = 0.05
_WITHIN = 0.9  # of the reach: farther away an echo may fail
_LEAST_ECHOES = 2
_MOST_CELLS = 4_000_000  # of the box that the echoes lie in

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Expected:
    """N readings of a sensor in time: when, whether there was an echo, whether one was expected."""

    t_ns: Ints
    echo: Flags
    expected: Flags

    def missed_between(self, first_ns: int, last_ns: int) -> int:
        """How many readings of a stretch expect an echo and have none."""
        within = (self.t_ns >= first_ns) & (self.t_ns <= last_ns)
        return int((within & self.expected & ~self.echo).sum())


def expected_echoes(readings: Readings, sensor: str) -> Expected | None:
    """Of a ranger with a thin beam; None where too little is seen or places lie too far apart."""
    names = [each.name for each in readings.sensors]
    if sensor not in names:
        return None
    mine = readings.chosen(readings.sensor == names.index(sensor))
    echo, range_m, reach_m = np.isfinite(mine.ranges_m), mine.ranges_m, mine.reach_m
    if len(range_m) != len(mine) or not echo.any() or not np.isfinite(reach_m).all():
        return None
    start = mine.world_from_sensor
    heading_rad = start.heading_rad + mine.bearings_rad
    way = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    from_m = np.column_stack([start.x_m, start.y_m])
    at_m, _ = mine.points_m()
    low_m = at_m.min(axis=0) - _CELL_M
    size = np.floor((at_m.max(axis=0) - low_m) / _CELL_M).astype(np.int64) + 2
    if size.prod() > _MOST_CELLS:
        return None
    cells = _Cells(low_m, size)
    hits = np.bincount(cells.of(at_m), minlength=cells.count)
    passed: Ints = np.zeros(cells.count, np.int64)
    for step_m in _steps(float(range_m[echo].max()) - _CELL_M):
        on = range_m[echo] - _CELL_M > step_m
        through = cells.of(from_m[echo][on] + step_m * way[echo][on])
        passed += np.bincount(through, minlength=cells.count)
    wall = (hits >= _LEAST_ECHOES) & (hits >= passed)
    wall[-1] = False  # all that lies outside
    expected = np.zeros(len(mine), np.bool_)
    for step_m in _steps(_WITHIN * float(reach_m.max())):
        ahead = np.flatnonzero(~expected & (step_m < _WITHIN * reach_m))
        expected[ahead] = wall[cells.of(from_m[ahead] + step_m * way[ahead])]
    order = np.argsort(mine.t_ns, kind="stable")
    return Expected(mine.t_ns[order], echo[order], expected[order])


def _steps(end_m: float) -> list[float]:
    return [0.5 * _CELL_M * k for k in range(1, math.ceil(max(end_m, 0.0) / (0.5 * _CELL_M)))]


@dataclass(frozen=True, slots=True)
class _Cells:
    """A box of cells, counted row by row, and one more for all that lies outside."""

    low_m: Floats
    size: Ints

    @property
    def count(self) -> int:
        return int(self.size.prod()) + 1

    def of(self, at_m: Floats) -> Ints:
        """In which cell each place (N, 2) lies, (N,)."""
        cell = np.floor((at_m - self.low_m) / _CELL_M).astype(np.int64)
        inside = ((cell >= 0) & (cell < self.size)).all(axis=1)
        return np.where(inside, cell[:, 0] * self.size[1] + cell[:, 1], self.count - 1)
