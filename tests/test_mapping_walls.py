"""Lines of a grid, moved to where the readings have the walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks.segment_scores import segment_scores
from mapping.artifacts import LineStage, Segment, Snapshot
from mapping.config import MappingConfig, SegmentsSection
from mapping.pipeline import build_maps
from mapping.placed_session import place_session
from mapping.readings import Readings
from mapping.segments import segments_at_walls
from mapping.segments.refit import refit
from mapping.segments.sightings import MOST, SightingLog, Sightings
from mapping.segments.stages import Drop, Move, Stage
from mapping.segments.stretch import Stretch
from recorder.simulator.echoes import cast
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS
from tests.naive_sightings import naive_against, naive_explains, naive_place

Floats = NDArray[np.float64]
CONFIG = SegmentsSection()
SQUARE = np.array(
    [[[0, 0], [2, 0]], [[2, 0], [2, 2]], [[2, 2], [0, 2]], [[0, 2], [0, 0]]], np.float64
)
INWARDS = np.array([[0, 1], [-1, 0], [0, -1], [1, 0]], np.float64)


def seen(seed: int, many: int, *, sonar: bool = True, light: bool = True) -> Sightings:
    """Readings of the square's walls from places inside, with a centimetre of noise."""
    rng = np.random.default_rng(seed)
    from_m = rng.uniform(0.3, 1.7, (many, 2))
    heading = rng.uniform(-math.pi, math.pi, many)
    arc = rng.random(many) < 0.5 if sonar and light else np.full(many, sonar)
    half = np.where(arc, math.radians(19.0), math.radians(3.0))
    fan = heading + np.linspace(-1.0, 1.0, 39)[:, None] * np.where(arc, half, 0.0)
    met = np.array([cast(SQUARE, from_m, each).distance_m for each in fan]).min(axis=0)
    return Sightings(
        from_m, np.column_stack([np.cos(heading), np.sin(heading)]),
        met + rng.normal(0.0, 0.01, many), half, arc, ~arc,
    )  # fmt: skip


def segment(ends_m: Floats, layer: str = "fused") -> Segment:
    start, end = ((float(x), float(y)) for x, y in ends_m)
    covariance = np.diag([1e-4, 1e-4])
    return Segment(layer, "grid", 3, start, end, 1.0, 0.0, covariance, 0.01, 50)


def grid_lines(in_m: float = 0.04) -> list[Segment]:
    """The square's walls as a grid has them: inside of it."""
    return [segment(wall + in_m * inward) for wall, inward in zip(SQUARE, INWARDS, strict=True)]


def ends_of(segments: list[Segment]) -> Floats:
    return np.array([(s.start_m, s.end_m) for s in segments]).reshape(-1, 2, 2)


def same(a: list[Segment], b: list[Segment]) -> bool:
    """Whether all that is known of the lines is the same."""
    return len(a) == len(b) and all(
        (x.start_m, x.end_m, x.rms_m, x.points, x.border, x.covariance.tolist())
        == (y.start_m, y.end_m, y.rms_m, y.points, y.border, y.covariance.tolist())
        for x, y in zip(a, b, strict=True)
    )


@pytest.mark.parametrize("sensors", [{}, {"sonar": False}, {"light": False}], ids=str)
def test_lines_move_to_the_walls(sensors: dict[str, bool]) -> None:
    found = segments_at_walls(grid_lines(), [], seen(1, 800, **sensors), CONFIG, layer="fused")
    score = segment_scores(ends_of(found), SQUARE, seen_from_m=np.array([[1.0, 1.0]]))
    assert score.lines == 4
    assert score.within[0].completeness > 0.97
    assert score.within[0].correctness > 0.97
    assert abs(score.offset_m) < 0.004
    assert score.angle_rad < math.radians(0.5)
    for each in found:
        assert each.points > 20
        assert each.rms_m < 0.02
        assert np.linalg.eigvalsh(each.covariance).min() > 0.0


def test_covariances_hold_the_truth() -> None:
    errors = []
    for seed in range(40):
        for each in segments_at_walls(grid_lines(), [], seen(seed, 400), CONFIG, layer="fused"):
            nearest = round(each.alpha_rad / (math.pi / 2)) * math.pi / 2
            errors.append((each.alpha_rad - nearest) / math.sqrt(each.covariance[1, 1]))
    assert len(errors) == 160
    assert 0.4 < float(np.mean(np.square(errors))) < 2.0


def test_few_points_leave_the_line_as_it_is() -> None:
    lines = sorted(grid_lines(), key=lambda one: -one.length_m)
    few = seen(2, 400).of(np.array([0, 1, 2]))
    config = CONFIG.model_copy(update={"corner_reach_m": 0.0})
    assert same(segments_at_walls(lines, [], Sightings.none(), CONFIG, layer="fused"), lines)
    assert same(segments_at_walls(lines, [], few, config, layer="fused"), lines)
    assert refit(Stretch.between(*SQUARE[0]), few, within_m=0.1, min_points=5) is None


def test_stray_echoes_do_not_move_a_line() -> None:
    right = seen(3, 600)
    rng = np.random.default_rng(4)
    stray = rng.random(len(right)) < 0.3
    ranges = np.where(stray, right.range_m * rng.uniform(0.3, 2.0, len(right)), right.range_m)
    odd = Sightings(right.from_m, right.towards, ranges, right.half_rad, right.arc, right.narrow)
    score = segment_scores(
        ends_of(segments_at_walls(grid_lines(), [], odd, CONFIG, layer="fused")), SQUARE
    )
    assert score.within[0].completeness > 0.95
    assert score.lines == 4


def test_a_cut_across_a_corner_is_no_wall() -> None:
    cut = segment(np.array([[0.05, 0.3], [0.3, 0.05]]))
    stages: list[Stage] = []
    found = segments_at_walls(
        [*grid_lines(), cut], [], seen(5, 800), CONFIG, layer="fused", observe=stages.append
    )
    assert len(found) == 4
    assert sum(isinstance(stage, Drop) for stage in stages) == 1
    moves = [stage.moved_m for stage in stages if isinstance(stage, Move)]
    assert np.median(moves) == pytest.approx(0.04, abs=0.005)


def test_a_line_that_beams_went_through_is_no_wall() -> None:
    through = segment(np.array([[0.7, 1.0], [1.3, 1.0]]))
    found = segments_at_walls([*grid_lines(), through], [], seen(6, 800), CONFIG, layer="fused")
    assert len(found) == 4


def test_a_wall_in_pieces_becomes_one_and_one_that_the_grid_missed_comes_back() -> None:
    pieces = [segment(SQUARE[0] * [[1, 1], [0.4, 1]] + [0, 0.03]),
              segment(SQUARE[0] * [[1, 1], [0.35, 1]] + [1.3, 0.05])]  # fmt: skip
    raw = [segment(SQUARE[1], "dirrs")]
    found = segments_at_walls(
        [*pieces, *grid_lines()[2:]], raw, seen(7, 1200), CONFIG, layer="fused"
    )
    score = segment_scores(ends_of(found), SQUARE)
    assert score.lines == 4
    assert score.within[0].completeness > 0.97
    assert {each.layer for each in found} == {"fused"}


@settings(max_examples=12, deadline=None)
@given(turn=st.floats(-3.0, 3.0), x=st.floats(-20.0, 20.0), y=st.floats(-20.0, 20.0))
def test_lines_move_with_the_frame(turn: float, x: float, y: float) -> None:
    turned = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    here = seen(8, 500)
    there = Sightings(
        here.from_m @ turned + [x, y], here.towards @ turned, here.range_m, here.half_rad,
        here.arc, here.narrow,
    )  # fmt: skip
    lines = grid_lines()
    moved = [segment(ends @ turned + [x, y]) for ends in ends_of(lines)]
    a = ends_of(segments_at_walls(lines, [], here, CONFIG, layer="fused"))
    b = ends_of(segments_at_walls(moved, [], there, CONFIG, layer="fused"))
    assert len(a) == len(b)
    for ends in a @ turned + [x, y]:  # equal lengths may come in another order
        assert np.abs(b - ends).max(axis=(1, 2)).min() < 2e-3


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000), many=st.integers(0, 60), scale=st.sampled_from([1e-6, 0.1, 30.0])
)
def test_whatever_the_readings_lines_are_finite(seed: int, many: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    heading = rng.choice([0.0, 0.5, math.pi / 2], many)
    arc = rng.random(many) < 0.5
    odd = Sightings(
        scale * rng.integers(0, 3, (many, 2)).astype(np.float64),
        np.column_stack([np.cos(heading), np.sin(heading)]), scale * rng.uniform(0.0, 2.0, many),
        np.where(arc, 0.3, 0.05), arc, ~arc,
    )  # fmt: skip
    lines = [segment(scale * rng.integers(0, 3, (2, 2)).astype(np.float64)) for _ in range(4)]
    for each in segments_at_walls(lines, lines[:1], odd, CONFIG, layer="fused"):
        numbers = [*each.start_m, *each.end_m, each.rho_m, each.alpha_rad, each.rms_m]
        assert np.isfinite(numbers).all()
        assert np.isfinite(each.covariance).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_evidence_equals_its_obvious_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sightings = seen(seed, 60)
    wall = Stretch.between(rng.uniform(0.0, 2.0, 2), rng.uniform(0.0, 2.0, 2))
    places, can = sightings.places_on(wall)
    explained, against = sightings.explained_by(wall), sightings.against(wall)
    for k in range(len(sightings)):
        place = naive_place(sightings, k, wall)
        assert (place is not None) == can[k]
        if place is not None:
            assert places[k] == pytest.approx(place, abs=1e-9)
        assert naive_explains(sightings, k, wall) == explained[k]
        assert naive_against(sightings, k, wall) == against[k]


def test_more_readings_than_are_needed_are_thinned() -> None:
    parts = [seen(1, 100)] * (MOST // 100 + 1)
    assert MOST // 2 <= len(Sightings.joined(parts)) <= MOST


def test_what_is_kept_does_not_depend_on_the_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapping.segments.sightings.MOST", 40)
    messages = [message for _, message in simulate(ROOMS["empty"], duration_s=30.0, seed=3)]
    whole = Readings.joined(
        [each for each in place_session(messages, MappingConfig()) if len(each)]
    )
    logs = []
    for portion in (len(whole), 7, 1):
        log = SightingLog()
        for begin in range(0, len(whole), portion):
            log.take(whole[begin : begin + portion])
        logs.append([log.of_layer(layer) for layer in ("ping", "dirrs", "fused")])
    for other in logs[1:]:
        for a, b in zip(logs[0], other, strict=True):
            assert 20 <= len(a) <= 40
            assert np.array_equal(a.points_m, b.points_m)


@pytest.fixture(scope="module")
def messages() -> list[object]:
    return [message for _, message in simulate(ROOMS["skewed"], duration_s=100.0, seed=21)]


def _lines(messages: list[object], refit: str) -> tuple[list[Segment], list[LineStage]]:
    config = MappingConfig.model_validate(
        {"grid": {"resolution_m": 0.02}, "segments": {"refit": refit}}
    )
    artifacts = list(build_maps(messages, config, watched=False))  # type: ignore[arg-type]
    assert any(isinstance(each, Snapshot) for each in artifacts)
    lines = [each for each in artifacts if isinstance(each, Segment)]
    stages = [each for each in artifacts if isinstance(each, LineStage)]
    return [s for s in lines if (s.layer, s.source) == ("fused", "grid")], stages


def test_the_walls_of_a_simulated_room(messages: list[object]) -> None:
    walls = ROOMS["skewed"].walls_m
    (moved, stages), (given, none) = (_lines(messages, refit) for refit in ("points", "none"))
    better, before = (segment_scores(ends_of(lines), walls).within[0] for lines in (moved, given))
    assert better.completeness > 0.9
    assert better.correctness > 0.95
    assert before.completeness < 0.5
    assert {"move", "drop"} <= {stage.kind for stage in stages}
    assert not {"move", "drop"} & {stage.kind for stage in none}
