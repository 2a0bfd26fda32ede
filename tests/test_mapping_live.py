"""Maps while the messages come in: at the end they are those of the finished session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_live_placing import LivePlacer
from naive_placing import place

from mapping.artifacts import Artifact, Finished, MergedGrid, Snapshot, Started
from mapping.beams import Beam
from mapping.config import MappingConfig, load_config
from mapping.live_pipeline import build_live_maps
from mapping.pipeline import build_maps
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range
from recorder.session import read_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room

LOGS = Path(__file__).resolve().parent.parent / "logs"
COARSE = ["grid.resolution_m=0.05"]


def config(*settings_: str) -> MappingConfig:
    return load_config((), [*COARSE, *settings_], None)


def session(head_sweep_deg: float = 0.0, seed: int = 3) -> list[Message]:
    messages = simulate(
        load_room("room"), duration_s=12.0, seed=seed, head_sweep_deg=head_sweep_deg
    )
    return [message for _, message in messages]


def beams_of(messages: list[Message], configuration: MappingConfig) -> list[Beam]:
    placer = LivePlacer(configuration)
    found = [beam for message in messages for beam in placer.take(message)]
    return found + placer.finish()


def assert_same_beams(one: list[Beam], two: list[Beam]) -> None:
    assert len(one) == len(two) > 0
    for a, b in zip(one, two, strict=True):
        assert (a.number, a.t_ns, a.sensor, a.layer) == (b.number, b.t_ns, b.sensor, b.layer)
        assert a.world_from_sensor == b.world_from_sensor
        np.testing.assert_array_equal(a.ranges_m, b.ranges_m)


@pytest.mark.parametrize("head_sweep_deg", [0.0, 60.0])
@pytest.mark.parametrize("topic", ["", "/odom"])
def test_the_beams_are_those_of_the_finished_session(head_sweep_deg: float, topic: str) -> None:
    messages, configuration = session(head_sweep_deg), config(f"pose.topic={topic!r}")
    placed = place(messages, configuration)
    assert_same_beams(beams_of(messages, configuration), list(placed.beams))


def test_a_recorded_session_gives_the_same_beams_and_counts() -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())
    placed = place(messages, config())
    placer = LivePlacer(config())
    beams = [b for m in messages for b in placer.take(m)] + placer.finish()
    assert_same_beams(beams, list(placed.beams))
    assert dict(placer.used) == placed.used
    assert dict(placer.dropped) == placed.dropped


def test_a_reading_waits_for_the_pose_after_it_and_no_longer() -> None:
    reading = Range(0, "ping", 1.0, 0.6, 0.02, 4.0, Radiation.ULTRASOUND)
    ns = 1_000_000_000

    def pose(t_s: float) -> Pose:
        return Pose(round(t_s * ns), SE2(t_s, 0.0, 0.0))

    placer = LivePlacer(config())
    assert placer.take(pose(0.0)) == []
    assert placer.take(pose(2.9)) == []
    assert placer.take(replace(reading, t_ns=3 * ns)) == []  # after the warm-up, no pose behind it
    found = placer.take(pose(3.1))
    assert [beam.world_from_base.x_m for beam in found] == [pytest.approx(3.0)]
    assert placer.take(replace(reading, t_ns=4 * ns)) == []
    assert placer.take(replace(reading, t_ns=round(4.6 * ns))) == []
    assert placer.dropped == {"no pose at that time": 1}
    assert [beam.t_ns for beam in placer.take(pose(4.7))] == []  # the poses' gap is too long
    assert placer.dropped == {"no pose at that time": 2}


def layers_at_the_end(artifacts: list[Artifact]) -> dict[str, Snapshot]:
    return {a.layer.name: a for a in artifacts if isinstance(a, Snapshot) and a.final}


def test_a_growing_grid_ends_with_the_maps_of_the_finished_session() -> None:
    messages, configuration = session(), config()
    live = list(build_live_maps(messages, configuration))
    whole = list(build_maps(messages, configuration))
    starts = [a for a in live if isinstance(a, Started)]
    assert len(starts) > 1, "the robot never left its first grid: the test shows nothing"
    found, wanted = layers_at_the_end(live), layers_at_the_end(whole)
    assert set(found) == set(wanted) == {"ping", "dirrs", "fused"}
    for name, snapshot in wanted.items():
        grown = found[name].layer
        shift = np.array(snapshot.layer.geometry.origin_m) - grown.geometry.origin_m
        col, row = (round(float(v) / 0.05) for v in shift)
        rows, cols = snapshot.layer.values.shape
        inside = grown.values[row : row + rows, col : col + cols]
        np.testing.assert_array_equal(inside, snapshot.layer.values)
        outside = grown.observed.copy()
        outside[row : row + rows, col : col + cols] = False
        assert not outside.any()
    assert live[-1] == whole[-1]


@settings(deadline=None, max_examples=10)
@given(late=st.lists(st.booleans(), min_size=1, max_size=50))
def test_being_late_hides_steps_but_changes_no_map(late: list[bool]) -> None:
    messages, configuration = session()[:500], config()
    turn = iter(late * 1000)
    hurried = list(build_live_maps(messages, configuration, is_late=lambda: next(turn)))
    calm = list(build_live_maps(messages, configuration))
    for name, snapshot in layers_at_the_end(calm).items():
        np.testing.assert_array_equal(
            layers_at_the_end(hurried)[name].layer.values, snapshot.layer.values
        )
    count = sum(isinstance(a, MergedGrid) for a in hurried)
    assert count <= sum(isinstance(a, MergedGrid) for a in calm)
    assert isinstance(hurried[-1], Finished)


def test_a_configured_grid_does_not_grow() -> None:
    fixed = config("grid.origin_m=[0,0]", "grid.size_m=[1,1]")
    live = list(build_live_maps(session(), fixed))
    starts = [a for a in live if isinstance(a, Started)]
    assert [s.geometry.shape for s in starts] == [(20, 20)]


def test_no_reading_at_all_is_reported_in_one_line() -> None:
    with pytest.raises(BadInput, match="not one reading can be mapped"):
        list(build_live_maps([], config()))
