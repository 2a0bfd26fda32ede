"""The range that a map predicts: the kernels against slow twins, and a room to check."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive_casting import nearest_in_cone as slow_in_cone
from naive_casting import nearest_on_ray as slow_on_ray

from mapping.artifacts import MergedGrid, Started
from mapping.beams import Beam
from mapping.grid import GridGeometry
from mapping.kernels.casting import nearest_in_cone, nearest_on_rays
from mapping.prediction import SHORT, THROUGH, RangePredictor
from recorder.geometry import SE2

GRID = GridGeometry((-1.0, 2.0), 0.1, 30, 40)
PLACES = st.floats(-6.0, 30.0)
HEADINGS = st.floats(-9.0, 9.0)  # beyond a whole turn, both ways


def speckled(seed: int, share: float) -> np.ndarray:
    """Some occupied cells of a grid of 17 x 23."""
    return np.random.default_rng(seed).random((17, 23)) < share


def beam(x: float, y: float, heading: float, *, axes: int = 1, reach_m: float = 5.0) -> Beam:
    bearings = np.linspace(-1.0, 1.0, axes) if axes > 1 else np.zeros(1)
    pose = SE2(x, y, heading)
    return Beam(
        number=0, t_ns=0, sensor="ping", layer="ping", world_from_base=pose,
        world_from_sensor=pose, bearings_rad=bearings, ranges_m=np.full(axes, 1.0),
        beam_width_rad=math.radians(20), reach_m=reach_m,
    )  # fmt: skip


def with_cells(*cells: tuple[int, int]) -> RangePredictor:
    """A predictor that has seen a map in which only these cells are above its threshold."""
    predictor = RangePredictor(0.55)
    predictor(Started(GRID, ("ping",), np.zeros((0, 2, 2)), 0, 1))
    probability = np.full(GRID.shape, 0.55, np.float32)  # the threshold itself is not above it
    for cell in cells:
        probability[cell] = 0.9
    predictor(merged(probability))
    return predictor


def merged(probability: np.ndarray) -> MergedGrid:
    return MergedGrid(
        beam(0, 3, 0), "ping", "bayes", "probability", GRID, GRID.whole,
        probability, probability, probability,
    )  # fmt: skip


@settings(deadline=None, max_examples=150)
@given(
    st.integers(0, 999), st.sampled_from([0.0, 0.02, 0.2]), PLACES, PLACES, HEADINGS,
    st.sampled_from([0.0, 0.01, 0.3, 1.5, math.pi]), st.floats(0.1, 40.0),
)  # fmt: skip
def test_the_nearest_in_a_cone_is_that_of_looking_at_every_cell(
    seed: int, share: float, x: float, y: float, heading: float, half: float, reach: float
) -> None:
    occupied = speckled(seed, share)
    found = nearest_in_cone(occupied, x, y, heading, half, reach)
    expected = slow_in_cone(occupied, x, y, heading, half, reach)
    # A centre on the very edge may fall to either side: a hair more or less must then agree.
    wider = slow_in_cone(occupied, x, y, heading, half + 1e-7, reach + 1e-7)
    assume(expected == wider)
    assert found == pytest.approx(expected, abs=1e-9)


@settings(deadline=None, max_examples=150)
@given(
    st.integers(0, 999), st.sampled_from([0.0, 0.02, 0.2]), PLACES, PLACES, HEADINGS,
    st.floats(0.1, 40.0),
)  # fmt: skip
def test_the_first_on_a_ray_is_that_of_clipping_it_to_every_cell(
    seed: int, share: float, x: float, y: float, heading: float, reach: float
) -> None:
    occupied = speckled(seed, share)
    expected, close = slow_on_ray(occupied, x, y, heading, reach)
    assume(not close)
    (found,) = nearest_on_rays(occupied, x, y, np.array([heading]), reach)
    assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_rays_along_the_axes_meet_the_wall(turns: int) -> None:
    """Straight headings divide by zero where one is not careful."""
    occupied = np.zeros((21, 21), bool)
    occupied[0], occupied[-1], occupied[:, 0], occupied[:, -1] = True, True, True, True
    heading = turns * math.pi / 2
    (found,) = nearest_on_rays(occupied, 10.5, 10.5, np.array([heading]), 30.0)
    assert found == pytest.approx(10.0)
    assert nearest_in_cone(occupied, 10.5, 10.5, heading, 0.0, 30.0) == pytest.approx(10.0)


def test_a_thin_beam_slips_through_no_wall() -> None:
    occupied = np.zeros((200, 200), bool)
    occupied[np.arange(200), 199 - np.arange(200)] = True  # a thin wall, cell corner to corner
    for heading in np.linspace(0.1, math.pi / 2 - 0.1, 57):
        found = nearest_in_cone(occupied, 20.3, 20.4, heading, 0.0, 400.0)
        towards = (199 - 20.3 - 20.4 + 1) / (math.cos(heading) + math.sin(heading))
        assert found == pytest.approx(towards, abs=1.0)


def test_a_ranger_meets_the_nearest_of_its_cone_and_a_scan_what_is_on_each_axis() -> None:
    row = 10  # y from 3.0 to 3.1
    predictor = with_cells((row, 30), (row + 1, 20), (29, 0))
    ranger = beam(0.05, 3.05, 0.0)  # in the middle of cell (10, 10)
    assert predictor.ranges_m(ranger)[0] == pytest.approx(math.hypot(1.0, 0.1))
    scan = beam(0.05, 3.05, 0.0, axes=3)
    assert predictor.ranges_m(scan) == pytest.approx([math.inf, 2.0, math.inf])


def test_nothing_is_predicted_beyond_the_reach_behind_the_sensor_or_at_the_threshold() -> None:
    predictor = with_cells((10, 30))
    assert np.isinf(predictor.ranges_m(beam(0.05, 3.05, math.pi))).all()
    assert np.isinf(predictor.ranges_m(beam(0.05, 3.05, 0.0, reach_m=1.9))).all()
    assert predictor.ranges_m(beam(0.05, 3.05, 0.0, reach_m=2.1)) == pytest.approx([2.0])
    assert np.isinf(with_cells().ranges_m(beam(0.05, 3.05, 0.0))).all()


def test_a_sensor_outside_the_grid_and_a_map_not_begun() -> None:
    assert with_cells((10, 0)).ranges_m(beam(-1.95, 3.05, 0.0)) == pytest.approx([1.0])
    endless = beam(-1.95, 3.05, 0.5, axes=3, reach_m=1e9)
    assert np.isinf(with_cells().ranges_m(endless)).all()
    fresh = RangePredictor(0.55)
    assert np.isinf(fresh.ranges_m(beam(0, 3, 0, axes=4))).tolist() == [True] * 4


def test_what_is_freed_again_is_no_longer_predicted() -> None:
    predictor = with_cells((10, 30))
    predictor(merged(np.full(GRID.shape, 0.2, np.float32)))
    assert np.isinf(predictor.ranges_m(beam(0.05, 3.05, 0.0))).all()


@pytest.mark.parametrize(
    ("measured_m", "expected"),
    [(0.5, SHORT), (1.0, None), (1.05, None), (1.5, THROUGH), (np.inf, THROUGH)],
)
def test_a_wall_ahead_contradicts_what_falls_short_of_it_or_looks_through(
    measured_m: float, expected: str | None
) -> None:
    wall = with_cells(*((row, 20) for row in range(GRID.rows)))  # a metre ahead
    read = dataclasses.replace(beam(0.05, 3.5, 0.0), ranges_m=np.array([measured_m]))
    found = wall.contradiction(read)
    assert (None if found is None else found.kind) == expected
    if found is not None:
        assert found.expected_m == pytest.approx(1.0, abs=GRID.resolution_m)
        assert found.weight > 0.4


def test_a_nearer_wall_at_the_cones_edge_does_not_count_against_a_ranger() -> None:
    """It may send no echo back; and a map without a layer has nothing to say."""
    read = dataclasses.replace(beam(0.05, 3.5, 0.0), ranges_m=np.array([1.0]))
    half = math.radians(8)
    edge = (round((1.5 + 0.6 * math.sin(half)) / 0.1), round((1.05 + 0.6 * math.cos(half)) / 0.1))
    assert with_cells(edge, (15, 20)).contradiction(read) is None
    assert RangePredictor(0.55).contradiction(read) is None
