"""Laser scans as thin rays with `fading` and Bayes' rule: each cell once a scan, hits win.

A ray runs along x or y, whichever it does more, and takes the cell in which it crosses the middle
of each column (row) between the sensor's and the obstacle's. All it does there is to set the
scan's bit in the cell's byte: that is once a scan, however many rays run through. After eight
scans the bits are counted, eight cells at a time, and many scans later the counts become log-odds:
losses of the same size may wait, for their sum held at the clamp is what they come to one by one.
A cell with an obstacle is brought up to date before its hit. Where a loss depends on the place of
the sensor nothing waits, and the scan's box is gone through at once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.fading import FADE, FLAT, MISS, NEAR, gaussians
from mapping.kernels.batch.lanes import free_loop, inlined_loop, loop
from mapping.kernels.batch.lidar import _hit_of
from mapping.kernels.batch.readings import Place, ScanAxes, Scans
from mapping.kernels.batch.steps import CLAMP, HIGHEST, LANES, LOWEST, ONE

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Singles = NDArray[np.float32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Eights = NDArray[np.uint64]  # the bytes of eight cells
Box = tuple[int, int, int, int]  # first row, row after the last, the same of columns

FRACTION = 32  # bits of a cell's 2^32 parts: slopes and places along a ray are whole numbers
_WHOLE = float(1 << FRACTION)
_LINE = 64  # bytes that the cache moves at once
_SCANS, _COUNTS = 8, 31  # bits of a byte; 31 times 8 still fits into one
_ODD, _PAIRS, _HALVES = (
    np.uint64(k * 0x0101010101010101) for k in (0x55, 0x33, 0x0F)
)  # fmt: skip
_1, _2, _4 = np.uint64(1), np.uint64(2), np.uint64(4)
# Columns of the table of a scan's rays.
CELL, ALONG, ACROSS, SLOPE, BEGIN, FIRST, AFTER = range(7)


@loop
def _end_of(
    x: float, y: float, heading: float, range_m: float, own: tuple[int, int], place: Place
) -> tuple[int, int, bool, int, int, int]:
    """A ray's last row and column; does it run along x, how many steps, slope, and where it begins.

    The slope is how far a ray gets across with each step along, the begin where it is across, from
    the sensor's row or column on, at step 0; both in 2^-32 of a cell.
    """
    size, (row0, col0) = place.size_m, own
    x_cells, y_cells = (x - place.origin_x_m) / size, (y - place.origin_y_m) / size
    c, s = math.cos(heading), math.sin(heading)
    col = math.floor((x + range_m * c - place.origin_x_m) / size)
    row = math.floor((y + range_m * s - place.origin_y_m) / size)
    along_x = abs(c) >= abs(s)
    if along_x:
        slope, across = s / abs(c), y_cells - row0
        off = (col0 + 0.5 - x_cells) if c > 0.0 else (x_cells - col0 - 0.5)
        count = abs(col - col0)
    else:
        slope, across = c / abs(s), x_cells - col0
        off = (row0 + 0.5 - y_cells) if s > 0.0 else (y_cells - row0 - 0.5)
        count = abs(row - row0)
    begin = math.floor((across + off * slope) * _WHOLE)
    return row, col, along_x, count, math.floor(slope * _WHOLE + 0.5), begin


@loop
def _steps_inside(
    own: int, ahead: int, size: int, own_across: int, size_across: int, slope: int, begin: int,
    count: int,
) -> tuple[int, int]:  # fmt: skip
    """The first of a ray's steps 1 .. count - 1 that lies in the grid, and the one after the last.

    ``own`` and ``own_across`` are the sensor's row and column, along the ray and across.
    """
    first = max(1, -own if ahead > 0 else own - size + 1)
    after = min(count, size - own if ahead > 0 else own + 1)
    low: Any = (np.int64(-own_across) << FRACTION) - begin  # of what the slope adds up to
    high: Any = (np.int64(size_across - own_across) << FRACTION) - 1 - begin
    if after <= first or (low <= first * slope <= high and low <= (after - 1) * slope <= high):
        return first, after
    if slope == 0:
        return first, first
    steepness = abs(slope)
    low, high = (low, high) if slope > 0 else (-high, -low)
    return max(first, -(-low // steepness)), min(after, high // steepness + 1)


@loop
def _rays_of(
    axes: ScanAxes, heading: float, x: float, y: float, ranges: Floats, fronts: Floats,
    place: Place, rows: int, cols: int, width: int, rays: Integers, ends: Integers,
) -> tuple[int, Box]:  # fmt: skip
    """Fill ``rays`` (A, 7) with how each that says something runs through the rows of ``width``.

    ``ends`` (A, 2) get row and column of the obstacles' cells. Returns how many rays there are,
    the sensor's cell being one of them, and the box that holds their cells.
    """
    size = place.size_m
    own = (math.floor((y - place.origin_y_m) / size), math.floor((x - place.origin_x_m) / size))
    own_row, own_col = own[0] - place.row0, own[1] - place.col0
    low_row, high_row, low_col, high_col = own_row, own_row, own_col, own_col
    cell, found, leaves = own_row * width + own_col, 0, False
    for j in range(axes.axis.size):
        k = axes.axis[j]
        if fronts[k] < 0.0:
            continue
        row, col, along_x, count, slope, begin = _end_of(
            x, y, axes.bearings_rad[k] + heading, ranges[k], own, place
        )
        row, col = row - place.row0, col - place.col0
        ends[j, 0], ends[j, 1] = row, col
        leaves |= row != own_row or col != own_col
        low_row, high_row = min(low_row, row), max(high_row, row)
        low_col, high_col = min(low_col, col), max(high_col, col)
        ahead = 1 if (col > own_col if along_x else row > own_row) else -1
        if along_x:
            first, after = _steps_inside(own_col, ahead, cols, own_row, rows, slope, begin, count)
            _put(rays, found, cell, ahead, width, slope, begin, first, after)
        else:
            first, after = _steps_inside(own_row, ahead, rows, own_col, cols, slope, begin, count)
            _put(rays, found, cell, ahead * width, 1, slope, begin, first, after)
        found += 1
    if leaves and 0 <= own_row < rows and 0 <= own_col < cols:
        _put(rays, found, cell, 0, 0, 0, 0, 0, 1)
        found += 1
    # A cell more on each side: a slope is rounded.
    return found, (_held(low_row - 1, rows), _held(high_row + 2, rows), _held(low_col - 1, cols),
                   _held(high_col + 2, cols))  # fmt: skip


@inlined_loop
def _held(index: int, most: int) -> int:
    return min(max(index, 0), most)


@inlined_loop
def _put(
    rays: Integers, k: int, cell: int, along: int, across: int, slope: int, begin: int, first: int,
    after: int,
) -> None:  # fmt: skip
    """A row of the table of rays: the sensor's cell, and how far apart steps lie."""
    rays[k, CELL], rays[k, ALONG], rays[k, ACROSS], rays[k, SLOPE] = cell, along, across, slope
    rays[k, BEGIN], rays[k, FIRST], rays[k, AFTER] = begin, first, after


@loop
def _stamp(stamps: Bytes, rays: Integers, count: int, bit: int) -> None:
    """Set a bit in the cells of the rays."""
    own = np.uint8(bit)
    for k in range(count):
        cell, along, across, slope = rays[k, CELL], rays[k, ALONG], rays[k, ACROSS], rays[k, SLOPE]
        at = rays[k, BEGIN] + rays[k, FIRST] * slope
        cell += rays[k, FIRST] * along
        for _ in range(rays[k, FIRST], rays[k, AFTER]):
            stamps[np.uint64(cell + (at >> FRACTION) * across)] |= own
            at += slope
            cell += along


@inlined_loop
def _ones(word: Any) -> Any:
    """How many bits are set in each byte."""
    pairs = word - ((word >> _1) & _ODD)
    fours = (pairs & _PAIRS) + ((pairs >> _2) & _PAIRS)
    return (fours + (fours >> _4)) & _HALVES


@inlined_loop
def _eights(width: int, row: int, box: Box) -> tuple[Any, Any]:
    """The eights of a box's row, first and after the last."""
    begin = row * width
    return np.uint64((begin + box[2]) >> 3), np.uint64((begin + box[3] + 7) >> 3)


@loop
def _count(stamps: Eights, counts: Eights, width: int, box: Box) -> None:
    """Add the number of stamps to the counts, and take these off."""
    for row in range(box[0], box[1]):
        first, after = _eights(width, row, box)
        for k in range(first, after):
            counts[k] += _ones(stamps[k])
            stamps[k] = np.uint64(0)


@inlined_loop
def _less(value: int, count: int, step: int) -> Any:
    """What is left of a cell after ``count`` losses."""
    return np.int32(max(np.int64(value) + np.int64(count) * np.int64(step), np.int64(LOWEST)))


@loop
def _add_counts(
    cells: Steps, observed: Flags, counts: Bytes, width: int, box: Box, plain: int
) -> None:
    """Take what was counted from the cells."""
    eights = counts.view(np.uint64)
    for row in range(box[0], box[1]):
        first, after = _eights(width, row, box)
        for k in range(first, after):
            if eights[k] == 0:
                continue
            begin = np.int64(k) * 8
            for c in range(begin, begin + 8):
                if counts[c] > 0:
                    col = c - row * width
                    cells[row, col] = _less(cells[row, col], counts[c], plain)
                    observed[row, col] = True
            eights[k] = np.uint64(0)


@loop
def _add_shaded(
    cells: Steps, observed: Flags, stamps: Bytes, width: int, box: Box, miss: Any, near: Any,
    bell: Singles, square: Singles, row_bell: Singles, row_square: Singles,
) -> None:  # fmt: skip
    """Take from the stamped cells what depends on their place; the stamps go."""
    eights = stamps.view(np.uint64)
    for row in range(box[0], box[1]):
        depth, own_near = np.float32(1.0) + row_square[row], near * row_bell[row]
        first, after = _eights(width, row, box)
        for k in range(first, after):
            if eights[k] == 0:
                continue
            begin = np.int64(k) * 8
            for c in range(begin, begin + 8):
                if stamps[c] > 0:
                    col = c - row * width
                    value = (miss + own_near * bell[col]) / (depth + square[col])
                    step = np.int32(np.rint(max(value, np.float32(-CLAMP))))
                    cells[row, col] = max(np.int32(cells[row, col] + step), LOWEST)
                    observed[row, col] = True
            eights[k] = np.uint64(0)


@loop
def _settle(
    cells: Steps, stamps: Bytes, counts: Bytes, width: int, bit: int, plain: int, row: int, col: int
) -> Any:
    """Bring a cell up to date with all scans before that of ``bit``, which it forgets."""
    c = row * width + col
    earlier = np.int64(counts[c]) + np.int64(_ones(np.uint64(stamps[c] & ~np.uint8(bit))))
    cells[row, col] = _less(cells[row, col], earlier, plain)
    counts[c] = stamps[c] = np.uint8(0)
    return cells[row, col]


@loop
def _add_hits(
    cells: Steps, observed: Flags, stamps: Bytes, counts: Bytes, width: int, bit: int, plain: int,
    axis: Integers, ends: Integers, before: Steps, ranges: Floats, fronts: Floats, bands: Floats,
    sensor: Floats,
) -> None:  # fmt: skip
    """The obstacles' cells: what they held before the scan and a hit, of the nearest beam."""
    for turn in range(2):
        for j in range(axis.size):
            row, col = ends[j, 0], ends[j, 1]
            if bands[axis[j]] < 0.0 or fronts[axis[j]] < 0.0:
                continue
            if not (0 <= row < observed.shape[0] and 0 <= col < observed.shape[1]):
                continue
            if turn == 0:
                before[j] = _settle(cells, stamps, counts, width, bit, plain, row, col)
                continue
            hit = np.int32(before[j] + _hit_of(sensor, ranges[axis[j]]))
            cells[row, col] = max(cells[row, col], min(hit, HIGHEST))
            observed[row, col] = True


@loop
def _reach_of(scans: Scans, axis: Integers) -> tuple[float, float, float]:
    """The longest range of the beams that say something, and how far down and up they may come."""
    longest, low, high = 0.0, math.inf, -math.inf
    for i in range(scans.x_m.size):
        farthest = -1.0
        for k in axis:
            if scans.front_end_m[i, k] >= 0.0:
                farthest = max(farthest, scans.range_m[i, k])
        if farthest >= 0.0:
            longest = max(longest, farthest)
            low, high = min(low, scans.y_m[i] - farthest), max(high, scans.y_m[i] + farthest)
    return longest, low, high


@loop
def _rows_of_part(
    place: Place, rows: int, low: float, high: float, part: int, parts: int
) -> tuple[int, int]:
    """The rows that a part owns, of those that are met between two heights: neighbours."""
    first = math.floor((low - place.origin_y_m) / place.size_m - 2.0) - place.row0
    after = math.floor((high - place.origin_y_m) / place.size_m + 3.0) - place.row0
    first, after = _held(first, rows), _held(after, rows)
    count = max(after - first, 0)
    return first + count * part // parts, first + count * (part + 1) // parts


@free_loop
def add_rays(
    cells: Steps, observed: Flags, place: Place, scans: Scans, axes: ScanAxes, sensor: Floats,
    part: int, parts: int,
) -> None:  # fmt: skip
    """Add scans of one laser, in their order, to one of the ``parts`` of a map's rows.

    ``cells`` (rows, a multiple of ``LANES``) are steps of log-odds, ``observed`` (rows, cols) gets
    the cells of which anything was said. ``sensor`` (5,) is a row of ``fading``'s table.
    """
    longest, low, high = _reach_of(scans, axes.axis)
    if high < low:
        return
    first, after = _rows_of_part(place, cells.shape[0], low, high, part, parts)
    _add_to_rows(
        cells[first:after], observed[first:after],
        Place(place.origin_x_m, place.origin_y_m, place.size_m, place.row0 + first, place.col0),
        scans, axes, sensor, longest,
    )  # fmt: skip


@loop
def _add_to_rows(
    cells: Steps, observed: Flags, place: Place, scans: Scans, axes: ScanAxes, sensor: Floats,
    longest: float,
) -> None:  # fmt: skip
    """Add scans to neighbouring rows; ``longest`` is their longest range."""
    (rows, cols), stride, size = observed.shape, cells.shape[1], place.size_m
    bell, square = np.zeros(stride, np.float32), np.zeros(stride, np.float32)
    row_bell = np.zeros(-(-rows // LANES) * LANES, np.float32)
    row_square = np.zeros_like(row_bell)
    # An odd number of lines a row: the rows of a column then lie in different places of the cache.
    width = ((cols + _LINE - 1) // _LINE | 1) * _LINE
    stamps, counts = np.zeros(rows * width, np.uint8), np.zeros(rows * width, np.uint8)
    rays, ends = (
        np.empty((axes.axis.size + 1, 7), np.int64),
        np.empty((axes.axis.size, 2), np.int64),
    )
    before = np.empty(axes.axis.size, np.int32)
    miss, near = np.float32(-sensor[MISS] * ONE), np.float32(-sensor[MISS] * sensor[NEAR] * ONE)
    plain = np.int32(np.rint(max(miss, np.float32(-CLAMP))))
    is_plain = near == 0.0 and longest + 2.0 * size < sensor[FADE] * FLAT
    stamped, counted, of_stamps, of_counts = 0, 0, (rows, 0, cols, 0), (rows, 0, cols, 0)
    for i in range(scans.x_m.size):
        x, y, ranges, fronts = scans.x_m[i], scans.y_m[i], scans.range_m[i], scans.front_end_m[i]
        bit = 1 << stamped
        found, box = _rays_of(axes, scans.heading_rad[i], x, y, ranges, fronts, place, rows, cols,
                              width, rays, ends)  # fmt: skip
        if miss != 0.0:
            _stamp(stamps, rays, found, bit)
        of_stamps = _both(of_stamps, box)
        if not is_plain:
            gaussians(place.col0, stride, 1, size, place.origin_x_m - x, sensor[FADE], bell, square)
            gaussians(place.row0, rows, 1, size, place.origin_y_m - y, sensor[FADE], row_bell,
                      row_square)  # fmt: skip
        _add_hits(cells, observed, stamps, counts, width, bit, plain, axes.axis, ends, before,
                  ranges, fronts, scans.band_end_m[i], sensor)  # fmt: skip
        if not is_plain:
            _add_shaded(cells, observed, stamps, width, box, miss, near, bell, square, row_bell,
                        row_square)  # fmt: skip
            continue
        stamped += 1
        if stamped == _SCANS or i == scans.x_m.size - 1:
            _count(stamps.view(np.uint64), counts.view(np.uint64), width, of_stamps)
            of_counts = _both(of_counts, of_stamps)
            stamped, counted, of_stamps = 0, counted + 1, (rows, 0, cols, 0)
        if counted == _COUNTS or i == scans.x_m.size - 1:
            _add_counts(cells, observed, counts, width, of_counts, plain)
            counted, of_counts = 0, (rows, 0, cols, 0)


@inlined_loop
def _both(one: Box, other: Box) -> Box:
    """The box around two boxes; one without cells has its ends before its beginnings."""
    if other[1] <= other[0] or other[3] <= other[2]:
        return one
    return (min(one[0], other[0]), max(one[1], other[1]), min(one[2], other[2]),
            max(one[3], other[3]))  # fmt: skip
