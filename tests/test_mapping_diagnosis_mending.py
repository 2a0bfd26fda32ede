"""Smoothing and filters are suggested where the score gains by them, and only there."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mapping.config import load_config
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.causes.interface import Suspect
from mapping.diagnosis.causes.smoothing import Smoothing
from mapping.diagnosis.causes.table import CAUSES
from mapping.diagnosis.causes.wrong_echoes import WrongEchoes
from mapping.diagnosis.first_sight import worst_line
from mapping.diagnosis.patches import NO_FAULT
from mapping.placed_session import place_session
from recorder.messages import Message, Odometry, Range
from recorder.simulator.faults import SOUND
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

CONFIG = load_config()


@lru_cache(maxsize=4)
def messages(noise_deg: float = 0.0) -> tuple[Message, ...]:
    faults = replace(SOUND, pose_noise_m=0.002 * noise_deg, pose_noise_deg=noise_deg)
    run = simulate(ROOMS["room"], duration_s=120.0, seed=3, faults=faults)
    return tuple(message for _, message in run)


def case(some: tuple[Message, ...], *settings: str) -> Case:
    config = load_config((), settings, None)
    return case_of(place_session(list(some), config), config)


NOISY = 5.0  # degrees, and 1 cm


def test_noisy_poses_are_smoothed_where_that_gains() -> None:
    (found,) = Smoothing().examine(case(messages(NOISY)), NO_FAULT)
    assert found.settings == {"pose": {"smooth": True}}
    assert found.gain is not None
    assert 0.0 < found.gain.low < found.gain.mean
    assert found.cost < found.gain.mean  # a way round: what is truly wrong stands before it
    assert "dead reckoning" in found.evidence[0]
    assert 2.0 < np.degrees(found.value) < 6.0  # half of them were off by 3.4 degrees or more
    # Once they are smoothed there is nothing left to suggest; nor is there in a sound session.
    assert not list(Smoothing().examine(case(messages(NOISY), "pose.smooth=true"), NO_FAULT))
    assert not list(Smoothing().examine(case(messages()), NO_FAULT))


def test_dead_reckoning_alone_is_not_smoothed() -> None:
    by_wheels = case(messages(NOISY), "pose.topic=/odom")
    assert not list(Smoothing().examine(by_wheels, NO_FAULT))


@lru_cache(maxsize=1)
def with_wrong_echoes() -> tuple[Message, ...]:
    """Each fourth ping comes back from something close by that is not there."""
    found: list[Message] = []
    count = 0
    for message in messages():
        if isinstance(message, Range) and message.sensor == "ping":
            count += 1
            message = message if count % 4 else replace(message, range_m=0.3)
        found.append(message)
    return tuple(found)


def wrong_echoes(some: tuple[Message, ...], *settings: str) -> dict[str, Suspect]:
    return {s.subject: s for s in WrongEchoes().examine(case(some, *settings), NO_FAULT)}


def test_a_filter_is_named_where_the_kept_readings_gain() -> None:
    found = wrong_echoes(with_wrong_echoes())["ping"]
    assert found.settings == {"sensors": {"ping": {"filter": "agree"}}}
    assert found.gain is not None
    assert 0.0 < found.gain.low < found.gain.mean == found.cost
    assert found.seconds
    assert "ping" not in wrong_echoes(with_wrong_echoes(), "sensors.ping.filter=agree")


def test_no_filter_is_named_in_a_sound_session() -> None:
    assert not wrong_echoes(messages())


def test_both_are_causes_that_need_no_walls() -> None:
    names = {cause.name for cause in CAUSES if not cause.needs_walls}
    assert names >= {"smoothing", "wrong-echoes"}


@pytest.mark.parametrize("most", [200_000, 10])
def test_the_worst_is_one_line_where_a_session_is_short(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mapping.diagnosis.first_sight.MOST_LOOKED_AT", most)
    line = worst_line(place_session(list(messages(NOISY)), CONFIG), CONFIG)
    assert line.endswith("degrees each: see echogrid diagnose") if most > 10 else line == ""


def test_odometry_is_kept_beside_a_trackers_poses() -> None:
    placed = place_session(list(messages()), CONFIG)
    assert placed.placement.odometry is not None
    assert not placed.by_odometry
    alone = [m for m in messages() if not isinstance(m, Odometry)]
    assert place_session(alone, CONFIG).placement.odometry is None
