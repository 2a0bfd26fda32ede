"""Faults as the benchmark plants them: those that were once missed, each with its session."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.planted import PLANTED, Planted, recorded, simulated
from mapping.config import load_config
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.diagnosing import diagnose
from mapping.diagnosis.fitting import Fit
from mapping.diagnosis.hypothesis import Hypothesis, y_of, yaw_of
from mapping.diagnosis.patches import NO_FAULT
from mapping.diagnosis.pruning import standing_out
from mapping.placed_session import HasBlocks, place_session

BY_NAME = {each.name: each for each in PLANTED}
DURATION_S = 280.0


def misses(planted: Planted, seed: int, session: HasBlocks) -> list[str]:
    """What is not named, or by another amount; and all that is named, where nothing is wrong."""
    suspects, faults = diagnose(session, load_config()).suspects, planted.faults(seed)
    if not faults:
        return [each.text for each in suspects]
    # Nobody can tell where a sensor stuck at no echo stops to be so, as long as none would come.
    return [
        f"{fault.kind}: {[each.text for each in suspects]}"
        for fault in faults
        if not any((fault.is_named if fault.kind == "stuck" else fault.is_right)(each)
                   for each in suspects)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("none", 2),
        ("late and infrared turned", 2),
        ("poses 50 to 200 ms late or early", 221),  # noisy poses drew readings between two of them
        ("late, and the infrared stuck", 222),  # late poses hid the walls that it did not see
    ],
)
def test_faults_in_sessions_of_another_simulator_are_named(
    shared_data: Path, name: str, seed: int
) -> None:
    planted = BY_NAME[name]
    assert misses(planted, seed, recorded(planted, seed, shared_data / "rooms")) == []


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("infrared turned and shifted sideways", 413),  # the one that mends both was named
        ("15 % cross-talk of two sonars", 303),  # a fit that tore all walls scored best
        ("sonar bias 2 cm", 402),  # the infrared ranger was blamed
        ("sonar beam twice as wide", 303),  # only one edge of the cone shows
    ],
)
def test_faults_that_were_missed_are_named(name: str, seed: int) -> None:
    planted = BY_NAME[name]
    assert misses(planted, seed, simulated(planted, seed, DURATION_S)) == []


@cache
def sound() -> Case:
    session = simulated(BY_NAME["none"], 304, DURATION_S)
    return case_of(place_session(session, load_config()), load_config())


@settings(max_examples=15, deadline=None)
@given(yaw_deg=st.floats(3.0, 16.0), way=st.sampled_from([-1.0, 1.0]), wide=st.floats(0.5, 0.7))
def test_points_leave_their_walls_as_a_mount_is_turned(
    yaw_deg: float, way: float, wide: float
) -> None:
    twisted = Hypothesis().with_sensor("dirrs", yaw_rad=way * math.radians(yaw_deg))
    before, after = (sound().on_walls(each, wide) for each in (NO_FAULT, twisted))
    assert 0.0 <= after.mean < before.mean - 0.02 <= 1.0
    assert np.array_equal(before.count, after.count)  # the same points, so that they compare


def test_two_numbers_that_feign_each_other_stand_out_together() -> None:
    """A turn and a shift, each unsure beside the other: that one of them is there is sure."""
    numbers = (yaw_of("dirrs"), y_of("dirrs"))
    covariance = np.array([[1e-4, -0.95e-4], [-0.95e-4, 1e-4]])
    found = Fit(Hypothesis().with_sensor("dirrs", yaw_rad=0.02, y_m=0.02), numbers, covariance, 99)
    assert found.significance(numbers[0]) == pytest.approx(2.0)
    assert standing_out(found, numbers) == pytest.approx(math.sqrt(2 * 0.02**2 / 0.05e-4))
    assert standing_out(found, numbers[:1]) == pytest.approx(2.0)
