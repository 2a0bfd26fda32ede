"""Far echoes of a sonar that spoil its map: named where it is plainly better without them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mapping.config import load_config
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.causes.mirrors import Mirrors, caps_of
from mapping.diagnosis.facing import Walls, overshoot
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.placed_session import place_session
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Range, Transform
from recorder.sensors import CATALOGUE
from recorder.simulator.faults import SOUND, SensorFaults
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

DURATION_S = 100.0


@lru_cache(maxsize=2)
def case(at_random: float) -> Case:
    faults = replace(SOUND, sensors={"ping": SensorFaults(random=at_random)})
    run = simulate(ROOMS["l-room"], duration_s=DURATION_S, seed=2, faults=faults)
    config = load_config()
    return case_of(place_session([message for _, message in run], config), config)


def test_wrong_far_echoes_are_named_with_the_reach_that_mends_it() -> None:
    (suspect,) = Mirrors().examine(case(0.5), Hypothesis())
    assert suspect.cause == "far-echoes"
    assert suspect.subject == "ping"
    assert suspect.gain is not None
    assert suspect.gain.low > 0.05
    assert suspect.settings is not None
    reach_m = suspect.settings["sensors"]["ping"]["max_range_m"]
    assert 0.4 < reach_m < 2.0
    readings = case(0.5).readings
    first_s = [each[0] + 0.05 for each in suspect.seconds]
    times_s = (readings.t_ns - readings.t_ns.min()) * 1e-9
    rows = np.searchsorted(times_s, np.array(first_s) - 1e-6)
    assert readings.ranges_m[readings.begins[rows]].min() >= reach_m


def test_the_mirrored_echoes_of_a_sound_sonar_are_not() -> None:
    assert list(Mirrors().examine(case(0.0), Hypothesis())) == []
    assert list(caps_of(case(0.0), Hypothesis(), "ping")) != []  # they were tried


@pytest.mark.parametrize("slant_deg", [0.0, 40.0])
def test_overshoot_is_by_the_wall_on_the_axis(slant_deg: float) -> None:
    """A robot that stands before a wall at x = 1 m, and measures 0.4 m past it each third time."""
    slant = math.radians(slant_deg)
    ahead_m = 1.0 / math.cos(slant)
    kind = CATALOGUE["ping"].parameters
    messages: list[Message] = [Transform(0, "base_link", "ping", SE2(0.0, 0.0, 0.0))]
    for k in range(300):
        t_ns = k * 50_000_000
        messages.append(Pose(t_ns, SE2(0.0, 0.0, slant)))
        messages.append(Range(
            t_ns, "ping", ahead_m + (0.4 if k % 3 == 0 else 0.0), kind.beam_width_rad,
            kind.min_range_m, kind.max_range_m, kind.radiation,
        ))  # fmt: skip
    config = load_config()
    standing = case_of(place_session(messages, config), config)
    wall = Walls(np.array([[1.0, 0.0]]), np.array([1.0]), np.array([-2.0]), np.array([2.0]))
    seen = overshoot(standing, Hypothesis(), "ping", wall)
    assert seen is not None
    assert np.degrees(seen.angle_rad) == pytest.approx(slant_deg, abs=1e-6)
    assert seen.past.mean() == pytest.approx(1.0 / 3.0, abs=0.01)
    assert seen.beyond_m[seen.past] == pytest.approx(0.4)
    beside = replace(wall, low_m=np.array([1.5]))  # the axis does not meet it
    assert overshoot(standing, Hypothesis(), "ping", beside) is None
