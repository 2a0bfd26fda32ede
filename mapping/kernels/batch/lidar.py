"""Laser scans with `fading` and Bayes' rule: each cell takes the beam whose axis is nearest.

A scan is one reading. The fronts of its beams form one star-shaped patch: between two rows of
cells its outline changes only where two neighbouring beams end at different ranges, and along the
arc at each beam's end. So the outline is followed once around, each row collects where it is
crossed, in order, and what lies between two crossings is one run, however many beams it holds.
Only the bands are drawn beam by beam. A row whose crossing is too close to a cell's centre to tell
is looked at again, cell by cell, with the rasteriser's predicate.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.fading import (
    FADE,
    FLAT,
    HALF_WIDTH,
    HIT,
    MISS,
    NEAR,
    add_plain_row,
    add_row,
    gaussians,
)  # fmt: skip
from mapping.kernels.batch.lanes import free_loop, loop
from mapping.kernels.batch.outline import front_runs
from mapping.kernels.batch.owners import look_for_bands, nearest_axes, owner
from mapping.kernels.batch.readings import Place, ScanAxes, Scans
from mapping.kernels.batch.seen import (
    Bits,
    around,
    blank_seen,
    mark,
    mark_changed,
    mark_seen,
    no_box,
)  # fmt: skip
from mapping.kernels.batch.spans import Beam, likely_spans, span_scratch
from mapping.kernels.batch.steps import CLAMP, HIGHEST, ONE
from mapping.kernels.footprints import TOLERANCE_M

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Singles = NDArray[np.float32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]


@loop
def _band_runs(
    x: float, y: float, low: Floats, high: Floats, axis: Integers, fronts: Floats, bands: Floats,
    place: Place, rows: int, cols: int, runs: Steps, slow: Flags, in_band: Flags, spans: Steps,
    doubt: Steps,
) -> int:  # fmt: skip
    """Fill ``runs`` (4, M) with a scan's bands, row, first, after and beam; how many, -1: too many.

    ``fronts`` and ``bands`` are in metres, tolerances included. ``in_band`` gets the beams that
    surely have a cell in their band.
    """
    found, size = 0, place.size_m
    for j in range(axis.size):
        in_band[axis[j]] = False
    y_row = (y - place.origin_y_m) / size - 0.5 - place.row0
    for j in range(axis.size):
        begin, end = fronts[j], bands[j]
        if not end > begin or end <= 0.0:
            continue
        c0, s0, c1, s1 = low[0, j], low[1, j], high[0, j], high[1, j]
        inner = max(begin, 0.0)
        top = end if c0 >= 0.0 >= c1 else max(end * s0, end * s1, inner * s0, inner * s1)
        bottom = -end if c0 <= 0.0 <= c1 else min(end * s0, end * s1, inner * s0, inner * s1)
        row0 = int(max(math.ceil(y_row + bottom / size - 1e-4), 0.0))
        row1 = int(min(math.floor(y_row + top / size + 1e-4), rows - 1.0)) + 1
        if row1 <= row0:
            continue
        beam = Beam(x, y, 0.0, 0.0, 0.0, 0.0, 0.0, c0, s0, c1, s1, begin, end)
        box = (row0 + place.row0, row1 + place.row0, place.col0, place.col0 + cols)
        likely_spans(beam, place, box, np.int64(1), spans, doubt)
        if found + 2 * rows > runs.shape[1]:
            return -1
        for k in range(row1 - row0):
            slow[row0 + k] |= doubt[k] != 0
            for a, b in ((spans[0, k], spans[1, k]), (spans[2, k], spans[3, k])):
                if b > a:
                    runs[0, found], runs[1, found] = row0 + k, a - place.col0
                    runs[2, found], runs[3, found] = b - place.col0, axis[j]
                    in_band[axis[j]] |= doubt[k] == 0
                    found += 1
    return found


@loop
def _turned(c: float, s: float, unit: Floats, out: Floats) -> None:
    """Directions (2, A) turned by an angle."""
    for j in range(unit.shape[1]):
        out[0, j] = c * unit[0, j] - s * unit[1, j]
        out[1, j] = s * unit[0, j] + c * unit[1, j]


@loop
def _hit_of(sensor: Floats, range_m: float) -> Any:
    """Steps that a cell in the band gains."""
    faded = range_m / sensor[FADE]
    return np.int32(np.rint(min(sensor[HIT] / (1.0 + faded * faded) * ONE, CLAMP)))


@loop
def _point_cells(
    cells: Steps, place: Place, x: float, y: float, headings: Floats, ranges: Floats,
    bands: Floats, in_band: Flags, part: int, parts: int, cols: int, points: Integers,
) -> int:  # fmt: skip
    """The obstacle's own cell of each beam without a band: row, column, beam and what was there.

    From the longest range to the shortest, which wins a cell. Returns how many there are.
    """
    found = 0
    for axis in range(headings.size):
        if in_band[axis] or bands[axis] < 0.0:
            continue
        px, py = (
            x + ranges[axis] * math.cos(headings[axis]),
            y + ranges[axis] * math.sin(headings[axis]),
        )
        col = math.floor((px - place.origin_x_m) / place.size_m) - place.col0
        row = math.floor((py - place.origin_y_m) / place.size_m) - place.row0
        if 0 <= row < cells.shape[0] and 0 <= col < cols and row % parts == part:
            k = found  # kept in order as they come; of equal ranges the later one stays behind
            while k > 0 and ranges[points[2, k - 1]] < ranges[axis]:
                for n in range(4):
                    points[n, k] = points[n, k - 1]
                k -= 1
            points[0, k], points[1, k], points[2, k], points[3, k] = row, col, axis, cells[row, col]
            found += 1
    return found


@free_loop
def add_scans(
    cells: Steps, observed: Flags, place: Place, scans: Scans, axes: ScanAxes, sensor: Floats,
    part: int, parts: int,
) -> None:  # fmt: skip
    """Add scans of one laser, in their order, to the rows part, part + parts, ... of a map.

    ``cells`` (rows, a multiple of ``LANES``) are steps of log-odds, ``observed`` (rows, cols) gets
    the cells of which anything was said; all that are not 0 must have it. ``sensor`` (5,) is a
    row of ``fading``'s table.
    """
    (rows, cols), stride, beams = observed.shape, cells.shape[1], axes.bearings_rad.size
    bell, square = np.zeros(stride, np.float32), np.zeros(stride, np.float32)
    (spans, doubt), start, slow = (
        span_scratch(rows),
        np.empty(rows, np.int32),
        np.empty(rows, np.bool_),
    )
    row_bell, row_square = np.zeros(doubt.size, np.float32), np.zeros(doubt.size, np.float32)
    seen, touched = blank_seen(rows, cols, part, parts), no_box()
    fronts_found, band_runs = np.empty((3, 8 * rows), np.int32), np.empty((4, 8 * rows), np.int32)
    in_band, points = np.zeros(beams, np.bool_), np.empty((4, beams + 1), np.int64)
    low, high = np.empty_like(axes.low), np.empty_like(axes.high)
    axis, joined, bearings = axes.axis, axes.joined, axes.bearings_rad
    fronts, bands, in_cells = np.empty(axis.size), np.empty(axis.size), np.empty(axis.size)
    turns, after, headings = np.empty(axis.size), np.empty(axis.size, np.int64), np.empty(beams)
    half, size, is_sharp = sensor[HALF_WIDTH], place.size_m, _is_sharp(axes)
    width, turned = (math.sin(half), math.cos(half), half), np.empty((2, beams))
    miss, near = np.float32(-sensor[MISS] * ONE), np.float32(-sensor[MISS] * sensor[NEAR] * ONE)
    for i in range(scans.x_m.size):
        x, y, heading = scans.x_m[i], scans.y_m[i], scans.heading_rad[i]
        ranges, front_ends, band_ends = scans.range_m[i], scans.front_end_m[i], scans.band_end_m[i]
        for k in range(beams):
            headings[k] = bearings[k] + heading
        _turned(math.cos(heading), math.sin(heading), axes.low, low)
        _turned(math.cos(heading), math.sin(heading), axes.high, high)
        farthest = _ends_of(axis, front_ends, band_ends, size, fronts, bands, in_cells)
        found = found_bands = -1
        while found < 0 or found_bands < 0:
            for row in range(rows):
                slow[row] = not is_sharp
            if not is_sharp:
                found, found_bands, in_band[:] = 0, 0, False
                break
            column = (x - place.origin_x_m) / size - 0.5 - place.col0
            row_at = (y - place.origin_y_m) / size - 0.5 - place.row0
            found = front_runs(column, row_at, low, high, joined, in_cells, rows, cols, part,
                                parts, start, fronts_found, slow)  # fmt: skip
            found_bands = _band_runs(x, y, low, high, axis, fronts, bands, place, rows, cols,
                                     band_runs, slow, in_band, spans, doubt)  # fmt: skip
            if found < 0:
                fronts_found = np.empty((3, 2 * fronts_found.shape[1]), np.int32)
            if found_bands < 0:
                band_runs = np.empty((4, 2 * band_runs.shape[1]), np.int32)
        box = _box_of(x, y, farthest, place, rows, cols)
        touched = around(touched, box)
        if _any(slow):
            nearest_axes(axis, headings, turns, after, in_cells)
            for k in range(beams):
                turned[0, k], turned[1, k] = math.cos(headings[k]), math.sin(headings[k])
            look_for_bands(slow, place, x, y, box[2], box[3], turns, after, turned, width,
                            front_ends, band_ends, in_band)  # fmt: skip
        found_points = _point_cells(cells, place, x, y, headings, ranges, band_ends, in_band, part,
                                    parts, cols, points)  # fmt: skip
        is_plain = near == 0.0 and farthest < sensor[FADE] * FLAT
        if not is_plain:
            gaussians(place.col0, stride, 1, size, place.origin_x_m - x, sensor[FADE], bell,
                      square)  # fmt: skip
            gaussians(place.row0, rows, 1, size, place.origin_y_m - y, sensor[FADE], row_bell,
                      row_square)  # fmt: skip
        _add_front(cells, seen, fronts_found, found, slow, bell, square, row_bell,
                   row_square, miss, near, is_plain, parts)  # fmt: skip
        _add_bands(cells, seen, band_runs, found_bands, slow, sensor, ranges, part, parts)
        for row in range(part, rows, parts):
            if slow[row]:
                _add_slow_row(cells, seen, row, place, x, y, box[2], box[3], turns, after,
                              turned, width, front_ends, band_ends, ranges, sensor, bell, square,
                              row_bell, row_square, miss, near, parts)  # fmt: skip
        for k in range(found_points):
            row, col = points[0, k], points[1, k]
            hit = _hit_of(sensor, ranges[points[2, k]])
            cells[row, col] = min(np.int32(np.int32(points[3, k]) + hit), HIGHEST)
            mark(seen, row // parts, col, col, col, col + 1, True)
    mark_seen(seen, observed, part, parts)
    mark_changed(cells, observed, touched, 0, 0, part, parts)


@loop
def _box_of(
    x: float, y: float, reach: float, place: Place, rows: int, cols: int
) -> tuple[int, int, int, int]:
    """The rows and columns of the array that something at most so far away may lie in."""
    column, row = (x - place.origin_x_m) / place.size_m, (y - place.origin_y_m) / place.size_m
    far = reach / place.size_m + 2.0
    low_row, low_col = row - far - place.row0, column - far - place.col0
    return (int(min(max(low_row, 0.0), rows)), int(min(max(low_row + 2.0 * far, 0.0), rows)),
            int(min(max(low_col, 0.0), cols)),
            int(min(max(low_col + 2.0 * far, 0.0), cols)))  # fmt: skip


@loop
def _any(flags: Flags) -> bool:
    found = False
    for k in range(flags.size):
        found |= flags[k]
    return found


@loop
def _ends_of(
    axis: Integers, front_ends: Floats, band_ends: Floats, size: float, fronts: Floats,
    bands: Floats, in_cells: Floats,
) -> float:  # fmt: skip
    """Ends of fronts and bands (A,) with their tolerance, and of the fronts in cells; the farthest.

    A beam without a band gets -1 as its end.
    """
    farthest = 0.0
    for j in range(axis.size):
        front, band = front_ends[axis[j]], band_ends[axis[j]]
        fronts[j], bands[j] = front - TOLERANCE_M, band + TOLERANCE_M if band > front else -1.0
        in_cells[j] = max(fronts[j], 0.0) / size
        farthest = max(farthest, fronts[j], bands[j])
    return farthest


@loop
def _add_bands(
    cells: Steps, seen: Bits, runs: Steps, found: int, slow: Flags, sensor: Floats,
    ranges: Floats, part: int, parts: int,
) -> None:  # fmt: skip
    """The runs of a scan's bands."""
    beam, hit = -1, np.int32(0)
    for k in range(found):
        row, a, b = runs[0, k], runs[1, k], runs[2, k]
        if (parts > 1 and row % parts != part) or slow[row]:
            continue
        if runs[3, k] != beam:
            beam = runs[3, k]
            hit = _hit_of(sensor, ranges[beam])
        if add_plain_row(cells, row, a, b, b, b, 0, hit) != 0:
            mark(seen, row // parts, a, b, b, b, True)


@loop
def _is_sharp(axes: ScanAxes) -> bool:
    """Is every beam narrower than a half plane, so that a row meets it in one run?"""
    for j in range(axes.axis.size):
        across = axes.low[0, j] * axes.high[1, j] - axes.low[1, j] * axes.high[0, j]
        along = axes.low[0, j] * axes.high[0, j] + axes.low[1, j] * axes.high[1, j]
        if not (across > 1e-6 or (abs(across) <= 1e-6 and along > 0.0)):
            return False
    return True


@loop
def _add_front(
    cells: Steps, seen: Bits, runs: Steps, found: int, slow: Flags, bell: Singles,
    square: Singles, row_bell: Singles, row_square: Singles, miss: Any,
    near: Any, is_plain: bool, parts: int,
) -> None:  # fmt: skip
    """The runs of a scan's front."""
    if miss == 0.0:
        return
    plain = np.int32(np.rint(max(miss, np.float32(-CLAMP))))
    for k in range(found):
        row, a, b = runs[0, k], runs[1, k], runs[2, k]
        if slow[row]:
            continue
        if is_plain:
            zeros = add_plain_row(cells, row, a, a, b, b, plain, plain)
        else:
            zeros = add_row(cells, row, bell, square, a, a, b, b, miss, near * row_bell[row],
                            np.float32(1.0) + row_square[row], plain)  # fmt: skip
        if zeros != 0:
            mark(seen, row // parts, a, a, b, b, True)


@loop
def _add_slow_row(
    cells: Steps, seen: Bits, row: int, place: Place, x: float, y: float, first: int, last: int,
    turns: Floats, after: Integers, turned: Floats, width: tuple[float, float, float],
    fronts: Floats, bands: Floats, ranges: Floats, sensor: Floats, bell: Singles,
    square: Singles, row_bell: Singles, row_square: Singles,
    miss: float, near: float, parts: int,
) -> None:  # fmt: skip
    """One row of a scan, each cell looked at."""
    dy = (row + place.row0 + 0.5) * place.size_m + place.origin_y_m - y
    for col in range(first, last):
        dx = (col + place.col0 + 0.5) * place.size_m + place.origin_x_m - x
        axis, is_band = owner(dx, dy, turns, after, turned, width, fronts, bands)
        if axis < 0:
            continue
        hit = _hit_of(sensor, ranges[axis])
        if is_band or miss != 0.0:
            mark(seen, row // parts, col, col, col, col + 1, True)
        g = col if is_band else col + 1
        add_row(cells, row, bell, square, col, col, g, col + 1, miss,
                near * row_bell[row], np.float32(1.0) + row_square[row], hit)  # fmt: skip
