"""The value log of a layer: small, and bit for bit what the values were, however merged."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import MadeRun, temp_grid
from naive_predicting import look_up

from mapping.artifacts import MergedGrid, TempGrid
from mapping.grid import GridGeometry, Window
from mapping.update_rules import UPDATE_RULES
from mapping.update_rules.pooled import Pooled
from mapping.update_rules.state import start
from replay.rrd.value_log.encoder import LogEncoder
from replay.rrd.value_log.radial_profile import fit_table
from replay.rrd.value_log.records import LogReader, ValueLogError
from replay.rrd.value_log.sums import Formula
from replay.rrd.value_log.track import Track

GRID = GridGeometry((-0.3, -0.2), 0.02, 110, 140)


def readings(
    rule: str, count: int, width_deg: float = 38.0, grid: GridGeometry = GRID
) -> Iterator[tuple[TempGrid, MergedGrid]]:
    """Real merges of made readings of one sensor."""
    run = MadeRun(grid, sensors=(("ping", width_deg),), readings=count)
    state = start(rule, grid)
    for number in range(count):
        temp = temp_grid(run.beam(number), grid)
        yield temp, state.merge(temp)


def formula_of(merged: MergedGrid) -> Formula | None:
    rule = None if merged.sums is None else merged.sums.rule
    return Formula.of(rule) if isinstance(rule, Pooled) else None


def empty(rule: str) -> np.ndarray:
    known = UPDATE_RULES[rule]
    return np.full(GRID.shape, known.start_value, np.float32)


def logged(
    rule: str, count: int, **options: float
) -> tuple[list[tuple[int, bytes]], list[np.ndarray]]:
    """The records of a run, with the number of the reading of each, and the grid after each."""
    known = UPDATE_RULES[rule]
    writer: LogEncoder[int] = LogEncoder(
        GRID, known.kind, known.start_value, predicts=known.multiplies_odds
    )
    grid, records, after = empty(rule), [], []
    for number, (temp, merged) in enumerate(readings(rule, count)):
        formula = formula_of(merged)
        records += writer.add(merged.window, merged.values, temp, number, formula)
        grid[merged.window.slices] = merged.values
        after.append(grid.copy())
    return records + writer.drain(), after


def reader(rule: str) -> LogReader:
    known = UPDATE_RULES[rule]
    return LogReader(Track(GRID, known.kind, known.start_value))


@pytest.mark.parametrize("rule", sorted(UPDATE_RULES))
def test_every_rules_values_come_back_bit_for_bit(rule: str) -> None:
    records, after = logged(rule, 40)
    back = reader(rule)
    newest = 0
    for number, record in records:
        assert number >= newest
        newest = number
        back.take(record)
        assert back.values.tobytes() == after[number].tobytes()
    assert back.values.tobytes() == after[-1].tobytes()


@pytest.mark.parametrize("width_deg", [38.0, 6.0])
def test_evidence_by_distance_alone_takes_next_to_nothing(width_deg: float) -> None:
    """A tenth, once the table is there, of what the plain differences take."""
    grid = GridGeometry((-0.3, -0.2), 0.01, 280, 360)
    predicted: LogEncoder[int] = LogEncoder(grid, "probability", 0.5, predicts=True)
    plain: LogEncoder[int] = LogEncoder(grid, "probability", 0.5, predicts=True)
    sizes = {"predicted": 0, "plain": 0}
    for number, (temp, merged) in enumerate(readings("bayes", 48, width_deg, grid)):
        records = predicted.add(merged.window, merged.values, temp, number)
        sizes["predicted"] += sum(len(record) for ticket, record in records if ticket >= 24)
        ((_, record),) = plain.add(merged.window, merged.values, None, number)
        sizes["plain"] += len(record) * (number >= 24)
    assert 0 < 10 * sizes["predicted"] < sizes["plain"]


def test_sums_that_are_followed_take_next_to_nothing() -> None:
    """A tenth of what the plain differences take, from the first reading on."""
    grid = GridGeometry((-0.3, -0.2), 0.01, 280, 360)
    predicts = Pooled.multiplies_odds  # which it does not, and need not
    followed: LogEncoder[int] = LogEncoder(grid, "probability", 0.5, predicts=predicts)
    plain: LogEncoder[int] = LogEncoder(grid, "probability", 0.5, predicts=True)
    sizes = {"followed": 0, "plain": 0}
    for number, (temp, merged) in enumerate(readings("pooled", 24, grid=grid)):
        formula = formula_of(merged)
        ((_, record),) = followed.add(merged.window, merged.values, temp, number, formula)
        sizes["followed"] += len(record)
        ((_, record),) = plain.add(merged.window, merged.values, None, number)
        sizes["plain"] += len(record)
    assert 0 < 10 * sizes["followed"] < sizes["plain"]


@pytest.mark.parametrize("spoiled", [False, True])
def test_sums_go_on_over_a_whole_map_and_end_with_what_no_record_tells(spoiled: bool) -> None:
    """A reader may begin at a whole map; a tile that came without a reading ends the following."""
    writer: LogEncoder[int] = LogEncoder(GRID, "probability", 0.5, predicts=Pooled.multiplies_odds)
    late, grid, sizes = reader("pooled"), empty("pooled"), []
    for number, (temp, merged) in enumerate(readings("pooled", 40)):
        grid[merged.window.slices] = merged.values
        if spoiled and number == 10:  # not logged, its tile is
            writer.replace(merged.window, merged.values)
            continue
        formula = formula_of(merged)
        records = writer.add(merged.window, merged.values, temp, number, formula)
        records += writer.drain()
        sizes.append(sum(len(record) for _, record in records))
        for _, record in records:
            (late.skip if number <= 20 else late.take)(record)
        if number == 20:
            writer.replace(GRID.whole, grid)  # nothing new
            writer.restart()
            late.replace(GRID.whole, grid)
            late.restart()
        if number > 20:
            assert late.values.tobytes() == grid.tobytes()
    assert (np.mean(sizes[25:]) > 4.0 * np.mean(sizes[1:9])) == spoiled


def test_a_lost_or_spoiled_record_is_noticed() -> None:
    records, _ = logged("bayes", 30)
    back = reader("bayes")
    back.take(records[0][1])
    with pytest.raises(ValueLogError, match="record 2 is missing"):
        back.take(records[2][1])
    plain, _ = logged("sum", 2)
    spoiled = bytearray(plain[1][1])
    spoiled[30] ^= 1  # of the checksum or the lengths; either way it cannot come out right
    back = reader("sum")
    back.take(plain[0][1])
    with pytest.raises((ValueLogError, OSError, ValueError)):
        back.take(bytes(spoiled))


def test_whole_values_in_between_and_a_restart() -> None:
    """A whole tile that the file holds, and the odds forgotten after a whole map."""
    writer: LogEncoder[int] = LogEncoder(GRID, "probability", 0.5, predicts=True)
    back, grid = reader("bayes"), empty("bayes")
    for number, (temp, merged) in enumerate(readings("bayes", 60)):
        before = grid.copy()
        grid[merged.window.slices] = merged.values
        if number == 25:
            for _, record in writer.drain():
                back.take(record)
            for taker in (writer, back):
                taker.replace(merged.window, merged.values)
        else:
            for _, record in writer.add(merged.window, merged.values, temp, number):
                back.take(record)
        if number == 40:
            for _, record in writer.drain():
                back.take(record)
            assert back.values.tobytes() == grid.tobytes()
            for taker in (writer, back):
                taker.restart()
        assert not np.array_equal(before, grid)
    for _, record in writer.drain():
        back.take(record)
    assert back.values.tobytes() == grid.tobytes()


@settings(deadline=None, max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 25), odds=st.booleans())
def test_any_bits_in_any_windows_with_or_without_temp_grids(
    seed: int, count: int, odds: bool
) -> None:
    random = np.random.default_rng(seed)
    geometry = GridGeometry(
        (0.0, 0.0), 0.1, int(random.integers(1, 60)), int(random.integers(1, 60))
    )
    kind = "odds" if odds else "probability"
    writer: LogEncoder[int] = LogEncoder(geometry, kind, 0.5, predicts=True)
    back = LogReader(Track(geometry, kind, 0.5))
    grid, run = np.full(geometry.shape, 0.5, np.float32), MadeRun(geometry, readings=count)
    grids = []
    for number in range(count):
        temp = temp_grid(run.beam(number), geometry)
        window = temp.window
        if random.random() < 0.5:
            window = Window(0, 0, int(random.integers(1, geometry.rows + 1)), geometry.cols)
        values = grid[window.slices].copy()
        some = random.random(values.shape) < random.random()
        bits = random.integers(0, 2**32, values.shape, dtype=np.uint32)
        values[some] = bits.view(np.float32)[some]
        grid[window.slices] = values
        grids.append(grid.copy())
        given_temp = temp if random.random() < 0.8 else None
        for logged_number, record in writer.add(window, values, given_temp, number):
            back.take(record)
            assert back.values.tobytes() == grids[logged_number].tobytes()
    for _, record in writer.drain():
        back.take(record)
    assert back.values.tobytes() == grid.tobytes()


def test_a_reading_that_lacks_its_front_or_band() -> None:
    temp, merged = next(readings("bayes", 1))
    nothing = np.zeros_like(temp.band)
    for changed in ({"band": nothing}, {"free": nothing}, {"band": nothing, "free": nothing}):
        writer: LogEncoder[int] = LogEncoder(GRID, "probability", 0.5, predicts=True)
        part = dataclasses.replace(temp, **changed)
        records = writer.add(merged.window, merged.values, part, 0) + writer.drain()
        back = reader("bayes")
        for _, record in records:
            back.take(record)
        assert back.values[merged.window.slices].tobytes() == merged.values.tobytes()


@settings(deadline=None, max_examples=6)
@given(
    scale=st.floats(0.3, 3.0), low=st.floats(0.05, 0.9), seed=st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_a_smooth_function_is_found_to_ten_digits(scale: float, low: float, seed: int) -> None:
    x = np.random.default_rng(seed).uniform(0.0, 2.5, 30_000)
    y = low + (1.0 - low) * np.exp(-((x / scale) ** 2))
    table = fit_table(x, y)
    assert table is not None
    # In the last cells of the table a cubic lacks its neighbour; what misses there is kept apart.
    end_m = 2.0 * table.spacing_m
    inner = (x > end_m) & (x < 2.5 - end_m)
    assert inner.mean() > 0.95
    got = look_up(table.cubics(), table.spacing_m, x[inner])
    assert np.abs(got / y[inner] - 1.0).max() < 1e-9


def test_one_value_needs_few_knots_and_noise_makes_no_table() -> None:
    x = np.linspace(0.0, 30.0, 5000)
    table = fit_table(x, np.full(5000, 0.3))
    assert table is not None
    assert len(table.knots) < 10
    assert (look_up(table.cubics(), table.spacing_m, x) == 0.3).all()
    assert fit_table(x, np.random.default_rng(1).random(5000) + 0.1) is None
    assert fit_table(x[:5], x[:5] + 1.0) is None


def test_beyond_its_end_a_table_changes_nothing() -> None:
    table = fit_table(np.linspace(0, 1, 9000), np.exp(-np.linspace(0, 1, 9000)))
    assert table is not None
    far = look_up(table.cubics(), table.spacing_m, np.array([5.0, 100.0]))
    assert (far == 1.0).all()
