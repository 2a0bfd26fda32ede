"""Planted faults: each does what it says to the messages, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner

from recorder.cli.simulate import simulate as command
from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.messages import Pose, Range, Scan, Transform
from recorder.session import read_session
from recorder.simulator.faults import RunFaults, SensorFaults
from recorder.simulator.robot import DEFAULT_START_NS, Robot, simulate
from recorder.simulator.rooms import ROOMS

ROOM = ROOMS["room"]


def run(noise=0.0, duration_s=8.0, names=("ping", "dirrs"), **faults):
    run_faults = RunFaults(**faults)
    pairs = simulate(
        ROOM, duration_s=duration_s, seed=3, noise=noise, sensors=names, faults=run_faults
    )
    return [message for _, message in pairs]


def ranges(messages, sensor):
    return np.array([m.range_m for m in messages if isinstance(m, Range) and m.sensor == sensor])


def poses(messages):
    return [m for m in messages if isinstance(m, Pose)]


def of_ping(**faults):
    return {"sensors": {"ping": SensorFaults(**faults)}} if faults else {}


def run_of(faults):
    return [m for _, m in simulate(ROOM, duration_s=4.0, seed=3, noise=1.0, faults=faults)]


def test_a_late_pose_shows_where_the_robot_was():
    robot = Robot(ROOM, seed=3)
    for pose in poses(run(pose_delay_s=0.25)):
        t_ns = pose.t_ns - DEFAULT_START_NS
        assert pose.world_from_base == robot.world_from_base(max(0, t_ns - 250_000_000))


def test_pose_faults_add_up_and_leave_the_ranges_alone():
    sound, wrong = (
        run(noise=1.0, duration_s=60.0, **faults)
        for faults in ({}, {"pose_noise_m": 0.02, "pose_drift_degpmin": 3.0,
                            "heading_bias_deg": 5.0, "pose_drift_mpmin": 0.3})
    )  # fmt: skip
    np.testing.assert_array_equal(ranges(sound, "ping"), ranges(wrong, "ping"))
    pairs = list(zip(poses(sound), poses(wrong), strict=True))
    off = np.array([
        (b.world_from_base.x_m - a.world_from_base.x_m,
         b.world_from_base.y_m - a.world_from_base.y_m,
         math.degrees(wrap_angle(b.world_from_base.heading_rad - a.world_from_base.heading_rad)))
        for a, b in pairs
    ])  # fmt: skip
    np.testing.assert_allclose(off[:, 2], 5.0 + 3.0 * np.linspace(0.0, 1.0, len(off)), atol=1e-6)
    steps = np.diff(off[:, :2], axis=0)
    assert steps.std() == pytest.approx(0.02 * math.sqrt(2.0), rel=0.1)
    assert np.hypot(*off[-50:, :2].mean(axis=0)) == pytest.approx(0.3, rel=0.15)


def test_scale_and_bias_of_one_sensor():
    sound, wrong = run(), run(**of_ping(scale=1.05, bias_m=0.03))
    np.testing.assert_allclose(ranges(wrong, "ping"), 1.05 * ranges(sound, "ping") + 0.03)
    np.testing.assert_array_equal(ranges(wrong, "dirrs"), ranges(sound, "dirrs"))


def test_a_wrong_mount_is_where_the_sensor_truly_sits():
    error = SE2(0.01, -0.02, math.radians(8.0))
    wrong = run(**of_ping(mount=error))
    stated = next(m for m in wrong if isinstance(m, Transform) and m.child == "ping")
    assert stated.parent_from_child == SE2(0.044, 0.0, 0.0)
    robot = Robot(ROOM, seed=3, sensors=("ping",))
    for reading in [m for m in wrong if isinstance(m, Range) and m.sensor == "ping"][::20]:
        sensor = robot.world_from_base(reading.t_ns - DEFAULT_START_NS) @ SE2(0.044, 0, 0) @ error
        hit = sensor @ SE2(reading.range_m, 0.0, 0.0)
        walls = ROOM.walls_m
        along = walls[:, 1] - walls[:, 0]
        point = np.array([hit.x_m, hit.y_m]) - walls[:, 0]
        across = np.abs(along[:, 0] * point[:, 1] - along[:, 1] * point[:, 0])
        assert (across / np.linalg.norm(along, axis=1)).min() < 1e-9


def test_a_delayed_range_was_measured_before_its_stamp():
    sound, late = run(), run(**of_ping(delay_s=0.1))  # two periods of 50 ms
    np.testing.assert_array_equal(ranges(late, "ping")[2:], ranges(sound, "ping")[:-2])


def test_stuck_dead_and_swapped():
    stuck = ranges(run(**of_ping(stuck_s=(2.0, 4.0))), "ping")
    assert len(set(stuck[39:80])) == 1 < len(set(stuck[80:]))
    assert len(ranges(run(**of_ping(dead_s=(2.0, 4.0))), "ping")) == 161 - 40
    both = {"ping": SensorFaults(reports_as="dirrs"), "dirrs": SensorFaults(reports_as="ping")}
    messages = run_of(RunFaults(sensors=both))
    expected = run_of(RunFaults())
    np.testing.assert_array_equal(ranges(messages, "dirrs"), ranges(expected, "ping"))
    np.testing.assert_array_equal(ranges(messages, "ping"), ranges(expected, "dirrs"))


def test_lost_and_random_come_in_their_shares():
    sound = ranges(run(duration_s=100.0, names=("ping",)), "ping")
    wrong = ranges(run(duration_s=100.0, names=("ping",), **of_ping(lost=0.2, random=0.1)), "ping")
    assert np.isinf(wrong).mean() == pytest.approx(0.2, abs=0.03)
    changed = np.isfinite(wrong) & (wrong != sound)
    assert changed.sum() / np.isfinite(wrong).sum() == pytest.approx(0.1, abs=0.02)


def test_a_narrower_beam_meets_less():
    wide, narrow = (
        run(noise=1.0, duration_s=60.0, **of_ping(**f)) for f in ({}, {"beam_width_deg": 5.0})
    )
    assert ranges(narrow, "ping").size == ranges(wide, "ping").size
    assert np.median(ranges(narrow, "ping")) > np.median(ranges(wide, "ping"))
    assert all(m.beam_width_rad == pytest.approx(math.radians(38.0))
               for m in narrow if isinstance(m, Range) and m.sensor == "ping")  # fmt: skip


def test_cross_talk_makes_ranges_shorter_never_longer():
    names = ("ping", "ping_left")
    apart = {"sensors": {"ping_left": SensorFaults(mount=SE2(0.0, 0.0, math.radians(60.0)))}}
    quiet = run(names=names, **apart)
    loud = run(names=names, cross_talk=0.5, **apart)
    before, after = ranges(quiet, "ping"), ranges(loud, "ping")
    shorter = after < before - 1e-9
    assert not (after > before + 1e-9).any()
    assert 0.1 < shorter.mean() < 0.5
    np.testing.assert_allclose(after[shorter], ranges(quiet, "ping_left")[shorter])


def test_scans_have_faults_too():
    faults = {"sensors": {"lidar": SensorFaults(scale=1.1, dead_s=(2.0, 9.0))}}
    sound, wrong = run(names=("lidar",)), run(names=("lidar",), **faults)
    scans = [[m.ranges_m for m in messages if isinstance(m, Scan)] for messages in (sound, wrong)]
    assert len(scans[1]) == 10
    np.testing.assert_allclose(np.array(scans[1]), 1.1 * np.array(scans[0][:10]))


@pytest.mark.parametrize(
    ("faults", "reason"),
    [
        ({"cross_talk": 1.5}, "cross talk must be 0 to 1"),
        ({"sensors": {"png": SensorFaults()}}, "did you mean 'ping'"),
        ({"sensors": {"ping": SensorFaults(reports_as="sonar")}}, "fault of 'sonar'"),
        ({"sensors": {"ping": SensorFaults(scale=0.0)}}, "ping: the scale must be"),
    ],
)
def test_faults_that_cannot_be_are_refused(faults, reason):
    with pytest.raises(BadInput, match=reason):
        simulate(ROOM, duration_s=1.0, seed=0, faults=RunFaults(**faults))


def test_the_command_plants_what_it_is_asked(tmp_path):
    file = tmp_path / "s.mcap"
    arguments = [
        "room", "-o", str(file), "--duration", "2", "--range-bias", "ping=0.03",
        "--mount-error", "dirrs=0,0,4", "--stuck", "ping=1", "--pose-noise", "0.01,2",
    ]  # fmt: skip
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    stated = dict(read_session(file).metadata["faults"])
    assert stated["ping.bias_m"] == "0.03"
    assert stated["pose_noise_deg"] == "2.0"
    assert set(stated) == {
        "ping.bias_m", "ping.stuck_s", "dirrs.mount", "pose_noise_m", "pose_noise_deg"
    }  # fmt: skip
