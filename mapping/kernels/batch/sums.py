"""Rules that keep several sums a cell: `saturating` with the model `fading`, and `pooled`.

Every reading adds whole steps of 2^-24, whole numbers, or a range that is the least so far, to
float64, where such sums are exact: in any order they come to the same. What the arrays hold is
said by the rules (``update_rules/saturating.py`` and ``pooled.py``).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.cell_tables import POOLED, SATURATING
from mapping.kernels.batch.fading import NEAR_M
from mapping.kernels.batch.lanes import ROOM, WITH_LANES, free_loop, loop
from mapping.kernels.batch.lanes_of_sums import lanes_of_pooled, lanes_of_saturating
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.seen import Bits, blank_seen, mark, mark_rows, mark_seen
from mapping.kernels.batch.spans import (
    FRONT,
    OUTSIDE,
    WIDEST_RAD,
    Beam,
    beam_between,
    part_of_beam,
    point_cell,
    rows_of_part,
    span_scratch,
    spans_of_rows,
    widths_of,
)  # fmt: skip
from mapping.kernels.batch.steps import LANES

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Columns = NDArray[np.int32]
Rows = tuple[int, int, int]  # the first of a reading in the map, the step to the next, how many

# Columns of the table of sensors; HIT, MISS and NEAR are those of `fading`, for `saturating`.
HALF_WIDTH, FADE, WITH_FREE, HIT, MISS, NEAR = range(6)
# Of a reading: what it adds to a cell of its band, where its arc ends, where the last stretch
# before the arc begins (past all cells where nothing came back), its range.
ADDED, ARC_END, LAST, RANGE = range(4)
# Limits of `pooled`: of near misses, of those in the middle, of what is just before an arc, and
# how far the cells of the arc itself reach behind the range, relative and in metres; and how far
# off the nearest miss counts. As squares also: the first two, that, and of a reading from where
# its last stretch is and where its arc ends.
NEARER, MIDDLE, BEFORE, THIN, THIN_M, FARTHEST_MISS = range(6)
FARTHEST, FROM, END = range(2, 5)
# The arrays of `pooled`; those of `saturating` are the evidence for and against.
HITS, MISSES, ON_ARC, BEFORE_ARC, MISSES_NEAR, MISSES_MIDDLE, NEAREST_MISS, NEAREST_HIT = range(8)
FOR, AGAINST = range(2)
ONE = 2.0**24  # steps in evidence of 1
_WORTH = 1024  # cells of the map for each reading: for fewer readings tiles are not worth it
_CLAMP = 13.8  # of one reading's evidence
_ROUNDING_M = 1e-9


@loop
def _in_steps(evidence: float) -> float:
    return float(np.rint(evidence * ONE) / ONE)


class Scratch(NamedTuple):
    """Of each column, and of each row: the distance squared, the same over the fading distance
    squared, and the bell of `fading`."""

    across: Floats
    faded_across: Floats
    bell: Floats
    down: Floats
    faded_down: Floats
    row_bell: Floats


@loop
def _scratch(rows: int, cols: int) -> Scratch:
    return Scratch(
        np.zeros(cols + ROOM), np.zeros(cols + ROOM), np.zeros(cols + ROOM),
        np.zeros(rows + ROOM), np.zeros(rows + ROOM), np.zeros(rows + ROOM),
    )  # fmt: skip


@loop
def _measure(
    squares: Floats, faded: Floats, bell: Floats, count: int, first: int, step: int, size: float,
    origin: float, sensor_m: float, fade_m: float, near: float,
) -> None:  # fmt: skip
    """Of rows or columns first, first + step, ..., at (index + 0.5) size + origin."""
    per_fade = 1.0 / fade_m
    for k in range(count):
        d = (first + k * step + 0.5) * size + origin - sensor_m
        squares[k], faded[k] = d * d, (d * per_fade) * (d * per_fade)
    if near > 0.0:
        for k in range(count):
            d = (first + k * step + 0.5) * size + origin - sensor_m
            bell[k] = near * math.exp(-((d / NEAR_M) ** 2))


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
    cells[AGAINST, row, col] += _in_steps(min(evidence, _CLAMP))


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
def add_saturating_plainly(
    cells: Floats, rows: Rows, spans: Columns, shift: int, of: Scratch, sensor: Floats,
    reading: Floats,
) -> None:  # fmt: skip
    """All rows of a reading, whose columns lie in ``of``."""
    with_free, miss = sensor[WITH_FREE] != 0.0, sensor[MISS]
    for k in range(rows[2]):
        row = rows[0] + k * rows[1]
        f, g = spans[1, k] - shift, spans[2, k] - shift
        for c in range(spans[0, k] - shift, spans[3, k] - shift):
            if not f <= c < g:
                cells[FOR, row, c] += reading[ADDED]
            elif with_free:
                evidence = miss + of.row_bell[k] * of.bell[c]
                evidence /= 1.0 + (of.faded_across[c] + of.faded_down[k])
                cells[AGAINST, row, c] += _in_steps(min(evidence, _CLAMP))


@loop
def _square_from(value: float) -> float:
    """The least number whose square root is not below a value."""
    if value <= 0.0 or value == math.inf:
        return max(value, 0.0)
    square = value * value
    while math.sqrt(square) >= value:
        square = np.nextafter(square, 0.0)
    while math.sqrt(square) < value:
        square = np.nextafter(square, math.inf)
    return square


@loop
def add_pooled_plainly(
    cells: Floats, rows: Rows, spans: Columns, shift: int, of: Scratch, sensor: Floats,
    reading: Floats, squares: Floats,
) -> None:  # fmt: skip
    """The same for `pooled`; ``squares`` are limits of squared distances."""
    with_free = sensor[WITH_FREE] != 0.0
    for k in range(rows[2]):
        row = rows[0] + k * rows[1]
        f, g = spans[1, k] - shift, spans[2, k] - shift
        for c in range(spans[0, k] - shift, spans[3, k] - shift):
            square = of.across[c] + of.down[k]
            if not f <= c < g:
                cells[HITS, row, c] += reading[ADDED]
                cells[ON_ARC, row, c] += 1.0 if square < squares[END] else 0.0
                cells[NEAREST_HIT, row, c] = min(cells[NEAREST_HIT, row, c], reading[RANGE])
            elif with_free:
                depth = 1.0 + (of.faded_across[c] + of.faded_down[k])
                cells[MISSES, row, c] += np.rint(ONE / depth) / ONE
                cells[BEFORE_ARC, row, c] += 1.0 if square >= squares[FROM] else 0.0
                cells[MISSES_NEAR, row, c] += 1.0 if square < squares[NEARER] else 0.0
                is_middle = squares[NEARER] <= square < squares[MIDDLE]
                cells[MISSES_MIDDLE, row, c] += 1.0 if is_middle else 0.0
                cells[NEAREST_MISS, row, c] = min(cells[NEAREST_MISS, row, c], math.sqrt(square))


@loop
def add_rows_plainly(
    cells: Floats, tiles: Columns, what: int, rows: Rows, spans: Columns, shift: int, of: Scratch,
    sensor: Floats, reading: Floats, squares: Floats,
) -> int:  # fmt: skip
    """All rows of a reading; ``tiles`` stay empty."""
    if what == SATURATING:
        add_saturating_plainly(cells, rows, spans, shift, of, sensor, reading)
    else:
        add_pooled_plainly(cells, rows, spans, shift, of, sensor, reading, squares)
    return 0


@loop
def add_rows_in_lanes(
    cells: Floats, tiles: Columns, what: int, rows: Rows, spans: Columns, shift: int, of: Scratch,
    sensor: Floats, reading: Floats, squares: Floats,
) -> int:  # fmt: skip
    """The same, several cells at a time, into ``tiles``; not 0 where they have to be emptied."""
    lines = (rows[0], rows[1], rows[2], rows[0] // rows[1])
    added, to = np.int32(np.rint(reading[ADDED] * ONE)), np.int32(shift)
    if what == SATURATING:
        return int(lanes_of_saturating(
            cells, tiles, lines, spans, to, of.faded_across, of.faded_down, of.bell, of.row_bell,
            added, (sensor[WITH_FREE], sensor[MISS], _CLAMP),
        ))  # fmt: skip
    numbers = (sensor[WITH_FREE], reading[RANGE], squares[NEARER], squares[MIDDLE],
               squares[FARTHEST], squares[FROM], squares[END])  # fmt: skip
    return int(lanes_of_pooled(cells, tiles, lines, spans, to, of.across, of.down, of.faded_across,
                               of.faded_down, added, numbers))  # fmt: skip


_add_rows: Any = add_rows_in_lanes if WITH_LANES else add_rows_plainly


@loop
def _empty_tiles(
    cells: Floats, tiles: Columns, what: int, first: int, step: int, count: int, col0: int,
    col1: int,
) -> None:  # fmt: skip
    """Move what the tiles of some rows and of the columns col0 to col1 - 1 hold into the map."""
    lines = 2 if what == SATURATING else 5
    for k in range(count):
        row, own = first + k * step, first // step + k
        for group in range(col0 // LANES, (col1 + LANES - 1) // LANES):
            tile = tiles[own, group * lines * LANES : (group + 1) * lines * LANES]
            for c in range(LANES):
                col = group * LANES + c
                cells[0, row, col] += tile[c] / ONE
                cells[1, row, col] += tile[LANES + c] / ONE
                tile[c] = tile[LANES + c] = 0
            if what == SATURATING:
                continue
            for c in range(LANES):
                counts, col = tile[2 * LANES + c], group * LANES + c
                cells[MISSES_NEAR, row, col] += counts & 255
                cells[MISSES_MIDDLE, row, col] += counts >> 8 & 255
                cells[BEFORE_ARC, row, col] += counts >> 16 & 255
                cells[ON_ARC, row, col] += counts >> 24 & 255
                tile[2 * LANES + c] = 0


@loop
def _empty_all(cells: Floats, tiles: Columns, what: int, seen: Bits, part: int, parts: int) -> None:
    """Move all that the tiles hold into the map."""
    for k in range(seen.shape[0]):
        for word in range(seen.shape[1]):
            if seen[k, word] != 0:
                last = min((word + 1) * 64, cells.shape[2])
                _empty_tiles(cells, tiles, what, part + k * parts, parts, 1, word * 64, last)


@loop
def _squares_of(limits: Floats) -> Floats:
    """Limits of distances as those of their squares; room for what each reading has of its own."""
    squares = np.zeros(5)
    squares[NEARER], squares[MIDDLE] = _square_from(limits[NEARER]), _square_from(limits[MIDDLE])
    squares[FARTHEST] = _square_from(limits[FARTHEST_MISS])
    return squares


@loop
def _add_wide(
    cells: Floats, what: int, seen: Bits, place: Place, beam: Beam, sensor: Floats,
    reading: Floats, limits: Floats, box: tuple[int, int, int, int], parts: int,
) -> None:  # fmt: skip
    """A beam of 180 degrees and more, each cell looked at on its own."""
    row0, row1, col0, col1 = box
    for row in range(row0, row1, parts):
        dy, own = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            c, dx = col - place.col0, (col + 0.5) * place.size_m + place.origin_x_m - beam.x
            found = part_of_beam(beam, dx, dy)
            if found == OUTSIDE:
                continue
            g = c + 1 if found == FRONT else c
            mark(seen, own // parts, c, c, g, c + 1, sensor[WITH_FREE] != 0.0)
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
    _measure(of.across[first:], of.faded_across[first:], of.bell[first:], count, box[2], 1, size,
             place.origin_x_m, beam.x, fade_m, 1.0 if near > 0.0 else 0.0)  # fmt: skip
    _measure(of.down, of.faded_down, of.row_bell, rows[2], rows[0] + place.row0, rows[1], size,
             place.origin_y_m, beam.y, fade_m, near)  # fmt: skip
    if what == POOLED:
        squares[FROM] = _square_from(np.nextafter(reading[LAST], math.inf))
        squares[END] = _square_from(np.nextafter(reading[ARC_END], math.inf))
    if tiles.size == 0:
        return int(add_rows_plainly(cells, tiles, what, rows, spans, shift, of, sensor, reading,
                                squares))  # fmt: skip
    return int(_add_rows(cells, tiles, what, rows, spans, shift, of, sensor, reading, squares))


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
        reading[ADDED] = _in_steps(min(sensor[HIT] / (1.0 + faded * faded), _CLAMP))
    else:
        reading[ADDED] = _in_steps(share)
    behind = max(limits[THIN_M], 0.7072 * cell_m)
    reading[ARC_END] = range_m * (1.0 + limits[THIN]) + behind + _ROUNDING_M
    reading[LAST] = range_m - limits[BEFORE] if band_end_m >= 0.0 else math.inf
    reading[RANGE] = range_m


@free_loop
def add_sums(
    cells: Floats, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    limits: Floats, what: int, part: int, parts: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows part, part + parts, ... of a map.

    ``cells`` (2 or 8, rows, a multiple of ``LANES``) are the arrays of the rule ``what``,
    SATURATING or POOLED, in its order; ``observed`` (rows, cols) gets the cells of which anything
    was said. ``sensors`` (S, 6) and ``limits`` (6,) hold what is named above.
    """
    (rows, cols), lines = observed.shape, 2 if what == SATURATING else 5
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    seen, widths = blank_seen(rows, cols, part, parts), widths_of(sensors[:, HALF_WIDTH])
    of, squares, reading = _scratch(rows, cols), _squares_of(limits), np.empty(4)
    kept, small = np.empty(cells.shape[0]), np.zeros(lines, np.int32)
    xs, ys, headings, ranges, fronts, bands, names = readings
    tiled = seen.shape[0] if xs.size * _WORTH >= observed.size else 0
    tiles = np.zeros((tiled, cells.shape[2] * lines), np.int32)
    for i in range(xs.size):
        sensor, full = sensors[names[i]], 0
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, names[i])
        box, first, count = rows_of_part(beam, place, rows, cols, part, parts)
        _describe(reading, what, sensor, ranges[i], bands[i], place.size_m, limits)
        if count > 0 and beam.half <= WIDEST_RAD:
            spans_of_rows(beam, place, box, parts, spans, doubt)
        row, col = point_cell(beam, place, rows, cols, ranges[i], bands[i], part, parts, spans,
                              count, spare)  # fmt: skip
        if row >= 0:
            _cell_of(cells, tiles, row // parts, row, col, kept, small, False)
        if count > 0 and beam.half > WIDEST_RAD:
            _add_wide(cells, what, seen, place, beam, sensor, reading, limits, box, parts)
        elif count > 0:
            free = sensor[WITH_FREE] != 0.0
            mark_rows(seen, first // parts, count, place.col0, spans, free)
            full = _add_wedge(cells, tiles, what, place, beam, sensor, reading, box,
                              (first, parts, count), spans, of, squares)  # fmt: skip
        if row >= 0:  # the obstacle's cell is the band, whatever ran through it
            _cell_of(cells, tiles, row // parts, row, col, kept, small, True)
            dx = (col + place.col0 + 0.5) * place.size_m + place.origin_x_m - beam.x
            dy = (row + place.row0 + 0.5) * place.size_m + place.origin_y_m - beam.y
            _cell(cells, what, row, col, False, dx, dy, sensor, reading, limits)
            mark(seen, row // parts, col, col, col, col + 1, True)
        if full != 0:
            _empty_tiles(cells, tiles, what, first, parts, count, box[2] - place.col0,
                         box[3] - place.col0)  # fmt: skip
    if tiled:
        _empty_all(cells, tiles, what, seen, part, parts)
    mark_seen(seen, observed, part, parts)
