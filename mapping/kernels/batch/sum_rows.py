"""What a reading adds to rows of arrays of sums: several cells at a time into tiles, or plainly."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.cell_tables import SATURATING
from mapping.kernels.batch.fading import NEAR_M
from mapping.kernels.batch.lanes import ROOM, WITH_LANES, loop
from mapping.kernels.batch.lanes_of_sums import lanes_of_pooled, lanes_of_saturating
from mapping.kernels.batch.seen import Bits
from mapping.kernels.batch.steps import LANES

Floats = NDArray[np.float64]
Columns = NDArray[np.int32]
Rows = tuple[int, int, int]  # of a reading the first in the map, how many, the first of tiles

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
MOST = 13.8  # of one reading's evidence
ROUNDING_M = 1e-9


@loop
def in_steps(evidence: float) -> float:
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
def scratch_of(rows: int, cols: int) -> Scratch:
    return Scratch(
        np.zeros(cols + ROOM), np.zeros(cols + ROOM), np.zeros(cols + ROOM),
        np.zeros(rows + ROOM), np.zeros(rows + ROOM), np.zeros(rows + ROOM),
    )  # fmt: skip


@loop
def measure(
    squares: Floats, faded: Floats, bell: Floats, count: int, first: int, size: float,
    origin: float, sensor_m: float, fade_m: float, near: float,
) -> None:  # fmt: skip
    """Of rows or columns first, first + 1, ..., at (index + 0.5) size + origin."""
    per_fade = 1.0 / fade_m
    for k in range(count):
        d = (first + k + 0.5) * size + origin - sensor_m
        squares[k], faded[k] = d * d, (d * per_fade) * (d * per_fade)
    if near > 0.0:
        for k in range(count):
            d = (first + k + 0.5) * size + origin - sensor_m
            bell[k] = near * math.exp(-((d / NEAR_M) ** 2))


@loop
def add_saturating_plainly(
    cells: Floats, rows: Rows, spans: Columns, shift: int, of: Scratch, sensor: Floats,
    reading: Floats,
) -> None:  # fmt: skip
    """All rows of a reading, whose columns lie in ``of``."""
    with_free, miss = sensor[WITH_FREE] != 0.0, sensor[MISS]
    for k in range(rows[1]):
        row = rows[0] + k
        f, g = spans[1, k] - shift, spans[2, k] - shift
        for c in range(spans[0, k] - shift, spans[3, k] - shift):
            if not f <= c < g:
                cells[FOR, row, c] += reading[ADDED]
            elif with_free:
                evidence = miss + of.row_bell[k] * of.bell[c]
                evidence /= 1.0 + (of.faded_across[c] + of.faded_down[k])
                cells[AGAINST, row, c] += in_steps(min(evidence, MOST))


@loop
def square_from(value: float) -> float:
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
    for k in range(rows[1]):
        row = rows[0] + k
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
    added, to = np.int32(np.rint(reading[ADDED] * ONE)), np.int32(shift)
    if what == SATURATING:
        return int(lanes_of_saturating(
            cells, tiles, rows, spans, to, of.faded_across, of.faded_down, of.bell, of.row_bell,
            added, (sensor[WITH_FREE], sensor[MISS], MOST),
        ))  # fmt: skip
    numbers = (sensor[WITH_FREE], reading[RANGE], squares[NEARER], squares[MIDDLE],
               squares[FARTHEST], squares[FROM], squares[END])  # fmt: skip
    return int(lanes_of_pooled(cells, tiles, rows, spans, to, of.across, of.down, of.faded_across,
                               of.faded_down, added, numbers))  # fmt: skip


add_rows: Any = add_rows_in_lanes if WITH_LANES else add_rows_plainly


@loop
def empty_tiles(
    cells: Floats, tiles: Columns, what: int, rows: Rows, col0: int, col1: int,
) -> None:  # fmt: skip
    """Move what the tiles of some rows and of the columns col0 to col1 - 1 hold into the map."""
    lines = 2 if what == SATURATING else 5
    for k in range(rows[1]):
        row, own = rows[0] + k, rows[2] + k
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
def empty_all(cells: Floats, tiles: Columns, what: int, seen: Bits, first: int) -> None:
    """Move all that the tiles hold into the map."""
    for k in range(seen.shape[0]):
        for word in range(seen.shape[1]):
            if seen[k, word] != 0:
                last = min((word + 1) * 64, cells.shape[2])
                empty_tiles(cells, tiles, what, (first + k, 1, k), word * 64, last)


@loop
def squares_of(limits: Floats) -> Floats:
    """Limits of distances as those of their squares; room for what each reading has of its own."""
    squares = np.zeros(5)
    squares[NEARER], squares[MIDDLE] = square_from(limits[NEARER]), square_from(limits[MIDDLE])
    squares[FARTHEST] = square_from(limits[FARTHEST_MISS])
    return squares
