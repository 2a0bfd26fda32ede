"""Readings find the pose at their own time, and their place in the map frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_placing import Placed, place
from naive_poses import Track

from mapping.config import load_config
from mapping.pipeline import MARGIN_M, build_maps, geometry_of
from mapping.placed_session import place_session
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Scan, Transform

NS = 1_000_000_000


def reading(t_ns: int, range_m: float = 0.5, sensor: str = "ping") -> Range:
    return Range(t_ns, sensor, range_m, math.radians(38), 0.02, 4.0, Radiation.ULTRASOUND)


HERE = SE2(1.0, 1.0, 0.0)


def still(*t_ns: int, pose: SE2 = HERE) -> list[Message]:
    return [Pose(t, pose) for t in t_ns]


def placed(messages: list[Message], *settings_: str) -> Placed:
    return place(messages, load_config([], settings_))


def test_a_reading_with_the_head_turned_right_lies_to_the_right() -> None:
    head = SE2(0.0, 0.0, math.radians(-90))
    messages: list[Message] = [
        Transform(0, "base_link", "head", head, static=False),
        Transform(0, "head", "ping", SE2(0.044, 0.0, 0.0)),
        *still(0),
        reading(0),
    ]
    np.testing.assert_allclose(placed(messages).beams[0].points_m, [[1.0, 0.456]], atol=1e-12)


def test_a_tag_on_the_head_holds_the_heads_angle_already() -> None:
    head = SE2(0.0, 0.0, math.radians(-90))
    messages: list[Message] = [
        Transform(0, "base_link", "head", head, static=False),
        Transform(0, "head", "ping", SE2(0.044, 0.0, 0.0)),
        Transform(0, "base_link", "ping2", SE2(0.044, 0.0, 0.0)),
        *still(0, pose=SE2(1.0, 1.0, math.radians(-90))),
        reading(0),
        reading(0, sensor="ping2"),
    ]
    on_head, on_body = placed(messages, "pose.rides_on=head").beams
    np.testing.assert_allclose(on_head.points_m, [[1.0, 0.456]], atol=1e-12)
    np.testing.assert_allclose(on_body.points_m, [[1.544, 1.0]], atol=1e-12)


def test_without_transforms_the_built_in_mount_counts_and_the_configuration_before_it() -> None:
    built_in = placed([*still(0), reading(0)]).beams[0]
    np.testing.assert_allclose(built_in.points_m, [[1.544, 1.0]])
    asked = placed([*still(0), reading(0)], "sensors.ping.mount=[0.1, 0, 90]").beams[0]
    np.testing.assert_allclose(asked.points_m, [[1.1, 1.5]])


def test_readings_in_a_gap_between_poses_are_dropped_and_counted() -> None:
    messages = [*still(0, NS, NS + NS // 10), reading(NS // 2), reading(NS + NS // 20)]
    result = placed(messages)
    assert [beam.t_ns for beam in result.beams] == [NS + NS // 20]
    assert result.dropped == {"no pose at that time": 1}


@pytest.mark.parametrize(
    ("range_m", "reason"),
    [
        (math.nan, "not a number"),
        (-math.inf, "too close"),
        (0.0, "zero or negative"),
        (-3.0, "zero or negative"),
        (0.01, "below the sensor's minimum"),
        (math.inf, "saw nothing (skipped)"),
        (4.0, "saw nothing (skipped)"),
        (1e300, "saw nothing (skipped)"),
    ],
)
def test_ranges_that_cannot_be_used_are_dropped_by_reason(range_m: float, reason: str) -> None:
    result = placed([*still(0), reading(0), reading(0, range_m)])
    assert result.dropped == {reason: 1}
    assert result.used == {"ping": 1}


def test_a_pose_a_million_kilometres_away_is_dropped() -> None:
    messages = [*still(0), Pose(0, SE2(1e9, 0.0, 0.0)), reading(0)]
    result = placed(messages)
    assert result.dropped == {"pose not finite or too far": 1}
    assert result.beams[0].world_from_base == SE2(1.0, 1.0, 0.0)


def test_a_session_without_poses_or_ranges_is_refused_with_what_it_holds() -> None:
    with pytest.raises(BadInput, match=r"no poses.*1 range"):
        placed([reading(0)])
    with pytest.raises(BadInput, match=r"no range readings.*1 pose"):
        placed([*still(0)])


def test_a_robot_that_stands_still_needs_no_tracker() -> None:
    beam = placed([reading(0)], "pose.fixed=[2, 3, 90]").beams[0]
    np.testing.assert_allclose(beam.points_m, [[2.0, 3.544]], atol=1e-12)


def test_sensors_of_one_kind_share_a_map_named_by_the_kind() -> None:
    both = [*still(0), reading(0, sensor="ping_left"), reading(0, sensor="ping_right")]
    assert {beam.layer for beam in placed(both).beams} == {"ping"}
    assert {beam.layer for beam in placed(both[:2]).beams} == {"ping_left"}


def test_beams_of_a_scan_that_are_not_numbers_are_no_evidence() -> None:
    ranges = np.array([1.0, math.nan, math.inf, 0.0])
    scan = Scan(0, "lidar", ranges, -0.1, 0.1, 0.05, 12.0)
    beam = placed([*still(0), scan]).beams[0]
    np.testing.assert_allclose(beam.bearings_rad, [-0.1, 0.1], atol=1e-12)
    np.testing.assert_array_equal(beam.ranges_m, [1.0, math.inf])


@settings(deadline=None, max_examples=100)
@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-10, 10), st.floats(0.03, 3.9),
    st.sampled_from([0.01, 0.03, 0.1]),
)  # fmt: skip
def test_the_grid_holds_every_beam_and_a_margin(
    x_m: float, y_m: float, heading_rad: float, range_m: float, resolution_m: float
) -> None:
    messages = [*still(0, pose=SE2(x_m, y_m, heading_rad)), reading(0, range_m)]
    config = load_config([], [f"grid.resolution_m={resolution_m}"])
    result = place(messages, config)
    geometry = geometry_of(place_session(messages, config), config)
    low = np.array(geometry.origin_m)
    high = low + geometry.size_m
    origin = result.beams[0].world_from_sensor
    angles = origin.heading_rad + np.radians(np.linspace(-19, 19, 77))
    tip = np.array([[origin.x_m, origin.y_m]])
    rim = np.column_stack([np.cos(angles), np.sin(angles)]) * range_m * 1.1
    points = np.vstack([rim + tip, tip])
    assert (points.min(axis=0) >= low + MARGIN_M - 1e-9).all()
    assert (points.max(axis=0) <= high - MARGIN_M + 1e-9).all()
    np.testing.assert_allclose(low / resolution_m, np.round(low / resolution_m), atol=1e-6)


def test_a_grid_that_is_too_large_is_refused_with_its_size() -> None:
    config = load_config([], ["grid.max_cells=1000"])
    with pytest.raises(BadInput, match=r"cells .* more than grid.max_cells = 1,000"):
        next(build_maps([*still(0), reading(0)], config))


@settings(deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(-3, 3), st.floats(0, 1))
def test_a_heading_between_two_poses_lies_on_the_shorter_arc(
    start_rad: float, turn_rad: float, share: float
) -> None:
    track = Track.of([(0, SE2(0, 0, start_rad)), (NS, SE2(2, 0, start_rad + turn_rad))], 2.0)
    pose = track.at(round(share * NS))
    assert pose is not None
    expected = SE2(0, 0, start_rad + turn_rad * round(share * NS) / NS)
    assert math.cos(pose.heading_rad - expected.heading_rad) == pytest.approx(1.0)
    assert pose.x_m == pytest.approx(2 * share, abs=1e-8)


def test_poses_outside_the_track_are_not_guessed() -> None:
    track = Track.of([(10, SE2(0, 0, 0)), (20, SE2(1, 0, 0))], 1.0)
    assert track.at(9) is None
    assert track.at(21) is None
    assert track.at(20) == replace(SE2(1, 0, 0))
