"""Rules that only ask whether a cell lies in the band: `count` and `binary`, many readings at once.

The values are those of one reading after the other, exactly: they are whole numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping.kernels.batch.lanes import free_loop, inlined_loop, loop
from mapping.kernels.batch.readings import BINARY, COUNT, Place, Readings
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

Floats = NDArray[np.float64]
Steps = NDArray[np.int32]
Flags = NDArray[np.bool_]

HALF_WIDTH, WITH_FREE = range(2)  # columns of the table of sensors


@inlined_loop
def _gain(values: Floats, row: int, first: int, after: int, what: int) -> None:
    """Change the cells first to after - 1 of a row."""
    for c in range(first, after):
        if what == COUNT:
            values[row, c] += 1.0
        elif what == BINARY:
            values[row, c] = 1.0


@loop
def _add_wide(
    values: Floats, seen: Bits, place: Place, beam: Beam, what: int, with_free: bool,
    box: tuple[int, int, int, int],
) -> None:  # fmt: skip
    """The rows of a beam of 180 degrees and more, each cell looked at on its own."""
    row0, row1, col0, col1 = box
    for row in range(row0, row1):
        dy, own = (row + 0.5) * place.size_m + place.origin_y_m - beam.y, row - place.row0
        for col in range(col0, col1):
            dx, c = (col + 0.5) * place.size_m + place.origin_x_m - beam.x, col - place.col0
            found = part_of_beam(beam, dx, dy)
            if found == BAND or (found != OUTSIDE and with_free):
                mark(seen, own, c, c, c, c + 1, True)
            if found == BAND:
                _gain(values, own, c, c + 1, what)


@free_loop
def add_bands(
    values: Floats, observed: Flags, place: Place, readings: Readings, sensors: Floats, what: int,
    begin: int, end: int,
) -> None:  # fmt: skip
    """Add readings, in their order, to the rows begin to end - 1 of a map.

    ``values`` is (rows, cols or more), ``observed`` (rows, cols) gets the cells of which anything
    was said. ``sensors`` (S, 2) holds half the beam's width, and 1 where a sensor's model says
    something of the cells in front. ``what``: COUNT, BINARY, or NOTHING (only ``observed``).
    """
    rows, cols = observed.shape
    (spans, doubt), spare = span_scratch(rows), span_scratch(rows)
    seen, widths = blank_seen(rows, cols, 0, 1), widths_of(sensors[:, HALF_WIDTH])
    xs, ys, headings, ranges, fronts, bands, names = readings
    for i in range(xs.size):
        if is_beyond(ys[i], max(fronts[i], bands[i]), place, begin, end):
            continue
        half, with_free = sensors[names[i], HALF_WIDTH], sensors[names[i], WITH_FREE] != 0.0
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, names[i])
        box, first, count = rows_of_band(beam, place, rows, cols, begin, end)
        if half <= WIDEST_RAD and count > 0:
            spans_of_rows(beam, place, box, 1, spans, doubt)
        row, col = obstacle_cell(beam, place, rows, cols, ranges[i], bands[i], begin, end, spans,
                                 count, spare)  # fmt: skip
        if row >= 0:
            mark(seen, row, col, col, col, col + 1, True)
            _gain(values, row, col, col + 1, what)
        if half > WIDEST_RAD:
            _add_wide(values, seen, place, beam, what, with_free, box)
            continue
        shift = place.col0
        mark_rows(seen, first, count, shift, spans, with_free)
        for k in range(count):
            row = first + k
            _gain(values, row, spans[0, k] - shift, spans[1, k] - shift, what)
            _gain(values, row, spans[2, k] - shift, spans[3, k] - shift, what)
    mark_seen(seen[begin:end], observed[begin:end], 0, 1)
