"""The outline of a scan's front, followed once around: where it crosses each row of cells.

Its sides are the rays between neighbouring beams that end at different ranges, and the arcs at the
beams' ends. All lengths are in cells.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import loop

Floats = NDArray[np.float64]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]

_UNSURE = 1e-6  # of a cell, ...
_UNSURE_RAD = 2e-10  # and what the rasteriser's tolerance of an edge moves at the end of a beam


@loop
def _row_range(
    y: float, up: bool, d0: float, d1: float, unsure: float, rows: int, part: int, parts: int,
    slow: Flags,
) -> tuple[int, int]:  # fmt: skip
    """First row and row after the last whose centres lie d0 to d1 cells above (below) the sensor.

    ``y`` is the sensor's row. Rows whose centre lies ``unsure`` of an end are marked as ``slow``.
    """
    low, high = (y + d0, y + d1) if up else (y - d1, y - d0)
    for end in (low, high):
        nearest = np.rint(end)
        if abs(end - nearest) < unsure and 0.0 <= nearest < rows:
            slow[int(nearest)] = True
    first = math.ceil(max(low, 0.0))
    return first + (part - first) % parts, math.floor(min(high, rows - 1.0)) + 1


@loop
def _along_ray(
    x: float, y: float, c: float, s: float, before: float, after: float, rows: int, cols: int,
    part: int, parts: int, start: Steps, runs: Steps, found: int, slow: Flags,
) -> int:  # fmt: skip
    """Rows whose outline crosses a ray where the front's end jumps, in cells."""
    up, height = s > 0.0, abs(s)
    if before == after or height < 1e-12:
        return found
    longest = max(before, after)
    turned = _UNSURE_RAD * longest
    first, end = _row_range(y, up, min(before, after) * height, longest * height, _UNSURE + turned,
                            rows, part, parts, slow)  # fmt: skip
    opens, last = after > before, np.float64(cols)
    slope, unsure = c / s, _UNSURE + turned / height
    for row in range(first, end, parts):
        u = x + (row - y) * slope
        if abs(u - np.rint(u)) < unsure:
            slow[row] = True
        col = np.int32(math.ceil(min(max(u, 0.0), last)))
        if opens:
            start[row] = col
            continue
        a, b = (col, start[row]) if up else (start[row], col)
        if b > a:
            runs[0, found], runs[1, found], runs[2, found] = row, a, b
            found += 1
    return found


@loop
def _along_arc(
    x: float, y: float, c0: float, s0: float, c1: float, s1: float, radius: float, up: bool,
    rows: int, cols: int, part: int, parts: int, start: Steps, runs: Steps, found: int, slow: Flags,
) -> int:  # fmt: skip
    """Crossings of the arc from direction 0 to direction 1, both in one half plane."""
    if radius <= 0.0:
        return found
    side = 1.0 if up else -1.0
    begins, ends = c0 * side > 0.0, c1 * side < 0.0  # before, and after the farthest row
    unsure, last = _UNSURE + 1e-12 * radius * radius, np.float64(cols)
    for part_of_arc in range(2):
        opens = part_of_arc == 0
        if (opens and not begins) or (not opens and not ends):
            continue
        low = radius * abs(s0 if opens else s1)
        high = radius if (begins and ends) else radius * abs(s1 if opens else s0)
        first, end = _row_range(y, up, low, high, _UNSURE + _UNSURE_RAD * radius, rows, part, parts,
                                slow)  # fmt: skip
        for row in range(first, end, parts):
            wide = math.sqrt(max(radius * radius - (row - y) * (row - y), 0.0))
            u = x + (side if opens else -side) * wide
            if wide < 1e-3 or abs(u - np.rint(u)) < unsure:
                slow[row] = True
            col = np.int32(math.ceil(min(max(u, 0.0), last)))
            if opens:
                start[row] = col
                continue
            a, b = (col, start[row]) if up else (start[row], col)
            if b > a:
                runs[0, found], runs[1, found], runs[2, found] = row, a, b
                found += 1
    return found


@loop
def _is_up(c: float, s: float, begins: bool) -> bool:
    """Is a direction above the sensor? Of those along the row: 0 where a beam begins, pi where it
    ends."""
    return s > 0.0 or (s == 0.0 and (c > 0.0) == begins)


@loop
def _first_axis(low: Floats, high: Floats) -> int:
    """The beam that direction 0 goes through, or the next one."""
    first, nearest = 0, 5.0
    for j in range(low.shape[1]):
        begins_up, ends_up = (
            _is_up(low[0, j], low[1, j], True),
            _is_up(high[0, j], high[1, j], False),
        )
        if ends_up and not begins_up:
            return j
        turn = 1.0 - low[0, j] if begins_up else 3.0 + low[0, j]
        if turn < nearest:
            first, nearest = j, turn
    return first


@loop
def front_runs(
    x: float, y: float, low: Floats, high: Floats, joined: Flags, fronts: Floats, rows: int,
    cols: int, part: int, parts: int, start: Steps, runs: Steps, slow: Flags,
) -> int:  # fmt: skip
    """Fill ``runs`` (3, M) with a scan's front, row, first and after; how many, -1: too many.

    ``low`` and ``high`` (2, A) are cosine and sine of where beams begin and end, ``fronts`` (A,)
    the ends of their fronts in cells, 0 where there is none. Rows above the sensor are crossed
    from direction 0 on, those below from pi on: so each row meets its crossings in order.
    """
    count, found = fronts.size, 0
    first = _first_axis(low, high)
    for n in range(count + 1):
        j = (first + n) % count
        c0, s0, c1, s1, radius = low[0, j], low[1, j], high[0, j], high[1, j], fronts[j]
        begins_up, ends_up = _is_up(c0, s0, True), _is_up(c1, s1, False)
        across = ends_up and not begins_up  # goes through direction 0: ends first, begins last
        if n == count and not across:
            break
        if found + 4 * rows > runs.shape[1]:
            return -1
        if n > 0 or not across:
            before = fronts[j - 1] if joined[j] else 0.0
            found = _along_ray(x, y, c0, s0, before, radius, rows, cols, part, parts, start, runs,
                               found, slow)  # fmt: skip
        if n == count:
            ends_up, c1, s1 = False, 1.0, 0.0
        if n == 0 and across:
            begins_up, c0, s0 = True, 1.0, 0.0
        if begins_up:
            c2, s2 = (c1, s1) if ends_up else (-1.0, 0.0)
            found = _along_arc(x, y, c0, s0, c2, s2, radius, True, rows, cols, part, parts, start,
                               runs, found, slow)  # fmt: skip
        if not ends_up:
            c2, s2 = (-1.0, 0.0) if begins_up else (c0, s0)
            found = _along_arc(x, y, c2, s2, c1, s1, radius, False, rows, cols, part, parts, start,
                               runs, found, slow)  # fmt: skip
        if n < count and not joined[(j + 1) % count]:
            found = _along_ray(x, y, high[0, j], high[1, j], radius, 0.0, rows, cols, part, parts,
                               start, runs, found, slow)  # fmt: skip
    return found
