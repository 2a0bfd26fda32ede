"""Rules that need each cell's probability itself: `sum`, Dempster-Shafer, and `saturating` with
the chapter's models: many readings at once.

Cell by cell in float64, with the very formulas and the order of one reading after the other.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.cell_tables import (
    A_MAX,
    EMPTINESS,
    EVIDENCE,
    FADE,
    HALF_WIDTH,
    HIT,
    MISS,
    MODEL,
    NEAR,
    P_HIT,
    P_MISS,
    Q_MAX,
    SUM,
)  # fmt: skip
from mapping.kernels.batch.fading import NEAR_M
from mapping.kernels.batch.lanes import free_loop, loop
from mapping.kernels.batch.readings import Place, Readings
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
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ONE, _CLAMP = 2.0**24, 13.8  # steps in evidence of 1, and the most of one reading
_FLOOR = 1e-6  # Dempster-Shafer: the mass that stays unknown


@loop
def _expit(x: float) -> Any:
    return 1.0 / (1.0 + math.exp(-x))


@loop
def _region(table: Floats, fraction: float) -> Any:
    """The factor of the region that holds a fraction of the way across."""
    at = math.floor(min(max(fraction, 0.0), 1.0) * table.size)
    return table[min(max(at, 0), table.size - 1)]


@loop
def _emptiness(kind: float, t: float) -> Any:
    """-1 (surely empty) .. 0 (nothing said) at t = 0 .. 1 of the way to the band."""
    if kind == 1.0:
        return -1.0
    if kind == 2.0:
        return t - 1.0
    return -min(1.0, 2.0 * (1.0 - t)) if kind == 3.0 else 0.0


@loop
def probability(
    sensor: Floats, angle: Floats, distance: Floats, rho: float, alpha: float, in_band: bool,
    range_m: float, start_m: float, end_m: float,
) -> Any:  # fmt: skip
    """What a reading says of one cell: that it is occupied with this probability."""
    if sensor[MODEL] == 2.0:
        if in_band:
            return _expit(sensor[HIT] / (1.0 + (range_m / sensor[FADE]) ** 2))
        closeness = 1.0 + sensor[NEAR] * math.exp(-((rho / NEAR_M) ** 2))
        return _expit(-(sensor[MISS] * closeness / (1.0 + (rho / sensor[FADE]) ** 2)))
    a = _region(angle, 0.5 + 0.5 * alpha / sensor[HALF_WIDTH])
    if in_band:
        depth = end_m - start_m
        q = _region(distance, (rho - start_m) / depth if depth > 0.0 else 0.5)
    else:
        q = _emptiness(sensor[EMPTINESS], rho / start_m if start_m > 0.0 else 1.0)
    if sensor[MODEL] == 0.0:
        return 0.5 + a * q / 2.0
    a = a / sensor[A_MAX]
    if in_band:
        return 0.5 + (sensor[P_HIT] - 0.5) * a * q / sensor[Q_MAX]
    return 0.5 + (0.5 - sensor[P_MISS]) * a * q


@loop
def _combine(cells: Floats, row: int, col: int, p: float) -> None:
    """Dempster's rule for one cell: occupied, empty, unknown, conflict in ``cells[0..3]``."""
    said = 2.0 * p - 1.0
    o1, e1, u1 = cells[0, row, col], cells[1, row, col], cells[2, row, col]
    o2, e2, u2 = _floored(max(said, 0.0), max(-said, 0.0), 1.0 - abs(said))
    conflict = o1 * e2 + e1 * o2
    scale = 1.0 / (1.0 - conflict)
    occupied, empty = (o1 * o2 + o1 * u2 + u1 * o2) * scale, (e1 * e2 + e1 * u2 + u1 * e2) * scale
    occupied, empty, unknown = _floored(occupied, empty, u1 * u2 * scale)
    cells[0, row, col], cells[1, row, col], cells[2, row, col] = occupied, empty, unknown
    cells[3, row, col] = 1.0 - (1.0 - cells[3, row, col]) * (1.0 - conflict)


@loop
def _add_evidence(cells: Floats, row: int, col: int, p: float) -> None:
    """`saturating`: whole steps of log-odds to what is for the cell, or to what is against it."""
    log_odds = math.log(p) - math.log1p(-p)
    steps = np.rint(min(max(log_odds, -_CLAMP), _CLAMP) * _ONE) / _ONE
    if steps > 0.0:
        cells[0, row, col] += steps
    else:
        cells[1, row, col] -= steps


@loop
def _floored(occupied: float, empty: float, unknown: float) -> tuple[float, float, float]:
    """Keep a little mass unknown; the three still add up to 1."""
    unknown = max(unknown, _FLOOR)
    scale = (1.0 - unknown) / max(occupied + empty, _FLOOR)
    return occupied * scale, empty * scale, unknown


@loop
def _merge(
    cells: Floats, observed: Flags, row: int, col: int, p: float, in_band: bool, rule: int
) -> None:
    """One cell of one reading."""
    if in_band or p != 0.5:
        observed[row, col] = True
    if rule == SUM:
        cells[0, row, col] += 2.0 * p - 1.0
    elif rule == EVIDENCE:
        _add_evidence(cells, row, col, p)
    elif p != 0.5:
        _combine(cells, row, col, p)


@loop
def _add_reading(
    cells: Floats, observed: Flags, place: Place, beam: Beam, sensor: Floats, angle: Floats,
    distance: Floats, range_m: float, start_m: float, end_m: float, rule: int,
    box: tuple[int, int, int, int], point_row: int, point_col: int,
) -> None:  # fmt: skip
    """Some rows of one reading, but for the cell of its point."""
    row0, row1, col0, col1 = box
    for row in range(row0, row1):
        dy, r = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            dx, c = (col + 0.5) * place.size_m + place.origin_x_m - beam.x, col - place.col0
            found = part_of_beam(beam, dx, dy)
            if found == OUTSIDE or (r == point_row and c == point_col):
                continue
            along, across = dx * beam.cos + dy * beam.sin, dy * beam.cos - dx * beam.sin
            p = probability(sensor, angle, distance, math.sqrt(dx * dx + dy * dy),
                            math.atan2(across, along), found == BAND, range_m, start_m,
                            end_m)  # fmt: skip
            _merge(cells, observed, r, c, p, found == BAND, rule)


@free_loop
def add_cellwise(
    cells: Floats, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    angles: Floats, distances: Floats, rule: int, begin: int, end: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows begin to end - 1 of a map.

    ``cells`` (K, rows, cols) is the rule's: the sum alone (SUM), or the masses occupied, empty,
    unknown and the conflict (MASSES), or evidence for and against (EVIDENCE). ``observed`` (rows,
    cols) gets the cells with any evidence. The tables of S sensors are those of ``cell_tables``.
    """
    rows, cols = observed.shape
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    widths = widths_of(sensors[:, HALF_WIDTH])
    xs, ys, headings, ranges, fronts, bands, names = readings
    for i in range(xs.size):
        if is_beyond(ys[i], max(fronts[i], bands[i]), place, begin, end):
            continue
        name = names[i]
        sensor, angle, distance = sensors[name], angles[name], distances[name]
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, name)
        box, _, count = rows_of_band(beam, place, rows, cols, begin, end)
        if beam.half <= WIDEST_RAD and count > 0:
            spans_of_rows(beam, place, box, 1, spans, doubt)
        row, col = obstacle_cell(beam, place, rows, cols, ranges[i], bands[i], begin, end, spans,
                                 count, spare)  # fmt: skip
        _add_reading(cells, observed, place, beam, sensor, angle, distance, ranges[i], fronts[i],
                     bands[i], rule, box, row, col)  # fmt: skip
        if row >= 0:
            p = probability(
                sensor, angle, distance, ranges[i], 0.0, True, ranges[i], fronts[i], bands[i]
            )
            _merge(cells, observed, row, col, p, True, rule)
