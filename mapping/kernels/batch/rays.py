"""Laser scans as thin rays with `fading` and Bayes' rule: each cell once a scan, hits win.

A ray runs along x or y, whichever it does more, and takes the cell in which it crosses the middle
of each column (row) between the sensor's and the obstacle's. Rays of one such quarter that come in
the order of their directions cross the k-th column in that order too, so a cell that the last ray
there took is known by one comparison, without a look at the map. Only near the four diagonals,
where two quarters meet, a cell may be met from both: these few are marked.
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
from mapping.kernels.batch.steps import CLAMP, HIGHEST, LOWEST, ONE

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Singles = NDArray[np.float32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

FRACTION = 32  # bits of a cell's 2^32 parts: slopes and places along a ray are whole numbers
_WHOLE = float(1 << FRACTION)
_NOWHERE = np.int32(-(1 << 30))
# Columns of the table of a scan's rays.
QUARTER, SLOPE, BEGIN, COUNT, END_ROW, END_COL, INSIDE = range(7)


@loop
def _rays_of(
    axis: Integers, bearings: Floats, heading: float, x: float, y: float, ranges: Floats,
    fronts: Floats, place: Place, rows: int, cols: int, rays: Integers,
) -> None:  # fmt: skip
    """Fill ``rays`` (A, 7): how each runs, in whole numbers; a COUNT of -1 where it says nothing.

    Quarters are 0 to 3: along +x, +y, -x, -y. The slope is how far a ray gets across with each
    step along, BEGIN where it is across, from the sensor's row or column on, at step 0.
    """
    size = place.size_m
    x_cells, y_cells = (x - place.origin_x_m) / size, (y - place.origin_y_m) / size
    col0, row0 = math.floor(x_cells), math.floor(y_cells)
    for j in range(axis.size):
        k = axis[j]
        c, s = math.cos(bearings[k] + heading), math.sin(bearings[k] + heading)
        col = math.floor((x + ranges[k] * c - place.origin_x_m) / size)
        row = math.floor((y + ranges[k] * s - place.origin_y_m) / size)
        if abs(c) >= abs(s):
            quarter, slope, across = 0 if c > 0.0 else 2, s / abs(c), y_cells - row0
            off = (col0 + 0.5 - x_cells) if c > 0.0 else (x_cells - col0 - 0.5)
            count = abs(col - col0)
        else:
            quarter, slope, across = 1 if s > 0.0 else 3, c / abs(s), x_cells - col0
            off = (row0 + 0.5 - y_cells) if s > 0.0 else (y_cells - row0 - 0.5)
            count = abs(row - row0)
        rays[j, QUARTER], rays[j, SLOPE] = quarter, math.floor(slope * _WHOLE + 0.5)
        rays[j, BEGIN] = math.floor((across + off * slope) * _WHOLE)
        rays[j, COUNT] = count if fronts[k] >= 0.0 else -1
        rays[j, END_ROW], rays[j, END_COL] = row - place.row0, col - place.col0
        ends_in = 0 <= row - place.row0 < rows and 0 <= col - place.col0 < cols
        begins_in = 0 <= row0 - place.row0 < rows and 0 <= col0 - place.col0 < cols
        rays[j, INSIDE] = begins_in and ends_in


@loop
def _first_of(rays: Integers) -> int:
    """The ray to begin with, so that those of a quarter follow each other by their slopes."""
    count = rays.shape[0]
    for j in range(count):
        if rays[j, QUARTER] != rays[j - 1, QUARTER]:
            return j
    rises = rays[0, QUARTER] == 0 or rays[0, QUARTER] == 3
    for j in range(count):
        if (rays[j, SLOPE] < rays[j - 1, SLOPE]) == rises and rays[j, SLOPE] != rays[j - 1, SLOPE]:
            return j
    return 0


@loop
def _is_new(marks: Steps, scan: int, along: int, across: int, quarter: int) -> bool:
    """Whether a cell near a diagonal is met for the first time in this scan."""
    ahead = along if quarter < 2 else -along
    dx, dy = (ahead, across) if quarter % 2 == 0 else (across, ahead)
    wide, high = abs(dx), abs(dy)
    corner = (1 if dx < 0 else 0) + (2 if dy < 0 else 0)
    place = (np.int64(corner) * marks.shape[1] + min(wide, high)) * 3 + wide - high + 1
    flat = marks.reshape(-1)
    if flat[place] == scan:
        return False
    flat[place] = scan
    return True


@inlined_loop
def _shaded(
    shade: tuple[Any, Any], bells: tuple[Singles, Singles], squares: tuple[Singles, Singles],
    row: int, col: int,
) -> Any:  # fmt: skip
    """What a free cell loses, in steps, where that depends on its place."""
    near = shade[0] + shade[1] * bells[0][row] * bells[1][col]
    value = near / (np.float32(1.0) + squares[0][row] + squares[1][col])
    return np.int32(np.rint(max(value, np.float32(-CLAMP))))


@loop
def _add_plain_ray(
    cells: Steps, observed: Bytes, stride: int, cols: int, ray: Integers, row: int, col: int,
    last: Steps, marks: Steps, scan: int, plain: Any,
) -> None:  # fmt: skip
    """The same where all of it lies in the grid and each cell loses as much; both are flat."""
    quarter, slope, at = ray[QUARTER], ray[SLOPE], ray[BEGIN]
    ahead = np.int64(1 if quarter < 2 else -1)
    along, across_by, along_o, across_o = (
        (ahead, stride, ahead, cols) if quarter % 2 == 0 else (ahead * stride, 1, ahead * cols, 1)
    )
    begin, begin_o = row * stride + col, row * cols + col
    # Up to here it may be near a diagonal; from there on it gets away from it with each step.
    near = min(ray[COUNT], np.int64(3.0 / max(1.0 - abs(slope) / _WHOLE, 1e-9)) + 2)
    for k in range(1, near):
        at += slope
        across = at >> FRACTION
        if last[k] == across:
            continue
        last[k] = np.int32(across)
        if k - abs(across) <= 1 and not _is_new(marks, scan, k, across, quarter):
            continue
        cell = np.uint64(begin + k * along + across * across_by)
        observed[np.uint64(begin_o + k * along_o + across * across_o)] = 1
        total = np.int32(cells[cell] + plain)
        cells[cell] = total if total > LOWEST else LOWEST
    nothing = np.int32(0)
    for k in range(near, ray[COUNT]):
        at += slope
        across = np.int32(at >> FRACTION)
        place = np.uint64(k)
        cell = np.uint64(begin + k * along + across * across_by)
        value = cells[cell]
        step = nothing if last[place] == across else plain  # without a branch: both are common
        last[place] = across
        if value == 0:  # what is not 0 has been observed before
            observed[np.uint64(begin_o + k * along_o + across * across_o)] = 1
        total = np.int32(value + step)
        cells[cell] = total if total > LOWEST else LOWEST


@loop
def _add_ray(
    cells: Steps, observed: Flags, ray: Integers, row: int, col: int, last: Steps, marks: Steps,
    scan: int, plain: Any, shade: tuple[Any, Any], bells: tuple[Singles, Singles],
    squares: tuple[Singles, Singles], is_plain: bool, part: int, parts: int,
) -> None:  # fmt: skip
    """The front of one ray, from the cell behind the sensor's to that before the obstacle's."""
    quarter, slope, at = ray[QUARTER], ray[SLOPE], ray[BEGIN]
    stride, cols = cells.shape[1], observed.shape[1]
    ahead = 1 if quarter < 2 else -1
    row_along, col_along = (0, ahead) if quarter % 2 == 0 else (ahead, 0)
    row_across, col_across = (1, 0) if quarter % 2 == 0 else (0, 1)
    all_cells, all_observed, is_inside = cells.reshape(-1), observed.reshape(-1), ray[INSIDE] != 0
    for k in range(1, ray[COUNT]):
        at += slope
        across = at >> FRACTION
        place = np.uint64(k)
        if last[place] == across:
            continue
        last[place] = across
        if k - abs(across) <= 1 and not _is_new(marks, scan, k, across, quarter):
            continue
        r = row + k * row_along + across * row_across
        c = col + k * col_along + across * col_across
        if not is_inside and not (0 <= r < observed.shape[0] and 0 <= c < cols):
            continue
        if parts > 1 and r % parts != part:
            continue
        step = plain if is_plain else _shaded(shade, bells, squares, r, c)
        cell = np.uint64(r * stride + c)
        total = np.int32(all_cells[cell] + step)
        all_cells[cell] = total if total > LOWEST else LOWEST
        all_observed[np.uint64(r * cols + c)] = True


@loop
def _add_hits(
    cells: Steps, observed: Flags, axis: Integers, rays: Integers, before: Steps, ranges: Floats,
    bands: Floats, sensor: Floats, part: int, parts: int,
) -> None:  # fmt: skip
    """The obstacles' cells: what they held before the scan and a hit, of the nearest beam."""
    for turn in range(2):
        for j in range(axis.size):
            row, col = rays[j, END_ROW], rays[j, END_COL]
            if bands[axis[j]] < 0.0 or rays[j, COUNT] < 0 or row % parts != part:
                continue
            if not (0 <= row < observed.shape[0] and 0 <= col < observed.shape[1]):
                continue
            if turn == 0:
                cells[row, col] = before[j]
                continue
            hit = np.int32(before[j] + _hit_of(sensor, ranges[axis[j]]))
            cells[row, col] = max(cells[row, col], min(hit, HIGHEST))
            observed[row, col] = True


@free_loop
def add_rays(
    cells: Steps, observed: Flags, place: Place, scans: Scans, axes: ScanAxes, sensor: Floats,
    part: int, parts: int,
) -> None:  # fmt: skip
    """Add scans of one laser, in their order, to the rows part, part + parts, ... of a map.

    ``cells`` (rows, a multiple of ``LANES``) are steps of log-odds, ``observed`` (rows, cols) gets
    the cells of which anything was said. ``sensor`` (5,) is a row of ``fading``'s table.
    """
    (rows, cols), stride, size = observed.shape, cells.shape[1], place.size_m
    bell, square = np.zeros(stride, np.float32), np.zeros(stride, np.float32)
    row_bell = np.zeros(-(-rows // 16) * 16, np.float32)
    row_square = np.zeros_like(row_bell)
    rays, before = np.empty((axes.axis.size, 7), np.int64), np.empty(axes.axis.size, np.int32)
    last, marks = np.empty(1, np.int32), np.zeros((4, 1, 3), np.int32)
    miss, near = np.float32(-sensor[MISS] * ONE), np.float32(-sensor[MISS] * sensor[NEAR] * ONE)
    plain = np.int32(np.rint(max(miss, np.float32(-CLAMP))))
    flat_cells, flat_observed = cells.reshape(-1), observed.reshape(-1).view(np.uint8)
    for i in range(scans.x_m.size):
        x, y, ranges, bands = scans.x_m[i], scans.y_m[i], scans.range_m[i], scans.band_end_m[i]
        _rays_of(axes.axis, axes.bearings_rad, scans.heading_rad[i], x, y, ranges,
                 scans.front_end_m[i], place, rows, cols, rays)  # fmt: skip
        longest, farthest, leaves = 0, 0.0, False
        own_row = math.floor((y - place.origin_y_m) / size) - place.row0
        own_col = math.floor((x - place.origin_x_m) / size) - place.col0
        for j in range(axes.axis.size):
            row, col = rays[j, END_ROW], rays[j, END_COL]
            if 0 <= row < rows and 0 <= col < cols:
                before[j] = cells[row, col]
            if rays[j, COUNT] >= 0:
                longest = max(longest, rays[j, COUNT])
                farthest = max(farthest, ranges[axes.axis[j]])
                leaves |= row != own_row or col != own_col
        if longest >= last.size:
            last = np.empty(2 * longest + 2, np.int32)
            marks = np.zeros((4, 2 * longest + 2, 3), np.int32)
        is_plain = near == 0.0 and farthest + 2.0 * size < sensor[FADE] * FLAT
        if not is_plain:
            gaussians(place.col0, stride, 1, size, place.origin_x_m - x, sensor[FADE], bell, square)
            gaussians(place.row0, rows, 1, size, place.origin_y_m - y, sensor[FADE], row_bell,
                      row_square)  # fmt: skip
        row, col = own_row, own_col
        first, quarter = _first_of(rays), np.int64(-1)
        is_mine = 0 <= row < rows and 0 <= col < cols and row % parts == part
        if miss != 0.0 and leaves and is_mine:
            step = plain
            if not is_plain:
                step = _shaded((miss, near), (row_bell, bell), (row_square, square), row, col)
            cells[row, col] = max(np.int32(cells[row, col] + step), LOWEST)
            observed[row, col] = True
        if miss != 0.0:
            for n in range(axes.axis.size):
                j = (first + n) % axes.axis.size
                if rays[j, QUARTER] != quarter:
                    quarter = rays[j, QUARTER]
                    last[: longest + 1] = _NOWHERE
                if is_plain and parts == 1 and rays[j, INSIDE] != 0:
                    _add_plain_ray(flat_cells, flat_observed, stride, cols, rays[j], row, col,
                                   last, marks, i + 1, plain)  # fmt: skip
                    continue
                _add_ray(cells, observed, rays[j], row, col, last, marks, i + 1, plain,
                         (miss, near), (row_bell, bell), (row_square, square), is_plain, part,
                         parts)  # fmt: skip
        _add_hits(cells, observed, axes.axis, rays, before, ranges, bands, sensor, part, parts)
