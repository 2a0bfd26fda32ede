"""Smoothed poses are nearer to the truth, those of a good tracker stay, and jumps do not smear."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.config import load_config
from mapping.live_pipeline import build_live_maps
from mapping.placed_session import place_session
from mapping.smoothing import Noise, smoothed_track
from mapping.smoothing.kalman import Motion, filtered, smoothed
from mapping.tracks import Motions, MotionTrack, wrapped
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Odometry, Pose, Radiation, Range

HZ, GAP_NS = 10, 500_000_000


def batch(t_s: np.ndarray, z: np.ndarray, measured: np.ndarray, motion: Motion) -> np.ndarray:
    """The same by least squares over all states at once: every equation, weighed by its spread."""
    count, rows, right = len(t_s), [], []

    def add(weight: float, value: float, **at: float) -> None:
        row = np.zeros(2 * count)
        for key, factor in at.items():
            row[int(key[1:])] = factor
        rows.append(weight * row)
        right.append(weight * value)

    add(1e6, 0.0, _1=1.0) if motion.wanders else add(1.0 / motion.fastest, 0.0, _1=1.0)
    for at in range(count):
        if measured[at]:
            add(motion.noise**-0.5, z[at], **{f"_{2 * at}": 1.0})
        if at + 1 == count:
            break
        dt, a, b = t_s[at + 1] - t_s[at], 2 * at, 2 * at + 2
        if motion.wanders:
            add((motion.drive * dt) ** -0.5, 0.0, **{f"_{b}": 1.0, f"_{a}": -1.0})
            add(1e6, 0.0, **{f"_{b + 1}": 1.0, f"_{a + 1}": -1.0})
            continue
        spread = motion.drive * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        whiten = np.linalg.inv(np.linalg.cholesky(spread))
        moved = np.array([[1, 0, -1, -dt], [0, 1, 0, -1]])  # next value, speed; value, speed
        for equation in whiten @ moved:
            keys = (f"_{b}", f"_{b + 1}", f"_{a}", f"_{a + 1}")
            add(1.0, 0.0, **dict(zip(keys, equation.tolist(), strict=True)))
    return np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0][::2]


@settings(deadline=None, max_examples=40)
@given(st.integers(2, 12), st.booleans(), st.integers(0, 1000))
def test_it_is_least_squares_over_all_states_at_once(count: int, wanders: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t_s, z = np.cumsum(rng.uniform(0.05, 0.5, count)), rng.normal(0.0, 0.3, count)
    measured = rng.random(count) < 0.7
    measured[0] = True
    motion = Motion(0.04, 0.5, wanders, least_jump=100.0)
    way = filtered(t_s, z, measured, np.zeros(count, bool), motion)
    assert smoothed(t_s, way, motion) == pytest.approx(batch(t_s, z, measured, motion), abs=1e-6)


def drive(count: int = 500) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Seconds, x, y and heading of a robot that goes straight and turns by turns."""
    t_s = np.arange(count) / HZ
    heading = np.cumsum(np.where(t_s % 6 < 3, 0.0, 0.6)) / HZ
    return t_s, *(np.cumsum(0.2 * f(heading)) / HZ for f in (np.cos, np.sin)), heading


def track_of(t_s: np.ndarray, x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> MotionTrack:
    return MotionTrack((t_s * 1e9).astype(np.int64), Motions(x, y, wrapped(heading)), GAP_NS)


def noisy(track: MotionTrack, noise_m: float, noise_deg: float) -> MotionTrack:
    rng, m = np.random.default_rng(4), track.motions
    x, y, turn = (rng.normal(0, 1, len(m)) for _ in range(3))
    heading = m.heading_rad + math.radians(noise_deg) * turn
    return replace(
        track, motions=Motions(m.x_m + noise_m * x, m.y_m + noise_m * y, wrapped(heading))
    )


def errors(track: MotionTrack, truth: MotionTrack) -> tuple[float, float]:
    """Root mean squares: metres, degrees."""
    a, b = track.motions, truth.motions
    off = wrapped(a.heading_rad - b.heading_rad)
    away = np.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
    return math.sqrt(np.mean(away**2)), math.degrees(math.sqrt(np.mean(off**2)))


TRUTH = track_of(*drive())


def wheels() -> MotionTrack:
    """Dead reckoning from another origin, 2 % long, whose heading drifts 0.2 degrees a second."""
    t_s, x, y, heading = drive()
    c, s = math.cos(0.3), math.sin(0.3)
    return track_of(t_s, 3 + 1.02 * (c * x - s * y), 1.02 * (s * x + c * y),
                    heading + 0.3 + 0.0035 * t_s)  # fmt: skip


@pytest.mark.parametrize("noise", [Noise(), Noise(0.01, 5.0 * math.pi / 180)])
@pytest.mark.parametrize("odometry", [None, wheels()])
def test_noise_is_lowered(noise: Noise, odometry: MotionTrack | None) -> None:
    bad = noisy(TRUTH, 0.01, 5.0)
    found = smoothed_track(bad, noise, odometry)
    (before_m, before_deg), (after_m, after_deg) = errors(bad, TRUTH), errors(found, TRUTH)
    assert after_m < 0.4 * before_m
    assert after_deg < (0.5 if odometry is None else 0.2) * before_deg
    assert np.array_equal(found.t_ns, bad.t_ns)


def test_clean_poses_stay() -> None:
    away_m, off_deg = errors(smoothed_track(TRUTH, Noise()), TRUTH)
    assert away_m < 2e-4
    assert off_deg < 0.1
    few = TRUTH.since(495)
    assert smoothed_track(few, Noise()) is few


def test_a_jump_does_not_smear_and_a_stray_pose_is_not_believed() -> None:
    m = TRUTH.motions
    moved = m.x_m + np.where(np.arange(500) >= 250, 1.0, 0.0)
    turned = wrapped(m.heading_rad + np.where(np.arange(500) >= 250, 2.0, 0.0))
    jumped = replace(TRUTH, motions=Motions(moved, m.y_m, turned))
    bad = noisy(jumped, 0.01, 2.0)
    bad.motions.heading_rad[100] = wrapped(bad.motions.heading_rad[100] + math.pi)
    found = smoothed_track(bad, Noise())
    near = wrapped(found.motions.heading_rad - jumped.motions.heading_rad)
    assert np.abs(near).max() < math.radians(6.0)
    assert np.abs(found.motions.x_m - moved).max() < 0.03


def test_nothing_is_smoothed_over_a_gap() -> None:
    t_s, x, y, heading = drive()
    late = np.where(np.arange(500) >= 250, 5.0, 0.0)
    both = smoothed_track(noisy(track_of(t_s + late, x, y, heading), 0.01, 3.0), Noise(0.01, 0.05))
    assert errors(both, TRUTH)[1] < 2.0


def test_a_tracker_that_repeats_itself_measures_once() -> None:
    bad = noisy(TRUTH, 0.01, 5.0)
    four = MotionTrack(
        np.concatenate([bad.t_ns + k * 25_000_000 for k in range(4)]).reshape(4, -1).T.ravel(),
        Motions(*(np.repeat(each, 4) for each in (
            bad.motions.x_m, bad.motions.y_m, bad.motions.heading_rad))), GAP_NS,
    )  # fmt: skip
    found = smoothed_track(four, Noise())
    once = replace(found, t_ns=found.t_ns[::4], motions=found.motions[np.arange(0, 2000, 4)])
    assert errors(once, TRUTH)[1] < 0.5 * errors(bad, TRUTH)[1]


def session(with_odometry: bool) -> list[Message]:
    bad, odometry = noisy(TRUTH, 0.01, 5.0), wheels()
    messages: list[Message] = []
    for at, t_ns in enumerate(TRUTH.t_ns.tolist()):
        messages.append(Pose(t_ns, bad.motions.one(at)))
        if with_odometry:
            messages.append(Odometry(t_ns, odometry.motions.one(at)))
        messages.append(Range(t_ns, "ping", 1.0, 0.66, 0.02, 4.0, Radiation.ULTRASOUND))
    return messages


def test_the_configuration_smooths_with_odometry_where_there_is() -> None:
    found = {}
    for with_odometry in (False, True):
        for on in ("true", "false"):
            config = load_config((), [f"pose.smooth={on}"], None)
            placed = place_session(session(with_odometry), config)
            found[with_odometry, on] = errors(placed.placement.track, TRUTH)[1]
    assert found[True, "true"] < found[False, "true"] < 0.5 * found[False, "false"]
    stated = load_config((), ["pose.smooth=true", "pose.smooth_deg=5", "pose.smooth_m=0.01"], None)
    assert errors(place_session(session(False), stated).placement.track, TRUTH)[1] < 2.5


def test_a_live_session_is_not_smoothed() -> None:
    config = load_config((), ["pose.smooth=true"], None)
    with pytest.raises(BadInput, match=r"pose.smooth needs a finished session"):
        list(build_live_maps([Pose(0, SE2(0.0, 0.0, 0.0))], config))
