"""From points to lines: the methods, the fit and the figures of a line."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from benchmarks.made_up_scans import made_up_scan
from mapping.artifacts import Segment
from mapping.beams import Beam
from mapping.config import SegmentsSection
from mapping.segments import (
    LINE_METHODS,
    Corner,
    Fit,
    Merge,
    Split,
    segments_from_points,
    segments_from_scan,
    stages_of_points,
)
from mapping.segments.chains import BREAKPOINT_LAMBDA_RAD, chains_from_points, chains_from_scan
from mapping.segments.least_squares import fit_line
from recorder.errors import BadInput
from recorder.geometry import SE2
from tests.naive_lines import naive_growth, naive_line, naive_scan_breaks, naive_splits

Floats = NDArray[np.float64]
ORDERED = [name for name, method in LINE_METHODS.items() if method.ordered]


def polyline(corners: list[tuple[float, float]], step_m: float = 0.05) -> Floats:
    """Points along a polyline, the corners among them."""
    parts = [np.array(corners[:1], float)]
    for a, b in itertools.pairwise(np.array(corners, float)):
        n = max(round(math.dist(a, b) / step_m), 1)
        parts.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.concatenate(parts)


def noisy(points: Floats, seed: int, sigma_m: float = 0.01) -> Floats:
    """The same points, each a little off."""
    return points + np.random.default_rng(seed).normal(0.0, sigma_m, points.shape)


def ends(segments: list[Segment]) -> list[tuple[float, ...]]:
    """Rounded ends, so that they can be compared as a whole."""
    return [tuple(round(v, 6) + 0.0 for v in (*s.start_m, *s.end_m)) for s in segments]


U_SHAPE = [(0.0, 2.0), (0.0, 0.0), (3.0, 0.0), (3.0, 2.0)]


@pytest.mark.parametrize("name", LINE_METHODS)
def test_every_method_finds_the_three_walls_of_a_u(name: str) -> None:
    points = noisy(polyline(U_SHAPE), seed=1)
    config = SegmentsSection(method=name, epsilon_m=0.04, min_length_m=0.5, min_points=8)
    segments = segments_from_points(points, config, layer="ping")
    walls = sorted((round(s.rho_m, 1), round(abs(math.sin(s.alpha_rad)), 1)) for s in segments)
    assert walls == [(0.0, 0.0), (0.0, 1.0), (3.0, 0.0)]
    for segment in segments:
        x = (segment.start_m[0] + segment.end_m[0]) / 2.0
        wanted = 3.0 if abs(x - 1.5) < 0.5 else 2.0
        assert segment.length_m == pytest.approx(wanted, abs=0.05)
        assert (segment.layer, segment.source, segment.border) == ("ping", "raw", None)


@pytest.mark.parametrize("name", ORDERED)
def test_without_noise_the_corners_are_exact(name: str) -> None:
    config = SegmentsSection(method=name, epsilon_m=0.02)
    segments = segments_from_points(polyline(U_SHAPE), config, layer="x")
    assert ends(segments) == [(0, 2, 0, 0), (0, 0, 3, 0), (3, 0, 3, 2)]


@settings(deadline=None, max_examples=60)
@given(
    angle=st.floats(-math.pi, math.pi),
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    seed=st.integers(0, 1000),
)
def test_turning_and_moving_the_points_turns_and_moves_the_lines(
    angle: float, x: float, y: float, seed: int
) -> None:
    points = noisy(polyline(U_SHAPE), seed, 0.005)
    config = SegmentsSection(epsilon_m=0.04)
    pose = SE2(x, y, angle)
    here = segments_from_points(points, config, layer="x", closed=False)
    there = segments_from_points(pose.transform(points), config, layer="x", closed=False)
    assert len(here) == len(there) == 3
    for a, b in zip(here, there, strict=True):
        moved = pose.transform(np.array([a.start_m, a.end_m]))
        np.testing.assert_allclose([b.start_m, b.end_m], moved, atol=1e-6)
        assert b.rms_m == pytest.approx(a.rms_m, abs=1e-7)
        assert b.covariance[1, 1] == pytest.approx(a.covariance[1, 1], rel=1e-4)


@settings(deadline=None, max_examples=80)
@given(
    st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=1, max_size=40),
    st.floats(0.01, 0.5),
)
def test_splits_equal_the_recursive_definition(
    places: list[tuple[int, int]], epsilon: float
) -> None:
    # A tenth of a metre apart, with irrational offsets: no two points are equally far by chance.
    points = np.array(places, float) * 0.1
    points += 1e-3 * np.sin(np.outer(np.arange(len(points)) + 1.0, [1.7, 2.3]))
    config = SegmentsSection(epsilon_m=epsilon, merge="none", gap_m=100.0)
    splits: list[Split] = []

    def note(stage: object) -> None:
        if isinstance(stage, Split):
            splits.append(stage)

    segments_from_points(points, config, layer="x", closed=False, observe=note)
    wanted = [tuple(points[i]) for i in naive_splits(points, epsilon)]
    assert sorted(split.at_m for split in splits) == sorted(wanted)
    assert all(split.distance_m > epsilon for split in splits)


@pytest.mark.parametrize("seed", range(8))
def test_growth_equals_fitting_again_for_every_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0.0, 0.03, (120, 2)), axis=0) + np.array([100.0, -50.0])
    config = SegmentsSection(method="incremental", rms_m=0.02, merge="none", gap_m=10.0)
    stages: list[object] = []
    segments_from_points(points, config, layer="x", closed=False, observe=stages.append)
    found = [stage.at_m for stage in stages if isinstance(stage, Split)]
    assert found == [tuple(points[i]) for i in naive_growth(points, 0.02)]


@pytest.mark.parametrize("seed", range(5))
def test_scan_chains_equal_the_rule_beam_by_beam(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bearings = np.sort(rng.uniform(-math.pi, math.pi, 200))
    ranges = np.repeat(rng.uniform(0.5, 5.0, 20), 10) + rng.normal(0.0, 0.02, 200)
    ranges[rng.integers(0, 200, 30)] = np.inf
    ranges[rng.integers(0, 200, 5)] = np.nan
    ranges[rng.integers(0, 200, 5)] = 0.0
    chains = chains_from_scan(ranges, bearings, sigma_m=0.01)
    wanted = naive_scan_breaks(ranges, bearings, 0.01, BREAKPOINT_LAMBDA_RAD)
    good = np.isfinite(ranges) & (ranges > 0)
    points = (ranges * np.array([np.cos(bearings), np.sin(bearings)])).T[good]
    np.testing.assert_allclose(chains.points_m, np.roll(points, -wanted.index(True), axis=0))
    assert len(chains.offsets) - 1 == sum(wanted)
    shifted = np.roll(wanted, -wanted.index(True))
    np.testing.assert_array_equal(chains.offsets[:-1], np.flatnonzero(shifted))


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 10_000), st.integers(3, 60), st.floats(-1e4, 1e4))
def test_total_least_squares_equals_singular_values(seed: int, n: int, offset: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(0.0, [1.0, 0.1], (n, 2)) @ np.linalg.qr(rng.normal(size=(2, 2)))[0] + offset
    line, (centre, along, rms) = fit_line(points), naive_line(points)
    np.testing.assert_allclose(line.centre_m, centre, rtol=1e-12, atol=1e-9)
    assert abs(line.along @ along) == pytest.approx(1.0, abs=1e-9)
    assert line.rms_m == pytest.approx(rms, rel=1e-6, abs=1e-9)


def test_the_kernel_keeps_its_digits_far_from_the_origin() -> None:
    points = noisy(polyline([(0.0, 0.0), (40.0, 3.0)], 0.01), seed=3) + np.array([1e6, -1e6])
    found = segments_from_points(points, SegmentsSection(), layer="x")
    assert len(found) == 1
    _, along, rms = naive_line(points)
    assert found[0].rms_m == pytest.approx(rms, rel=1e-6)
    normal = np.array([math.cos(found[0].alpha_rad), math.sin(found[0].alpha_rad)])
    assert abs(normal @ along) < 1e-9


def test_segments_have_the_normal_form_of_their_ends() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        a, b = rng.uniform(-5, 5, (2, 2))
        (found,) = segments_from_points(
            noisy(polyline([tuple(a), tuple(b)]), 1), SegmentsSection(gap_m=5.0), layer="x"
        )
        normal = np.array([math.cos(found.alpha_rad), math.sin(found.alpha_rad)])
        assert found.rho_m >= 0.0
        assert -math.pi <= found.alpha_rad < math.pi
        for end in (found.start_m, found.end_m):
            assert normal @ np.array(end) == pytest.approx(found.rho_m, abs=1e-9)
        assert np.linalg.eigvalsh(found.covariance).min() > 0.0


@pytest.mark.parametrize("fit", ["total", "y-on-x"])
def test_fits_of_a_vertical_wall(fit: str) -> None:
    exact = polyline([(2.0, 0.0), (2.0, 3.0)])
    config = SegmentsSection(fit=fit)  # type: ignore[arg-type]
    (segment,) = segments_from_points(exact, config, layer="x")
    assert (segment.rho_m, segment.alpha_rad) == (pytest.approx(2.0), pytest.approx(0.0))
    slanted = noisy(exact, seed=2)
    found = segments_from_points(slanted, config.model_copy(update={"epsilon_m": 0.2}), layer="x")
    off_rad = max(abs(math.sin(segment.alpha_rad)) for segment in found)
    # y = m x + b goes wrong where a wall is steep and the points are not exact: that is its point.
    assert off_rad < 0.01 if fit == "total" else off_rad > 0.05


def closed_square(sigma_m: float = 0.0) -> Floats:
    corners = [(0.0, 1.0), (0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 1.05)]
    return noisy(polyline(corners), 4, sigma_m) if sigma_m else polyline(corners)


def test_wrap_around_joins_the_last_line_to_the_first() -> None:
    points = closed_square()
    on = segments_from_points(points, SegmentsSection(wrap="on"), layer="x")
    assert sorted(sorted([s.start_m, s.end_m]) for s in on) == [
        [pytest.approx((0, 0)), pytest.approx((0, 2))],
        [pytest.approx((0, 0)), pytest.approx((2, 0))],
        [pytest.approx((0, 2)), pytest.approx((2, 2))],
        [pytest.approx((2, 0)), pytest.approx((2, 2))],
    ]
    off = segments_from_points(points, SegmentsSection(wrap="off"), layer="x")
    assert len(off) == 5
    assert ends(off)[0] == (0, 1, 0, 0)
    dropped = segments_from_points(points, SegmentsSection(wrap="drop"), layer="x", closed=False)
    assert ends(dropped) == ends(off)[1:-1]


@pytest.mark.parametrize("merge", ["joint-fit", "angle", "collinear", "endpoints"])
def test_merging_heals_what_splitting_cut_too_often(merge: str) -> None:
    points = noisy(polyline([(0.0, 0.0), (4.0, 0.0)]), seed=9, sigma_m=0.012)
    cut = SegmentsSection(epsilon_m=0.025, rms_m=0.03, merge="none", min_points=2, min_length_m=0)
    pieces = segments_from_points(points, cut, layer="x")
    merged = segments_from_points(points, cut.model_copy(update={"merge": merge}), layer="x")
    assert len(pieces) > 5
    assert len(merged) < len(pieces)
    if merge == "joint-fit":
        assert len(merged) == 1


def test_a_gap_is_kept_whatever_lies_in_it() -> None:
    points = np.concatenate(
        [polyline([(0, 0), (1, 0)]), [[np.nan, 0.0]], polyline([(2, 0), (3, 0)])]
    )
    assert ends(segments_from_points(points, SegmentsSection(), layer="x")) == [
        (0, 0, 1, 0),
        (2, 0, 3, 0),
    ]
    assert len(segments_from_points(points, SegmentsSection(), layer="x", gap_m=1.5)) == 1


@pytest.mark.parametrize("order", ["bearing", "path"])
def test_points_out_of_order_are_put_in_order(order: str) -> None:
    points = closed_square(0.003)
    start = points[:1] if order == "path" else np.empty((0, 2))
    rest = np.random.default_rng(0).permutation(points[len(start) :])
    mixed = np.concatenate([start, rest])
    plain = segments_from_points(mixed, SegmentsSection(min_points=8), layer="x")
    config = SegmentsSection(min_points=8, order=order)  # type: ignore[arg-type]
    found = segments_from_points(mixed, config, layer="x")
    assert len(found) == 4 != len(plain)
    assert all(s.length_m == pytest.approx(2.0, abs=0.05) for s in found)


def test_the_nearest_neighbour_path_visits_every_point_once() -> None:
    rng = np.random.default_rng(2)
    points = np.round(rng.uniform(0, 3, (400, 2)), 1)  # many places twice
    chains = chains_from_points(points, order="path", gap_m=0.3, closed=False, origin_m=np.zeros(2))
    assert sorted(map(tuple, chains.points_m)) == sorted(map(tuple, points))
    assert tuple(chains.points_m[0]) == tuple(points[0])


def test_corners_are_guarded() -> None:
    flat = polyline([(0.0, 0.0), (2.0, 0.0), (4.0, 0.25)])  # 7 degrees: where they cross is vague
    config = SegmentsSection(epsilon_m=0.03, merge="none")
    first, second = segments_from_points(flat, config, layer="x")
    assert first.end_m != second.start_m
    open_corner = np.concatenate(
        [polyline([(0.0, 0.0), (1.0, 0.0)]), polyline([(1.28, 0.28), (1.28, 1.0)])]
    )
    loose = SegmentsSection(gap_m=0.5, epsilon_m=0.03)
    far, near = (
        segments_from_points(open_corner, loose.model_copy(update={"corner_reach_m": r}), layer="x")
        for r in (0.2, 0.4)
    )
    assert far[0].end_m[0] < 1.1
    assert near[0].end_m == pytest.approx((1.28, 0.0), abs=0.02)


def test_stages_show_the_way_to_the_lines() -> None:
    points = noisy(polyline(U_SHAPE), seed=1)
    config = SegmentsSection(epsilon_m=0.025)
    stages = list(stages_of_points(points, config))
    kinds = [type(stage) for stage in stages]
    assert kinds == sorted(kinds, key=[Split, Merge, Fit, Corner].index)
    counts = {kind: kinds.count(kind) for kind in (Split, Merge, Fit, Corner)}
    segments = segments_from_points(points, config, layer="x")
    assert counts[Fit] == len(segments) == 3
    assert counts[Corner] == 2
    assert counts[Split] + 1 - counts[Merge] == 3
    assert {s.at_m for s in stages if isinstance(s, Corner)} == {s.end_m for s in segments[:2]}


@pytest.mark.parametrize("name", LINE_METHODS)
@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 2)),
        np.array([[1.0, 2.0]]),
        np.array([[1.0, 2.0], [1.0, 2.5]]),
        np.array([[1.0, 2.0], [1.0, 2.0]]),
        np.full((50, 2), 3.0),
        np.full((50, 2), np.nan),
        np.array([[np.inf, 0.0], [0.0, 0.0], [0.1, 0.0], [-np.inf, np.nan], [0.2, 0.0]]),
        np.repeat(polyline([(0, 0), (1, 0), (1, 1)]), 5, axis=0),
        np.column_stack([np.zeros(200), np.linspace(0, 2, 200)]),
        np.random.default_rng(0).normal(0.0, 0.2, (300, 2)),
    ],
    ids=["none", "one", "two", "same two", "one place", "nan", "some inf", "repeated", "vertical",
         "cluster"],
)  # fmt: skip
def test_awkward_points_give_lines_or_none(name: str, points: Floats) -> None:
    config = SegmentsSection(method=name, min_points=2, min_length_m=0.0)
    for order in ("time", "bearing", "path"):
        found = segments_from_points(points, config.model_copy(update={"order": order}), layer="x")
        for segment in found:
            assert np.isfinite([*segment.start_m, *segment.end_m, segment.rho_m]).all()
            assert np.isfinite(segment.covariance).all()
            assert segment.points >= 2


@pytest.mark.parametrize("name", LINE_METHODS)
def test_a_hundred_thousand_points_in_a_staircase(name: str) -> None:
    steps = np.arange(100_000)
    points = np.column_stack([(steps + 1) // 2, steps // 2]) * 0.02
    points[::1000] = np.nan
    config = SegmentsSection(method=name, epsilon_m=0.05)
    found = segments_from_points(points, config, layer="x")
    assert found
    longest = max(found, key=lambda segment: segment.length_m)
    assert abs(math.degrees(longest.alpha_rad)) == pytest.approx(45.0, abs=1.0)


def test_an_unknown_method_names_the_nearest() -> None:
    with pytest.raises(BadInput, match="split-and-merge"):
        segments_from_points(np.zeros((3, 2)), SegmentsSection(method="split"), layer="x")


def test_a_scan_comes_out_in_the_map_frame() -> None:
    scan = made_up_scan(np.random.default_rng(12))
    pose = SE2(3.0, -2.0, 1.1)
    config = SegmentsSection(min_points=8)

    def found(at: SE2) -> list[Segment]:
        beam = Beam(0, 0, "lidar", "l", at, at, scan.bearings_rad, scan.ranges_m, 0.02, 30.0)
        return segments_from_scan(beam, config, sigma_m=0.01)

    here, there = found(SE2(0.0, 0.0, 0.0)), found(pose)
    assert len(here) == len(there) >= 3
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(
            [b.start_m, b.end_m], pose.transform(np.array([a.start_m, a.end_m])), atol=1e-9
        )
        assert b.covariance[1, 1] == pytest.approx(a.covariance[1, 1], rel=1e-6)


def test_runs_of_the_methods_that_draw_are_repeatable() -> None:
    points = noisy(polyline(U_SHAPE), seed=6)
    for name in ("ransac", "em"):
        config = SegmentsSection(method=name, seed=3)
        first, again = (segments_from_points(points, config, layer="x") for _ in range(2))
        assert ends(first) == ends(again)
