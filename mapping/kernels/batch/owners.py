"""Whose a cell of a scan is, looked at one by one with the rasteriser's predicate.

That is slow, so it is for the few rows whose outline passes too close to a cell's centre to tell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import loop
from mapping.kernels.batch.readings import Place
from mapping.kernels.footprints import TOLERANCE_M, _in_beam, turn_of

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]


@loop
def nearest_axes(
    axis: Integers, headings: Floats, turns: Floats, after: Integers, scratch: Floats
) -> None:
    """Borders between neighbouring axes as numbers of ``turn_of``, ascending, and the axis after
    each: those of the rasteriser. The axes come in the order of their directions, so both lists
    only have to be begun at their lowest."""
    n, lowest, first = axis.size, 0, 0
    directions = turns  # until these are found
    for k in range(n):
        directions[k] = headings[axis[k]] % (2.0 * math.pi)
        lowest = k if directions[k] < directions[lowest] else lowest
    for k in range(n):
        here, there = directions[(lowest + k) % n], directions[(lowest + k + 1) % n]
        there += 2.0 * math.pi if k == n - 1 else 0.0
        middle = here + (there - here) / 2.0
        scratch[k] = turn_of(math.cos(middle), math.sin(middle))
        first = k if scratch[k] < scratch[first] else first
    for k in range(n):
        turns[k] = scratch[(first + k) % n]
        after[k] = axis[(lowest + first + k + 1) % n]


@loop
def owner(
    dx: float, dy: float, turns: Floats, after: Integers, turned: Floats,
    width: tuple[float, float, float], fronts: Floats, bands: Floats,
) -> tuple[int, bool]:  # fmt: skip
    """The beam that says something of a place, -1 for none, and is it in its band?

    ``turned`` (2, B) are cosine and sine of all beams, ``width`` sine, cosine and half a beam's
    width itself; ``fronts`` and ``bands`` the ends in metres, as the scan has them.
    """
    turn, low, high = turn_of(dx, dy), 0, turns.size
    while low < high:  # how many borders lie at or before the place
        middle = (low + high) // 2
        low, high = (middle + 1, high) if turns[middle] <= turn else (low, middle)
    axis = after[low - 1 if low > 0 else turns.size - 1]
    rho = math.sqrt(dx * dx + dy * dy)
    if rho > max(fronts[axis], bands[axis]) + TOLERANCE_M:
        return -1, False
    in_front = rho < fronts[axis] - TOLERANCE_M
    if not in_front and not bands[axis] > fronts[axis]:
        return -1, False
    c, s = turned[0, axis], turned[1, axis]
    if not _in_beam(dx * c + dy * s, dy * c - dx * s, rho, width[0], width[1], width[2]):
        return -1, False
    return axis, not in_front


@loop
def look_for_bands(
    slow: Flags, place: Place, x: float, y: float, first: int, last: int, turns: Floats,
    after: Integers, turned: Floats, width: tuple[float, float, float], fronts: Floats,
    bands: Floats, in_band: Flags,
) -> None:  # fmt: skip
    """Which beams own a cell of their band in the rows that are looked at cell by cell?"""
    lacking = False
    for k in range(bands.size):
        lacking |= bands[k] >= 0.0 and not in_band[k]
    if not lacking:
        return
    for row in range(slow.size):
        if slow[row]:
            dy = (row + place.row0 + 0.5) * place.size_m + place.origin_y_m - y
            for col in range(first, last):
                dx = (col + place.col0 + 0.5) * place.size_m + place.origin_x_m - x
                axis, is_band = owner(dx, dy, turns, after, turned, width, fronts, bands)
                if axis >= 0 and is_band:
                    in_band[axis] = True
