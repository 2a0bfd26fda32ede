"""What the batch kernels take: readings as columns. This file does not load numba."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Readings(NamedTuple):
    """Readings of rangers in the order in which they are mapped; all arrays (N,).

    ``front_end_m`` is where the front of a reading ends, ``band_end_m`` where its band does (-1:
    no band); a reading with a negative front end says nothing. ``sensor`` is the row that its
    sensor has in the table of parameters that goes with a kernel.
    """

    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    range_m: Floats
    front_end_m: Floats
    band_end_m: Floats
    sensor: NDArray[np.int32]


class Place(NamedTuple):
    """Where an array of cells lies: the grid's origin and cell size, and which of its cells
    the array's cell (0, 0) is (0, 0 for a whole grid, elsewhere a window's first)."""

    origin_x_m: float
    origin_y_m: float
    size_m: float
    row0: int
    col0: int


def place_of(
    origin_m: tuple[float, float], size_m: float, row0: int = 0, col0: int = 0
) -> Place:
    """A place with the types that the kernels are compiled for."""
    return Place(float(origin_m[0]), float(origin_m[1]), float(size_m), int(row0), int(col0))


def ends_of(
    ranges_m: Floats, reach_m: Floats | float, before: Floats | float, behind: Floats | float,
    empties: NDArray[np.bool_] | bool,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Range, end of the front and end of the band of each reading, in the shape of ``ranges_m``.

    A range of +Inf saw nothing: it has its front up to ``reach_m`` and no band where it
    ``empties`` its beam. It says nothing where it does not, and neither does NaN nor a negative.
    """
    ranges = np.asarray(ranges_m, np.float64)
    seen = np.isfinite(ranges) & (ranges >= 0.0)
    silent = ~seen & ~(np.isposinf(ranges) & empties)
    far = np.where(seen, ranges, reach_m)
    front = np.where(silent, -1.0, np.where(seen, far * (1.0 - np.asarray(before)), far))
    band = np.where(seen, far * (1.0 + np.asarray(behind)), -1.0)
    return far, front, band
