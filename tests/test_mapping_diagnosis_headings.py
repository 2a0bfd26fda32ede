"""Headings that are off by one angle, poses that drift, and the direction of travel."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.config import load_config
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.causes.headings import Drift, Headings
from mapping.diagnosis.causes.mount import Mount
from mapping.diagnosis.fitting import fit
from mapping.diagnosis.hypothesis import Hypothesis, Session, drift_of_poses, heading_of_poses
from mapping.diagnosis.pose_quality import travel
from mapping.diagnosis.search import Found, search
from mapping.motion_gathering import LiveMotion
from mapping.placed_session import place_session
from mapping.tracks import Motions, MotionTrack
from recorder.columns import block_of
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Record
from recorder.simulator.faults import SOUND, RunFaults
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

LONG_S = 200.0  # the robot comes round again: only so walls tell of a drift


@lru_cache(maxsize=4)
def messages(bias_deg: float, duration_s: float) -> tuple[Message, ...]:
    faults: RunFaults = replace(SOUND, heading_bias_deg=bias_deg)
    run = simulate(
        ROOMS["cluttered"], duration_s=duration_s, seed=2, sensors=("dirrs",), faults=faults
    )
    return tuple(message for _, message in run)


@lru_cache(maxsize=4)
def case(bias_deg: float = 0.0, duration_s: float = 100.0) -> Case:
    config = load_config()
    return case_of(place_session(list(messages(bias_deg, duration_s)), config), config)


def test_headings_of_one_thin_beam_are_named_where_the_travel_agrees() -> None:
    tried = case(6.0)
    alone = next(iter(Headings().candidates(tried)))
    yaw = next(iter(Mount().candidates(tried)))
    assert set(yaw.numbers) <= set(alone.instead_of)
    candidates = [yaw, replace(alone, coarse=((math.radians(-5.0),),))]
    hypothesis, taken = search(tried, candidates)
    assert math.degrees(hypothesis.heading_rad) == pytest.approx(-6.0, abs=1.0)
    number = heading_of_poses()
    found = next(each for each in taken if each.number == number)
    suspect = Headings().explained(tried, number, found, hypothesis)
    assert suspect is not None
    assert "too far to the left" in suspect.text
    assert "to the right of its headings" in " ".join(suspect.evidence)
    assert suspect.settings is not None
    assert suspect.settings["pose"]["heading_offset_deg"] == pytest.approx(-6.0, abs=1.0)
    assert Mount().explained(tried, number, found, hypothesis) is None


def test_a_robot_that_drives_where_it_heads_is_not_suspected() -> None:
    assert list(Headings().candidates(case())) == []


@pytest.mark.parametrize(("key", "total"), [("heading_radps", math.radians(4.0)), ("x_mps", -0.06)])
def test_walls_tell_how_fast_poses_drift(key: str, total: float) -> None:
    tried, number, rate = case(duration_s=LONG_S), drift_of_poses(key, LONG_S), total / LONG_S
    planted = Session(
        tried.session.under(Hypothesis().with_number(number, -rate)), tried.placed.placement
    )
    found = fit(replace(tried, session=planted).beams(["dirrs"]), [number])
    assert not found.failed
    assert found.value(number) == pytest.approx(rate, abs=0.2 * abs(rate))


def test_drift_is_named_by_the_minute_and_taken_off() -> None:
    tried = case()
    hypothesis = Hypothesis(x_mps=-0.03 / 60.0, y_mps=0.04 / 60.0)
    _, x, y = (each.numbers[0] for each in Drift().candidates(tried))
    gain = tried.score(hypothesis).gain_over(tried.score(Hypothesis()))
    found = Found(x, hypothesis, 1e-5, gain)
    suspect = Drift().explained(tried, x, found, hypothesis)
    assert suspect is not None
    assert suspect.text.startswith("the places drift by 5 +- ")
    assert suspect.text.endswith("a minute towards -53 degrees")
    assert suspect.settings == {"pose": {"drift_per_min": [0.03, -0.04, 0.0]}}
    assert Drift().explained(tried, y, found, hypothesis) is None


@settings(max_examples=20, deadline=None)
@given(off_deg=st.floats(-30.0, 30.0), sign=st.sampled_from([-1.0, 1.0]), seed=st.integers(0, 99))
def test_travel_is_the_way_against_the_headings(off_deg: float, sign: float, seed: int) -> None:
    """Forwards or backwards, whatever the noise of single headings."""
    count, rng = 400, np.random.default_rng(seed)
    heading = np.repeat(rng.uniform(-3.0, 3.0, count // 40), 40)
    way = heading + math.radians(off_deg) + (0.0 if sign > 0 else math.pi)
    x_m, y_m = np.cumsum(0.02 * np.cos(way)), np.cumsum(0.02 * np.sin(way))
    noisy = heading + math.radians(1.0) * rng.standard_normal(count)
    track = MotionTrack(np.arange(count) * 100_000_000, Motions(x_m, y_m, noisy), 500_000_000)
    seen = travel(track, 0.5)
    assert seen is not None
    assert math.degrees(seen.rad) == pytest.approx(off_deg, abs=2.0)


def test_a_robot_that_stands_or_spins_has_no_direction_of_travel() -> None:
    count = 200
    track = MotionTrack(
        np.arange(count) * 100_000_000,
        Motions(np.zeros(count), np.zeros(count), 0.1 * np.arange(count)), 500_000_000,
    )  # fmt: skip
    assert travel(track, 0.5) is None


def test_a_live_map_turns_headings_and_refuses_to_take_off_a_drift() -> None:
    turned = LiveMotion(load_config([], ["pose.heading_offset_deg=90"]))
    turned.take(block_of([Record("/pose", 5, Pose(5, SE2(1.0, 2.0, 0.25)))]))
    assert turned.track.motions.one(0) == SE2(1.0, 2.0, 0.25 + math.pi / 2)
    with pytest.raises(BadInput, match="finished session"):
        LiveMotion(load_config([], ["pose.drift_per_min=[0.1,0,0]"]))
