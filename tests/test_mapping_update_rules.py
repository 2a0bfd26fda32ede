"""Many readings: the worked figures, what is the same thing, and what never breaks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.config import (
    MappingConfig,
    ReportedSensor,
    load_config,
    resolve_sensor,
    validate,
)
from mapping.config_text import commented_toml
from mapping.grid import GridGeometry, Window
from mapping.parameters import Table
from mapping.sensor_model import make_temp_grid
from mapping.update_rules import (
    UPDATE_RULES,
    combine_masses,
    log_odds,
    start,
)
from mapping.update_rules.axis import axis_cells
from mapping.update_rules.pooled_weights import SHIPPED, as_table, weights_of
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Radiation

PING = resolve_sensor(ReportedSensor("ping", Radiation.ULTRASOUND), MappingConfig(), mounted=False)
ROW = GridGeometry((0.0, 0.0), 0.1, 1, 8)


def beam_of(d, *, x=0.05, y=0.05, heading=0.0, width=0.02, bearings=(0.0,), reach=0.75):
    pose = SE2(x, y, heading)
    return Beam(
        number=0, t_ns=0, sensor="ping", layer="sonar", world_from_base=pose,
        world_from_sensor=pose, bearings_rad=np.array(bearings, float),
        ranges_m=np.atleast_1d(np.array(d, float)), beam_width_rad=width, reach_m=reach,
    )  # fmt: skip


def temp_of(probability, band=None, geometry=ROW, window=None):
    """A temp grid with just this evidence for the first row of cells."""
    evidence = np.atleast_2d(np.array(probability, float))
    band = evidence > 0.5 if band is None else np.atleast_2d(band)
    window = window or Window(0, 0, *evidence.shape)
    return TempGrid(beam_of(math.nan), geometry, window, evidence, band, ~band & (evidence != 0.5))


def merged(rule, readings):
    state = start(rule, ROW)
    for reading in readings:
        state.merge(temp_of([*reading, *[0.5] * (8 - len(reading))]))
    return state.layer("sonar")


# --- the chapter's figures --------------------------------------------------------------------


@pytest.mark.parametrize("rule", ["bayes", "odds"])
def test_the_chapters_worked_example(rule):
    assert merged(rule, [[0.5582428486]]).probability[0, 0] == pytest.approx(0.5582428486, abs=1e-7)
    state = start(rule, ROW)
    state.merge(temp_of([0.5582428486] + [0.5] * 7))
    exact = UPDATE_RULES["bayes"].values(state.cells)[0, 0]  # before it is rounded to float32
    assert exact == pytest.approx(0.5582428486, abs=1e-8)


def test_count_and_its_thresholds():
    layer = merged("count", [[0.6, 0.6, 0.4], [0.6, 0.6], [0.6], [0.6]])
    np.testing.assert_array_equal(layer.values[0, :3], [4, 2, 0])
    np.testing.assert_array_equal(layer.probability[0, :3], [1.0, 0.5, 0.0])
    assert layer.kind == "count"
    kept = [(layer.probability[0, :4] >= share).tolist() for share in (0.25, 0.5, 0.75)]
    assert kept == [[True, True, False, False], [True, True, False, False],
                    [True, False, False, False]]  # fmt: skip


def test_binary_never_forgets():
    layer = merged("binary", [[0.6, 0.5, 0.4], [0.1, 0.5, 0.4]])
    np.testing.assert_array_equal(layer.values[0, :3], [1, 0, 0])
    np.testing.assert_array_equal(layer.observed[0, :4], [True, False, True, False])


def test_sum_adds_likelihoods_and_shows_them_against_the_largest():
    layer = merged("sum", [[0.55, 0.6], [0.55, 0.4]])
    np.testing.assert_allclose(layer.values[0, :3], [0.2, 0.0, 0.0], atol=1e-7)
    np.testing.assert_allclose(layer.probability[0, :3], [1.0, 0.0, 0.0], atol=1e-7)


def test_a_reading_of_all_regions_sums_to_the_chapters_totals():
    """One cell in each region, by the chapter's tables, with only the distance modelled."""
    for regions, total in ((6, 0.9972), (12, 0.9974)):
        sensor = replace(PING, model="regions", regions=regions, gaussian="distance",
                         emptiness="none", range_error=0.5, rasteriser="cells")  # fmt: skip
        d = 2.0
        size = 2.0 * d * 0.5 / regions
        grid = GridGeometry((0.0, 0.0), size, 1, 4 * regions)
        # The sensor stands at a cell's corner, so that each cell's centre lies inside one region.
        steps = d * 0.5 / size
        assert steps == pytest.approx(round(steps))
        beam = beam_of(d, x=0.0, y=size / 2, width=1e-3, reach=9.0)
        state = start("sum", grid)
        state.merge(make_temp_grid(beam, sensor, grid))
        assert state.layer("sonar").values.sum() == pytest.approx(total, abs=1e-6)


# --- Bayes is odds is log-odds ----------------------------------------------------------------

READINGS = st.lists(st.floats(0.3, 0.7), min_size=1, max_size=12)


def bayes_in_double(readings):
    belief = 0.5
    for t in readings:
        belief = t * belief / (t * belief + (1 - t) * (1 - belief))
    return belief


@settings(deadline=None, max_examples=200)
@given(READINGS, st.randoms(use_true_random=False))
def test_bayes_is_odds_is_log_odds_in_any_order(readings, random):
    expected = bayes_in_double(readings)
    odds = math.prod(t / (1 - t) for t in readings)
    shuffled = random.sample(readings, len(readings))
    for rule in ("bayes", "odds"):
        for order in (readings, shuffled):
            layer = merged(rule, [[t] for t in order])
            assert layer.probability[0, 0] == pytest.approx(expected, abs=1e-5)
    assert layer.values[0, 0] == pytest.approx(odds, rel=1e-5)
    assert odds / (1 + odds) == pytest.approx(expected, abs=1e-9)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60))
def test_any_readings_leave_bayes_within_the_clamp(readings):
    layer = merged("bayes", [[t] for t in readings])
    assert 1e-6 <= layer.probability[0, 0] <= 1 - 9e-7


def test_log_odds_of_the_ends_are_finite():
    np.testing.assert_allclose(log_odds(np.array([0.0, 0.5, 1.0])), [-13.8, 0.0, 13.8])
    assert log_odds(np.array([0.7]))[0] == pytest.approx(math.log(0.7 / 0.3), abs=1e-12)


def test_the_merging_kernel_is_like_its_twin():
    draw = np.random.default_rng(3)
    from mapping.kernels import merging
    from mapping.kernels.batch.steps import ONE

    belief = np.round(draw.uniform(-13.8, 13.8, (30, 40)) * ONE).astype(np.int32)
    evidence = np.where(draw.random((30, 40)) < 0.3, 0.5, draw.random((30, 40)))
    evidence[0, :3] = [0.0, 1.0, 1e-300]
    expected = belief / ONE
    for row in range(30):
        for col in range(40):
            p = evidence[row, col]
            if p == 0.0 or p == 1.0:
                step = 13.8 if p else -13.8
            else:
                step = max(-13.8, min(13.8, math.log(p / (1 - p))))
            expected[row, col] = max(-13.8, min(13.8, expected[row, col] + step))
    whole = np.full((33, 48), 7, np.int32)
    whole[2:32, 5:45] = belief
    merging.add_log_odds(whole, 2, 5, evidence)
    np.testing.assert_allclose(whole[2:32, 5:45] / ONE, expected, atol=1 / ONE)
    whole[2:32, 5:45] = 7
    assert (whole == 7).all()


# --- Dempster-Shafer --------------------------------------------------------------------------


def masses(*triples):
    return tuple(np.array(v, float) for v in zip(*triples, strict=True))


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [  # conflict, occupied, empty, unknown, pignistic probability
        ((0.4, 0, 0.6), (0.6, 0, 0.4), (0, 0.76, 0, 0.24, 0.88)),
        ((0.4, 0, 0.6), (0, 0.6, 0.4), (0.24, 0.210526, 0.473684, 0.315789, 0.368421)),
        ((0.7, 0.1, 0.2), (0.7, 0.1, 0.2), (0.14, 0.895349, 0.058140, 0.046512, 0.918605)),
        ((0.9, 0, 0.1), (0, 0.9, 0.1), (0.81, 0.473684, 0.473684, 0.052632, 0.5)),
        ((0.8, 0.2, 0), (0.6, 0.4, 0), (0.44, 0.857143, 0.142857, 0, 0.857143)),
        ((0.96875, 0, 0.03125), (0, 0.5, 0.5), (0.484375, 0.939394, 0.030303, 0.030303, 0.954545)),
    ],
)
def test_dempsters_rule_on_worked_cases(first, second, expected):
    o, e, u, conflict = combine_masses(masses(first), masses(second))
    found = [conflict[0], o[0], e[0], u[0], o[0] + u[0] / 2]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_three_masses_in_any_order():
    given_masses = [(0.5, 0.1, 0.4), (0.2, 0.6, 0.2), (0.3, 0.3, 0.4)]
    for a, b, c in [(0, 1, 2), (2, 0, 1), (1, 2, 0), (2, 1, 0)]:
        o, e, u, _ = combine_masses(masses(given_masses[a]), masses(given_masses[b]))
        o, e, u, _ = combine_masses((o, e, u), masses(given_masses[c]))
        np.testing.assert_allclose([o[0], e[0], u[0]], [0.44, 0.496, 0.064], atol=1e-9)


def test_the_rule_on_repeated_and_contradicting_readings():
    layer = merged("dempster-shafer", [[0.75]] * 5)  # p 0.75: half the mass occupied
    assert layer.extra["occupied"][0, 0] == pytest.approx(1 - 0.5**5, abs=1e-6)
    assert layer.extra["unknown"][0, 0] == pytest.approx(0.5**5, abs=1e-6)
    assert layer.extra["conflict"][0, 0] == 0.0
    layer = merged("dempster-shafer", [[0.75]] * 5 + [[0.25]])
    found = [layer.extra[k][0, 0] for k in ("conflict", "occupied", "empty", "unknown")]
    np.testing.assert_allclose(found, [0.484375, 0.939394, 0.030303, 0.030303], atol=1e-6)
    assert layer.probability[0, 0] == pytest.approx(0.954545, abs=1e-6)
    assert layer.kind == "mass"
    np.testing.assert_array_equal(layer.values, layer.extra["occupied"])
    assert layer.extra["unknown"][0, 1] == 1.0


@settings(deadline=None, max_examples=150)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=15), st.randoms(use_true_random=False))
def test_masses_sum_to_one_and_commute(readings, random):
    layer = merged("dempster-shafer", [[t] for t in readings])
    other = merged("dempster-shafer", [[t] for t in random.sample(readings, len(readings))])
    total = sum(layer.extra[name] for name in ("occupied", "empty", "unknown"))
    np.testing.assert_allclose(total, 1.0, atol=1e-6)
    # Readings of nearly 0 or 1 reach the floor of the unknown mass, where order shows.
    if all(0.05 <= t <= 0.95 for t in readings) and layer.extra["unknown"][0, 0] > 1e-5:
        for name in ("occupied", "empty", "unknown", "conflict"):
            np.testing.assert_allclose(layer.extra[name], other.extra[name], atol=1e-5)


@settings(deadline=None, max_examples=100)
@given(st.floats(0.01, 0.99), st.floats(0.01, 0.99))
def test_without_unknown_mass_it_is_bayes(a, b):
    o, e, u, _ = combine_masses(masses((a, 1 - a, 0)), masses((b, 1 - b, 0)))
    assert o[0] == pytest.approx(bayes_in_double([a, b]), abs=1e-12)
    assert o[0] + e[0] == pytest.approx(1.0)
    assert u[0] == 0.0


@settings(deadline=None, max_examples=100)
@given(*[st.tuples(st.floats(0.01, 1), st.floats(0.01, 1), st.floats(0.01, 1))] * 3)
def test_dempsters_rule_commutes_and_groups_as_it_likes(a, b, c):
    a, b, c = (masses(tuple(v / sum(m) for v in m)) for m in (a, b, c))
    for one, other in (
        (combine_masses(a, b)[:3], combine_masses(b, a)[:3]),
        (combine_masses(combine_masses(a, b)[:3], c)[:3],
         combine_masses(a, combine_masses(b, c)[:3])[:3]),
    ):  # fmt: skip
        np.testing.assert_allclose(one, other, atol=1e-9)
        assert sum(v[0] for v in one) == pytest.approx(1.0)


# --- HIMM -------------------------------------------------------------------------------------


def himm_after(ranges):
    sensor = replace(PING, model="peak", range_error=0.0)
    state = start("himm", ROW)
    seen = []
    for d in ranges:
        state.merge(make_temp_grid(beam_of(d), sensor, ROW))
        seen.append(state.layer("sonar").values[0].astype(int).tolist())
    return seen


def test_himm_counts_up_by_three_and_down_by_one():
    near, far = 0.3, 0.6  # the obstacle in cell 3, and a beam that passes through it
    seen = [row[3] for row in himm_after([near] * 6 + [far] * 4 + [near] * 2 + [far] * 18)]
    expected = [3, 6, 9, 12, 15, 15, 14, 13, 12, 11, 14, 15, *range(14, -1, -1), 0, 0, 0]
    assert seen == expected


def test_himm_touches_the_axis_only_and_excludes_the_hit():
    grid = GridGeometry((0.0, 0.0), 0.1, 10, 10)
    sensor = replace(PING, model="fading")
    temp = make_temp_grid(beam_of(0.5, x=0.05, y=0.55, width=1.2), sensor, grid)
    state = start("himm", grid)
    for _ in range(2):
        state.merge(temp)
    values = state.layer("sonar").values
    np.testing.assert_array_equal(np.argwhere(values > 0), [[5, 5]])
    assert values[5, 5] == 6
    assert (temp.band | temp.free).sum() > 12
    assert state.layer("sonar").probability[5, 5] == pytest.approx(6 / 15)


def test_himm_of_a_beam_that_saw_nothing_only_counts_down():
    sensor = replace(PING, model="peak", range_error=0.0, no_echo="empties")
    state = start("himm", ROW)
    state.merge(make_temp_grid(beam_of(0.3), sensor, ROW))
    state.merge(make_temp_grid(beam_of(math.inf), sensor, ROW))
    assert state.layer("sonar").values.max() == 2
    state.merge(make_temp_grid(beam_of(math.inf), replace(sensor, no_echo="skipped"), ROW))
    assert state.layer("sonar").values.max() == 2


@settings(deadline=None, max_examples=200)
@given(
    st.floats(-0.2, 1.2), st.floats(-0.2, 1.2), st.floats(-8, 8), st.floats(0.0, 1.5)
)  # fmt: skip
def test_axis_cells_are_those_that_points_of_the_axis_lie_in(x, y, heading, d):
    grid = GridGeometry((0.0, 0.0), 0.1, 10, 10)
    temp = make_temp_grid(beam_of(d, x=x, y=y, heading=heading, reach=2.0), PING, grid)
    passed, hit = axis_cells(temp)
    found = {(r + temp.window.row0, c + temp.window.col0) for r, c in np.argwhere(passed | hit)}
    along = np.linspace(0.0, d, 4001)
    points = np.column_stack([x + along * math.cos(heading), y + along * math.sin(heading)])
    cells = grid.cells_of(points)
    expected = {tuple(map(int, c)) for c in cells[grid.contains(cells)]}
    assert expected - found == set() or _only_by_rounding(points, grid)
    assert hit.sum() <= 1
    for row, col in found - expected:  # a corner cut that fell between the sampled points
        low = np.array([col, row]) * 0.1
        outside = np.maximum(np.maximum(low - points, points - low - 0.1), 0.0)
        assert np.hypot(*outside.T).min() < 1e-3


def _only_by_rounding(points, grid):
    scaled = points / grid.resolution_m
    return bool((np.abs(scaled - np.round(scaled)) < 1e-9).any())


# --- every rule -------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", UPDATE_RULES)
def test_one_spot_100_000_times_is_neither_nan_nor_stuck(rule):
    """Certain and uncertain readings alike; afterwards the opposite moves what listens to it."""
    cells = {k: np.full((1, 4), v) for k, v in UPDATE_RULES[rule].start.items()}
    evidence, other = temp_of([1.0, 0.7, 0.3, 0.0]), temp_of([0.0, 0.3, 0.7, 1.0])
    if rule == "pooled":  # which asks for the range
        beam = replace(evidence.beam, ranges_m=np.array([0.3]))
        evidence, other = replace(evidence, beam=beam), replace(other, beam=beam)
    himm_sensor = replace(PING, model="peak", range_error=0.0)
    if rule == "himm":
        evidence = make_temp_grid(beam_of(0.3), himm_sensor, ROW)
        other = make_temp_grid(beam_of(0.3, x=0.35, heading=math.pi), himm_sensor, ROW)
    for _ in range(100_000):
        UPDATE_RULES[rule].merge(cells, evidence)
    before = UPDATE_RULES[rule].values(cells).copy()
    assert np.isfinite(before).all()
    probability = UPDATE_RULES[rule].probability(cells, float(before.max()))
    assert ((probability >= 0) & (probability <= 1)).all()
    for _ in range(40):
        UPDATE_RULES[rule].merge(cells, other)
    after = UPDATE_RULES[rule].values(cells)
    assert np.isfinite(after).all()
    if rule in ("bayes", "odds", "dempster-shafer"):
        swapped = UPDATE_RULES[rule].probability(cells, 1.0)[0]
        assert (swapped[:2] < 0.5).all()
        assert (swapped[2:] > 0.5).all()
    elif rule == "sum":
        assert (np.abs(after - before) > 10).all()
    elif rule in ("himm", "pooled"):
        assert not np.array_equal(after, before)
    elif rule == "saturating":
        assert (after != before).all()
    else:  # seen once is seen, and a count never sinks: they do not listen to emptiness
        assert (after >= before).all()


@pytest.mark.parametrize("rule", UPDATE_RULES)
def test_a_merged_grid_is_the_maps_own_window(rule):
    grid = GridGeometry((-1.0, -1.0), 0.05, 40, 40)
    sensor = replace(PING, model="peak")
    draw = np.random.default_rng(5)
    state = start(rule, grid)
    shown = state.layer("sonar").probability.copy()
    for _ in range(25):
        x, y, heading = draw.uniform(-0.8, 0.8, 3) * (1, 1, 5)
        beam = beam_of(draw.uniform(0.1, 0.9), x=x, y=y, heading=heading, width=0.6)
        after = state.merge(make_temp_grid(beam, sensor, grid))
        window = after.window.slices
        layer = state.layer("sonar")
        np.testing.assert_array_equal(after.values, layer.values[window])
        np.testing.assert_array_equal(after.probability, layer.probability[window])
        np.testing.assert_array_equal(after.previous, shown[window])
        shown[window] = after.probability
        assert (after.rule, after.layer, after.kind) == (rule, "sonar", layer.kind)
        assert not after.values.flags.writeable
        if UPDATE_RULES[rule].against_largest:
            assert state.largest == pytest.approx(float(layer.values.max()), rel=1e-6)


def test_the_largest_sinks_with_the_sum_that_held_it():
    state = start("sum", ROW)
    state.merge(temp_of([0.9] + [0.5] * 6 + [0.6]))
    after = state.merge(temp_of([0.1]))  # the largest was 0.8, now it is 0.2, far off the window
    assert state.largest == pytest.approx(0.2)
    assert after.probability[0, 0] == 0.0
    assert state.layer("sonar").probability[0, 7] == 1.0


def test_samples_without_a_second_grid_are_merged_each():
    sensor = replace(PING, model="regions", gaussian="none", emptiness="none", rasteriser="arcs")
    grid = GridGeometry((-0.5, -0.5), 0.02, 50, 80)
    beam = beam_of(0.6, x=0.0, y=0.0, width=PING.beam_width_rad)
    counts = {}
    for second_grid in (True, False):
        state = start("count", grid)
        state.merge(make_temp_grid(beam, replace(sensor, second_grid=second_grid), grid))
        counts[second_grid] = state.layer("sonar").values
    assert counts[True].max() == 1
    assert set(np.unique(counts[False])) >= {0, 1, 2}
    np.testing.assert_array_equal(counts[True] > 0, counts[False] > 0)


def test_an_unknown_rule_is_answered_with_the_nearest():
    with pytest.raises(BadInput, match=r"unknown update rule 'baye'; the nearest .* bayes"):
        start("baye", ROW)


def test_layers_are_locked_copies():
    state = start("dempster-shafer", ROW)
    layer = state.layer("sonar")
    state.merge(temp_of([0.9] + [0.5] * 7))
    assert layer.values.max() == 0.0
    for array in (layer.values, layer.probability, layer.observed, *layer.extra.values()):
        assert not array.flags.writeable


# --- what moves -------------------------------------------------------------------------------


def at_time(seconds, probability):
    temp = temp_of([probability, *[0.5] * 7])
    beam = replace(temp.beam, t_ns=round(seconds * 1e9), ranges_m=np.array([0.3]))
    return replace(temp, beam=beam)


def test_evidence_halves_in_its_half_life():
    state = start("bayes", ROW, forget_s=10.0)
    state.merge(at_time(100.0, 0.9))
    one = float(log_odds(np.array(0.9)))
    for seconds, left in ((100.0, one), (110.0, one / 2), (130.0, one / 8)):
        state.pass_time(round(seconds * 1e9))
        assert state.cells["log_odds"][0, 0] == pytest.approx(left)
    state.layer("sonar")  # looking changes nothing
    state.merge(at_time(140.0, 0.2))
    expected = one / 16 + float(log_odds(np.array(0.2)))
    assert state.cells["log_odds"][0, 0] == pytest.approx(expected)
    state.pass_time(0)  # time that steps back stands still
    assert state.cells["log_odds"][0, 0] == pytest.approx(expected)


@pytest.mark.parametrize("rule", sorted(UPDATE_RULES))
def test_every_rule_forgets_towards_what_it_began_with(rule):
    state = start(rule, ROW, forget_s=1.0)
    empty = state.layer("sonar").values
    state.merge(at_time(0.0, 0.9))
    state.pass_time(round(60e9))
    np.testing.assert_allclose(state.layer("sonar").values, empty, atol=1e-6)


# --- sums apart -------------------------------------------------------------------------------


@pytest.mark.parametrize(("hits", "misses"), [(1, 0), (3, 2), (100_000, 0), (5, 5)])
def test_saturating_follows_its_formula(hits, misses):
    state = start("saturating", ROW)
    for p, times in ((0.9, hits), (0.3, misses)):
        cells = dict(state.cells)
        one = start("saturating", ROW)
        one.merge(temp_of([p, *[0.5] * 7]))
        for name, array in one.cells.items():
            cells[name] += times * array
    above, below = hits * math.log(9.0), misses * math.log(7.0 / 3.0)
    expected = (above - below) / (1.0 + (above + below) / 7.12)
    assert state.layer("").probability[0, 0] == pytest.approx(1 / (1 + math.exp(-expected)), 1e-5)


def test_saturating_takes_the_strengths_that_suit_it():
    asked = {"sensors": {"*": {"update": "saturating"}}}
    reported = ReportedSensor("ping", Radiation.ULTRASOUND)
    sensor = resolve_sensor(reported, MappingConfig.model_validate(asked), mounted=False)
    assert (sensor.hit, sensor.miss) == (4.74, 0.41)
    asked["sensors"]["*"]["hit"] = 2.0
    sensor = resolve_sensor(reported, MappingConfig.model_validate(asked), mounted=False)
    assert (sensor.hit, sensor.miss) == (2.0, 0.41)


@pytest.mark.parametrize(("text", "words"), [
    ("fade_m = 1", "a table weights"),
    ("fade_m = 1\nmost_unpassed = 1\nbias = nan\n[weights]\nhits = 1", "misses must be a number"),
    ("[a]\n[b]", "weights of which table"),
    ("x = =", "TOML"),
])  # fmt: skip
def test_weights_that_cannot_be_used_get_one_line(tmp_path, text, words):
    file = tmp_path / "w.toml"
    file.write_text(text)
    with pytest.raises(BadInput, match=words):
        start("pooled", ROW, {"weights": str(file)}).layer("sonar")


def test_weights_stand_in_a_configuration_as_a_table(tmp_path):
    table = as_table(weights_of("sonar"))
    text = commented_toml(validate({"sensors": {"ping": {"update": "pooled", "weights": table}}}))
    (tmp_path / "c.toml").write_text(text)
    config = load_config([tmp_path / "c.toml"])
    reported = ReportedSensor("ping", Radiation.ULTRASOUND)
    sensor = resolve_sensor(reported, config, mounted=False)
    assert sensor.own["weights"] == table
    assert {sensor.own["weights"]} == {Table(table)}  # it can be counted
    rule = start("pooled", ROW, sensor.own).rule
    assert as_table(rule.learned) == table
    bad = {"sensors": {"ping": {"update": "pooled", "weights": {**table, "fade_m": 0.0}}}}
    with pytest.raises(BadInput, match="fade_m must be above 0") as caught:
        resolve_sensor(reported, validate(bad), mounted=False)
    assert "\n" not in str(caught.value)


def test_weights_may_not_turn_evidence_round(tmp_path):
    text = SHIPPED.read_text().replace("misses_near = -", "misses_near = ")
    (tmp_path / "w.toml").write_text(text)
    with pytest.raises(BadInput, match="misses_near must not be positive"):
        weights_of(f"{tmp_path / 'w.toml'}#sonar")
    with pytest.raises(BadInput, match="no weights 'radar'"):
        weights_of("radar")
