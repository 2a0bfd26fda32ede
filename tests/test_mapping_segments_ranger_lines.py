"""The walls that a ranger met on its way, and how good they are in rooms and on a real trace."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.walls import ROOM_NAMES, SENSOR, figures, room_run, trace_run
from mapping.config import SegmentsSection
from mapping.grid import GridGeometry
from mapping.segments import segments_of_ranger
from mapping.segments.free_space import cut_where_free
from mapping.segments.least_squares import fit_line
from recorder.errors import BadInput

Floats = NDArray[np.float64]


def along(start: tuple[float, float], end: tuple[float, float], step_m: float = 0.02) -> Floats:
    n = max(round(math.dist(start, end) / step_m), 1) + 1
    return np.linspace(start, end, n)


def test_a_wall_that_was_passed_twice_is_one_line() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.005, (2, 101))
    there, back = along((0, 1), (2, 1)), along((2, 1), (0, 1))
    there[:, 1] += noise[0]
    back[:, 1] += noise[1]
    away = along((5, 5), (6, 5))  # another wall in between: the chain breaks twice
    points = np.concatenate([there, away, back])
    sensor_positions_m = points - [0.0, 0.5]
    found = segments_of_ranger(points, sensor_positions_m, SegmentsSection(), layer="x")
    assert [round(line.length_m, 1) for line in found] == [2.0, 1.0]
    assert found[0].points == 202
    assert all((line.source, line.layer) == ("raw", "x") for line in found)


def test_what_narrow_beams_go_through_is_no_wall() -> None:
    wall, ghost = along((0, 2), (2, 2)), along((0.5, 1), (1.5, 1))
    points = np.concatenate([ghost, wall])
    sensor_positions_m = points - [0.0, 0.8]
    sensor_positions_m[len(ghost) :] = wall - [0.0, 1.8]  # these look through where the ghost is
    narrow = segments_of_ranger(points, sensor_positions_m, SegmentsSection(), layer="x")
    assert [line.start_m[1] for line in narrow] == pytest.approx([2.0])
    wide = segments_of_ranger(
        points, sensor_positions_m, SegmentsSection(), layer="x", narrow=False
    )
    assert sorted(line.start_m[1] for line in wide) == pytest.approx([1.0, 2.0])


def test_ranges_scattered_along_one_beam_are_no_wall() -> None:
    points = along((0.5, 0.0), (1.0, 0.0))
    still = np.zeros_like(points)
    assert segments_of_ranger(points, still, SegmentsSection(), layer="x") == []
    moved = points - [0.5, 0.02]  # the same points, by a robot that drove along them
    assert len(segments_of_ranger(points, moved, SegmentsSection(), layer="x")) == 1


def test_points_that_leap_to_and_fro_between_two_walls_still_give_both() -> None:
    low, high = along((0, 0), (2, 0)), along((0, 0.5), (2, 0.5))
    points = np.stack([low, high], axis=1).reshape(-1, 2)
    sensor_positions_m = np.column_stack([points[:, 0], np.full(len(points), 0.25)])
    found = segments_of_ranger(points, sensor_positions_m, SegmentsSection(), layer="x")
    assert sorted(round(line.start_m[1], 2) for line in found) == [0.0, 0.5]
    assert all(line.length_m == pytest.approx(2.0, abs=0.05) for line in found)


@pytest.mark.parametrize("points", [[], [[0.0, 0.0]], [[np.nan, 1.0]], [[1.0, 1.0]] * 9])
def test_next_to_nothing_gives_nothing(points: list[list[float]]) -> None:
    places = np.array(points, np.float64).reshape(-1, 2)
    assert segments_of_ranger(places, places * 0.0, SegmentsSection(), layer="x") == []


def test_an_unknown_method_is_bad_input() -> None:
    with pytest.raises(BadInput, match="split-and-merge"):
        segments_of_ranger(
            np.zeros((3, 2)), np.zeros((3, 2)), SegmentsSection(method="split"), layer="x"
        )


def test_many_points_at_random_end() -> None:
    points = np.random.default_rng(2).uniform(0, 30, (20_000, 2))
    found = segments_of_ranger(points, points * 0.0, SegmentsSection(), layer="x")
    assert all(np.isfinite(line.covariance).all() for line in found)


def test_lines_are_cut_where_they_run_through_the_open() -> None:
    geometry = GridGeometry((0.0, 0.0), 0.1, 20, 40)
    solid, free = np.zeros((2, *geometry.shape), np.bool_)
    solid[10, :15] = solid[10, 28:] = True
    free[:, 16:27] = True
    whole = fit_line(along((0.05, 1.05), (3.95, 1.05)))
    left, right = cut_where_free([whole], solid, free, geometry)
    # a little more than the solid remains: within two and a half cells of it a line is no ghost
    assert (left.start_m[0], right.end_m[0]) == pytest.approx((0.05, 3.95))
    assert left.end_m[0] == pytest.approx(1.7, abs=0.06)
    assert right.start_m[0] == pytest.approx(2.6, abs=0.06)
    assert len(left.points_m) + len(right.points_m) < len(whole.points_m)
    (kept,) = cut_where_free([whole], solid, np.zeros_like(free), geometry)
    assert kept is whole


@pytest.mark.parametrize("name", ROOM_NAMES)
def test_walls_of_simulated_rooms(name: str) -> None:
    run = room_run(name, seed=1)
    grid, raw = (figures(run, SENSOR, source) for source in ("grid", "raw"))
    assert min(grid.recall, raw.recall) > 0.85
    assert min(grid.precision, raw.precision) > 0.9
    assert min(grid.near, raw.near) > 0.9
    assert max(grid.per_metre, raw.per_metre) < 1.8


@pytest.mark.real_data
def test_walls_of_a_real_trace(shared_data: Path) -> None:
    """Nobody surveyed that arena: points near lines, lines on points, and not too many of them."""
    run = trace_run(shared_data / "comp4807" / "trace21.trc")
    for source, near in (("grid", 0.5), ("raw", 0.65)):
        quality = figures(run, SENSOR, source)
        assert quality.near > near
        assert quality.on_points > 0.9
        assert quality.per_metre < 2.3
        assert max(line.length_m for line in run.lines(SENSOR, source)) > 1.3
