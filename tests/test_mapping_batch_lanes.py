"""Steps in lanes give the very bytes of the plain loops that are their twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapping.kernels.batch import fading, regions, spans, steps
from mapping.kernels.batch.readings import place_of

ROWS, COLS = 90, 140
PLACE = place_of((-0.3, 0.1), 0.02, 3, 5)


def beam_of(draw):
    """A beam somewhere in the place, now and then along a row or a column of cells."""
    half = draw.uniform(0.01, 1.5)
    heading = draw.choice([draw.uniform(-7, 7), draw.integers(-8, 8) * math.pi / 4])
    x, y = PLACE.origin_x_m + draw.uniform(0, 2.8), PLACE.origin_y_m + draw.uniform(0, 1.8)
    front = draw.uniform(0.0, 1.5)
    widths = spans.widths_of(np.array([half]))
    return spans.beam_between(x, y, heading, front, front + draw.uniform(0, 0.3), widths, 0)


def spans_of(draw, rows, cols):
    """Spans a <= f <= g <= b of some rows, some of them empty."""
    table = spans.span_scratch(rows)[0]
    table[:, :rows] = np.sort(draw.integers(0, cols + 1, (4, rows)), axis=0)
    table[:, draw.integers(0, rows, rows // 5)] = 7
    table[1, ::3] = table[2, ::3] = table[3, ::3]
    return table


def map_of(draw):
    """Cells anywhere between their clamps, many close to one."""
    cells = steps.blank(ROWS, COLS)
    near = draw.choice([-steps.CLAMP, 0, steps.CLAMP], cells.shape)
    cells[:] = np.clip(
        near + draw.integers(-(2**24), 2**24, cells.shape), -steps.CLAMP, steps.CLAMP
    )
    return cells


@pytest.mark.parametrize("step", [1, 3])
def test_spans(step):
    draw = np.random.default_rng(step)
    for _ in range(300):
        beam = beam_of(draw)
        box = spans.box_of(beam, PLACE, ROWS, COLS)
        rows = max((box[1] - box[0] + step - 1) // step, 0)
        limits = spans._limits(beam, PLACE, box, step)
        plain, lanes = spans.span_scratch(ROWS), spans.span_scratch(ROWS)
        in_doubt = spans.fill_spans_plainly(*plain, rows, limits)
        assert spans.fill_spans_in_lanes(*lanes, rows, limits) == in_doubt
        np.testing.assert_array_equal(lanes[0][:, :rows], plain[0][:, :rows])
        np.testing.assert_array_equal(lanes[1][:rows], plain[1][:rows])


def test_gaussians():
    draw = np.random.default_rng(3)
    for count in range(1, 70):
        plain, lanes = np.zeros((2, 96), np.float32), np.zeros((2, 96), np.float32)
        arguments = (int(draw.integers(-50, 50)), count, int(draw.integers(1, 4)), 0.02,
                     draw.uniform(-9, 9), 3.43, 1.0 / draw.uniform(0.1, 9))  # fmt: skip
        fading.fill_gaussians_plainly(*arguments, *plain)
        fading.fill_gaussians_in_lanes(*arguments, *lanes)
        np.testing.assert_array_equal(lanes[:, :count], plain[:, :count])


@pytest.mark.parametrize("step", [1, 2])
def test_rows_of_fading(step):
    draw = np.random.default_rng(4)
    for _ in range(40):
        rows, shift = int(draw.integers(1, ROWS // step)), int(draw.integers(0, 9))
        table = spans_of(draw, rows, COLS) + np.int32(shift)
        bell, square, row_bell, row_square = draw.uniform(0, 4, (4, 160)).astype(np.float32)
        miss, near = -(draw.uniform(0, 8, 2) * steps.ONE).astype(np.float32)
        hit = np.int32(draw.integers(0, steps.CLAMP))
        plain, first = map_of(draw), int(draw.integers(0, ROWS - (rows - 1) * step))
        lanes = plain.copy()
        place = (first, step, rows, shift, table)
        arguments = (*place, bell, square, row_bell, row_square, miss, near, hit)
        zeros = fading.add_rows_plainly(plain, *arguments)
        assert fading.add_rows_in_lanes(lanes, *arguments) == zeros
        np.testing.assert_array_equal(lanes, plain)
        zeros = fading.add_plain_rows_plainly(plain, *place, np.int32(miss), hit)
        assert fading.add_plain_rows_in_lanes(lanes, *place, np.int32(miss), hit) == zeros
        np.testing.assert_array_equal(lanes, plain)


def test_one_row_of_fading():
    draw = np.random.default_rng(5)
    bell, square = draw.uniform(0, 4, (2, 160)).astype(np.float32)
    losses = np.float32(-3e7), np.float32(-9e7), np.float32(1.5), np.int32(5_000_000)
    plain = map_of(draw)
    lanes = plain.copy()
    for row, span in enumerate(spans_of(draw, ROWS, COLS)[:, :ROWS].T):
        zeros = fading.add_row_plainly(plain, row, bell, square, *span, *losses)
        assert fading.add_row_in_lanes(lanes, row, bell, square, *span, *losses) == zeros
        zeros = fading.add_plain_row_plainly(plain, row, *span, np.int32(-9), np.int32(7))
        assert fading.add_plain_row_in_lanes(lanes, row, *span, np.int32(-9), np.int32(7)) == zeros
    np.testing.assert_array_equal(lanes, plain)


@pytest.mark.parametrize("add_row", [fading.add_plain_row_plainly, fading.add_plain_row_in_lanes])
def test_a_cell_that_became_0_is_reported(add_row):
    cells = steps.blank(1, COLS)
    for at in range(COLS):
        cells[0], cells[0, at] = 1, 9
        assert add_row(cells, 0, at, at, at + 1, at + 1, np.int32(-9), np.int32(7)) == 1
        assert add_row(cells, 0, at, at, at, at + 1, np.int32(-9), np.int32(7)) == 0
        assert add_row(cells, 0, at, at, at, at, np.int32(-9), np.int32(7)) == 0


@pytest.mark.parametrize("count", [1, 6, 12, 60])
def test_rows_of_regions(count):
    draw = np.random.default_rng(count)
    factors = regions._with_room(draw.uniform(0, 0.45, (1, count)).astype(np.float32))
    table = draw.integers(-steps.CLAMP, steps.CLAMP, count * 12).astype(np.int32)
    # Of a group the first or the last column is the farthest, as it is of a row.
    square = np.square(np.linspace(-1.2, 1.6, 160)).astype(np.float32)
    for _ in range(15):
        beam = beam_of(draw)
        box = spans.box_of(beam, PLACE, ROWS, COLS)
        if box[1] <= box[0] or box[3] <= box[2]:
            continue
        found, doubt = spans.span_scratch(ROWS)
        spans.spans_of_rows(beam, PLACE, box, 1, found, doubt)
        twins = []
        cells = map_of(draw)
        for fill, front, band in (
            (regions.fill_border_plainly, regions.add_front_plainly, regions.add_band_plainly),
            (regions.fill_border_in_lanes, regions.add_front_in_lanes, regions.add_band_in_lanes),
        ):
            twins.append(rows_of_regions(fill, front, band, cells.copy(), box, found, count,
                                         factors, table, square))  # fmt: skip
        for plain, lanes in zip(*twins, strict=True):
            np.testing.assert_array_equal(lanes, plain)


def rows_of_regions(fill, front, band, cells, box, found, count, factors, table, square):
    """Borders and map, made with one kind of step."""
    rows, start = box[1] - box[0], np.int32(-3)
    borders, rows_up = np.zeros((count, found.shape[1]), np.int16), np.zeros(found.shape[1])
    rows_up[:rows] = np.arange(rows) * PLACE.size_m - 0.4
    for k in range(1, count):
        line = (math.tan(0.1 * k) / PLACE.size_m, 70.0)
        fill(borders, k, 0, rows // 3, rows_up, (0.0, 1e300), 0.0)
        fill(borders, k, rows // 3, rows, rows_up, line, float(k % 2))
    losses = regions._full_losses(factors)[0]
    for r in range(rows):
        a, f, g, b = (int(v) - PLACE.col0 for v in found[:, r])
        flip = np.int16(-(r % 2))
        if b <= a:
            continue
        dy_squared = np.float32(0.3)
        emptiness = np.float32(2.0), np.float32(-1.3), np.float32(0.59)
        front(cells, r, square, dy_squared, borders, r, flip, start, factors[0], losses, f, g,
              emptiness)  # fmt: skip
        # In doubt, float64 says another number: so it shows whether both look at the same cells.
        exact = 12.0, 0.2, 1.3, 3.0, PLACE.size_m, PLACE.origin_x_m, 0.4
        said = np.float32(9.0), np.float32(-4.0), np.float32(0.01), exact
        band(cells, r, square, dy_squared, borders, r, flip, start, table, a, b, said, 0.3)
    return borders[1:, :rows], cells
