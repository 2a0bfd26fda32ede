"""Maps held against known walls: figures whose right value is known, and slow twins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive_scoring import cells_on, outranked, seen_on

from mapping.config import MappingConfig, load_config
from mapping.grid import GridGeometry
from mapping.kernels.visibility import mark_seen, mark_walls
from mapping.placed_session import place_session
from mapping.scoring.cells import HELD, area_under_curve, calibration, score_cells
from mapping.scoring.layers import score_layer
from mapping.scoring.lines import nearest, score_lines
from mapping.scoring.observable import observable_cells, with_silent_readings
from mapping.scoring.truth import TrueMap, TrueWalls
from recorder.geometry import SE2
from recorder.messages import Pose, Radiation, Range
from recorder.simulator.walls import rectangle

GRID = GridGeometry((-0.2, -0.2), 0.02, 100, 120)  # 2.4 x 2 m
ROOM = TrueWalls(rectangle((1.01, 0.81), 2.0, 1.6))  # its sides run through the middle of cells
SEEN = ROOM.open_cells(GRID) | ROOM.wall_cells(GRID)
INSIDE = np.array([[0.01, 0.01], [2.01, 0.01], [2.01, 1.61], [0.01, 1.61]])


def lines_of(*ends):
    return np.array(ends, np.float64).reshape(-1, 2, 2)


# --- what a sensor could see


@given(
    st.integers(0, 2**32 - 1),
    st.floats(-math.pi, math.pi),
    st.tuples(st.floats(0.1, 11.9), st.floats(0.1, 8.9)),
    st.floats(0.5, 15.0),
)
@settings(deadline=None, max_examples=150)
def test_a_ray_sees_what_the_slow_twin_sees(seed, heading_rad, start, reach):
    walls = np.random.default_rng(seed).random((9, 12)) < 0.08
    seen = np.zeros(walls.shape, np.bool_)
    mark_seen(seen, walls, np.array([[*start, heading_rad, 0.0, reach]]))
    passed = cells_on(walls.shape, start, heading_rad, reach, touched_too=True)
    assume(all(last - first > 1e-9 for first, last in passed.values()))  # else rounding decides
    expected = seen_on(walls, start, heading_rad, reach)
    assert {tuple(cell) for cell in np.argwhere(seen)} == expected


def test_a_fan_leaves_no_cell_out_up_to_its_reach():
    walls, seen = np.zeros((60, 60), np.bool_), np.zeros((60, 60), np.bool_)
    mark_seen(seen, walls, np.array([[30.0, 30.0, 0.3, math.radians(19.0), 25.0]]))
    rows, cols = np.indices(seen.shape)
    dx, dy = cols + 0.5 - 30.0, rows + 0.5 - 30.0
    bearing = np.abs((np.arctan2(dy, dx) - 0.3 + math.pi) % (2 * math.pi) - math.pi)
    inner = (np.hypot(dx, dy) < 24.0) & (bearing < math.radians(18.0))
    assert seen[inner].all()
    beside = (bearing > math.radians(45.0)) & (np.hypot(dx, dy) > 2.0)
    assert not seen[(np.hypot(dx, dy) > 26.5) | beside].any()


@given(st.tuples(*[st.floats(-2.0, 12.0)] * 4))
@settings(deadline=None, max_examples=150)
def test_wall_cells_are_those_that_the_piece_passes(ends):
    assume(math.hypot(ends[2] - ends[0], ends[3] - ends[1]) > 1e-3)
    marked = np.zeros((9, 12), np.bool_)
    mark_walls(marked, np.array([ends]))
    length = math.hypot(ends[2] - ends[0], ends[3] - ends[1])
    heading = math.atan2(ends[3] - ends[1], ends[2] - ends[0])
    passed = cells_on(marked.shape, ends[:2], heading, length)
    grazed = {cell for cell, (first, last) in passed.items() if last - first < 1e-6}
    unlike = {tuple(cell) for cell in np.argwhere(marked)} ^ set(passed)
    # Through a corner exactly, it goes by one of the two cells beside it.
    assert all(cell in grazed or _touches(cell, ends) for cell in unlike)


def _touches(cell, ends):
    """Whether a piece comes within rounding of a cell's outline only."""
    a, b = np.array(ends[:2]), np.array(ends[2:])
    places = a + np.linspace(0.0, 1.0, 4001)[:, None] * (b - a)
    inner = places - np.array([cell[1] + 0.5, cell[0] + 0.5])
    return np.abs(inner).max(axis=1).min() > 0.5 - 1e-2


def test_walls_hide_and_silent_readings_count():
    """A wall across the room: behind it nothing could be seen, before it all in the cone."""
    walls = TrueWalls(np.concatenate([ROOM.walls_m, lines_of((1.01, 0.01, 1.01, 1.61))]))
    messages = [Pose(t, SE2(0.3, 0.81, 0.0)) for t in (0, 400_000_000, 800_000_000)]
    silent, near = (
        Range(t_ns, "ping", range_m, math.radians(38.0), 0.02, 4.0, Radiation.ULTRASOUND)
        for t_ns, range_m in ((500_000_000, math.inf), (600_000_000, 0.1))
    )
    config = with_silent_readings(MappingConfig())
    seen = observable_cells(place_session([*messages, silent], config), walls, GRID)
    assert set(seen) == {"ping", "fused"}
    cells = GRID.cells_of(np.array([[0.9, 0.81], [1.01, 0.81], [1.2, 0.81], [0.4, 1.4]]))
    assert seen["ping"][tuple(cells.T)].tolist() == [True, True, False, False]
    other = observable_cells(place_session([*messages, near], config), walls, GRID)
    np.testing.assert_array_equal(seen["ping"], other["ping"])  # what was measured is no matter


def test_light_is_not_blamed_for_glass_and_sees_what_is_behind():
    """Glass across the room: a sonar sees it and nothing behind, an infrared ranger the reverse."""
    walls_m = np.concatenate([ROOM.walls_m, lines_of((0.71, 0.01, 0.71, 1.61))])
    walls = TrueWalls.of(walls_m, ["smooth"] * len(ROOM.walls_m) + ["glass"])
    messages = [Pose(t, SE2(0.3, 0.81, 0.0)) for t in (0, 400_000_000, 800_000_000)]
    for name, radiation in (("ping", Radiation.ULTRASOUND), ("dirrs", Radiation.INFRARED)):
        messages.append(Range(5 * 10**8, name, math.inf, math.radians(38.0), 0.02, 0.8, radiation))
    config = with_silent_readings(MappingConfig())
    seen = observable_cells(place_session(messages, config), walls, GRID)
    cells = tuple(GRID.cells_of(np.array([[0.6, 0.81], [0.71, 0.81], [0.9, 0.81]])).T)
    assert seen["ping"][cells].tolist() == [True, True, False]
    assert seen["dirrs"][cells].tolist() == [True, False, True]
    assert seen["fused"][cells].tolist() == [True, True, True]
    empty = np.full(GRID.shape, 0.1)  # free everywhere, the glass too
    by_light = score_cells(empty, GRID, walls, seen["dirrs"])
    assert by_light.glass_m == pytest.approx(2 * 0.44 * math.tan(math.radians(19.0)), abs=0.05)
    assert by_light.wall_cells == 0
    by_sound = score_cells(empty, GRID, walls, seen["ping"])
    assert by_sound.glass_m == 0.0
    assert by_sound.wall_cells > 10


def test_the_silent_are_kept_for_configured_sensors_too():
    config = load_config([], ['sensors.ping.no_echo="skipped"', "sensors.ping.hit=0.5"], None)
    looking = with_silent_readings(config)
    assert looking.sensors["ping"].no_echo == "empties"
    assert looking.sensors["ping"].hit == 0.5


# --- cells


def test_a_perfect_map():
    probability = np.where(ROOM.wall_cells(GRID), 1.0, 0.0)
    score = score_cells(probability, GRID, ROOM, SEEN)
    assert score.log_loss == pytest.approx(-math.log(1.0 - HELD))
    assert (score.brier, score.auc, score.iou, score.ghost_m2) == (0.0, 1.0, 1.0, 0.0)
    assert score.wall_found == 1.0
    assert score.wall_distance_p95_m < 0.01
    assert score.calibration_error == 0.0
    assert score.free_cells == 99 * 79
    assert score.wall_cells == 2 * 101 + 2 * 79


def test_an_undecided_map():
    score = score_cells(np.full(GRID.shape, 0.5), GRID, ROOM, SEEN)
    assert score.log_loss == pytest.approx(math.log(2.0))
    assert (score.brier, score.auc, score.wall_found) == (0.25, 0.5, 0.0)
    assert math.isnan(score.wall_distance_median_m)


def test_both_classes_weigh_the_same_and_are_held():
    walls = ROOM.wall_cells(GRID)
    score = score_cells(np.where(walls, 0.0, 0.2), GRID, ROOM, SEEN)
    assert score.log_loss_walls == pytest.approx(-math.log(HELD))
    assert score.log_loss_free == pytest.approx(-math.log(0.8))
    assert score.log_loss == pytest.approx((score.log_loss_free + score.log_loss_walls) / 2.0)
    assert score.brier == pytest.approx((0.04 + 1.0) / 2.0)


def test_a_ghost_lies_where_nothing_could_be_seen():
    probability = np.where(ROOM.wall_cells(GRID), 1.0, 0.0)
    probability[0:5, 0:10] = 0.9  # beyond the lower left corner, 10 x 20 cm
    score = score_cells(probability, GRID, ROOM, SEEN)
    assert score.ghost_m2 == pytest.approx(0.1 * 0.2)
    assert score.log_loss == pytest.approx(-math.log(1.0 - HELD))
    assert score.wall_distance_p95_m > 0.1


def test_how_far_occupied_cells_are_and_what_of_the_wall_they_find():
    probability = np.zeros(GRID.shape)
    row = GRID.cells_of(np.array([[1.0, 0.10]]))[0, 0]
    probability[row, :] = 1.0  # a line 9 cm above the lower wall
    probability[row, : GRID.cells_of(np.array([[0.02, 0.0]]))[0, 1]] = 0.0
    probability[row, GRID.cells_of(np.array([[2.0, 0.0]]))[0, 1] :] = 0.0
    score = score_cells(probability, GRID, ROOM, SEEN)
    assert score.wall_distance_median_m == pytest.approx(0.10, abs=0.011)
    assert score.wall_found == pytest.approx(4 * 0.04 / 7.2, abs=0.02)  # only where it meets sides


@given(
    st.lists(st.integers(0, 10), min_size=1, max_size=30),
    st.lists(st.integers(0, 10), min_size=1, max_size=30),
)
def test_the_area_is_the_share_of_pairs_in_order(free, walls):
    found = area_under_curve(np.array(free) / 10.0, np.array(walls) / 10.0)
    assert found == pytest.approx(outranked(free, walls))


def test_probabilities_drawn_as_they_promise_are_calibrated():
    rng = np.random.default_rng(3)
    p = rng.random(200_000)
    wall = rng.random(len(p)) < p
    bins, error = calibration(p[~wall], p[wall])
    assert error < 0.01
    assert sum(each.cells for each in bins) == len(p)
    for each in bins:
        assert each.occupied == pytest.approx(each.probability, abs=0.02)
    _, too_sure = calibration(p[~wall] ** 3, p[wall] ** 3)
    assert too_sure > 0.1


# --- lines


def test_the_walls_themselves_are_perfect_lines():
    score = score_lines("grid", ROOM.walls_m, GRID, ROOM, SEEN)
    assert all((w.completeness, w.correctness) == (1.0, 1.0) for w in score.within)
    assert (score.fragmentation, score.false_lines, score.lines) == (1.0, 0, 4)
    assert score.offset_m == pytest.approx(0.0, abs=1e-9)
    assert score.angle_deg == pytest.approx(0.0, abs=1e-9)
    assert score.length_m == pytest.approx(7.2)


@pytest.mark.parametrize("inwards_m", [0.03, -0.03])
def test_lines_that_lie_beside_their_walls(inwards_m):
    moved = rectangle((1.01, 0.81), 2.0 - 2 * inwards_m, 1.6 - 2 * inwards_m)
    score = score_lines("grid", moved, GRID, ROOM, SEEN)
    assert score.within[0].completeness < 0.05
    assert score.within[1].completeness > 0.99
    assert score.offset_m == pytest.approx(-inwards_m, abs=1e-6)


def test_halves_false_lines_and_directions():
    (a, b), *_ = ROOM.walls_m
    middle = (a + b) / 2.0
    halves = np.array([[a, middle], [middle, b]])
    across = lines_of((0.5, 0.75, 1.5, 0.85))  # through the open
    score = score_lines("grid", np.concatenate([halves, across]), GRID, ROOM, SEEN)
    assert score.fragmentation == 2.0
    assert score.false_lines == 1
    assert score.within[1].completeness == pytest.approx(2.0 / 7.2, abs=0.02)
    assert score.within[1].correctness == pytest.approx(2.0 / 3.0, abs=0.02)
    crossing = lines_of((1.0, -0.04, 1.0, 0.06))  # over the lower wall at a right angle
    assert score_lines("raw", crossing, GRID, ROOM, SEEN).within[1].correctness == 0.0


def test_only_the_seen_wall_must_be_explained():
    seen = SEEN.copy()
    seen[:, GRID.cells_of(np.array([[0.9, 0.0]]))[0, 1] :] = False
    left = lines_of((0.01, 0.01, 0.9, 0.01), (0.01, 0.01, 0.01, 1.61), (0.01, 1.61, 0.9, 1.61))
    score = score_lines("grid", left, GRID, ROOM, seen)
    assert score.within[1].completeness > 0.98


def test_no_lines_at_all():
    score = score_lines("grid", np.zeros((0, 2, 2)), GRID, ROOM, SEEN)
    assert score.within[1].completeness == 0.0
    assert math.isnan(score.within[1].correctness)
    assert math.isnan(score.fragmentation)


def test_the_nearest_piece_is_the_slow_twins():
    rng = np.random.default_rng(5)
    places, pieces = rng.random((40, 2)), rng.random((6, 2, 2))
    away, which = nearest(places, None, pieces)
    shares = np.linspace(0.0, 1.0, 20_001)[:, None]
    slow = np.array([
        [np.hypot(*(a + shares * (b - a) - p).T).min() for a, b in pieces] for p in places
    ])  # fmt: skip
    np.testing.assert_allclose(away, slow.min(axis=1), atol=1e-4)
    np.testing.assert_array_equal(which, slow.argmin(axis=1))


# --- a map as the truth


def test_a_true_map_has_the_walls_that_its_cells_have():
    geometry = GridGeometry((1.0, 2.0), 0.1, 8, 10)
    occupied = np.zeros(geometry.shape, np.bool_)
    occupied[2:5, 3:7] = True
    truth = TrueMap(geometry, occupied, ~occupied)
    sides = {tuple(map(tuple, np.round(piece, 9).tolist())) for piece in truth.walls_m}
    assert sides == {
        ((1.3, 2.2), (1.7, 2.2)), ((1.3, 2.5), (1.7, 2.5)),
        ((1.3, 2.2), (1.3, 2.5)), ((1.7, 2.2), (1.7, 2.5)),
    }  # fmt: skip
    np.testing.assert_array_equal(truth.wall_cells(geometry), occupied)
    np.testing.assert_array_equal(truth.open_cells(geometry), ~occupied)
    finer = GridGeometry((1.0, 2.0), 0.05, 16, 20)
    np.testing.assert_array_equal(
        truth.wall_cells(finer), np.kron(occupied, np.ones((2, 2), np.bool_))
    )
    shifted = GridGeometry((0.5, 2.0), 0.1, 8, 10)
    assert not truth.open_cells(shifted)[:, :5].any()  # of what it does not hold it knows nothing


def test_a_layer_against_a_true_map_made_of_itself():
    walls = ROOM.wall_cells(GRID)
    truth = TrueMap(GRID, walls, SEEN & ~walls)
    lines = {"grid": ROOM.walls_m}
    score = score_layer("x", np.where(walls, 1.0, 0.0), GRID, lines, truth, SEEN)
    assert (score.cells.auc, score.cells.iou) == (1.0, 1.0)
    assert score.lines_of("grid").within[0].completeness == 1.0
    assert score.lines_of("raw") is None
