"""`fading` with Bayes' rule: many readings added to a map of integer log-odds in one go.

In front a cell loses miss (1 + near exp(-(rho / 0.35 m)^2)) / (1 + (rho / fade)^2), in the band it
gains hit / (1 + (range / fade)^2). rho^2 = dx^2 + dy^2, so the exponential of a cell is that of its
row times that of its column, and what is left for each cell is one division. A cell's value is
float32, then whole steps.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import WITH_LANES, free_loop, inlined_loop, loop
from mapping.kernels.batch.lanes_of_rows import (
    POWERS,
    lanes_of_gaussians,
    lanes_of_plain_row,
    lanes_of_plain_rows,
    lanes_of_row,
    lanes_of_rows,
)
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.seen import (
    Bits,
    around,
    blank_seen,
    mark,
    mark_changed,
    mark_rows,
    mark_seen,
    no_box,
)  # fmt: skip
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
from mapping.kernels.batch.steps import CLAMP, HIGHEST, LANES, LOWEST, ONE

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]

NEAR_M = 0.35  # within this distance of the sensor emptiness is surer
HALF_WIDTH, HIT, MISS, NEAR, FADE = range(5)  # columns of the table of sensors
_LEAST: Any = np.float32(-CLAMP)
_LOWEST_EXPONENT = np.float32(-126.0)
_E0, _E1, _E2, _E3, _E4, _E5, _E6 = (np.float32(c) for c in POWERS)
_UNIT, _BIAS, _MANTISSA_BITS = np.float32(1.0), np.int32(127), np.int32(23)
_NOTHING: Any = np.int32(0)
FLAT = 2.0**-13  # of the fading distance: up to here 1 + (rho / fade)^2 is 1 in float32


@loop
def gaussians(
    first: int, count: int, step: int, size: float, to: float, fade_m: float, bell: Singles,
    square: Singles,
) -> None:  # fmt: skip
    """exp(-(d / 0.35 m)^2) and (d / fade)^2 of the rows or columns first, first + step, ...

    d = (index + 0.5) size + to, metres. They go to ``bell[k]`` and ``square[k]``, k < count, which
    have room for whole groups.
    """
    per_near, per_fade = math.sqrt(math.log2(math.e)) / NEAR_M, 1.0 / fade_m
    _fill_gaussians(np.int64(first), np.int64(count), np.int64(step), size, to, per_near, per_fade,
                    bell, square)  # fmt: skip


@loop
def fill_gaussians_plainly(
    first: int, count: int, step: int, size: float, to: float, per_near: float, per_fade: float,
    bell: Singles, square: Singles,
) -> None:  # fmt: skip
    """One after the other."""
    bits = np.empty(count, np.int32)
    for k in range(count):
        d = (np.float64(first + k * step) + 0.5) * size + to
        x, y = np.float32(d * per_near), np.float32(d * per_fade)
        exponent = max(-(x * x), _LOWEST_EXPONENT)
        whole = np.rint(exponent)
        u = exponent - whole
        p = ((((_E6 * u + _E5) * u + _E4) * u + _E3) * u + _E2) * u + _E1
        bell[k] = p * u + _E0
        square[k] = y * y
        bits[k] = np.int32(np.int32(np.int32(whole) + _BIAS) << _MANTISSA_BITS)
    power = bits.view(np.float32)
    for k in range(count):
        bell[k] *= power[k]


@loop
def fill_gaussians_in_lanes(
    first: int, count: int, step: int, size: float, to: float, per_near: float, per_fade: float,
    bell: Singles, square: Singles,
) -> None:  # fmt: skip
    """Several at a time."""
    lanes_of_gaussians(first, count, step, size, to, per_near, per_fade, bell, square)


_fill_gaussians = fill_gaussians_in_lanes if WITH_LANES else fill_gaussians_plainly


@inlined_loop
def add_row_plainly(
    cells: Steps, row: int, bell: Singles, square: Singles, a: Any, f: Any, g: Any, b: Any,
    miss: Any, near: Any, depth: Any, hit: Any,
) -> Any:  # fmt: skip
    """One row: a to f - 1 band, f to g - 1 front, g to b - 1 band. 1 if any of them became 0."""
    zeros = False
    for c in range(a, b):
        value = (miss + near * bell[c]) / (depth + square[c])  # both negative
        step = np.int32(np.rint(value if value > _LEAST else _LEAST))
        step = step if f <= c < g else hit
        total = np.int32(cells[row, c] + step)
        total = total if total < HIGHEST else HIGHEST
        cells[row, c] = total = total if total > LOWEST else LOWEST
        zeros |= total == 0
    return np.int32(zeros)


@inlined_loop
def add_row_in_lanes(
    cells: Steps, row: int, bell: Singles, square: Singles, a: Any, f: Any, g: Any, b: Any,
    miss: Any, near: Any, depth: Any, hit: Any,
) -> Any:  # fmt: skip
    """The same, several cells at a time; to those outside 0 is added."""
    bounds = (np.int32(a), np.int32(f), np.int32(g), np.int32(b))
    return lanes_of_row(cells, np.int64(row), bell, square, bounds, np.float32(miss),
                        np.float32(near), np.float32(depth), np.int32(hit), LOWEST)  # fmt: skip


@inlined_loop
def add_plain_row_plainly(
    cells: Steps, row: int, a: Any, f: Any, g: Any, b: Any, miss: Any, hit: Any
) -> Any:
    """One row where all cells in front lose as much."""
    zeros = False
    for c in range(a, b):
        total = np.int32(cells[row, c] + (miss if f <= c < g else hit))
        total = total if total < HIGHEST else HIGHEST
        cells[row, c] = total = total if total > LOWEST else LOWEST
        zeros |= total == 0
    return np.int32(zeros)


@inlined_loop
def add_plain_row_in_lanes(
    cells: Steps, row: int, a: Any, f: Any, g: Any, b: Any, miss: Any, hit: Any
) -> Any:
    """The same, several cells at a time; to those outside 0 is added."""
    bounds = (np.int32(a), np.int32(f), np.int32(g), np.int32(b))
    return lanes_of_plain_row(cells, np.int64(row), bounds, np.int32(miss), np.int32(hit), LOWEST)


add_row = add_row_in_lanes if WITH_LANES else add_row_plainly
add_plain_row = add_plain_row_in_lanes if WITH_LANES else add_plain_row_plainly


@loop
def add_rows_plainly(
    cells: Steps, first: int, step: int, rows: int, shift: int, spans: Steps, bell: Singles,
    square: Singles, row_bell: Singles, row_square: Singles, miss: Any, near: Any, hit: Any,
) -> Any:  # fmt: skip
    """The rows first, first + step, ... of one reading, their spans from column ``shift`` on."""
    zeros = np.int32(0)
    for k in range(rows):
        zeros |= add_row_plainly(cells, first + k * step, bell, square, spans[0, k] - shift,
                                 spans[1, k] - shift, spans[2, k] - shift, spans[3, k] - shift,
                                 miss, near * row_bell[k], _UNIT + row_square[k], hit)  # fmt: skip
    return zeros


@loop
def add_rows_in_lanes(
    cells: Steps, first: int, step: int, rows: int, shift: int, spans: Steps, bell: Singles,
    square: Singles, row_bell: Singles, row_square: Singles, miss: Any, near: Any, hit: Any,
) -> Any:  # fmt: skip
    """The same, several cells of two rows at a time."""
    return lanes_of_rows(cells, first, step, rows, np.int32(shift), spans, bell, square, row_bell,
                         row_square, miss, near, hit, LOWEST)  # fmt: skip


@loop
def add_plain_rows_plainly(
    cells: Steps, first: int, step: int, rows: int, shift: int, spans: Steps, miss: Any, hit: Any
) -> Any:
    """The same where all cells in front lose as much."""
    zeros = np.int32(0)
    for k in range(rows):
        zeros |= add_plain_row_plainly(cells, first + k * step, spans[0, k] - shift,
                                       spans[1, k] - shift, spans[2, k] - shift,
                                       spans[3, k] - shift, miss, hit)  # fmt: skip
    return zeros


@loop
def add_plain_rows_in_lanes(
    cells: Steps, first: int, step: int, rows: int, shift: int, spans: Steps, miss: Any, hit: Any
) -> Any:
    """The same, several cells of two rows at a time."""
    return lanes_of_plain_rows(cells, first, step, rows, np.int32(shift), spans, miss, hit, LOWEST)


_add_rows = add_rows_in_lanes if WITH_LANES else add_rows_plainly
_add_plain_rows = add_plain_rows_in_lanes if WITH_LANES else add_plain_rows_plainly


@loop
def _add_wedge(
    cells: Steps, seen: Bits, place: Place, beam: Beam, miss: float, near: float, fade: float,
    hit: int, first: int, count: int, box: tuple[int, int, int, int], spans: Steps, bell: Singles,
    square: Singles, row_bell: Singles, row_square: Singles,
) -> None:  # fmt: skip
    """The ``count`` rows of one beam from row ``first`` of the map on, ``spans`` being theirs."""
    if near == 0.0 and beam.limit < fade * FLAT:
        plain = np.int32(np.rint(max(miss, _LEAST)))
        if _add_plain_rows(cells, first, 1, count, place.col0, spans, plain, hit) != 0:
            mark_rows(seen, first, count, place.col0, spans, miss != 0.0)
        return
    start, end = (box[2] - place.col0) // LANES * LANES, -((place.col0 - box[3]) // LANES) * LANES
    gaussians(start + place.col0, end - start, 1, place.size_m, place.origin_x_m - beam.x,
              fade, bell[start:end], square[start:end])  # fmt: skip
    gaussians(first + place.row0, count, 1, place.size_m, place.origin_y_m - beam.y, fade,
              row_bell, row_square)  # fmt: skip
    if _add_rows(cells, first, 1, count, place.col0, spans, bell, square, row_bell, row_square,
                 miss, near, hit) != 0:  # fmt: skip
        mark_rows(seen, first, count, place.col0, spans, miss != 0.0)


@loop
def _add_wide(
    cells: Steps, seen: Bits, place: Place, beam: Beam, miss: float, near: float, fade: float,
    hit: int, box: tuple[int, int, int, int], bell: Singles, square: Singles, row_bell: Singles,
    row_square: Singles,
) -> None:  # fmt: skip
    """The same for a beam of 180 degrees and more, each cell looked at on its own."""
    (row0, row1, col0, col1), size = box, place.size_m
    gaussians(place.col0, bell.size, 1, size, place.origin_x_m - beam.x, fade, bell, square)
    for row in range(row0, row1):
        gaussians(row, 1, 1, size, place.origin_y_m - beam.y, fade, row_bell, row_square)
        dy, own = (row + 0.5) * size + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            found = part_of_beam(beam, (col + 0.5) * size + place.origin_x_m - beam.x, dy)
            if found == OUTSIDE:
                continue
            a = col - place.col0
            g = a + 1 if found == FRONT else a
            mark(seen, own, a, a, g, a + 1, miss != 0.0)
            add_row(cells, own, bell, square, a, a, g, a + 1, miss, near * row_bell[0],
                    _UNIT + row_square[0], hit)  # fmt: skip


@free_loop
def add_fading(
    cells: Steps, observed: Flags, place: Place, readings: Readings, sensors: Floats,
    begin: int, end: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows begin to end - 1 of a map.

    ``cells`` (rows, a multiple of ``LANES``) are steps of log-odds, ``observed`` (rows, cols) gets
    the cells of which anything was said; all that are not 0 must have it. ``sensors`` (S, 5) holds
    half the beam's width and `fading`'s hit, miss, near and fade_m of each sensor.
    """
    (rows, cols), stride = observed.shape, cells.shape[1]
    bell, square = np.empty(stride, np.float32), np.empty(stride, np.float32)
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    row_bell, row_square = np.empty(doubt.size, np.float32), np.empty(doubt.size, np.float32)
    seen = blank_seen(rows, cols, 0, 1)
    widths, touched = widths_of(sensors[:, HALF_WIDTH]), no_box()
    xs, ys, headings, ranges, fronts, bands, names = readings
    for i in range(xs.size):
        if is_beyond(ys[i], max(fronts[i], bands[i]), place, begin, end):
            continue
        name = names[i]
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, name)
        fade, faded = sensors[name, FADE], ranges[i] / sensors[name, FADE]
        miss = np.float32(-sensors[name, MISS] * ONE)
        near = np.float32(-sensors[name, MISS] * sensors[name, NEAR] * ONE)
        hit = np.int32(np.rint(min(sensors[name, HIT] / (1.0 + faded * faded) * ONE, CLAMP)))
        box, first, count = rows_of_band(beam, place, rows, cols, begin, end)
        touched = around(touched, box)
        if count > 0 and beam.half <= WIDEST_RAD:
            spans_of_rows(beam, place, box, 1, spans, doubt)
        point_row, point_col = obstacle_cell(beam, place, rows, cols, ranges[i], bands[i], begin,
                                             end, spans, count, spare)  # fmt: skip
        before = cells[point_row, point_col] if point_row >= 0 else _NOTHING
        if count > 0 and beam.half <= WIDEST_RAD:
            _add_wedge(cells, seen, place, beam, miss, near, fade, hit, first, count, box, spans,
                       bell, square, row_bell, row_square)  # fmt: skip
        elif count > 0:
            _add_wide(cells, seen, place, beam, miss, near, fade, hit, box, bell, square, row_bell,
                      row_square)  # fmt: skip
        if point_row >= 0:  # the obstacle's cell is the band, whatever ran through it
            cells[point_row, point_col] = min(np.int32(before + hit), HIGHEST)
            mark(seen, point_row, point_col, point_col, point_col, point_col + 1, True)
    mark_seen(seen[begin:end], observed[begin:end], 0, 1)
    mark_changed(cells, observed, touched, place.row0, place.col0, 0, 1)
