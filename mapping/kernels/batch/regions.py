"""`regions` and `peak` with Bayes' rule: many readings added to integer log-odds in one go.

Both say 2p - 1 = z of a cell, and log-odds are 2 atanh z. In front z = -factor(angular region) *
emptiness(t), a polynomial once z is small; in the band z depends on two regions only, so it comes
from a table of steps. Across a row of cells the angular regions are runs: their borders are worked
out for all rows at once, and a factor is written to a run. What a cell's band region is, is
decided in float32 where that is sure, and in float64 where it is not.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import free_loop, inlined_loop, loop
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.region_tables import EMPTY_0, EMPTY_T, HALF_WIDTH, LARGEST
from mapping.kernels.batch.seen import Bits, blank_seen, mark, mark_seen
from mapping.kernels.batch.spans import (
    BAND,
    OUTSIDE,
    WIDEST_RAD,
    Beam,
    beam_between,
    box_of,
    part_of_beam,
    point_cell,
    rows_of_part,
    span_scratch,
    spans_of_rows,
    widths_of,
)  # fmt: skip
from mapping.kernels.batch.steps import CLAMP, HIGHEST, LANES, LOWEST, ONE

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]

SMALL_Z = 0.45  # up to here the polynomial holds; larger ones take a logarithm each
_BEYOND = 1 << 30
# 2 atanh(z) / z for z^2 = 0 .. 0.2025, within 1e-8: the coefficients of 1, z^2, z^4, ...
_A0, _A1, _A2, _A3 = (np.float32(v) for v in (2, 0.666666442, 0.400017389, 0.285212549))
_A4, _A5, _A6 = (np.float32(v) for v in (0.229028995, 0.135602466, 0.299699575))
_SCALE, _UNIT, _ZERO = np.float32(-ONE), np.float32(1.0), np.float32(0.0)
_NOTHING = np.int32(0)


@loop
def region_borders(
    beam: Beam, place: Place, row0: int, step: int, rows: int, regions: int, borders: Steps
) -> None:
    """``borders[k, r]``: the column where the cells of region k and above begin or end in a row.

    In a row above the sensor they are those left of it, in the others those from it on.
    """
    per_cell = 1.0 / place.size_m
    offset = (beam.x - place.origin_x_m) * per_cell - 0.5
    # A border on the other side of the sensor does not cross the row: all of the row's cells lie
    # on that side of it on which the beam goes over to the other half.
    missed_above = float(_BEYOND if beam.sin_right <= 0.0 else -_BEYOND)
    missed_below = float(-_BEYOND if beam.sin_left < 0.0 else _BEYOND)
    for k in range(1, regions):
        angle = beam.half * (2.0 * k / regions - 1.0)
        c, s = math.cos(angle), math.sin(angle)
        cos_border, sin_border = c * beam.cos - s * beam.sin, s * beam.cos + c * beam.sin
        slope = cos_border / (sin_border if abs(sin_border) > 1e-300 else 1e-300) * per_cell
        is_up, is_down = sin_border > 0.0, sin_border < 0.0
        limit = np.float64(_BEYOND)
        for r in range(rows):
            dy = (np.float64(row0 + r * step) + 0.5) * place.size_m + place.origin_y_m - beam.y
            at = min(max(dy * slope + offset, -limit), limit)
            above = np.floor(at) + 1.0 if is_up else missed_above
            below = np.ceil(at) if is_down else missed_below
            borders[k, r] = np.int32(above if dy > 0.0 else below)


@inlined_loop
def _write_runs(
    borders: Steps, r: int, is_above: bool, regions: int, bands: int, a: int, b: int, shift: int,
    factors: Singles, factor: Singles, base: Steps,
) -> None:  # fmt: skip
    """The factor of each cell a to b - 1 of a row, and where its region begins in the table."""
    start, n_last = a, regions - 1
    for n in range(regions):  # from left to right, so that what is written too far is written over
        k = n_last - n if is_above else n
        end = b if n == n_last else min(borders[k if is_above else k + 1, r] - shift, b)
        if end <= start:
            continue
        first, value, row = np.uint64(start), factors[k], np.int32(k * bands)
        for u in range((end - start + 15) >> 4 << 4):
            factor[first + np.uint64(u)] = value
        for u in range((end - start + 15) >> 4 << 4):
            base[first + np.uint64(u)] = row
        start = end


@inlined_loop
def _add_front(
    cells: Steps, row: int, columns: Steps, square: Singles, dy_squared: float, factor: Singles,
    f: int, g: int, e0: float, e1: float,
) -> None:  # fmt: skip
    """What the cells f to g - 1 of a row lose."""
    groups = f >> 4
    start, count = np.uint64(groups << 4), (((g + 15) >> 4) - groups) << 4
    f32, width = np.int32(f), np.uint32(g - f)
    for k in range(count):
        c = start + np.uint64(k)
        e = e0 + e1 * np.sqrt(square[c] + dy_squared)
        e = e if e < _UNIT else _UNIT
        z = factor[c] * (e if e > _ZERO else _ZERO)
        s = z * z
        p = (((((_A6 * s + _A5) * s + _A4) * s + _A3) * s + _A2) * s + _A1) * s + _A0
        step = np.int32(np.rint(z * p * _SCALE))
        step = step if np.uint32(columns[c] - f32) < width else _NOTHING
        total = np.int32(cells[row, c] + step)
        total = total if total < HIGHEST else HIGHEST
        cells[row, c] = total if total > LOWEST else LOWEST


@inlined_loop
def _add_band(
    cells: Steps, row: int, place: Place, beam: Beam, columns: Steps, square: Singles,
    dy_squared: float, base: Steps, a: int, b: int, bands: int, table: Steps, index: Steps,
) -> None:  # fmt: skip
    """What the cells a to b - 1 of a row gain."""
    begin, depth = beam.front_limit, beam.limit - beam.front_limit
    scale, offset = np.float32(bands / depth), np.float32(-begin * bands / depth)
    unsure = np.float32(1e-6 * bands * beam.limit / depth)
    last, first, doubtful = np.float32(bands - 1), np.uint64(a), 0
    for k in range((b - a + 15) >> 4 << 4):
        c = first + np.uint64(k)
        at = np.sqrt(square[c] + dy_squared) * scale + offset
        doubtful += int(np.int32(abs(at - np.rint(at)) < unsure))
        at = np.floor(at)
        at = at if at < last else last
        index[c] = np.int32(base[c] + np.int32(at if at > _ZERO else _ZERO))
    if doubtful > 0 and bands > 1:
        dy = (row + place.row0 + 0.5) * place.size_m + place.origin_y_m - beam.y
        for col in range(a, b):
            dx = (col + place.col0 + 0.5) * place.size_m + place.origin_x_m - beam.x
            at_64 = math.floor((math.sqrt(dx * dx + dy * dy) - begin) / depth * bands)
            index[col] = base[col] + min(max(at_64, 0), bands - 1)
    for k in range(b - a):
        c = first + np.uint64(k)
        index[c] = table[np.uint32(index[c])]
    groups = a >> 4
    start, count = np.uint64(groups << 4), (((b + 15) >> 4) - groups) << 4
    a32, width = np.int32(a), np.uint32(b - a)
    for k in range(count):
        c = start + np.uint64(k)
        step = index[c] if np.uint32(columns[c] - a32) < width else _NOTHING
        total = np.int32(cells[row, c] + step)
        total = total if total < HIGHEST else HIGHEST
        cells[row, c] = total if total > LOWEST else LOWEST


@loop
def _squares(first: int, count: int, step: int, size: float, to: float, square: Singles) -> None:
    """((index + 0.5) size + to)^2 of the rows or columns first, first + step, ..."""
    for k in range(count):
        d = np.float32((np.float64(first + k * step) + 0.5) * size + to)
        square[k] = d * d


@loop
def _cell_step(
    beam: Beam, dx: float, dy: float, part: int, e0: float, e1: float, regions: int, bands: int,
    factors: Singles, table: Steps,
) -> Any:  # fmt: skip
    """What one cell gains, in float64: for beams and factors that no fast loop takes."""
    rho = math.sqrt(dx * dx + dy * dy)
    alpha = math.atan2(dy * beam.cos - dx * beam.sin, dx * beam.cos + dy * beam.sin)
    k = min(max(math.floor((0.5 + 0.5 * alpha / beam.half) * regions), 0), regions - 1)
    if part == BAND:
        depth = beam.limit - beam.front_limit
        j = min(max(math.floor((rho - beam.front_limit) / depth * bands), 0), bands - 1)
        return table[k * bands + j]
    z = factors[k] * min(max(e0 + e1 * rho, 0.0), 1.0)
    if abs(z) >= 1.0:
        return LOWEST if z > 0.0 else HIGHEST
    return np.int32(np.rint(min(max(math.log((1.0 - z) / (1.0 + z)) * ONE, -CLAMP), CLAMP)))


@loop
def _add_slowly(
    cells: Steps, seen: Bits, place: Place, beam: Beam, e0: float, e1: float, regions: int,
    bands: int, factors: Singles, table: Steps, part: int, parts: int, cols: int, says_front: bool,
) -> None:  # fmt: skip
    """The rows of one beam that belong to a part, each cell on its own."""
    row0, row1, col0, col1 = box_of(beam, place, cells.shape[0], cols)
    row0 += (part - (row0 - place.row0)) % parts
    for row in range(row0, row1, parts):
        dy, own = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            dx, c = (col + 0.5) * place.size_m + place.origin_x_m - beam.x, col - place.col0
            found = part_of_beam(beam, dx, dy)
            if found == OUTSIDE:
                continue
            if found == BAND or says_front:
                mark(seen, own // parts, c, c, c, c + 1, True)
            step = _cell_step(beam, dx, dy, found, e0, e1, regions, bands, factors, table)
            cells[own, c] = min(max(np.int32(cells[own, c] + step), LOWEST), HIGHEST)


@loop
def _add_rows(
    cells: Steps, seen: Bits, place: Place, beam: Beam, e0: float, e1: float, regions: int,
    bands: int, factors: Singles, table: Steps, box: tuple[int, int, int, int], rows: int,
    parts: int, says_front: bool, columns: Steps, square: Singles, row_square: Singles,
    factor: Singles, base: Steps, index: Steps, borders: Steps, spans: Steps,
) -> None:  # fmt: skip
    """The rows of one beam that belong to a part."""
    row0, _row1, col0, col1 = box
    shift, size = place.col0, place.size_m
    start, end = (col0 - shift) // LANES * LANES, -((shift - col1) // LANES) * LANES
    _squares(start + shift, end - start, np.int64(1), size, place.origin_x_m - beam.x,
             square[start:end])  # fmt: skip
    _squares(row0, rows, parts, size, place.origin_y_m - beam.y, row_square)
    region_borders(beam, place, row0, parts, rows, regions, borders)
    f0, f1 = np.float32(e0), np.float32(e1)
    for k in range(rows):
        a, f, g, b = (
            spans[0, k] - shift,
            spans[1, k] - shift,
            spans[2, k] - shift,
            spans[3, k] - shift,
        )
        if b <= a:
            continue
        row = row0 - place.row0 + k * parts
        mark(seen, row // parts, a, f, g, b, says_front)
        is_above = (row0 + k * parts + 0.5) * size + place.origin_y_m - beam.y > 0.0
        _write_runs(borders, k, is_above, regions, bands, a, b, shift, factors, factor, base)
        if says_front and g > f:
            _add_front(cells, row, columns, square, row_square[k], factor, f, g, f0, f1)
        for begin, end in ((a, f), (g, b)):
            if end > begin:
                _add_band(cells, row, place, beam, columns, square, row_square[k], base, begin, end,
                          bands, table, index)  # fmt: skip


@free_loop
def add_regions(
    cells: Steps, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    factors: Singles, tables: Steps, part: int, parts: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows part, part + parts, ... of a map.

    ``cells`` (rows, a multiple of ``LANES``) are steps of log-odds, ``observed`` (rows, cols) gets
    the cells of which anything was said. Of each of S sensors, ``sensors`` (S, 4) holds half the
    beam's width, its emptiness and the largest factor, ``factors`` (S, A) that of each angular
    region in front, and ``tables`` (S, A, B) the steps of each angular and band region.
    """
    (rows, cols), stride = observed.shape, cells.shape[1]
    regions, bands = tables.shape[1], tables.shape[2]
    columns, index = np.arange(stride).astype(np.int32), np.empty(stride + LANES, np.int32)
    square, row_square = np.zeros(stride + LANES, np.float32), np.empty(rows, np.float32)
    factor, base = np.empty(stride + LANES, np.float32), np.zeros(stride + LANES, np.int32)
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    widths = widths_of(sensors[:, HALF_WIDTH])
    borders = np.empty((regions, rows), np.int32)
    seen = blank_seen(rows, cols, part, parts)
    xs, ys, headings, ranges, fronts, bands_m, names = readings
    flat = tables.reshape(tables.shape[0], regions * bands)
    for i in range(xs.size):
        name = names[i]
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands_m[i], widths, name)
        own, table = factors[name], flat[name]
        e0 = sensors[name, EMPTY_0]
        e1 = sensors[name, EMPTY_T] / fronts[i] if fronts[i] > 0.0 else 0.0
        says_front = sensors[name, LARGEST] > 0.0 and e0 > 0.0
        is_fast = beam.half <= WIDEST_RAD and sensors[name, LARGEST] <= SMALL_Z
        box, _, count = rows_of_part(beam, place, rows, cols, part, parts)
        if beam.half <= WIDEST_RAD and count > 0:
            spans_of_rows(beam, place, box, parts, spans, doubt)
        point_row, point_col = point_cell(beam, place, rows, cols, ranges[i], bands_m[i], part,
                                          parts, spans, count, spare)  # fmt: skip
        before = cells[point_row, point_col] if point_row >= 0 else _NOTHING
        if not is_fast:
            _add_slowly(cells, seen, place, beam, e0, e1, regions, bands, own, table, part, parts,
                        cols, says_front)  # fmt: skip
        elif count > 0:
            _add_rows(cells, seen, place, beam, e0, e1, regions, bands, own, table, box, count,
                      parts, says_front, columns, square, row_square, factor, base, index, borders,
                      spans)  # fmt: skip
        if point_row >= 0:  # the obstacle's cell is the band, whatever ran through it
            hit = table[regions // 2 * bands + bands // 2]
            cells[point_row, point_col] = min(max(np.int32(before + hit), LOWEST), HIGHEST)
            mark(seen, point_row // parts, point_col, point_col, point_col, point_col + 1, True)
    mark_seen(seen, observed, part, parts)
