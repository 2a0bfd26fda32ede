"""The simulated robot: how it drives, what it reports and when."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_echoes import nearest_wall

from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.messages import (
    BASE_FRAME,
    HEAD_FRAME,
    Odometry,
    Pose,
    Radiation,
    Range,
    Scan,
    Transform,
)
from recorder.odometry import arc
from recorder.simulator.drive import SPEED_MPS, Drive
from recorder.simulator.robot import DEFAULT_START_NS, WHEELS, Robot, simulate
from recorder.simulator.rooms import ROOMS, parse_route

ROOM = ROOMS["room"]


def run(room=ROOM, duration_s=8.0, seed=4, **options):
    return list(simulate(room, duration_s=duration_s, seed=seed, **options))


def of(pairs, kind):
    return [message for _, message in pairs if isinstance(message, kind)]


def assert_close(a: SE2, b: SE2, metres: float, radians: float) -> None:
    assert math.hypot(a.x_m - b.x_m, a.y_m - b.y_m) <= metres
    assert abs(wrap_angle(a.heading_rad - b.heading_rad)) <= radians


# --- driving


@pytest.mark.parametrize("name", ROOMS)
def test_the_robot_stays_on_its_route_at_a_steady_pace(name):
    route_m = ROOMS[name].route_m
    drive = Drive(route_m, WHEELS.track_m)
    legs = list(zip(route_m, np.roll(route_m, -1, axis=0), strict=True))
    before = None
    for t_s in np.arange(0.0, 2.2 * drive.lap_s, 0.5):
        state = drive.at(float(t_s))
        here = np.array([state.world_from_base.x_m, state.world_from_base.y_m])
        assert (
            min(
                np.linalg.norm(here - a) + np.linalg.norm(here - b) - np.linalg.norm(a - b)
                for a, b in legs
            )
            < 1e-9
        )
        if before is not None:
            assert np.linalg.norm(here - before) <= 0.5 * SPEED_MPS + 1e-9
        before = here


@given(st.floats(0.0, 400.0))
@settings(deadline=None, max_examples=50)
def test_a_lap_later_it_stands_in_the_same_place(t_s):
    drive = Drive(ROOM.route_m, WHEELS.track_m)
    here, later = drive.at(t_s), drive.at(t_s + drive.lap_s)
    if min(t_s % drive.lap_s, -t_s % drive.lap_s) > 1e-6:
        assert_close(here.world_from_base, later.world_from_base, 1e-6, 1e-6)
    assert later.left_m + later.right_m > here.left_m + here.right_m


def test_the_wheels_say_where_the_robot_goes():
    """Small arcs from the wheels' ways lead to the true pose."""
    drive = Drive(ROOM.route_m, WHEELS.track_m)
    before = drive.at(0.0)
    here = before.world_from_base
    for t_s in np.arange(0.001, 30.0, 0.001):
        now = drive.at(float(t_s))
        here = here @ arc(now.left_m - before.left_m, now.right_m - before.right_m, WHEELS.track_m)
        before = now
    assert_close(here, before.world_from_base, 0.003, 1e-6)


def test_it_visits_every_waypoint_and_looks_around():
    drive = Drive(ROOM.route_m, WHEELS.track_m)
    states = [drive.at(k * 0.02).world_from_base for k in range(int(drive.lap_s / 0.02))]
    track_m = np.array([(s.x_m, s.y_m) for s in states])
    for waypoint in ROOM.route_m:
        assert np.linalg.norm(track_m - waypoint, axis=1).min() < 0.01
    looks = np.histogram([s.heading_rad for s in states], bins=24, range=(-math.pi, math.pi))[0]
    assert looks.min() > 0


def test_a_single_waypoint_is_a_turn_on_the_spot():
    drive = Drive(np.array([[0.5, 0.6], [0.5, 0.6]]), WHEELS.track_m)
    headings = [drive.at(t).world_from_base for t in (0.0, drive.lap_s / 4, drive.lap_s / 2)]
    assert {(h.x_m, h.y_m) for h in headings} == {(0.5, 0.6)}
    assert [wrap_angle(h.heading_rad - math.pi / 2 * k) for k, h in enumerate(headings)] == [
        pytest.approx(0.0)
    ] * 3


# --- messages


def test_the_same_seed_gives_the_same_and_another_does_not():
    options = {"sensors": ("ping", "dirrs", "lidar"), "head_sweep_deg": 30.0}
    assert repr(run(**options)) == repr(run(**options))
    assert repr(run(seed=5, **options)) != repr(run(**options))


def test_a_sensor_left_out_does_not_change_the_others():
    both, alone = run(), run(sensors=("ping",))
    pings = [m for m in of(both, Range) if m.sensor == "ping"]
    assert repr(pings) == repr(of(alone, Range))
    assert of(both, Pose) == of(alone, Pose)
    assert of(both, Odometry) == of(alone, Odometry)


def test_pairs_come_in_order_with_the_promised_rates():
    pairs = run(duration_s=10.0, sensors=("ping", "dirrs", "lidar"), start_ns=7_000)
    logs = [log_ns for log_ns, _ in pairs]
    assert logs == sorted(logs)
    assert all(log_ns >= message.t_ns >= 7_000 for log_ns, message in pairs)
    assert max(message.t_ns for _, message in pairs) == 7_000 + 10_000_000_000
    assert len(of(pairs, Pose)) == 101
    assert len(of(pairs, Odometry)) == 201
    assert len(of(pairs, Scan)) == 51
    ranges = of(pairs, Range)
    assert [m.sensor for m in ranges[:4]] == ["ping", "dirrs", "ping", "dirrs"]
    assert len(ranges) == 201 + 200
    for kind in (Pose, Odometry, Scan, Range):
        stamps = [message.t_ns for message in of(pairs, kind)]
        assert stamps == sorted(set(stamps))
    assert run()[0][0] == DEFAULT_START_NS


def test_mounts_come_first():
    pairs = run(sensors=("dirrs", "ping", "lidar"))
    mounts = {m.child: m for _, m in pairs[:3] if isinstance(m, Transform)}
    assert set(mounts) == {"ping", "dirrs", "lidar"}
    assert all(m.static and m.parent == BASE_FRAME for m in mounts.values())
    assert mounts["ping"].parent_from_child == SE2(0.044, 0.0, 0.0)
    assert mounts["dirrs"].parent_from_child == SE2(-0.0312, 0.0, 0.0)
    assert mounts["lidar"].parent_from_child == SE2(0.0, 0.0, 0.0)
    assert len(of(pairs, Transform)) == 3


def test_what_a_range_holds_of_its_sensor():
    ping, dirrs = of(run(), Range)[:2]
    assert (ping.radiation, ping.min_range_m, ping.max_range_m) == (
        Radiation.ULTRASOUND, 0.02, 4.0)  # fmt: skip
    assert (dirrs.radiation, dirrs.min_range_m, dirrs.max_range_m) == (
        Radiation.INFRARED, 0.1, 0.8)  # fmt: skip
    assert math.degrees(ping.beam_width_rad) == pytest.approx(38.0)
    assert math.degrees(dirrs.beam_width_rad) == pytest.approx(6.0)


@pytest.mark.parametrize("head_sweep_deg", [0.0, 75.0])
def test_without_noise_everything_fits_together(head_sweep_deg):
    """Pose, head and mount of the very moment give the ray whose length the reading is."""
    pairs = run(noise=0.0, head_sweep_deg=head_sweep_deg, duration_s=12.0)
    robot = Robot(ROOM, seed=4)
    mounts, base_from_head, checked = {}, SE2(0.0, 0.0, 0.0), 0
    for _, message in pairs:
        t_ns = message.t_ns - DEFAULT_START_NS
        match message:
            case Transform(static=True):
                assert message.parent == (HEAD_FRAME if head_sweep_deg else BASE_FRAME)
                mounts[message.child] = message.parent_from_child
            case Transform():
                assert (message.parent, message.child) == (BASE_FRAME, HEAD_FRAME)
                base_from_head = message.parent_from_child
                head_ns = message.t_ns
            case Pose():
                assert message.world_from_base == robot.world_from_base(t_ns)
            case Range():
                assert not head_sweep_deg or head_ns == message.t_ns
                sensor = robot.world_from_base(t_ns) @ base_from_head @ mounts[message.sensor]
                true_m, _ = nearest_wall(ROOM.walls_m, (sensor.x_m, sensor.y_m), sensor.heading_rad)
                seen = true_m if true_m <= message.max_range_m else math.inf
                assert message.range_m == pytest.approx(seen, rel=1e-9)
                checked += 1
    assert checked == 481


def test_the_head_sweeps_to_both_sides_and_no_further():
    turns = [
        m.parent_from_child.heading_rad
        for m in of(run(head_sweep_deg=75.0, duration_s=10.0), Transform)
        if not m.static
    ]
    assert turns[0] == 0.0 < turns[1]
    assert max(turns) == pytest.approx(math.radians(75.0), abs=0.02)
    assert min(turns) == pytest.approx(math.radians(-75.0), abs=0.02)
    assert np.abs(np.diff(turns)).max() < math.radians(60.0) * 0.026


def test_the_tracker_is_off_by_millimetres():
    pairs = run(duration_s=120.0, sensors=("dirrs",))
    robot = Robot(ROOM, seed=4)
    errors = np.array([
        (
            m.world_from_base.x_m - true.x_m,
            m.world_from_base.y_m - true.y_m,
            wrap_angle(m.world_from_base.heading_rad - true.heading_rad),
        )
        for m in of(pairs, Pose)
        for true in [robot.world_from_base(m.t_ns - DEFAULT_START_NS)]
    ])  # fmt: skip
    assert errors[:, :2].std() == pytest.approx(0.003, rel=0.1)
    assert np.degrees(errors[:, 2].std()) == pytest.approx(1.0, rel=0.1)
    assert np.abs(errors.mean(axis=0)).max() < 0.003


def test_dead_reckoning_is_exact_without_noise_and_drifts_with_it():
    """Over minutes, and over more than 65,536 ticks of a wheel."""
    robot = Robot(ROOM, seed=4)
    drift_m = {}
    for noise in (0.0, 1.0):
        pairs = run(duration_s=400.0, noise=noise, sensors=("dirrs",))
        last = of(pairs, Odometry)[-1]
        start, end = robot.world_from_base(0), robot.world_from_base(400_000_000_000)
        true = start.inverse() @ end
        drift_m[noise] = math.hypot(
            last.odom_from_base.x_m - true.x_m, last.odom_from_base.y_m - true.y_m
        )
    assert robot.drive.at(400.0).left_m * WHEELS.ticks_per_m > 65536
    assert drift_m[0.0] < 0.05
    assert 0.05 < drift_m[1.0] < 3.0


@pytest.mark.parametrize(
    ("sensor", "beams", "first_deg", "step_deg"),
    [("lidar", 360, -180.0, 1.0), ("vl53l5cx", 8, -19.6875, 5.625)],
)
def test_scans(sensor, beams, first_deg, step_deg):
    scan = of(run(sensors=(sensor,), noise=0.0), Scan)[5]
    assert scan.ranges_m.shape == (beams,)
    assert not scan.ranges_m.flags.writeable
    assert math.degrees(scan.angle_min_rad) == pytest.approx(first_deg)
    assert math.degrees(scan.angle_increment_rad) == pytest.approx(step_deg)
    pose = Robot(ROOM, seed=0).world_from_base(scan.t_ns - DEFAULT_START_NS)
    heading_rad = pose.heading_rad + scan.angle_min_rad + 6 * scan.angle_increment_rad
    true_m, _ = nearest_wall(ROOM.walls_m, (pose.x_m, pose.y_m), heading_rad)
    assert scan.ranges_m[6] == pytest.approx(true_m)


def test_a_route_of_one_s_own_is_driven():
    route_m = parse_route("0.3,0.3;1.9,0.3", ROOM)
    poses = of(run(route=route_m, noise=0.0, duration_s=20.0), Pose)
    assert {round(p.world_from_base.y_m, 9) for p in poses} == {0.3}
    assert max(p.world_from_base.x_m for p in poses) > 1.8


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"duration_s": 0.0}, "duration"),
        ({"duration_s": math.nan}, "duration"),
        ({"duration_s": math.inf}, "duration"),
        ({"seed": -1}, "seed"),
        ({"noise": -0.1}, "noise"),
        ({"noise": math.nan}, "noise"),
        ({"noise": 11.0}, "between 0 and 10"),
        ({"head_sweep_deg": 181.0}, "head sweep"),
        ({"sensors": ()}, "needs a sensor"),
        ({"sensors": ("pimg",)}, "did you mean 'ping'"),
        ({"sensors": ("ping", "xyzzy")}, "there are ping, hcsr04, "),
        ({"route": np.array([[0.3, 0.3], [2.5, 0.3]])}, "leaves room"),
    ],
)
def test_what_cannot_be_simulated_is_refused_at_once(options, reason):
    with pytest.raises(BadInput, match=reason) as caught:
        simulate(ROOM, **{"duration_s": 1.0, "seed": 0, **options})
    assert "\n" not in str(caught.value)
