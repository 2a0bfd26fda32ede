"""Lines against walls, by length."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.segment_scores import observed_steps, segment_scores, steps_along

SQUARE = np.array(
    [[[0, 0], [2, 0]], [[2, 0], [2, 2]], [[2, 2], [0, 2]], [[0, 2], [0, 0]]], np.float64
)
INSIDE = np.array([[1.0, 1.0]])


def moved_in(by_m: float) -> np.ndarray:
    """The square's walls, each moved towards its middle."""
    towards = np.array([[0, 1], [-1, 0], [0, -1], [1, 0]], np.float64)
    return SQUARE + by_m * towards[:, None, :]


def test_the_walls_themselves_are_right() -> None:
    score = segment_scores(SQUARE, SQUARE, seen_from_m=INSIDE)
    assert [(w.completeness, w.correctness) for w in score.within] == [(1.0, 1.0)] * 3
    assert (score.lines, score.walls, score.lines_per_wall) == (4, 4, 1.0)
    assert score.line_m == pytest.approx(8.0)
    assert score.wall_m == pytest.approx(8.0)
    assert (score.offset_m, score.spread_m, score.angle_rad) == (0.0, 0.0, 0.0)


def test_lines_in_front_of_their_walls() -> None:
    score = segment_scores(moved_in(0.04), SQUARE, seen_from_m=INSIDE)
    assert score.offset_m == pytest.approx(-0.04)
    assert [w.correctness for w in score.within] == [0.0, 1.0, 1.0]
    behind = segment_scores(moved_in(-0.04), SQUARE, seen_from_m=INSIDE)
    assert behind.offset_m == pytest.approx(0.04)
    assert math.isnan(segment_scores(SQUARE, SQUARE).offset_m)


def test_length_counts_not_lines() -> None:
    half = np.array([[[0, 0], [1, 0]], [[1, 0], [1, 0.5]]], np.float64)
    score = segment_scores(half, SQUARE, tolerances_m=(0.001,))
    assert score.within[0].completeness == pytest.approx(1 / 8)
    assert score.within[0].correctness == pytest.approx(2 / 3)


def test_a_wall_in_pieces_and_one_found_twice() -> None:
    pieces = np.array([[[0, 0], [0.9, 0]], [[1.1, 0], [2, 0]], [[0, 0.01], [2, 0.01]]], np.float64)
    assert segment_scores(pieces, SQUARE).lines_per_wall == 3.0


def test_the_angle_is_that_of_lines_not_of_length() -> None:
    tilted = np.array([[[0, 0], [0.5, 0.5 * math.tan(math.radians(3))]], SQUARE[1], SQUARE[2]])
    assert segment_scores(tilted[:1], SQUARE).angle_rad == pytest.approx(math.radians(3))
    assert segment_scores(tilted, SQUARE).angle_rad == pytest.approx(0.0, abs=1e-12)
    across = np.array([[[1, -1], [1, 1]]], np.float64)
    score = segment_scores(across, SQUARE)
    assert score.within[2].correctness == 0.0
    assert math.isnan(score.angle_rad)


def test_only_what_could_be_observed_has_to_be_found() -> None:
    counts = steps_along(SQUARE).piece < 2
    score = segment_scores(SQUARE[:2], SQUARE, counts=counts)
    assert score.within[0].completeness == 1.0
    assert score.wall_m == pytest.approx(4.0)


def test_nothing_against_something() -> None:
    score = segment_scores(np.zeros((0, 2, 2)), SQUARE)
    assert score.within[0].completeness == 0.0
    assert math.isnan(score.within[0].correctness)
    assert math.isnan(segment_scores(SQUARE, np.zeros((0, 2, 2))).within[0].completeness)


def test_what_a_beam_meets() -> None:
    north = observed_steps(SQUARE, INSIDE, np.array([math.pi / 2]), math.radians(20), 4.0)
    x = steps_along(SQUARE).places_m[north, 0]
    assert set(steps_along(SQUARE).piece[north]) == {2}
    assert x.min() == pytest.approx(1 - math.tan(math.radians(10)), abs=0.03)
    assert x.max() == pytest.approx(1 + math.tan(math.radians(10)), abs=0.03)
    assert not observed_steps(SQUARE, INSIDE, np.zeros(1), 0.1, 0.9).any()


def test_a_wall_hides_what_is_behind() -> None:
    screen = np.array([[[1.5, 0.5], [1.5, 1.5]]])
    walls = np.concatenate([SQUARE, screen])
    seen = observed_steps(walls, INSIDE, np.zeros(1), math.radians(30), 4.0)
    assert set(steps_along(walls).piece[seen]) == {4}


@settings(max_examples=30, deadline=None)
@given(
    turn=st.floats(-3.0, 3.0), x=st.floats(-5.0, 5.0), y=st.floats(-5.0, 5.0),
    in_m=st.floats(-0.08, 0.08), swap=st.booleans(),
)  # fmt: skip
def test_scores_do_not_depend_on_the_frame(
    turn: float, x: float, y: float, in_m: float, swap: bool
) -> None:
    turned = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    lines = moved_in(in_m)
    here = segment_scores(lines, SQUARE, seen_from_m=INSIDE, tolerances_m=(1.0,))
    there = segment_scores(
        (lines[:, ::-1] if swap else lines) @ turned + [x, y],
        SQUARE @ turned + [x, y],
        seen_from_m=INSIDE @ turned + [x, y],
        tolerances_m=(1.0,),
    )
    assert there.within == here.within
    assert there.offset_m == pytest.approx(here.offset_m, abs=1e-9)
    assert there.offset_m == pytest.approx(-in_m, abs=1e-9)
    assert there.lines_per_wall == here.lines_per_wall
