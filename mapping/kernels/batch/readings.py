"""What the batch kernels take: readings as columns. This file does not load numba."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
COUNT, BINARY, NOTHING = range(3)  # what a cell in the band gains: 1, being 1, nothing


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


class Scans(NamedTuple):
    """Scans of one laser in the order in which they are mapped: N scans of B beams each.

    Poses are (N,); the rest (N, B) is as in ``Readings``.
    """

    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    range_m: Floats
    front_end_m: Floats
    band_end_m: Floats


class ScanAxes(NamedTuple):
    """The beams of a laser, in the order of their directions: where each begins and ends.

    A beam's cells lie nearer to its axis than to any other, and within its half width. ``axis``
    (A,) are the beams, without those that look the same way as an earlier one; ``low`` and
    ``high`` (2, A) cosine and sine, relative to the laser, of both ends; ``joined`` (A,) tells
    which begin where the one before ends. ``bearings_rad`` (B,) are all directions.
    """

    axis: NDArray[np.int64]
    low: Floats
    high: Floats
    joined: NDArray[np.bool_]
    bearings_rad: Floats


_SAME_RAD = 1e-9  # beams that look the same way
_EDGE_RAD = 1e-10  # the rasteriser's tolerance of an edge


def scan_axes(bearings_rad: Floats, half_width_rad: float) -> ScanAxes:
    """The beams of a laser; ``half_width_rad`` is half the width of one of them."""
    bearings = np.asarray(bearings_rad, np.float64)
    directions = bearings % (2.0 * math.pi)
    order = np.argsort(directions, kind="stable")
    apart = np.diff(directions[order], prepend=directions[order[-1]] - 2.0 * math.pi) > _SAME_RAD
    # Of beams that look the same way, the first of the scan.
    group = np.maximum(np.cumsum(apart) - 1, 0)
    kept = np.minimum.reduceat(order, np.flatnonzero(np.diff(group, prepend=-1)))
    centre = directions[kept]
    gap = np.diff(centre, append=centre[0] + 2.0 * math.pi)
    half = half_width_rad + _EDGE_RAD
    after, before = np.minimum(gap / 2.0, half), np.minimum(np.roll(gap, 1) / 2.0, half)
    low, high = centre - before, centre + after
    return ScanAxes(
        kept.astype(np.int64), np.array([np.cos(low), np.sin(low)]),
        np.array([np.cos(high), np.sin(high)]), np.roll(gap, 1) / 2.0 <= half, bearings,
    )  # fmt: skip


class Place(NamedTuple):
    """Where an array of cells lies: the grid's origin and cell size, and which of its cells
    the array's cell (0, 0) is (0, 0 for a whole grid, elsewhere a window's first)."""

    origin_x_m: float
    origin_y_m: float
    size_m: float
    row0: int
    col0: int


def place_of(origin_m: tuple[float, float], size_m: float, row0: int = 0, col0: int = 0) -> Place:
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
