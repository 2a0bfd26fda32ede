"""Rules that keep several sums a cell: `saturating` with the model `fading`, and `pooled`.

Every reading adds whole steps of 2^-24, whole numbers, or a range that is the least so far, to
float64, where such sums are exact: in any order they come to the same. What the arrays hold is
said by the rules (``update_rules/saturating.py`` and ``pooled.py``).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.cell_tables import SATURATING
from mapping.kernels.batch.fading import NEAR_M
from mapping.kernels.batch.lanes import free_loop, loop
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

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Columns = NDArray[np.int32]

# Columns of the table of sensors; HIT, MISS and NEAR are those of `fading`, for `saturating`.
HALF_WIDTH, FADE, WITH_FREE, HIT, MISS, NEAR = range(6)
# Of a reading: what it adds to a cell of its band, where its arc ends, where the last stretch
# before the arc begins (past all cells where nothing came back), its range.
ADDED, ARC_END, LAST, RANGE = range(4)
# Limits of `pooled`: of near misses, of those in the middle, of what is just before an arc, and
# how far the cells of the arc itself reach behind the range, relative and in metres.
NEARER, MIDDLE, BEFORE, THIN, THIN_M = range(5)
_ONE = 2.0**24
_CLAMP = 13.8  # of one reading's evidence
_ROUNDING_M = 1e-9


@loop
def _in_steps(evidence: float) -> float:
    return float(np.rint(evidence * _ONE) / _ONE)


@loop
def _saturating_row(
    cells: Floats, row: int, a: int, f: int, g: int, b: int, dy: float, across: Floats,
    bell: Floats, sensor: Floats, added: float,
) -> None:  # fmt: skip
    """Columns a to b - 1 of a row, of which f to g - 1 are in front."""
    miss, near, fade = sensor[MISS], sensor[MISS] * sensor[NEAR], sensor[FADE]
    near *= math.exp(-((dy / NEAR_M) ** 2))
    per_fade = 1.0 / fade
    down = (dy * per_fade) ** 2
    for c in range(f, g):
        right = across[c] * per_fade
        evidence = (miss + near * bell[c]) / (1.0 + (right * right + down))
        evidence = min(evidence, _CLAMP)
        cells[1, row, c] += np.rint(evidence * _ONE) / _ONE
    for c in range(a, f):
        cells[0, row, c] += added
    for c in range(g, b):
        cells[0, row, c] += added


@loop
def _pooled_row(
    cells: Floats, row: int, a: int, f: int, g: int, b: int, dy: float, across: Floats,
    sensor: Floats, reading: Floats, limits: Floats,
) -> None:  # fmt: skip
    """Columns a to b - 1 of a row, of which f to g - 1 are in front."""
    near, middle, fade, last = limits[NEARER], limits[MIDDLE], sensor[FADE], reading[LAST]
    for c in range(f, g):
        rho = math.sqrt(across[c] * across[c] + dy * dy)
        faded = rho / fade
        cells[1, row, c] += np.rint(1.0 / (1.0 + faded * faded) * _ONE) / _ONE
        cells[3, row, c] += 1.0 if rho > last else 0.0
        cells[4, row, c] += 1.0 if rho < near else 0.0
        cells[5, row, c] += 1.0 if near <= rho < middle else 0.0
        cells[6, row, c] = min(cells[6, row, c], rho)
    for start, end in ((a, f), (g, b)):
        for c in range(start, end):
            rho = math.sqrt(across[c] * across[c] + dy * dy)
            cells[0, row, c] += reading[ADDED]
            cells[2, row, c] += 1.0 if rho <= reading[ARC_END] else 0.0
            cells[7, row, c] = min(cells[7, row, c], reading[RANGE])


@loop
def _row(
    cells: Floats, what: int, row: int, a: int, f: int, g: int, b: int, dy: float, across: Floats,
    bell: Floats, sensor: Floats, reading: Floats, limits: Floats,
) -> None:  # fmt: skip
    if sensor[WITH_FREE] == 0.0:  # the model has no evidence for what lies in front
        _band(cells, what, row, a, f, dy, across, bell, sensor, reading, limits)
        _band(cells, what, row, g, b, dy, across, bell, sensor, reading, limits)
    elif what == SATURATING:
        _saturating_row(cells, row, a, f, g, b, dy, across, bell, sensor, reading[ADDED])
    else:
        _pooled_row(cells, row, a, f, g, b, dy, across, sensor, reading, limits)


@loop
def _band(
    cells: Floats, what: int, row: int, a: int, b: int, dy: float, across: Floats, bell: Floats,
    sensor: Floats, reading: Floats, limits: Floats,
) -> None:  # fmt: skip
    if what == SATURATING:
        _saturating_row(cells, row, a, b, b, b, dy, across, bell, sensor, reading[ADDED])
    else:
        _pooled_row(cells, row, a, b, b, b, dy, across, sensor, reading, limits)


@loop
def _add_wide(
    cells: Floats, what: int, seen: Bits, place: Place, beam: Beam, across: Floats, bell: Floats,
    sensor: Floats, reading: Floats, limits: Floats, box: tuple[int, int, int, int], parts: int,
) -> None:  # fmt: skip
    """A beam of 180 degrees and more, each cell looked at on its own."""
    row0, row1, col0, col1 = box
    for row in range(row0, row1, parts):
        dy, own = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            c = col - place.col0
            found = part_of_beam(beam, across[c], dy)
            if found == OUTSIDE:
                continue
            g = c + 1 if found == FRONT else c
            mark(seen, own // parts, c, c, g, c + 1, sensor[WITH_FREE] != 0.0)
            _row(cells, what, own, c, c, g, c + 1, dy, across, bell, sensor, reading, limits)


@loop
def _fill_columns(
    place: Place, beam: Beam, box: tuple[int, int, int, int], what: int, across: Floats,
    bell: Floats,
) -> None:  # fmt: skip
    """How far to the right of the sensor the columns of a box lie, and the bell of each."""
    for col in range(box[2], box[3]):
        c = col - place.col0
        across[c] = (col + 0.5) * place.size_m + place.origin_x_m - beam.x
        if what == SATURATING:
            bell[c] = math.exp(-((across[c] / NEAR_M) ** 2))


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

    ``cells`` (2 or 8, rows, cols) are the arrays of the rule ``what``, SATURATING or POOLED, in
    its order; ``observed`` (rows, cols) gets the cells of which anything was said. ``sensors``
    (S, 6) and ``limits`` (5,) hold what is named above.
    """
    rows, cols = observed.shape
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    seen, widths = blank_seen(rows, cols, part, parts), widths_of(sensors[:, HALF_WIDTH])
    across, bell = np.empty(cols), np.empty(cols)
    reading, before = np.empty(4), np.empty(cells.shape[0])
    xs, ys, headings, ranges, fronts, bands, names = readings
    for i in range(xs.size):
        sensor = sensors[names[i]]
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, names[i])
        box, first, count = rows_of_part(beam, place, rows, cols, part, parts)
        _describe(reading, what, sensor, ranges[i], bands[i], place.size_m, limits)
        if count > 0 and beam.half <= WIDEST_RAD:
            spans_of_rows(beam, place, box, parts, spans, doubt)
        row, col = point_cell(beam, place, rows, cols, ranges[i], bands[i], part, parts, spans,
                              count, spare)  # fmt: skip
        if row >= 0:
            before[:] = cells[:, row, col]
        if count > 0:
            _fill_columns(place, beam, box, what, across, bell)
        if count > 0 and beam.half > WIDEST_RAD:
            _add_wide(cells, what, seen, place, beam, across, bell, sensor, reading, limits, box,
                      parts)  # fmt: skip
        elif count > 0:
            shift = place.col0
            mark_rows(seen, first // parts, count, shift, spans, sensor[WITH_FREE] != 0.0)
            for k in range(count):
                own = first + k * parts
                dy = (own + place.row0 + 0.5) * place.size_m + place.origin_y_m - beam.y
                _row(cells, what, own, spans[0, k] - shift, spans[1, k] - shift,
                     spans[2, k] - shift, spans[3, k] - shift, dy, across, bell, sensor, reading,
                     limits)  # fmt: skip
        if row >= 0:  # the obstacle's cell is the band, whatever ran through it
            cells[:, row, col] = before
            across[col] = (col + place.col0 + 0.5) * place.size_m + place.origin_x_m - beam.x
            dy = (row + place.row0 + 0.5) * place.size_m + place.origin_y_m - beam.y
            _band(cells, what, row, col, col + 1, dy, across, bell, sensor, reading, limits)
            mark(seen, row // parts, col, col, col, col + 1, True)
    mark_seen(seen, observed, part, parts)
