"""The parts of the recording's writer: tiles, pictures, entity names, thinning."""

from __future__ import annotations

import dataclasses
import math
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import MadeRun, temp_grid

from mapping.grid import GridGeometry, Window
from mapping.update_rules import UPDATE_RULES, UpdateRule
from mapping.update_rules.rules import Cells
from mapping.update_rules.state import start
from replay.rrd import layout
from replay.rrd.background import Background, done
from replay.rrd.pictures import (
    SLACK,
    STRENGTHS,
    UNSEEN,
    beam_outline,
    percent_classes,
    percent_names,
    strength_classes,
    strength_names,
)
from replay.rrd.thinning import Thinning
from replay.rrd.tiles import LayerTiles


@given(rows=st.integers(1, 5000), cols=st.integers(1, 5000))
def test_tiles_cover_every_cell_once_and_are_few(rows: int, cols: int) -> None:
    tiling = layout.tiling_for(GridGeometry((0.0, 0.0), 0.01, rows, cols))
    windows = [tiling.window(*place) for place in tiling]
    assert 1 <= len(windows) <= 1024
    assert sum(w.rows * w.cols for w in windows) == rows * cols
    assert all(w.row0 + w.rows <= rows and w.col0 + w.cols <= cols for w in windows)
    assert not any(w.empty for w in windows)
    corners = {(w.row0, w.col0) for w in windows}
    assert len(corners) == len(windows)
    assert all(row % tiling.side == 0 and col % tiling.side == 0 for row, col in corners)


@pytest.mark.parametrize(("rows", "cols", "side", "results"), [
    (400, 600, 75, 600), (777, 1231, 77, 1024), (4000, 4000, 160, 1024), (9, 7, 9, 9),
])  # fmt: skip
def test_tiles_are_small_and_even(rows: int, cols: int, side: int, results: int) -> None:
    """Larger ones than of 250 cells do not compress: the version before is too far back."""
    geometry = GridGeometry((0.0, 0.0), 0.01, rows, cols)
    assert layout.tiling_for(geometry).side == side
    assert layout.results_tiling_for(geometry).side == results


@pytest.mark.parametrize("name", ["ping", "left / 2nd: x", "Ünder", "a.b-c_d"])
def test_names_of_layers_stay_one_part_of_a_path(name: str) -> None:
    part = layout.layer_root(name).removeprefix(f"{layout.MAP}/layers/")
    assert part.replace("\\", "") == name
    assert all(part[i - 1] == "\\" for i, letter in enumerate(part) if letter in "/ :")


def test_a_window_begins_at_its_cells_outer_corner() -> None:
    geometry = GridGeometry((-1.0, 2.0), 0.05, 100, 100)
    assert layout.corner_m(geometry, Window(40, 20, 3, 3)) == pytest.approx((0.0, 4.0))


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), updates=st.integers(1, 6))
def test_exactly_the_tiles_that_changed_are_written(seed: int, updates: int) -> None:
    random = np.random.default_rng(seed)
    geometry = GridGeometry((0.0, 0.0), 0.1, int(random.integers(1, 200)), 150)
    state = LayerTiles(layout.tiling_for(geometry))
    assert not state.exact
    state.begin("probability", "bayes")
    assert state.exact, "what a cell begins with is known without a tile"
    written = np.full(geometry.shape, 0.5, np.float32)
    for _ in range(updates):
        row0, col0 = int(random.integers(geometry.rows)), int(random.integers(geometry.cols))
        window = Window(
            row0, col0, int(random.integers(1, geometry.rows - row0 + 1)),
            int(random.integers(1, geometry.cols - col0 + 1)),
        )  # fmt: skip
        values = random.choice(
            np.array([0.5, 0.25, 0.75], np.float32), size=(window.rows, window.cols)
        )
        before = state.values.copy()
        state.update(window, values, values)
        assert state.values[window.slices].tobytes() == values.tobytes()
        pending = {place for place, _ in state.take_inexact()}
        for place in state.tiling:
            part = state.tiling.window(*place).slices
            changed = not np.array_equal(before[part], state.values[part])
            assert (place in pending) == changed
        for place in pending:
            part = state.tiling.window(*place).slices
            written[part] = state.values[part]
        assert state.exact
    assert np.array_equal(written, state.values)
    assert state.take_inexact() == []


def test_a_picture_is_written_when_the_picture_changes() -> None:
    geometry = GridGeometry((0.0, 0.0), 0.1, 10, 10)
    state = LayerTiles(layout.tiling_for(geometry))
    state.begin("probability")
    assert (state.picture == UNSEEN).all()
    assert state.take_undrawn() == [], "tiles that nothing was seen of are not drawn"
    window, p = Window(2, 3, 1, 1), np.array([[0.7]], np.float32)
    state.update(window, p, p)
    assert state.take_undrawn() == [], "a cell that no reading touched looks as before"
    state.see(window, np.ones((1, 1), bool))
    state.update(window, p, p)
    (((row, col), picture),) = state.take_undrawn()
    assert (row, col) == (0, 0)
    assert picture[2, 3] == 70
    assert (picture == UNSEEN).sum() == picture.size - 1
    state.update(window, p + np.float32(0.001), p + np.float32(0.001))
    assert state.take_undrawn() == []
    assert len(state.take_inexact()) == 1


@pytest.mark.parametrize(("kind", "value"), [("probability", 0.5), ("odds", 1.0), ("count", 0.0)])
def test_untouched_cells_hold_what_the_rule_starts_from(kind: str, value: float) -> None:
    state = LayerTiles(layout.tiling_for(GridGeometry((0.0, 0.0), 0.1, 3, 3)))
    assert state.begin(kind)
    assert not state.begin(kind)
    assert (state.values == value).all()


def test_white_is_free_black_is_occupied_and_unknown_is_neither() -> None:
    probability = np.array([[0.0, 1.0, 0.5, 0.123, 0.5]], np.float32)
    observed = np.array([[True, True, True, True, False]])
    classes = percent_classes(probability, observed)
    assert classes.tolist() == [[0, 100, 50, 12, UNSEEN]]
    colours = {number: colour for number, _, colour in percent_names()}
    names = {number: name for number, name, _ in percent_names()}
    assert colours[0] == (255, 255, 255, 255)
    assert colours[100] == (0, 0, 0, 255)
    assert names[12] == "12 % occupied"
    assert names[UNSEEN] == "never seen"
    assert len({colours[number][:3] for number in colours}) == len(colours)


@settings(deadline=None)
@given(p=st.floats(-0.5, 0.5, allow_nan=False))
def test_strength_names_state_the_range_that_a_difference_lies_in(p: float) -> None:
    number = int(strength_classes(np.array([p]), np.array([True]))[0])
    names = {each: name for each, name, _ in strength_names()}
    assert 1 <= number <= 2 * len(STRENGTHS)
    *word, _, low, _, high, _ = names[number].split()
    assert " ".join(word) == ("more occupied" if p > 0 else "more free")
    assert float(low) - 1e-9 <= 100 * abs(p) <= float(high) + 1e-9
    assert strength_classes(np.array([p]), np.array([False]))[0] == 0


def test_a_stronger_difference_has_a_stronger_colour() -> None:
    alphas = [colour[3] for _, _, colour in strength_names()]
    half = len(STRENGTHS)
    assert alphas[0] == 0
    for side in (alphas[1 : half + 1], alphas[half + 1 :]):
        assert side == sorted(side)
        assert len(set(side)) == half


def test_a_beam_is_outlined_out_to_its_range() -> None:
    beam = MadeRun().beam(0)
    outline, axis = beam_outline(beam)
    origin = np.array([beam.world_from_sensor.x_m, beam.world_from_sensor.y_m])
    assert np.allclose(outline[[0, -1]], origin)
    assert np.allclose(np.linalg.norm(outline[1:-1] - origin, axis=1), beam.ranges_m[0])
    assert np.allclose(axis[1], beam.points_m[0])
    edges = outline[[1, -2]] - origin
    angle = np.arctan2(edges[1, 1], edges[1, 0]) - np.arctan2(edges[0, 1], edges[0, 0])
    assert angle % (2 * math.pi) == pytest.approx(beam.beam_width_rad)
    nothing = dataclasses.replace(beam, ranges_m=np.array([np.inf]))
    assert np.allclose(np.linalg.norm(beam_outline(nothing)[0][1:-1] - origin, axis=1), 4.0)
    scan = dataclasses.replace(
        beam, bearings_rad=np.array([-1.0, 0.0, 1.0]), ranges_m=np.array([1.0, np.inf, 2.0])
    )
    (strip,) = beam_outline(scan)
    assert np.linalg.norm(strip[1:-1] - origin, axis=1) == pytest.approx([1.0, 4.0, 2.0])


def simulate(
    thinning: Thinning, readings: int, picture_bytes: int, exact_bytes: int, patch_bytes: int
) -> tuple[int, int]:
    """A session with such costs, reviewed every 50 readings: the size, and how many were shown."""
    size = shown = 0
    for number in range(readings):
        if number and number % 50 == 0:
            thinning.review(size, number / readings)
        detail = thinning.next()
        if detail.shown:
            shown += 1
            size += picture_bytes + exact_bytes * detail.exact + patch_bytes * detail.changes
    return size, shown


def test_nothing_is_left_out_when_all_fits() -> None:
    thinning = Thinning(1e8)
    size, shown = simulate(thinning, 2000, 10_000, 20_000, 3_000)
    assert (size, shown) == (2000 * 33_000, 2000)
    assert thinning.left_out == ""


def test_exact_values_go_before_readings_do() -> None:
    thinning = Thinning(1e8)
    size, shown = simulate(thinning, 5000, 10_000, 100_000, 3_000)
    assert size <= 1e8
    assert shown == 5000
    assert "every reading is shown" in thinning.left_out
    assert "exact values are kept at one of" in thinning.left_out


@settings(deadline=None, max_examples=80)
@given(
    readings=st.integers(1500, 6000), picture=st.integers(1_000, 60_000),
    exact=st.integers(0, 200_000), patch=st.integers(0, 20_000),
)  # fmt: skip
def test_a_budget_is_never_passed(readings: int, picture: int, exact: int, patch: int) -> None:
    thinning = Thinning(6e7)
    size, shown = simulate(thinning, readings, picture, exact, patch)
    assert size <= 6e7
    assert shown >= 1
    wanted = readings * (picture + exact + patch)
    assert (thinning.left_out == "") == (wanted <= 6e7) or wanted > 0.8 * 6e7


def test_what_the_user_asked_to_leave_out_is_left_out() -> None:
    thinning = Thinning(1e9, every=4)
    shown = [number for number in range(40) if thinning.next().shown]
    assert shown == list(range(0, 40, 4))


def test_of_a_session_without_a_length_nothing_is_predicted() -> None:
    thinning = Thinning(1000.0)
    thinning.next()
    assert thinning.review(10**9, 0.0) == ""


@pytest.mark.parametrize("rule", ["count", "sum"])
def test_a_picture_of_shares_is_right_at_every_step(rule: str) -> None:
    """When the largest value changes, all cells look different, not only those of the reading."""
    run = MadeRun(sensors=(("ping", 38.0),), readings=25)
    state, merging = LayerTiles(layout.tiling_for(run.geometry)), start(rule, run.geometry)
    state.begin(UPDATE_RULES[rule].kind, rule)
    drawn = np.full(run.geometry.shape, UNSEEN, np.uint8)
    elsewhere = 0
    for number in range(run.readings):
        temp = temp_grid(run.beam(number), run.geometry)
        state.see(temp.window, temp.band | temp.free)
        merged = merging.merge(temp)
        state.update(merged.window, merged.values, merged.probability)
        before = drawn.copy()
        for place, picture in state.take_undrawn():
            drawn[state.tiling.window(*place).slices] = picture
        true = 100.0 * merging.layer("ping").probability.astype(np.float64)
        assert np.array_equal(drawn == UNSEEN, ~state.observed)
        assert np.abs(drawn - true)[state.observed].max() <= SLACK + 1e-3
        before[merged.window.slices] = drawn[merged.window.slices]
        elsewhere += int((before != drawn).sum())
    assert elsewhere > 0
    for place, picture in state.take_undrawn(whole=True):
        drawn[state.tiling.window(*place).slices] = picture
    expected = percent_classes(merging.layer("ping").probability, state.observed)
    # A float32 may fall on the other side of a border between two shades.
    assert (np.abs(drawn.astype(int) - expected) <= 2 * (expected != UNSEEN)).all()
    assert (drawn != expected).mean() < 1e-3
    assert state.take_undrawn(whole=True) == []


def test_a_rule_of_ones_own_may_start_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    class Sceptic(UpdateRule):
        name, kind, start = "sceptic", "doubt", {"doubt": 0.25}

        def values(self, cells: Cells) -> np.ndarray:
            return 2.0 * cells["doubt"]

    monkeypatch.setitem(UPDATE_RULES, "sceptic", Sceptic())
    state = LayerTiles(layout.tiling_for(GridGeometry((0.0, 0.0), 0.1, 3, 3)))
    assert state.begin("doubt", "sceptic")
    assert (state.values == 0.5).all()
    assert state.exact


def test_background_work_is_done_in_order_and_its_errors_come_back() -> None:
    background, order = Background(), []
    for number in range(200):
        background.do(order.append, number)
    background.wait()
    assert order == list(range(200))
    background.do(int, "no number")
    with pytest.raises(ValueError, match="no number"):
        background.wait()
    assert background.do(len, "abc").result() == 3
    assert done("here").result() == "here"


def test_background_work_does_not_pile_up() -> None:
    background, gate, behind = Background(), threading.Event(), []
    threading.Timer(0.2, gate.set).start()
    started = 0

    def wait() -> None:
        nonlocal started
        started += 1
        gate.wait()

    for number in range(100):
        background.do(wait)
        behind.append(number + 1 - started)
    assert max(behind) <= 66
    background.wait()
    assert started == 100
