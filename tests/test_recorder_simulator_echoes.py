"""What simulated sensors measure: against a slow twin, and what is known of real ones."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from naive_echoes import nearest_wall

from recorder.geometry import SE2
from recorder.sensors import CATALOGUE, ScanPattern
from recorder.simulator.echoes import cast, fan, range_reading, scan_reading
from recorder.simulator.robot import Robot
from recorder.simulator.rooms import ROOMS
from recorder.simulator.surfaces import MIRROR_DEG, wall_surfaces
from recorder.simulator.walls import rectangle

PING, DIRRS, LIDAR = (CATALOGUE[name] for name in ("ping", "dirrs", "lidar"))
ARENA = rectangle((0.0, 0.0), 2.0, 2.0)
coordinates = st.floats(-5, 5).map(lambda x: round(x, 3))
headings = st.floats(-math.pi, math.pi)


def pings(walls_m, sensor, noise=1.0, count=2000, ranger=PING):
    rng = np.random.default_rng(7)
    return np.array([range_reading(walls_m, sensor, ranger, noise, rng) for _ in range(count)])


@given(
    hnp.arrays(np.float64, (6, 2, 2), elements=coordinates),
    st.tuples(coordinates, coordinates),
    st.lists(headings, min_size=1, max_size=6),
)
@settings(deadline=None, max_examples=150)
def test_rays_meet_what_the_slow_twin_gives(walls_m, origin, headings_rad):
    walls_m = walls_m[np.linalg.norm(walls_m[:, 1] - walls_m[:, 0], axis=1) > 1e-3]
    assume(len(walls_m))
    hits = cast(walls_m, np.array(origin), np.array(headings_rad))
    for k, heading_rad in enumerate(headings_rad):
        distance_m, incidence_rad = nearest_wall(walls_m, origin, heading_rad)
        grazes = min(
            abs(math.sin(math.atan2(*(end - origin)[::-1]) - heading_rad))
            for end in walls_m.reshape(-1, 2)
        )
        if grazes < 1e-6 or distance_m < 1e-6:
            continue  # past the very end of a wall: rounding decides
        assert hits.distance_m[k] == pytest.approx(distance_m, rel=1e-6)
        if incidence_rad is not None:
            assert hits.incidence_rad[k] == pytest.approx(incidence_rad, abs=1e-6)


@given(coordinates, st.tuples(*[st.floats(-0.99, 0.99)] * 2), headings)
@settings(deadline=None)
def test_no_ray_leaves_a_closed_room_not_even_by_its_corners(turn_rad, origin, heading_rad):
    walls_m = rectangle((0.0, 0.0), 2.0, 2.0)
    corners_rad = np.arctan2(*(walls_m[:, 0] - origin).T[::-1])
    hits = cast(walls_m, np.array(origin), np.array([heading_rad, *corners_rad]))
    assert (hits.distance_m <= 2.0 * math.sqrt(2.0)).all()
    assert ((hits.incidence_rad >= 0.0) & (hits.incidence_rad <= math.pi / 2)).all()


def test_nothing_there():
    hits = cast(ARENA, np.array([3.0, 0.0]), np.array([0.0, math.pi]))
    assert hits.distance_m.tolist() == [math.inf, pytest.approx(2.0)]
    along_a_wall = cast(np.array([[[1.0, 0.0], [2.0, 0.0]]]), np.zeros(2), np.zeros(1))
    assert along_a_wall.distance_m[0] == math.inf


def test_a_fan_covers_the_beam_and_its_axis():
    across = fan(math.radians(38.0))
    assert across[0] == pytest.approx(-math.radians(19.0))
    assert across[len(across) // 2] == 0.0
    assert np.diff(across).max() < math.radians(1.01)
    np.testing.assert_allclose(across, -across[::-1])


@pytest.mark.parametrize("ranger", [PING, DIRRS], ids=["ping", "dirrs"])
@pytest.mark.parametrize("heading_rad", [0.0, 0.4, 0.79, 2.0, -3.0])
def test_without_noise_a_reading_is_the_exact_distance_along_the_axis(ranger, heading_rad):
    sensor = SE2(0.41, 0.52, heading_rad)
    true_m, _ = nearest_wall(ARENA, (0.41, 0.52), heading_rad)
    expected_m = true_m if true_m <= ranger.max_range_m else math.inf
    readings_m = pings(ARENA, sensor, noise=0.0, count=5, ranger=ranger)
    np.testing.assert_allclose(readings_m, expected_m, rtol=1e-12)


def test_out_of_range_is_infinite():
    far, near = SE2(-0.5, 0.0, 0.0), SE2(0.95, 0.0, 0.0)
    assert set(pings(ARENA, far, noise=0.0, count=3, ranger=DIRRS)) == {math.inf}
    assert set(pings(ARENA, near, noise=0.0, count=3, ranger=DIRRS)) == {-math.inf}
    assert set(pings(ARENA, SE2(0.99, 0.0, 0.0), noise=0.0, count=3)) == {-math.inf}
    assert set(pings(np.array([[[9.0, 0], [9, 1]]]), far, count=50)) == {math.inf}


def test_a_wall_ahead_is_measured_with_the_faults_of_a_cheap_sonar():
    """Square on, 0.8 m away: 1 % and 5 mm, with 2 % short and 8 % lost."""
    readings_m = pings(ARENA, SE2(0.2, 0.0, 0.0))
    lost = np.isinf(readings_m)
    short = readings_m < 0.75
    usual_m = readings_m[~lost & ~short]
    assert 0.06 < lost.mean() < 0.10
    assert 0.01 < short.mean() < 0.03
    assert np.median(usual_m) == pytest.approx(0.8, abs=0.002)
    assert usual_m.std() == pytest.approx(math.hypot(0.01 * 0.8, 0.005), rel=0.1)


def test_a_cone_measures_what_stands_beside_its_axis():
    """A post 15 degrees off the axis, with nothing else: measured, though the axis passes it by."""
    c, s = 0.6 * math.cos(math.radians(15.0)), 0.6 * math.sin(math.radians(15.0))
    post = rectangle((c, s), 0.06, 0.06, math.radians(15.0))
    readings_m = pings(post, SE2(0.0, 0.0, 0.0), count=500)
    assert (np.abs(readings_m - 0.57) < 0.05).mean() > 0.5
    assert np.isinf(pings(post, SE2(0.0, 0.0, math.radians(-15.0)), count=500)).all()


def test_a_slanted_wall_is_a_mirror():
    """Met at 50 degrees it sends the sound on, to a wall that it meets square, and back."""
    slant_rad = math.radians(90.0 - 50.0)
    along = np.array([math.cos(slant_rad), math.sin(slant_rad)])
    mirror = np.array([[-0.6 * along, 0.6 * along]])
    sensor = SE2(-0.5, 0.0, 0.0)
    on = np.array([math.cos(2 * slant_rad), math.sin(2 * slant_rad)])
    square = np.array([[-on[1], on[0]], [on[1], -on[0]]])
    behind = np.array([0.7 * on + square])
    assert np.isinf(pings(mirror, sensor, count=300)).mean() > 0.9
    both = pings(np.concatenate([mirror, behind]), sensor, count=300)
    assert (np.abs(both - (0.5 + 0.7)) < 0.1).mean() > 0.5
    infrared = pings(mirror, sensor, count=300, ranger=DIRRS)
    assert np.median(infrared) == pytest.approx(0.5, abs=0.01)


def test_a_corner_sends_sound_back():
    readings_m = pings(ARENA, SE2(0.3, 0.3, math.radians(45.0)), count=500)
    corner_m = 0.7 * math.sqrt(2.0)
    assert (np.abs(readings_m - corner_m) < 0.1).mean() > 0.5


def test_a_whole_run_has_the_known_shares_of_bad_pings():
    """About a third longer by more than 10 cm than the nearest surface, about a tenth lost."""
    longer, lost, total = 0, 0, 0
    for room in ROOMS.values():
        robot = Robot(room, seed=3, sensors=("ping",))
        rng = np.random.default_rng(5)
        for k in range(0, 1200, 3):
            pose = robot.world_from_base(k * 50_000_000) @ PING.mount
            measured_m = range_reading(room.walls_m, pose, PING, 1.0, rng)
            rays = cast(
                room.walls_m,
                np.array([pose.x_m, pose.y_m]),
                pose.heading_rad + fan(PING.parameters.beam_width_rad),
            )
            lost += measured_m == math.inf
            longer += math.isfinite(measured_m) and measured_m > rays.distance_m.min() + 0.1
            total += 1
    assert 0.25 < longer / total < 0.42
    assert 0.07 < lost / total < 0.16


def test_noise_scales_the_faults_and_not_the_number_of_draws():
    sensor = SE2(0.5, 0.1, 0.3)
    spread = [
        np.std([r for r in pings(ARENA, sensor, noise, ranger=DIRRS) if math.isfinite(r)])
        for noise in (0.0, 0.5, 1.0)
    ]
    assert spread[0] < 1e-12 < spread[1] < spread[2]
    one, other = np.random.default_rng(1), np.random.default_rng(1)
    range_reading(ARENA, sensor, PING, 0.0, one)
    range_reading(ARENA, SE2(0.0, 0.0, 0.0), PING, 1.0, other)
    assert one.random() == other.random()


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_scan_is_the_twin_s_with_a_centimetre_of_noise(noise):
    pose, pattern = SE2(0.3, -0.2, 0.5), LIDAR.scan
    rng = np.random.default_rng(2)
    ranges_m = scan_reading(ARENA, pose, LIDAR, pattern, noise, rng)
    true_m = np.array([nearest_wall(ARENA, (0.3, -0.2), 0.5 + b)[0] for b in pattern.bearings_rad])
    error_m = ranges_m - true_m
    if noise == 0.0:
        assert np.abs(error_m).max() < 1e-9
    else:
        assert error_m.std() == pytest.approx(0.01, rel=0.15)
        assert abs(error_m.mean()) < 0.003
    short = ScanPattern(360, -180.0, 1.0, reach_m=1.0)
    near = dataclasses.replace(LIDAR, min_range_m=0.75)
    short = scan_reading(ARENA, pose, near, short, noise, rng)
    assert set(np.sign(short[np.isinf(short)])) == {-1.0, 1.0}


def test_light_over_a_wide_cone_is_averaged_and_rounded():
    """Half of the cone meets a post at 0.5 m, the rest a wall at 1 m: the range lies between."""
    tof = CATALOGUE["vl53l0x"]
    walls_m = np.array([[[0.5, 0.0], [0.5, 0.5]], [[1.0, -2.0], [1.0, 2.0]]])
    readings_m = pings(walls_m, SE2(0.0, 0.0, 0.0), ranger=tof, count=500)
    assert 0.5 < np.median(readings_m) < 0.75  # more light returns from what is near
    np.testing.assert_allclose(readings_m, np.round(readings_m, 3), atol=1e-12)
    assert np.isinf(pings(walls_m, SE2(0.0, 0.0, math.pi), ranger=tof, count=50)).all()


def test_a_sensor_that_clips_reports_its_least_range():
    maxbotix, near = CATALOGUE["mb1010"], SE2(0.95, 0.0, 0.0)
    readings_m = pings(ARENA, near, ranger=maxbotix, count=300)
    assert set(readings_m[np.isfinite(readings_m)]) == {maxbotix.min_range_m}


# --- surfaces, and sensors that are read by their voltage


def slanted(angle_deg):
    """A long wall 0.5 m ahead of a sensor at the origin, met at so many degrees from its normal."""
    along = np.array([math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))])
    return np.array([[[0.5, 0.0] - 2.0 * along, [0.5, 0.0] + 2.0 * along]])


def share_heard(surface, angle_deg):
    rng, surfaces = np.random.default_rng(3), wall_surfaces([surface])
    thin = dataclasses.replace(PING, beam_width_deg=4.0)
    readings = [
        range_reading(slanted(angle_deg), SE2(0.0, 0.0, 0.0), thin, 1.0, rng, surfaces)
        for _ in range(200)
    ]
    return np.isfinite(readings).mean()


def test_rough_walls_send_sound_back_where_smooth_and_glass_ones_mirror_it():
    square, slant, steep = (
        [share_heard(surface, angle) for surface in ("rough", "smooth", "glass")]
        for angle in (0.0, 18.0, 45.0)
    )
    assert min(square) > 0.85
    assert slant[0] > 0.85 < slant[1]
    assert slant[2] < 0.2
    assert steep[0] > 0.85
    assert max(steep[1:]) < 0.1


def test_light_passes_through_glass():
    walls_m = np.array([[[0.3, -1.0], [0.3, 1.0]], [[0.6, -1.0], [0.6, 1.0]]])
    surfaces = wall_surfaces(["glass", "smooth"])
    rng = np.random.default_rng(1)
    seen = [range_reading(walls_m, SE2(0, 0, 0), DIRRS, 1.0, rng, surfaces) for _ in range(50)]
    assert np.median(seen) == pytest.approx(0.6, rel=0.03)
    heard = [range_reading(walls_m, SE2(0, 0, 0), PING, 1.0, rng, surfaces) for _ in range(50)]
    assert np.median(heard) == pytest.approx(0.3, rel=0.05)
    scan = scan_reading(walls_m, SE2(0, 0, 0), LIDAR, LIDAR.scan, 0.0, rng, surfaces)
    assert scan[180] == pytest.approx(0.6)
    only = wall_surfaces(["glass", "glass"])
    assert range_reading(walls_m, SE2(0, 0, 0), DIRRS, 1.0, rng, only) == math.inf


def test_where_all_is_smooth_nothing_changes():
    assert wall_surfaces(()) is None
    assert wall_surfaces(["smooth", "smooth"]) is None
    one, other = np.random.default_rng(1), np.random.default_rng(1)
    said = dataclasses.replace(wall_surfaces(["glass"] * 4), mirror_deg=np.full(4, MIRROR_DEG))
    pose = SE2(0.2, 0.1, 0.4)
    for _ in range(100):
        assert range_reading(ARENA, pose, PING, 1.0, one) == range_reading(
            ARENA, pose, PING, 1.0, other, said
        )


def test_a_voltage_is_read_in_steps_that_are_coarse_far_away():
    sharp, rng = CATALOGUE["gp2y0a21"], np.random.default_rng(2)
    walls_m = np.array([[[0.75, -1.0], [0.75, 1.0]]])
    far = {range_reading(walls_m, SE2(0, 0, 0), sharp, 1.0, rng) for _ in range(400)}
    finite = np.sort([r for r in far if math.isfinite(r)])
    steps = np.diff(finite)
    assert steps.min() == pytest.approx(finite.min() ** 2 * 5.0 / 1023.0 / 0.24, rel=0.1)
    assert len(finite) < 30
    near = range_reading(walls_m, SE2(0.6, 0, 0), sharp, 1.0, rng)
    assert near == pytest.approx(0.15, rel=0.15)


def test_what_is_very_near_reads_as_something_far():
    sharp, rng = CATALOGUE["gp2y0a21"], np.random.default_rng(2)
    walls_m = np.array([[[0.02, -1.0], [0.02, 1.0]]])
    assert range_reading(walls_m, SE2(0, 0, 0), sharp, 1.0, rng) == pytest.approx(0.18, rel=0.15)
    assert range_reading(walls_m, SE2(0, 0, 0), sharp, 0.0, rng) == -math.inf
