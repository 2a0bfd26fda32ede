"""`regions` and `peak` with Bayes' rule: many readings added to integer log-odds in one go.

Both say 2p - 1 = z of a cell, and log-odds are 2 atanh z. In front z = -factor(angular region) *
emptiness(t), a polynomial once z is small; in the band z depends on two regions only, so it comes
from a table of steps. Where the borders of the angular regions cross each row is worked out for
all rows at once; a cell's region is how many of them it lies beyond. What a cell's band region is,
is decided in float32 where that is sure, and in float64 where it is not.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import WITH_LANES, free_loop, inlined_loop, loop
from mapping.kernels.batch.lanes_of_regions import (
    lanes_of_border,
    lanes_of_region_band,
    lanes_of_region_front,
)
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.region_tables import EMPTY_0, EMPTY_T, HALF_WIDTH, LARGEST
from mapping.kernels.batch.seen import Bits, blank_seen, mark, mark_rows, mark_seen
from mapping.kernels.batch.spans import (
    BAND,
    OUTSIDE,
    WIDEST_RAD,
    Beam,
    beam_between,
    is_beyond,
    obstacle_cell,
    part_of_beam,
    rows_of_band,
    span_scratch,
    spans_of_rows,
    widths_of,
)  # fmt: skip
from mapping.kernels.batch.steps import CLAMP, HIGHEST, LANES, LOWEST, ONE

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]
Shorts = NDArray[np.int16]
Front = tuple[Any, Any, Any]
Band = tuple[Any, Any, Any, Any]

SMALL_Z = 0.45  # up to here the polynomial holds; larger ones take a logarithm each
_WIDEST = 32_000  # columns of a beam: their numbers take 16 bits
_LEVEL = 1e-300  # sine of a border of regions that no row meets
# -2 atanh(z) / z in steps for z^2 = 0 .. 0.2025, within 1e-8: coefficients of 1, z^2, z^4, ...
_A0, _A1, _A2, _A3 = (
    np.float32(-ONE) * np.float32(v) for v in (2, 0.666666442, 0.400017389, 0.285212549)
)
_A4, _A5, _A6 = (np.float32(-ONE) * np.float32(v) for v in (0.229028995, 0.135602466, 0.299699575))
_UNIT, _ZERO = np.float32(1.0), np.float32(0.0)
_NOTHING = np.int32(0)


@loop
def _border_turns(halves: Floats, regions: int) -> Floats:
    """Cosine and sine of the borders between angular regions, from the axis: (S, regions, 2)."""
    turns = np.empty((halves.size, regions, 2))
    for s in range(halves.size):
        for k in range(regions):
            angle = halves[s] * (2.0 * k / regions - 1.0)
            turns[s, k, 0], turns[s, k, 1] = math.cos(angle), math.sin(angle)
    return turns


@loop
def region_borders(
    beam: Beam, place: Place, start: int, turns: Floats, rows: int, rows_up: Floats, borders: Shorts
) -> None:
    """``borders[k, r]``: the column where the cells of region k and above begin or end in a row.

    In a row above the sensor they are those left of it: column < border. In the others they are
    those from it on, written so that -1 - column < border tells them. Columns begin at ``start``,
    a column of the whole grid.
    ``rows_up``: how far above the sensor each row lies, in metres, and so less than the next one;
    ``turns`` (regions, 2) are those of the sensor.
    """
    per_cell = 1.0 / place.size_m
    offset = (beam.x - place.origin_x_m) * per_cell - 0.5
    # A border on the other side of the sensor does not cross the row: all of the row's cells lie
    # on that side of it on which the beam goes over to the other half.
    missed_above = _WIDEST if beam.sin_right <= 0.0 else -_WIDEST
    missed_below = _WIDEST if beam.sin_left < 0.0 else -_WIDEST
    below = 0
    while below < rows and rows_up[below] <= 0.0:
        below += 1
    for k in range(1, turns.shape[0]):
        c, s = turns[k, 0], turns[k, 1]
        cos_border, sin_border = c * beam.cos - s * beam.sin, s * beam.cos + c * beam.sin
        if abs(sin_border) <= _LEVEL:  # as level as the rows, to which side ever it rounds
            sin_border = 0.0
        slope = cos_border / (sin_border if sin_border else _LEVEL) * per_cell
        if sin_border < 0.0:
            _fill_border(borders, k, 0, below, rows_up, (-slope, -offset), np.float64(start))
        else:
            borders[k, :below] = missed_below
        if sin_border > 0.0:
            to = np.float64(1 - start)
            _fill_border(borders, k, below, rows, rows_up, (slope, offset), to)
        else:
            borders[k, below:rows] = missed_above


@loop
def fill_border_plainly(
    borders: Shorts, k: int, first: int, after: int, rows_up: Floats, line: Any, to: Any
) -> None:
    """One border in the rows first to after - 1: ``line`` is its slope and offset, in cells."""
    slope, offset = line
    most = np.float64(_WIDEST)
    for r in range(first, after):
        at = np.floor(rows_up[r] * slope + offset) + to
        borders[k, r] = np.int32(min(max(at, -most), most))


@loop
def fill_border_in_lanes(
    borders: Shorts, k: int, first: int, after: int, rows_up: Floats, line: Any, to: Any
) -> None:
    """The same, several rows at a time; what it writes past the last row has room there."""
    most = np.float64(_WIDEST)
    lanes_of_border(borders, np.int64(k), np.int64(first), np.int64(after), rows_up, line, to, most)


_fill_border = fill_border_in_lanes if WITH_LANES else fill_border_plainly


@inlined_loop
def _region_of(borders: Shorts, r: int, flip: Any, column: int) -> Any:
    """The angular region of a column: how many borders it lies beyond."""
    own = 0
    for k in range(1, borders.shape[0]):
        own += int((column ^ flip) < borders[k, r])
    return own


@inlined_loop
def _loss(z: Any) -> Any:
    """The steps that z = -factor * emptiness stands for."""
    s = z * z
    t = s * s
    p = (s * _A5 + _A4) + t * _A6
    p = (s * _A1 + _A0) + (s * _A3 + _A2) * t + p * (t * t)
    return np.int32(np.rint(z * p))


@loop
def _with_room(factors: Singles) -> Singles:
    """The same with zeros for at least a whole group of regions."""
    wide = np.zeros((factors.shape[0], max(factors.shape[1], LANES)), np.float32)
    wide[:, : factors.shape[1]] = factors
    return wide


@loop
def _full_losses(factors: Singles) -> Steps:
    """Those of each angular region where emptiness is 1, (S, A)."""
    losses = np.empty(factors.shape, np.int32)
    for s in range(factors.shape[0]):
        for k in range(factors.shape[1]):
            losses[s, k] = _loss(factors[s, k])
    return losses


@inlined_loop
def _front_of(e0: float, e1: float) -> Front:
    """Emptiness e0 + e1 rho, and squared distances up to which it is 1 for sure."""
    full_m = (e0 - 1.0) / -e1 if e1 < 0.0 else np.inf
    return np.float32(e0), np.float32(e1), np.float32(full_m * full_m * (1.0 - 1e-5))


@inlined_loop
def add_front_plainly(
    cells: Steps, row: int, square: Singles, dy_squared: Any, borders: Shorts, r: int,
    flip: Any, start: Any, factors: Singles, full: Steps, f: int, g: int, front: Front,
) -> None:  # fmt: skip
    """What the cells f to g - 1 of a row lose; ``full`` is that where emptiness is 1."""
    e0, e1, _ = front
    for c in range(f, g):
        e = e0 + e1 * np.sqrt(square[c] + dy_squared)
        e = e if e < _UNIT else _UNIT
        own = factors[_region_of(borders, r, flip, c - start)]
        total = np.int32(cells[row, c] + _loss(own * (e if e > _ZERO else _ZERO)))
        total = total if total < HIGHEST else HIGHEST
        cells[row, c] = total if total > LOWEST else LOWEST


@inlined_loop
def add_front_in_lanes(
    cells: Steps, row: int, square: Singles, dy_squared: Any, borders: Shorts, r: int,
    flip: Any, start: Any, factors: Singles, full: Steps, f: int, g: int, front: Front,
) -> None:  # fmt: skip
    """The same, several cells at a time."""
    lanes_of_region_front(
        cells, row, square, dy_squared, borders, r, flip, start, factors, full, np.int32(f),
        np.int32(g), front, (_A0, _A1, _A2, _A3, _A4, _A5, _A6), LOWEST,
    )  # fmt: skip


@inlined_loop
def _band_of(beam: Beam, place: Place, bands: int) -> Band:
    """Scale and offset of a distance to the number of its band region, what of it is not sure, and
    in float64 what tells it then: the number of bands, where they begin and how deep they are, and
    of the columns the first one, size, origin and the sensor's place."""
    begin, depth = beam.front_limit, beam.limit - beam.front_limit
    scale, offset = np.float32(bands / depth), np.float32(-begin * bands / depth)
    exact = (
        np.float64(bands), begin, depth, np.float64(place.col0), place.size_m, place.origin_x_m,
        beam.x,
    )  # fmt: skip
    return scale, offset, np.float32(1e-6 * bands * beam.limit / depth), exact


@inlined_loop
def add_band_plainly(
    cells: Steps, row: int, square: Singles, dy_squared: Any, borders: Shorts, r: int, flip: Any,
    start: Any, table: Steps, a: int, b: int, band: Band, dy: float,
) -> None:  # fmt: skip
    """What the cells a to b - 1 of a row gain; ``dy`` is in float64 how far up the row lies."""
    scale, offset, unsure, exact = band
    bands, begin, depth, first, size, origin, x = exact
    for c in range(a, b):
        at = np.sqrt(square[c] + dy_squared) * scale + offset
        number = np.float64(np.floor(at))
        if abs(at - np.rint(at)) < unsure:
            dx = (c + first + 0.5) * size + origin - x
            number = np.floor((math.sqrt(dx * dx + dy * dy) - begin) / depth * bands)
        own = _region_of(borders, r, flip, c - start)
        gain = table[np.int64(own * bands + min(max(number, 0.0), bands - 1.0))]
        total = np.int32(cells[row, c] + gain)
        total = total if total < HIGHEST else HIGHEST
        cells[row, c] = total if total > LOWEST else LOWEST


@inlined_loop
def add_band_in_lanes(
    cells: Steps, row: int, square: Singles, dy_squared: Any, borders: Shorts, r: int, flip: Any,
    start: Any, table: Steps, a: int, b: int, band: Band, dy: float,
) -> None:  # fmt: skip
    """The same, several cells at a time."""
    lanes_of_region_band(cells, row, square, dy_squared, borders, r, flip, start, table,
                         np.int32(a), np.int32(b), band, dy, LOWEST)  # fmt: skip


_add_front = add_front_in_lanes if WITH_LANES else add_front_plainly
_add_band = add_band_in_lanes if WITH_LANES else add_band_plainly


@loop
def _squares(first: int, count: int, size: float, to: float, square: Singles) -> None:
    """((index + 0.5) size + to)^2 of the columns first, first + 1, ..."""
    for k in range(count):
        d = np.float32((np.float64(first + k) + 0.5) * size + to)
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
    bands: int, factors: Singles, table: Steps, box: tuple[int, int, int, int], with_free: bool,
) -> None:  # fmt: skip
    """Some rows of one beam, each cell on its own."""
    row0, row1, col0, col1 = box
    for row in range(row0, row1):
        dy, own = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            dx, c = (col + 0.5) * place.size_m + place.origin_x_m - beam.x, col - place.col0
            found = part_of_beam(beam, dx, dy)
            if found == OUTSIDE:
                continue
            if found == BAND or with_free:
                mark(seen, own, c, c, c, c + 1, True)
            step = _cell_step(beam, dx, dy, found, e0, e1, regions, bands, factors, table)
            cells[own, c] = min(max(np.int32(cells[own, c] + step), LOWEST), HIGHEST)


@loop
def _add_rows(
    cells: Steps, seen: Bits, place: Place, beam: Beam, e0: float, e1: float, bands: int,
    factors: Singles, full: Steps, table: Steps, box: tuple[int, int, int, int],
    rows: int, with_free: bool, square: Singles, rows_up: Floats, borders: Shorts,
    turns: Floats, spans: Steps,
) -> None:  # fmt: skip
    """Some rows of one beam."""
    row0, _row1, col0, col1 = box
    shift, size = place.col0, place.size_m
    start, end = (col0 - shift) // LANES * LANES, -((shift - col1) // LANES) * LANES
    _squares(start + shift, end - start, size, place.origin_x_m - beam.x, square[start:end])
    for k in range(rows):
        rows_up[k] = (np.float64(row0 + k) + 0.5) * size + (place.origin_y_m - beam.y)
    region_borders(beam, place, start + shift, turns, rows, rows_up, borders)
    front = _front_of(e0, e1)
    first = row0 - place.row0
    band = _band_of(beam, place, bands)
    mark_rows(seen, first, rows, shift, spans, with_free)
    for k in range(rows):
        a, f = spans[0, k] - shift, spans[1, k] - shift
        g, b = spans[2, k] - shift, spans[3, k] - shift
        if b <= a:
            continue
        row, up = first + k, np.float32(rows_up[k])
        flip, row_square = np.int16(0 if rows_up[k] > 0.0 else -1), up * up
        if with_free and g > f:
            _add_front(cells, row, square, row_square, borders, k, flip, np.int32(start), factors,
                       full, f, g, front)  # fmt: skip
        dy = (row0 + k + 0.5) * size + place.origin_y_m - beam.y
        for begin, end in ((a, f), (g, b)):
            if end > begin:
                _add_band(cells, row, square, row_square, borders, k, flip, np.int32(start), table,
                          begin, end, band, dy)  # fmt: skip


@free_loop
def add_regions(
    cells: Steps, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    factors: Singles, tables: Steps, begin: int, end: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows begin to end - 1 of a map.

    ``cells`` (rows, a multiple of ``LANES``) are steps of log-odds, ``observed`` (rows, cols) gets
    the cells of which anything was said. Of each of S sensors, ``sensors`` (S, 4) holds half the
    beam's width, its emptiness and the largest factor, ``factors`` (S, A) that of each angular
    region in front, and ``tables`` (S, A, B) the steps of each angular and band region.
    """
    (rows, cols), stride = observed.shape, cells.shape[1]
    regions, bands = tables.shape[1], tables.shape[2]
    factors, square = _with_room(factors), np.zeros(stride, np.float32)
    full = _full_losses(factors)
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    widths = widths_of(sensors[:, HALF_WIDTH])
    rows_up, borders = np.empty(doubt.size), np.empty((regions, doubt.size), np.int16)
    turns = _border_turns(sensors[:, HALF_WIDTH], regions)
    seen = blank_seen(rows, cols, 0, 1)
    xs, ys, headings, ranges, fronts, bands_m, names = readings
    flat = tables.reshape(tables.shape[0], regions * bands)
    for i in range(xs.size):
        if is_beyond(ys[i], max(fronts[i], bands_m[i]), place, begin, end):
            continue
        name = names[i]
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands_m[i], widths, name)
        own, table = factors[name], flat[name]
        e0 = sensors[name, EMPTY_0]
        e1 = sensors[name, EMPTY_T] / fronts[i] if fronts[i] > 0.0 else 0.0
        with_free = sensors[name, LARGEST] > 0.0 and e0 > 0.0
        is_fast = beam.half <= WIDEST_RAD and sensors[name, LARGEST] <= SMALL_Z
        box, _, count = rows_of_band(beam, place, rows, cols, begin, end)
        is_fast = is_fast and box[3] - box[2] + LANES < _WIDEST
        if beam.half <= WIDEST_RAD and count > 0:
            spans_of_rows(beam, place, box, 1, spans, doubt)
        point_row, point_col = obstacle_cell(beam, place, rows, cols, ranges[i], bands_m[i], begin,
                                             end, spans, count, spare)  # fmt: skip
        before = cells[point_row, point_col] if point_row >= 0 else _NOTHING
        if not is_fast:
            _add_slowly(cells, seen, place, beam, e0, e1, regions, bands, own, table, box,
                        with_free)  # fmt: skip
        elif count > 0:
            _add_rows(cells, seen, place, beam, e0, e1, bands, own, full[name], table, box, count,
                      with_free, square, rows_up, borders, turns[name], spans)  # fmt: skip
        if point_row >= 0:  # the obstacle's cell is the band, whatever ran through it
            hit = table[regions // 2 * bands + bands // 2]
            cells[point_row, point_col] = min(max(np.int32(before + hit), LOWEST), HIGHEST)
            mark(seen, point_row, point_col, point_col, point_col, point_col + 1, True)
    mark_seen(seen[begin:end], observed[begin:end], 0, 1)
