"""The cells of a beam as one span a row: where a row enters beam and front, and where it leaves.

A beam up to 180 degrees wide is convex, so a row of cells meets it, and its front, in one run
each. The borders of all rows are worked out at once, in float64 and without branches. Where one
passes too close to a cell's centre to tell its side for sure, the row is looked at again, cell by
cell, with the very predicate of the rasteriser (``footprints``), so that both cover the same cells.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import ROOM, WITH_LANES, inlined_loop, loop
from mapping.kernels.batch.lanes_of_rows import lanes_of_spans
from mapping.kernels.batch.readings import Place
from mapping.kernels.footprints import TOLERANCE_M, TOLERANCE_RAD, _in_beam

Floats = NDArray[np.float64]
Columns = NDArray[np.int32]

WIDEST_RAD = math.pi / 2 - 1e-6  # half a beam; wider ones are looked at cell by cell
OUTSIDE, FRONT, BAND = 0, 1, 2
_SURE_CELLS = 1e-5  # a centre nearer to a border than this, in cells, is looked at again
_MARGIN_CELLS = 1e-4
_ANY_SINE = 1e-300  # an edge along a row leaves it at plus or minus infinity, never at 0 / 0
_DISC_CELLS = 0.7072  # a disc of this radius holds a cell's centre, wherever it lies


class Beam(NamedTuple):
    """One reading's beam: where it starts, its axis, its edges (with their tolerance), its reach.

    Nothing lies beyond ``limit``, and the front ends before ``front_limit``, tolerances included.
    """

    x: float
    y: float
    cos: float
    sin: float
    half: float
    sin_half: float
    cos_half: float
    cos_right: float
    sin_right: float
    cos_left: float
    sin_left: float
    front_limit: float
    limit: float


@loop
def widths_of(halves: Floats) -> Floats:
    """What beams of each sensor share (S, 5): half the width, its sine and cosine, and those of
    the half with its tolerance; ``halves`` are (S,)."""
    widths = np.empty((halves.size, 5))
    for k in range(halves.size):
        half = halves[k]
        widths[k, 0], widths[k, 1], widths[k, 2] = half, math.sin(half), math.cos(half)
        widths[k, 3], widths[k, 4] = math.sin(half + TOLERANCE_RAD), math.cos(half + TOLERANCE_RAD)
    return widths


@inlined_loop
def beam_between(
    x: float, y: float, heading: float, front_end: float, band_end: float, widths: Floats,
    sensor: int,
) -> Beam:  # fmt: skip
    """The beam of a reading of a sensor, of ``widths_of``."""
    c, s = math.cos(heading), math.sin(heading)
    half, sin_half, cos_half = widths[sensor, 0], widths[sensor, 1], widths[sensor, 2]
    sin_out, cos_out = widths[sensor, 3], widths[sensor, 4]
    front_limit = front_end - TOLERANCE_M
    limit = band_end + TOLERANCE_M if band_end > front_end else front_limit
    return Beam(
        x, y, c, s, half, sin_half, cos_half,
        c * cos_out + s * sin_out, s * cos_out - c * sin_out,
        c * cos_out - s * sin_out, s * cos_out + c * sin_out, front_limit, limit,
    )  # fmt: skip


@loop
def span_scratch(rows: int) -> tuple[Columns, Columns]:
    """``spans`` and ``doubt`` for so many rows, with room for whole groups."""
    return np.empty((4, rows + ROOM), np.int32), np.empty(rows + ROOM, np.int32)


@loop
def part_of_beam(beam: Beam, dx: float, dy: float) -> int:
    """OUTSIDE, FRONT or BAND: the rasteriser's predicate for a cell's centre."""
    squared = dx * dx + dy * dy
    if beam.limit <= 0.0 or squared > beam.limit * beam.limit:
        return OUTSIDE
    along = dx * beam.cos + dy * beam.sin
    across = dy * beam.cos - dx * beam.sin
    rho = math.sqrt(squared)
    if not _in_beam(along, across, rho, beam.sin_half, beam.cos_half, beam.half):
        return OUTSIDE
    if rho < beam.front_limit:
        return FRONT
    return BAND if beam.limit > beam.front_limit else OUTSIDE


@loop
def box_of(beam: Beam, place: Place, rows: int, cols: int) -> tuple[int, int, int, int]:
    """First row, row after the last, first column, column after the last that a beam may meet.

    All are indices of the whole grid, cut to the ``rows`` and ``cols`` of the place.
    """
    reach = max(beam.limit, 0.0)
    right = max(0.0, beam.cos_right, beam.cos_left)
    left = min(0.0, beam.cos_right, beam.cos_left)
    up = max(0.0, beam.sin_right, beam.sin_left)
    down = min(0.0, beam.sin_right, beam.sin_left)
    # An axis direction lies in the beam where one edge is on each side of it.
    wide = beam.half > WIDEST_RAD
    right = 1.0 if wide or beam.sin_right <= 0.0 <= beam.sin_left else right
    left = -1.0 if wide or beam.sin_right >= 0.0 >= beam.sin_left else left
    up = 1.0 if wide or beam.cos_right >= 0.0 >= beam.cos_left else up
    down = -1.0 if wide or beam.cos_right <= 0.0 <= beam.cos_left else down
    per_cell = 1.0 / place.size_m
    x, y = (
        (beam.x - place.origin_x_m) * per_cell - 0.5,
        (beam.y - place.origin_y_m) * per_cell - 0.5,
    )
    reach *= per_cell
    col0 = math.ceil(max(x + reach * left - _MARGIN_CELLS, place.col0))
    col1 = math.floor(min(x + reach * right + _MARGIN_CELLS, place.col0 + cols - 1)) + 1
    row0 = math.ceil(max(y + reach * down - _MARGIN_CELLS, place.row0))
    row1 = math.floor(min(y + reach * up + _MARGIN_CELLS, place.row0 + rows - 1)) + 1
    if beam.limit <= 0.0:
        return row0, row0, col0, col0
    return row0, max(row1, row0), col0, max(col1, col0)


@inlined_loop
def surely_has_band(beam: Beam, place: Place, rows: int, cols: int) -> bool:
    """Can it be told without looking that a cell's centre lies in the band?"""
    radius, middle = _DISC_CELLS * place.size_m, (beam.front_limit + beam.limit) / 2.0
    if beam.limit - beam.front_limit < 2.0 * radius or beam.half > WIDEST_RAD:
        return False
    if middle * beam.sin_half < radius:
        return False
    col = (beam.x + middle * beam.cos - place.origin_x_m) / place.size_m - place.col0
    row = (beam.y + middle * beam.sin - place.origin_y_m) / place.size_m - place.row0
    margin = _MARGIN_CELLS
    return margin < col < cols - margin and margin < row < rows - margin


@loop
def _row_again(
    beam: Beam, place: Place, row: int, first: int, after: int
) -> tuple[int, int, int, int]:
    """The spans of one row, each cell from ``first`` to ``after`` looked at."""
    dy = (row + 0.5) * place.size_m + place.origin_y_m - beam.y
    start = end = front_start = front_end = -1
    for col in range(first, after):
        dx = (col + 0.5) * place.size_m + place.origin_x_m - beam.x
        part = part_of_beam(beam, dx, dy)
        if part == OUTSIDE:
            continue
        start, end = (col if start < 0 else start), col + 1
        if part == FRONT:
            front_start, front_end = (col if front_start < 0 else front_start), col + 1
    if start < 0:
        return first, first, first, first
    if front_start < 0:
        return start, end, end, end
    return start, front_start, front_end, end


@loop
def spans_of_rows(
    beam: Beam, place: Place, box: tuple[int, int, int, int], step: int, spans: Columns,
    doubt: Columns,
) -> int:  # fmt: skip
    """Fill ``spans[:, k]`` for the rows of a box, from the first on every ``step``-th: a, f, g, b.

    The beam covers the columns a to b - 1, of these f to g - 1 are its front; all are indices of
    the whole grid. Needs half a beam of at most ``WIDEST_RAD``. ``doubt`` is scratch; both are
    those of ``span_scratch``. Returns the number of rows.
    """
    row0, row1, col0, col1 = box
    rows = (row1 - row0 + step - 1) // step
    if likely_spans(beam, place, box, step, spans, doubt) > 0:
        for k in range(rows):
            if doubt[k] != 0:
                a, f, g, b = _row_again(beam, place, row0 + k * step, col0, col1)
                spans[0, k], spans[1, k], spans[2, k], spans[3, k] = a, f, g, b
    return rows


@loop
def likely_spans(
    beam: Beam, place: Place, box: tuple[int, int, int, int], step: int, spans: Columns,
    doubt: Columns,
) -> int:  # fmt: skip
    """The same without a second look: ``doubt[k]`` is 1 for a row whose spans are not sure.

    Returns how many these are.
    """
    rows = (box[1] - box[0] + step - 1) // step
    return int(_fill_spans(spans, doubt, np.int64(rows), _limits(beam, place, box, step)))


@inlined_loop
def _limits(beam: Beam, place: Place, box: tuple[int, int, int, int], step: int) -> Any:
    """All that the spans of a row depend on but the row."""
    row0, _row1, col0, col1 = box
    size, limit, front_limit = place.size_m, beam.limit, beam.front_limit
    sin_right = beam.sin_right if abs(beam.sin_right) > _ANY_SINE else _ANY_SINE
    sin_left = beam.sin_left if abs(beam.sin_left) > _ANY_SINE else _ANY_SINE
    # Of the right edge: dx sin <= dy cos; of the left one: dx sin >= dy cos.
    slope_right, slope_left = beam.cos_right / sin_right, beam.cos_left / sin_left
    far = 4.37 * (limit + size)  # beyond all cells
    low_r, low_r0 = (slope_right, 0.0) if sin_right < 0.0 else (0.0, -far)
    high_r, high_r0 = (slope_right, 0.0) if sin_right >= 0.0 else (0.0, far)
    low_l, low_l0 = (slope_left, 0.0) if sin_left >= 0.0 else (0.0, -far)
    high_l, high_l0 = (slope_left, 0.0) if sin_left < 0.0 else (0.0, far)
    per_cell = 1.0 / size
    offset = (beam.x - place.origin_x_m) * per_cell - 0.5
    reach_cells = limit * per_cell
    unsure = _SURE_CELLS + 1e-12 * reach_cells * reach_cells + 1e-15 * abs(offset)
    unsure += 2e-10 * reach_cells / min(abs(sin_right), abs(sin_left))
    flat_m = size * 1e-5 + limit * (0.0 if unsure < 0.25 else 1e-5)
    unsure = min(unsure, 0.25)
    front_squared = front_limit * front_limit if front_limit > 0.0 else -1.0
    return (
        np.float64(row0), np.float64(step), size, place.origin_y_m - beam.y, limit * limit,
        front_squared, low_r, low_r0, low_l, low_l0, high_r, high_r0, high_l, high_l0, far,
        per_cell, offset, np.float64(col0), np.float64(col1), unsure, flat_m,
    )  # fmt: skip


@loop
def fill_spans_plainly(spans: Columns, doubt: Columns, rows: int, limits: Any) -> Any:
    """Spans of rows and what is in doubt; how many rows are."""
    (row0, step, size, base_y, limit_squared, front_squared, low_r, low_r0, low_l, low_l0, high_r,
     high_r0, high_l, high_l0, far, per_cell, offset, first, after, unsure, flat_m) = (
        limits
    )  # fmt: skip
    unclear = np.int32(0)
    for k in range(rows):
        dy = (np.float64(k) * step + row0 + 0.5) * size + base_y
        wide = math.sqrt(max(limit_squared - dy * dy, 0.0))
        front_wide = math.sqrt(max(front_squared - dy * dy, 0.0))
        low = min(max(dy * low_r + low_r0, dy * low_l + low_l0), far)
        high = max(min(dy * high_r + high_r0, dy * high_l + high_l0), -far)
        a = max(low, -wide) * per_cell + offset
        b = min(high, wide) * per_cell + offset
        f = max(low, -front_wide) * per_cell + offset
        g = min(high, front_wide) * per_cell + offset
        near = min(abs(a - np.rint(a)), abs(b - np.rint(b)))
        near = min(near, abs(f - np.rint(f)), abs(g - np.rint(g)))
        is_unclear = np.int32(near < unsure) | np.int32(abs(dy) < flat_m)
        doubt[k] = is_unclear
        unclear += is_unclear
        a = min(max(np.ceil(a), first), after)
        b = min(max(np.floor(b) + 1.0, a), after)
        f = min(max(np.ceil(f), a), b)
        g = min(max(np.floor(g) + 1.0, f), b)
        spans[0, k] = np.int32(a)
        spans[1, k] = np.int32(f if g > f else b)
        spans[2, k] = np.int32(g if g > f else b)
        spans[3, k] = np.int32(b)
    return unclear


@loop
def fill_spans_in_lanes(spans: Columns, doubt: Columns, rows: int, limits: Any) -> Any:
    """The same, several rows at a time."""
    return lanes_of_spans(spans, doubt, rows, limits)


_fill_spans = fill_spans_in_lanes if WITH_LANES else fill_spans_plainly


@inlined_loop
def rows_of_band(
    beam: Beam, place: Place, rows: int, cols: int, begin: int, end: int
) -> tuple[tuple[int, int, int, int], int, int]:
    """The box of a beam within the rows begin to end - 1 of the array; its first row there, and
    how many it has (none where it has no columns)."""
    row0, row1, col0, col1 = box_of(beam, place, rows, cols)
    row0, row1 = max(row0, begin + place.row0), min(row1, end + place.row0)
    count = row1 - row0 if row1 > row0 and col1 > col0 else 0
    return (row0, row0 + count, col0, col1), row0 - place.row0, count


@loop
def _has_band(spans: Columns, rows: int) -> bool:
    """Does any of these rows have a cell in the band? Looked for from both ends: most bands reach
    to one."""
    for k in range((rows + 1) // 2):
        for own in (k, rows - 1 - k):
            if spans[3, own] - spans[0, own] > spans[2, own] - spans[1, own]:
                return True
    return False


@loop
def _lacks_band(
    beam: Beam, place: Place, rows: int, cols: int, scratch: tuple[Columns, Columns]
) -> bool:
    """Is there no cell in the band, all rows looked at?"""
    box = row0, row1, col0, col1 = box_of(beam, place, rows, cols)
    if beam.half <= WIDEST_RAD:
        if col1 <= col0:
            return True
        count = spans_of_rows(beam, place, box, np.int64(1), scratch[0], scratch[1])
        return not _has_band(scratch[0], count)
    for row in range(row0, row1):
        dy = (row + 0.5) * place.size_m + place.origin_y_m - beam.y
        for col in range(col0, col1):
            dx = (col + 0.5) * place.size_m + place.origin_x_m - beam.x
            if part_of_beam(beam, dx, dy) == BAND:
                return False
    return True


@inlined_loop
def is_beyond(y: float, reach: float, place: Place, begin: int, end: int) -> bool:
    """Does a beam from ``y`` meet none of the rows begin to end - 1, whichever way it looks?"""
    per_cell = 1.0 / place.size_m
    row, reach = (y - place.origin_y_m) * per_cell - place.row0, reach * per_cell + 1.0
    return row + reach < begin or row - reach > end


@loop
def obstacle_cell(
    beam: Beam, place: Place, rows: int, cols: int, range_m: float, band_end_m: float, begin: int,
    end: int, spans: Columns, count: int, scratch: tuple[Columns, Columns],
) -> tuple[int, int]:  # fmt: skip
    """Row and column, in the array of the place, of the obstacle's cell where it is the band.

    (-1, -1) where there are cells in the band, where nothing came back, and where the obstacle's
    cell lies outside the rows begin to end - 1. ``spans`` are those of the ``count`` rows of the
    beam in there, if it has spans; ``scratch`` is a ``span_scratch`` of its own.
    """
    if band_end_m < 0.0 or _is_in_spans(beam, spans, count):
        return -1, -1
    if surely_has_band(beam, place, rows, cols):
        return -1, -1
    row, col = _cell_at(beam, place, range_m)
    if not (0 <= col < cols and begin <= row < end):
        return -1, -1
    is_whole = begin == 0 and end == rows
    has_band = _is_elsewhere(beam, place, rows, cols, is_whole, scratch)
    return (-1, -1) if has_band else (row, col)


@loop
def _cell_at(beam: Beam, place: Place, range_m: float) -> tuple[int, int]:
    """Row and column, in the array of the place, of what lies on the axis at a range."""
    x, y = beam.x + range_m * beam.cos, beam.y + range_m * beam.sin
    col = math.floor((x - place.origin_x_m) / place.size_m) - place.col0
    return math.floor((y - place.origin_y_m) / place.size_m) - place.row0, col


@inlined_loop
def _is_in_spans(beam: Beam, spans: Columns, count: int) -> bool:
    """Do the spans of a beam, if it has any, hold a cell of the band?"""
    is_spanned = beam.half <= WIDEST_RAD and beam.limit > beam.front_limit
    return is_spanned and _has_band(spans, count)


@loop
def _is_elsewhere(
    beam: Beam, place: Place, rows: int, cols: int, is_whole: bool, scratch: tuple[Columns, Columns]
) -> bool:
    """Is there a cell in the band that spans do not hold? ``is_whole``: they are of all rows."""
    if beam.limit <= beam.front_limit or (beam.half <= WIDEST_RAD and is_whole):
        return False
    return not _lacks_band(beam, place, rows, cols, scratch)
