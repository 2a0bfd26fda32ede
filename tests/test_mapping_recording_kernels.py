"""The kernels behind a recording give what plain numpy gives, bit for bit."""

from __future__ import annotations

import math
from dataclasses import replace

import naive_predicting as slow
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import MadeRun, temp_grid

from mapping.grid import GridGeometry
from mapping.kernels import recording
from mapping.update_rules.pooled import Pooled
from replay.rrd.pictures import UNSEEN, percent_classes
from replay.rrd.value_log import kernels as predicting
from replay.rrd.value_log.radial_profile import RadialProfile
from replay.rrd.value_log.sums import Formula, logarithms

ROWS, COLS = 31, 43  # of the grid
SEEDS = st.integers(0, 2**32 - 1)
few = settings(deadline=None, max_examples=60)


def masks(random: np.random.Generator, shape: tuple[int, int]) -> list[np.ndarray]:
    """Three that share no cell, each possibly empty."""
    which = random.integers(0, random.integers(1, 6), shape)
    return [which == number for number in random.permutation(4)[:3]]


def window(random: np.random.Generator) -> tuple[int, int, int, int]:
    """First row and column, rows and columns, within the grid."""
    rows, cols = int(random.integers(1, ROWS + 1)), int(random.integers(1, COLS + 1))
    return (
        int(random.integers(0, ROWS - rows + 1)), int(random.integers(0, COLS - cols + 1)),
        rows, cols,
    )  # fmt: skip


@few
@given(SEEDS, st.integers(0, 70))
def test_cells_come_in_order_front_band_others(seed: int, most: int) -> None:
    random = np.random.default_rng(seed)
    row0, col0, rows, cols = window(random)
    free, band, others = masks(random, (rows, cols))
    got = predicting.covered_cells(free, band, others, row0, col0, COLS)
    expected = slow.covered_cells(free, band, others, row0, col0, COLS)
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(predicting.some_of(free, most), slow.some_of(free, most))


@few
@given(SEEDS)
def test_sums_are_followed_as_the_rule_merges_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    rule, grid = Pooled(), GridGeometry((0.0, 0.0), 0.05, ROWS, COLS)
    formula = Formula.of(rule)
    sums = random.exponential(random.uniform(0.1, 50.0), (ROWS * COLS, 8))
    sums[:, :6] *= random.random((ROWS * COLS, 6)) < 0.7
    sums[:, 2:6] = np.floor(6.0 * sums[:, 2:6])  # counts
    sums[:, 6:] = formula.start[6:] * random.random((ROWS * COLS, 2))
    run = MadeRun(grid, sensors=(("ping", 38.0),), readings=1, turn_rad=0.0)
    beam = replace(run.beam(0), ranges_m=random.choice([0.1, 0.5, 0.9, np.inf], 1))
    temp = temp_grid(beam, grid)
    free, band = temp.free & ~temp.band, temp.band & np.isfinite(beam.ranges_m[0])
    w = temp.window
    cells, inner, in_front, _ = slow.covered_cells(
        free, band, np.zeros_like(free), w.row0, w.col0, COLS
    )
    known = {
        name: sums[:, n].reshape(ROWS, COLS)[w.slices].copy() for n, name in enumerate(rule.start)
    }
    rule.merge(known, replace(temp, free=free, band=band))
    reading = formula.reading(temp)
    at = beam.world_from_sensor
    distances = slow.distances_m(cells, COLS, 0.05, -at.x_m, -at.y_m)
    predicting.follow_sums(cells, in_front, distances, sums, reading.numbers, formula.numbers)
    found = sums[cells]
    wanted = np.column_stack([array.ravel()[inner] for array in known.values()])
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-7)
    values = predicting.values_of_sums(cells, sums, formula.numbers, logarithms(), formula.curve)
    exact = rule.values({name: found[:, n] for n, name in enumerate(rule.start)})
    np.testing.assert_allclose(values, exact, rtol=1e-7, atol=0.0)


@few
@given(SEEDS)
def test_logarithms_of_sums_and_products_alone(seed: int) -> None:
    for x in np.random.default_rng(seed).exponential(10.0, 50) ** 3.0:
        got = predicting.ln_of_one_plus(x, logarithms())
        assert abs(got - math.log1p(x)) <= 4e-15 * max(1.0, math.log1p(x))


@few
@given(SEEDS)
def test_cells_that_changed_without_evidence(seed: int) -> None:
    random = np.random.default_rng(seed)
    row0, col0, rows, cols = window(random)
    free, band, _ = masks(random, (rows, cols))
    old = random.integers(0, 3, (ROWS, COLS)).astype(np.uint32)
    new = random.integers(0, 3, (rows, cols)).astype(np.uint32)
    changed = new != old[row0 : row0 + rows, col0 : col0 + cols]
    got = predicting.other_changes(new, old, free, band, row0, col0)
    np.testing.assert_array_equal(got, changed & ~(free | band))


@few
@given(SEEDS, st.floats(0.001, 0.5), st.floats(-9, 9), st.floats(-9, 9))
def test_distances_and_factors_have_the_same_bits(
    seed: int, size_m: float, x_m: float, y_m: float
) -> None:
    random = np.random.default_rng(seed)
    cells = np.flatnonzero(random.random(ROWS * COLS) < random.random())
    distances = predicting.distances_m(cells, COLS, size_m, x_m, y_m)
    assert distances.tobytes() == slow.distances_m(cells, COLS, size_m, x_m, y_m).tobytes()
    table = RadialProfile(random.random() + 0.01, random.random(random.integers(5, 40)))
    factors = predicting.front_factors(table.cubics(), table.spacing_m, distances)
    expected = slow.look_up(table.cubics(), table.spacing_m, distances)
    assert factors.tobytes() == expected.tobytes()
    if len(cells):
        factors = expected * random.choice([1.0, 1.0 + 1e-12, 2.0], len(cells))
        share = predicting.share_fitting(table.cubics(), table.spacing_m, distances, factors, 1e-9)
        assert share == np.mean(np.abs(expected - factors) <= 1e-9 * factors)


@few
@given(SEEDS, st.booleans())
def test_predicted_values_have_the_same_bits_and_settle(seed: int, is_odds: bool) -> None:
    random = np.random.default_rng(seed)
    values = random.random(ROWS * COLS).astype(np.float32)
    values[random.random(values.size) < 0.1] = random.choice([0.0, 1.0, np.nan])
    odds = random.random(values.size) * (random.random(values.size) < 0.5)
    cells = random.permutation(values.size)[: random.integers(0, values.size)]
    free, band = (random.random(len(cells) // 3) * 2 for _ in range(2))
    with np.errstate(all="ignore"):
        expected = slow.predict(cells, free, band, odds, values, is_odds, 1e6)
    after, predicted = predicting.predict(cells, free, band, odds, values, is_odds, 1e6)
    np.testing.assert_array_equal(after, expected[0])
    np.testing.assert_array_equal(predicted, expected[1])
    missed = np.flatnonzero(random.random(len(cells)) < 0.2)
    true, bits = random.random(len(missed), np.float32), random.integers(0, 3, len(missed))
    middle = (expected[1][missed].astype(np.float64) + true) / 2.0
    with np.errstate(all="ignore"):
        expected[0][missed] = np.where(bits <= 1, slow.odds_of(middle, is_odds), 0.0)
    expected[1][missed] = true
    predicting.settle(cells, after, predicted, missed, true, bits, odds, values, is_odds)
    np.testing.assert_array_equal(odds[cells], expected[0])
    np.testing.assert_array_equal(values[cells], expected[1])


@few
@given(SEEDS, st.integers(1, 50))
def test_new_numbers_are_taken_and_their_tiles_marked(seed: int, side: int) -> None:
    random = np.random.default_rng(seed)
    row0, col0, rows, cols = window(random)
    grid = random.integers(0, 3, (ROWS, COLS)).astype(np.uint8)
    part = grid[row0 : row0 + rows, col0 : col0 + cols]
    new = np.where(random.random(part.shape) < 0.02, random.integers(0, 3, part.shape), part)
    new = new.astype(np.uint8)
    expected = slow.tiles_that_differ(part, new, row0, col0, side)
    marked, before = np.zeros((-(-ROWS // side), -(-COLS // side)), bool), grid.copy()
    recording.take(grid, new, row0, col0, side, marked)
    assert {tuple(place) for place in np.argwhere(marked).tolist()} == expected
    before[row0 : row0 + rows, col0 : col0 + cols] = new
    np.testing.assert_array_equal(grid, before)


@few
@given(SEEDS, st.sampled_from([np.float32, np.float64]))
def test_changes_and_evidence(seed: int, kind: type) -> None:
    random = np.random.default_rng(seed)
    before, after = (random.integers(0, 5, 200).astype(np.float32) / 4 for _ in range(2))
    assert recording.changes_of(before, after) == slow.changes_of(before, after)
    edges: np.ndarray = np.array([0.0, 0.002, 0.25, 0.5], kind)
    difference: np.ndarray = (after - before).astype(kind)
    marked = random.random(200) < 0.7
    np.testing.assert_array_equal(
        recording.strength_classes(difference, marked, edges),
        slow.strength_classes(difference, marked, edges),
    )
    free, band, _ = masks(random, (10, 20))
    probability = random.random((10, 20))
    single = np.array([0.0, 0.002, 0.25, 0.5], np.float32)
    np.testing.assert_array_equal(
        recording.changes_by_strength(
            after.reshape(10, 20), before.reshape(10, 20), single
        ).ravel(),
        slow.strength_classes(after - before, after != before, single),
    )
    edges = np.array([0.0, 0.002, 0.25, 0.5])
    np.testing.assert_array_equal(
        recording.evidence_by_strength(probability, free, band, edges).ravel(),
        slow.strength_classes((probability - 0.5).ravel(), (free | band).ravel(), edges),
    )
    assert recording.evidence_of(probability, free, band) == (
        band.sum(), probability[band].max(initial=0.0),
        free.sum(), probability[free].min(initial=1.0),
    )  # fmt: skip


@few
@given(SEEDS, st.integers(1, 50), st.floats(0.0, 5.0))
def test_shades_are_taken_and_tiles_that_are_drawn_far_off_are_marked(
    seed: int, side: int, slack: float
) -> None:
    random = np.random.default_rng(seed)
    row0, col0, rows, cols = window(random)
    part = np.s_[row0 : row0 + rows, col0 : col0 + cols]
    observed = random.random((ROWS, COLS)) < 0.5
    shades, drawn = (random.integers(0, 102, (ROWS, COLS)).astype(np.uint8) for _ in range(2))
    drawn[random.random(drawn.shape) < 0.3] = UNSEEN
    near = drawn[part] / np.float32(100) + random.normal(0, 0.02, (rows, cols))
    probability = np.clip(near, 0, 1).astype(np.float32)
    expected = shades.copy()
    expected[part][observed[part]] = percent_classes(probability, observed[part])[observed[part]]
    off = np.abs(np.float32(100) * probability - drawn[part].astype(np.float32)) > slack
    off = (off | (drawn[part] == UNSEEN)) & observed[part]
    tiles = {((row0 + r) // side, (col0 + c) // side) for r, c in np.argwhere(off).tolist()}
    marked = np.zeros((-(-ROWS // side), -(-COLS // side)), bool)
    before = drawn.copy()
    recording.shade(probability, observed, shades, drawn, row0, col0, side, UNSEEN, slack, marked)
    np.testing.assert_array_equal(shades, expected)
    np.testing.assert_array_equal(drawn, before)
    assert {tuple(place) for place in np.argwhere(marked).tolist()} == tiles


@few
@given(SEEDS, st.integers(1, 20), st.integers(1, 20), st.integers(0, 5))
def test_two_cells_are_packed_in_a_byte(seed: int, rows: int, cols: int, extra: int) -> None:
    classes = np.random.default_rng(seed).integers(0, 16, (rows, cols)).astype(np.uint8)
    side = max(rows, cols) + extra
    square = np.zeros((side, side + side % 2), np.uint8)
    square[:rows, :cols] = classes
    expected = np.hstack(
        [np.zeros((side, 1), np.uint8), square[:, 0::2] * np.uint8(16) + square[:, 1::2]]
    )
    np.testing.assert_array_equal(recording.packed_rows(classes, side), expected)
