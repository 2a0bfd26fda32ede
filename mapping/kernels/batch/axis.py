"""`himm`, many readings at once: the cells that a beam's axis runs through, and its end.

The line is cut where it crosses the borders between cells, with the sums of ``axis.line_cells`` of
the update rules, so the cells are the same. The map is that of one reading after the other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import free_loop, loop
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.spans import FRONT, beam_between, part_of_beam, widths_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


@loop
def _cuts(a: float, b: float, cuts: Floats, found: int) -> int:
    """Append where a line from a to b crosses whole numbers, as shares 0 .. 1 of its length."""
    low, high = min(a, b), max(a, b)
    for between in range(math.floor(low) + 1, math.ceil(high)):
        cuts[found] = min(max((between - a) / (b - a), 0.0), 1.0)
        found += 1
    return found


@loop
def line_cells(
    x: float, y: float, heading: float, length_m: float, place: Place
) -> tuple[Integers, Integers]:
    """Rows and columns of the whole grid along a line, in order; the last holds the line's end."""
    c, s = math.cos(heading), math.sin(heading)
    x0, y0 = (x - place.origin_x_m) / place.size_m, (y - place.origin_y_m) / place.size_m
    cells = length_m / place.size_m
    x1, y1 = x0 + c * cells, y0 + s * cells
    cuts = np.empty(int(abs(x1 - x0) + abs(y1 - y0)) + 6)
    cuts[0], cuts[1] = 0.0, 1.0
    found = _cuts(y0, y1, cuts, _cuts(x0, x1, cuts, 2))
    cuts = np.sort(cuts[:found])
    row, col = np.empty(found, np.int64), np.empty(found, np.int64)
    n = 0
    for k in range(1, found):
        if cuts[k] == cuts[k - 1]:
            continue
        middle = (cuts[k - 1] + cuts[k]) / 2.0
        row[n], col[n] = math.floor(y0 + middle * (y1 - y0)), math.floor(x0 + middle * (x1 - x0))
        n += 1
    row[n], col[n] = math.floor(y1), math.floor(x1)
    return row[: n + 1], col[: n + 1]


@free_loop
def add_axes(
    certainty: Floats, observed: Flags, place: Place, readings: Readings, half_widths: Floats,
    hit: float, miss: float, most: float,
) -> None:  # fmt: skip
    """Add readings, in their order: ``miss`` less along each axis, ``hit`` more at its end.

    ``certainty`` (rows, cols or more) stays in 0 .. ``most``; ``observed`` gets what changed.
    (What else a reading's model says something of is ``counts.add_bands`` with NOTHING.)
    """
    rows, cols = observed.shape
    touched = np.full((rows, cols), -1, np.int64)
    widths = widths_of(half_widths)
    xs, ys, headings, ranges, fronts, bands, names = readings
    for i in range(xs.size):
        seen = bands[i] >= 0.0
        if not seen and fronts[i] < 0.0:
            continue
        row, col = line_cells(xs[i], ys[i], headings[i], ranges[i], place)
        row, col = row - place.row0, col - place.col0
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, names[i])
        if not seen and not _any_in_front(row, col, rows, cols, beam, place):
            continue
        end = row.size - 1
        if seen and 0 <= row[end] < rows and 0 <= col[end] < cols:
            r, c = row[end], col[end]
            touched[r, c] = i  # a hit stays a hit
            before = certainty[r, c]
            certainty[r, c] = min(before + hit, most)
            observed[r, c] |= np.float32(certainty[r, c] / most) != np.float32(before / most)
        for k in range(row.size):
            r, c = row[k], col[k]
            if 0 <= r < rows and 0 <= c < cols and touched[r, c] != i:
                touched[r, c] = i
                before = certainty[r, c]
                certainty[r, c] = max(before - miss, 0.0)
                observed[r, c] |= certainty[r, c] != before


@loop
def _any_in_front(row, col, rows, cols, beam, place) -> bool:  # type: ignore[no-untyped-def]
    """Does the model let the beam empty any of these cells?"""
    for k in range(row.size):
        if 0 <= row[k] < rows and 0 <= col[k] < cols:
            dx = (col[k] + place.col0 + 0.5) * place.size_m + place.origin_x_m - beam.x
            dy = (row[k] + place.row0 + 0.5) * place.size_m + place.origin_y_m - beam.y
            if part_of_beam(beam, dx, dy) == FRONT:
                return True
    return False
