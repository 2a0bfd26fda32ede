"""Rules that keep several sums a cell: `saturating` with the model `fading`, and `pooled`.

Every reading adds whole steps of 2^-24, whole numbers, or a range that is the least so far, to
float64, where such sums are exact: in any order they come to the same. What the arrays hold is
said by the rules (``update_rules/saturating.py`` and ``pooled.py``).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.cell_tables import POOLED, SATURATING
from mapping.kernels.batch.fading import NEAR_M
from mapping.kernels.batch.lanes import free_loop, loop
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.seen import Bits, mark, mark_rows, mark_seen
from mapping.kernels.batch.spans import (
    FRONT,
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
from mapping.kernels.batch.steps import LANES
from mapping.kernels.batch.sum_rows import (
    ADDED,
    AGAINST,
    ARC_END,
    BEFORE,
    BEFORE_ARC,
    END,
    FADE,
    FOR,
    FROM,
    HALF_WIDTH,
    HIT,
    HITS,
    LAST,
    MIDDLE,
    MISS,
    MISSES,
    MISSES_MIDDLE,
    MISSES_NEAR,
    MOST,
    NEAR,
    NEARER,
    NEAREST_HIT,
    NEAREST_MISS,
    ON_ARC,
    ONE,
    RANGE,
    ROUNDING_M,
    THIN,
    THIN_M,
    WITH_FREE,
    Columns,
    Floats,
    Rows,
    Scratch,
    add_rows,
    add_rows_plainly,
    empty_all,
    empty_tiles,
    in_steps,
    measure,
    scratch_of,
    square_from,
    squares_of,
)

Flags = NDArray[np.bool_]

_WORTH = 1024  # cells of the map for each reading: for fewer readings tiles are not worth it
_BLOCK_CELLS = 60_000  # whose tiles, 20 bytes each, stay in the second cache
_LEAST_ROWS = 64  # a block of fewer would cut most beams in pieces


@loop
def _saturating_cell(
    cells: Floats, row: int, col: int, is_front: bool, dx: float, dy: float, sensor: Floats,
    reading: Floats,
) -> None:  # fmt: skip
    """What one cell gets."""
    if not is_front:
        cells[FOR, row, col] += reading[ADDED]
        return
    near, per_fade = sensor[MISS] * sensor[NEAR], 1.0 / sensor[FADE]
    near *= math.exp(-((dy / NEAR_M) ** 2))
    bell, right, up = math.exp(-((dx / NEAR_M) ** 2)), dx * per_fade, dy * per_fade
    evidence = (sensor[MISS] + near * bell) / (1.0 + (right * right + up * up))
    cells[AGAINST, row, col] += in_steps(min(evidence, MOST))


@loop
def _pooled_cell(
    cells: Floats, row: int, col: int, is_front: bool, dx: float, dy: float, sensor: Floats,
    reading: Floats, limits: Floats,
) -> None:  # fmt: skip
    """What one cell gets."""
    rho = math.sqrt(dx * dx + dy * dy)
    if not is_front:
        cells[HITS, row, col] += reading[ADDED]
        cells[ON_ARC, row, col] += 1.0 if rho <= reading[ARC_END] else 0.0
        cells[NEAREST_HIT, row, col] = min(cells[NEAREST_HIT, row, col], reading[RANGE])
        return
    per_fade = 1.0 / sensor[FADE]
    right, up = dx * per_fade, dy * per_fade
    cells[MISSES, row, col] += np.rint(ONE / (1.0 + (right * right + up * up))) / ONE
    cells[BEFORE_ARC, row, col] += 1.0 if rho > reading[LAST] else 0.0
    cells[MISSES_NEAR, row, col] += 1.0 if rho < limits[NEARER] else 0.0
    is_middle = limits[NEARER] <= rho < limits[MIDDLE]
    cells[MISSES_MIDDLE, row, col] += 1.0 if is_middle else 0.0
    cells[NEAREST_MISS, row, col] = min(cells[NEAREST_MISS, row, col], rho)


@loop
def _cell(
    cells: Floats, what: int, row: int, col: int, is_front: bool, dx: float, dy: float,
    sensor: Floats, reading: Floats, limits: Floats,
) -> None:  # fmt: skip
    if is_front and sensor[WITH_FREE] == 0.0:
        return  # the model has no evidence for what lies in front
    if what == SATURATING:
        _saturating_cell(cells, row, col, is_front, dx, dy, sensor, reading)
    else:
        _pooled_cell(cells, row, col, is_front, dx, dy, sensor, reading, limits)


@loop
def _add_wide(
    cells: Floats, what: int, seen: Bits, place: Place, beam: Beam, sensor: Floats,
    reading: Floats, limits: Floats, box: tuple[int, int, int, int], low: int,
) -> None:  # fmt: skip
    """A beam of 180 degrees and more, each cell looked at on its own."""
    row0, row1, col0, col1 = box
    for row in range(row0, row1):
        dy, own = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            c, dx = col - place.col0, (col + 0.5) * place.size_m + place.origin_x_m - beam.x
            found = part_of_beam(beam, dx, dy)
            if found == OUTSIDE:
                continue
            g = c + 1 if found == FRONT else c
            mark(seen, own - low, c, c, g, c + 1, sensor[WITH_FREE] != 0.0)
            _cell(cells, what, own, c, found == FRONT, dx, dy, sensor, reading, limits)


@loop
def _add_wedge(
    cells: Floats, tiles: Columns, what: int, place: Place, beam: Beam, sensor: Floats,
    reading: Floats, box: tuple[int, int, int, int], rows: Rows, spans: Columns, of: Scratch,
    squares: Floats,
) -> int:  # fmt: skip
    """Some rows of one beam, ``spans`` being theirs; not 0 where tiles have to be emptied."""
    size, shift, fade_m = place.size_m, place.col0, sensor[FADE]
    near = sensor[MISS] * sensor[NEAR] if what == SATURATING else 0.0
    first, count = box[2] - shift, box[3] - box[2]
    measure(of.across[first:], of.faded_across[first:], of.bell[first:], count, box[2], size,
            place.origin_x_m, beam.x, fade_m, 1.0 if near > 0.0 else 0.0)  # fmt: skip
    measure(of.down, of.faded_down, of.row_bell, rows[1], box[0], size, place.origin_y_m, beam.y,
            fade_m, near)  # fmt: skip
    if what == POOLED:
        squares[FROM] = square_from(np.nextafter(reading[LAST], math.inf))
        squares[END] = square_from(np.nextafter(reading[ARC_END], math.inf))
    if tiles.size == 0:
        return int(add_rows_plainly(cells, tiles, what, rows, spans, shift, of, sensor, reading,
                                squares))  # fmt: skip
    return int(add_rows(cells, tiles, what, rows, spans, shift, of, sensor, reading, squares))


@loop
def _cell_of(
    cells: Floats, tiles: Columns, own: int, row: int, col: int, kept: Floats, small: Columns,
    back: bool,
) -> None:  # fmt: skip
    """Keep what is known of a cell in ``kept`` and ``small``, or bring it back."""
    if back:
        cells[:, row, col] = kept
    else:
        kept[:] = cells[:, row, col]
    if tiles.size == 0:
        return
    at = col // LANES * small.size * LANES + col % LANES
    for line in range(small.size):
        if back:
            tiles[own, at + line * LANES] = small[line]
        else:
            small[line] = tiles[own, at + line * LANES]


@loop
def _describe(
    reading: Floats, what: int, sensor: Floats, range_m: float, band_end_m: float, cell_m: float,
    limits: Floats,
) -> None:  # fmt: skip
    """Fill what a reading adds."""
    faded = range_m / sensor[FADE]
    share = 1.0 / (1.0 + faded * faded)
    if what == SATURATING:
        reading[ADDED] = in_steps(min(sensor[HIT] / (1.0 + faded * faded), MOST))
    else:
        reading[ADDED] = in_steps(share)
    behind = max(limits[THIN_M], 0.7072 * cell_m)
    reading[ARC_END] = range_m * (1.0 + limits[THIN]) + behind + ROUNDING_M
    reading[LAST] = range_m - limits[BEFORE] if band_end_m >= 0.0 else math.inf
    reading[RANGE] = range_m


@loop
def _rows_met(
    readings: Readings, place: Place, widths: Floats, rows: int, cols: int, begin: int, end: int
) -> tuple[int, int]:
    """The first row of a band of rows, and the row after the last, that any reading may change."""
    low, high = end, begin
    for i in range(readings.x_m.size):
        reach = max(readings.front_end_m[i], readings.band_end_m[i])
        if is_beyond(readings.y_m[i], reach, place, begin, end):
            continue
        beam = beam_between(
            readings.x_m[i], readings.y_m[i], readings.heading_rad[i], readings.front_end_m[i],
            readings.band_end_m[i], widths, readings.sensor[i],
        )  # fmt: skip
        _box, first, count = rows_of_band(beam, place, rows, cols, begin, end)
        low, high = min(low, first - 1), max(high, first + count + 1)  # an obstacle's cell beside
    low = max(low, begin)
    return low, max(min(high, end), low)


@loop
def _add_block(
    cells: Floats, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    limits: Floats, what: int, is_tiled: bool, begin: int, end: int,
) -> None:  # fmt: skip
    """Add readings to the rows begin to end - 1 of a map, of which tiles stay in the cache."""
    (rows, cols), lines = observed.shape, 2 if what == SATURATING else 5
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    widths = widths_of(sensors[:, HALF_WIDTH])
    seen = np.zeros((end - begin, cols // 64 + 1), np.uint64)  # from row ``begin`` on, as the tiles
    of, squares, reading = scratch_of(rows, cols), squares_of(limits), np.empty(4)
    kept, small = np.empty(cells.shape[0]), np.zeros(lines, np.int32)
    xs, ys, headings, ranges, fronts, bands, names = readings
    tiles = np.zeros((end - begin if is_tiled else 0, cells.shape[2] * lines), np.int32)
    for i in range(xs.size):
        if is_beyond(ys[i], max(fronts[i], bands[i]), place, begin, end):
            continue
        sensor, full = sensors[names[i]], 0
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, names[i])
        box, first, count = rows_of_band(beam, place, rows, cols, begin, end)
        _describe(reading, what, sensor, ranges[i], bands[i], place.size_m, limits)
        if count > 0 and beam.half <= WIDEST_RAD:
            spans_of_rows(beam, place, box, 1, spans, doubt)
        row, col = obstacle_cell(beam, place, rows, cols, ranges[i], bands[i], begin, end, spans,
                                 count, spare)  # fmt: skip
        rows_of = first, count, first - begin
        if row >= 0:
            _cell_of(cells, tiles, row - begin, row, col, kept, small, False)
        if count > 0 and beam.half > WIDEST_RAD:
            _add_wide(cells, what, seen, place, beam, sensor, reading, limits, box, begin)
        elif count > 0:
            mark_rows(seen, first - begin, count, place.col0, spans, sensor[WITH_FREE] != 0.0)
            full = _add_wedge(cells, tiles, what, place, beam, sensor, reading, box, rows_of, spans,
                              of, squares)  # fmt: skip
        if row >= 0:  # the obstacle's cell is the band, whatever ran through it
            _cell_of(cells, tiles, row - begin, row, col, kept, small, True)
            dx = (col + place.col0 + 0.5) * place.size_m + place.origin_x_m - beam.x
            dy = (row + place.row0 + 0.5) * place.size_m + place.origin_y_m - beam.y
            _cell(cells, what, row, col, False, dx, dy, sensor, reading, limits)
            mark(seen, row - begin, col, col, col, col + 1, True)
        if full != 0:
            empty_tiles(cells, tiles, what, rows_of, box[2] - place.col0, box[3] - place.col0)
    if is_tiled:
        empty_all(cells, tiles, what, seen, begin)
    mark_seen(seen, observed[begin:end], 0, 1)


@free_loop
def add_sums(
    cells: Floats, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    limits: Floats, what: int, begin: int, end: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows begin to end - 1 of a map.

    ``cells`` (2 or 8, rows, a multiple of ``LANES``) are the arrays of the rule ``what``,
    SATURATING or POOLED, in its order; ``observed`` (rows, cols) gets the cells of which anything
    was said. ``sensors`` (S, 6) and ``limits`` (6,) hold what is named above.
    """
    rows, cols = observed.shape
    widths = widths_of(sensors[:, HALF_WIDTH])
    low, high = _rows_met(readings, place, widths, rows, cols, begin, end)
    is_tiled = readings.x_m.size * _WORTH >= (high - low) * cols
    at_once = max(_BLOCK_CELLS // cells.shape[2], _LEAST_ROWS)
    blocks = (high - low + at_once - 1) // at_once if is_tiled else 1
    for n in range(blocks):
        first, after = low + (high - low) * n // blocks, low + (high - low) * (n + 1) // blocks
        _add_block(cells, observed, place, readings, sensors, limits, what, is_tiled, first, after)
