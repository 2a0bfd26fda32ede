"""Two sonars that receive each other's echoes: named where planted, with the readings."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from mapping.config import load_config
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.causes.cross_talk import CrossTalk, Talk, talk
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.placed_session import place_session
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Range
from recorder.simulator.faults import SOUND
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS

SENSORS = ("ping_left", "ping")


@lru_cache(maxsize=4)
def run(share: float, yaw_deg: float) -> tuple[object, ...]:
    messages = simulate(
        ROOMS["cluttered"], duration_s=100.0, seed=5, sensors=SENSORS,
        faults=replace(SOUND, cross_talk=share),
        mounts={"ping_left": SE2(0.0, 0.044, math.radians(yaw_deg))},
    )  # fmt: skip
    return tuple(message for _, message in messages)


def case(share: float, yaw_deg: float = 90.0) -> Case:
    config = load_config()
    return case_of(place_session(list(run(share, yaw_deg)), config), config)  # type: ignore[arg-type]


def test_cross_talk_is_named_with_the_readings_that_show_it() -> None:
    tried = case(0.15)
    (suspect,) = CrossTalk().examine(tried, Hypothesis())
    assert suspect.cause == "cross-talk"
    assert suspect.subject in SENSORS
    assert "receive" in suspect.text
    assert suspect.settings is None
    assert "ms" in suspect.advice
    assert suspect.value is not None
    assert 0.01 < suspect.value < 0.15  # of the pings; only an echo that comes first is taken over
    assert len(suspect.seconds) > 20
    assert suspect.plots[0].points is not None
    # The readings that it points at are those that differ from the run without the fault.
    sound, spoilt = (
        {(m.t_ns, m.sensor): m.range_m for m in run(share, 90.0) if isinstance(m, Range)}
        for share in (0.0, 0.15)
    )
    found = {tried.readings.t_ns[row] for row in _both(tried)}
    wrong = {key[0] for key, range_m in spoilt.items() if range_m < sound[key] - 0.05}
    assert len(found & wrong) > 0.7 * len(found)  # the others match by chance, as it reports


def _both(tried: Case) -> list[int]:
    pairs = (talk(tried, Hypothesis(), *pair) for pair in (SENSORS, SENSORS[::-1]))
    return [row for each in pairs if each is not None for row in each.rows.tolist()]


@pytest.mark.parametrize(("share", "yaw_deg"), [(0.0, 90.0), (0.0, 0.0), (0.15, 0.0)])
def test_nothing_is_named_of_sound_sonars_nor_of_two_that_look_the_same_way(
    share: float, yaw_deg: float
) -> None:
    assert list(CrossTalk().examine(case(share, yaw_deg), Hypothesis())) == []


def test_it_counts_only_what_chance_does_not_explain() -> None:
    rows, pairs = np.arange(40), np.zeros((60, 2))
    assert Talk("a", "b", rows, pairs, 0.0, 5.0, 3.0, 1000).counts
    assert not Talk("a", "b", rows, pairs, 0.0, 5.0, 9.0, 1000).counts  # as chance might
    assert not Talk("a", "b", rows, pairs, 0.0, 5.0, 3.0, 9000).counts  # too few to matter


def test_a_mount_of_a_sensor_that_is_not_there_is_refused() -> None:
    with pytest.raises(BadInput, match="no sensor 'pinf' to mount"):
        simulate(ROOMS["cluttered"], duration_s=1.0, seed=0, mounts={"pinf": SE2(0.0, 0.0, 0.0)})
