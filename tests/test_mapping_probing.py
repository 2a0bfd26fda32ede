"""One cell followed through a run: which readings reached it, and what they did to it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.artifacts import Artifact, MergedGrid, Snapshot, TempGrid
from mapping.beams import Beam
from mapping.config import load_config
from mapping.pipeline import build_maps
from mapping.probing import BEHIND, BESIDE, EMPTY, OBSTACLE, CellProbe
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Scan

SETTINGS = (
    "grid.resolution_m=0.05", "grid.origin_m=[-1.0, -1.0]", "grid.size_m=[4.0, 3.0]",
)  # fmt: skip


def poses() -> list[Message]:
    """A robot that stands at the origin and looks along x."""
    return [Pose(t_ns, SE2(0.0, 0.0, 0.0)) for t_ns in range(0, 10_000_000_000, 100_000_000)]


def ping(number: int, range_m: float) -> Range:
    return Range(
        t_ns=100_000_000 * (number + 1), sensor="ping", radiation=Radiation.ULTRASOUND,
        beam_width_rad=math.radians(38), min_range_m=0.02, max_range_m=4.0, range_m=range_m,
    )  # fmt: skip


def artifacts_of(messages: list[Message], *more: str) -> list[Artifact]:
    return list(build_maps(messages, load_config(settings=[*SETTINGS, *more])))


def followed(artifacts: list[Artifact], x: float, y: float) -> CellProbe:
    probe = CellProbe((x, y))
    for artifact in artifacts:
        probe(artifact)
    return probe


def test_zones_are_distinguished_by_where_the_obstacle_was() -> None:
    """The cell lies 1 m ahead: a reading ends there, one passes on, one stops before it."""
    messages = [*poses(), ping(1, 0.956), ping(2, 1.9), ping(3, 0.5)]
    probe = followed(artifacts_of(messages, "sensors.ping.update=bayes"), 1.02, 0.02)
    assert [touch.zone for touch in probe.touches] == [OBSTACLE, EMPTY, BEHIND]
    first, second, third = probe.touches
    assert (first.reading, first.sensor, first.layer) == (0, "ping", "ping")
    assert first.range_m == 0.956
    assert first.evidence > 0.5 > second.evidence
    assert first.effect > 0 > second.effect
    assert third.effect == 0
    assert third.evidence == 0.5
    centre = np.array(probe.centre_m)
    assert first.distance_m == pytest.approx(float(np.hypot(*(centre - [0.044, 0.0]))))
    assert probe.counts() == {OBSTACLE: 1, EMPTY: 1, BEHIND: 1, BESIDE: 0}
    assert [touch.reading for touch in probe.strongest(2)] == [0, 1]
    assert probe.observed == {"ping"}


def test_each_belief_is_that_of_the_map_before_and_after() -> None:
    messages = [*poses(), *(ping(k, d) for k, d in enumerate((0.96, 1.8, 0.97, 0.5, 1.2)))]
    artifacts = artifacts_of(messages)
    probe = followed(artifacts, 1.02, 0.02)
    merged = [a for a in artifacts if isinstance(a, MergedGrid)]
    belief = 0.5
    for touch in probe.touches:
        assert touch.before == pytest.approx(belief, abs=1e-7)
        grid = merged[touch.reading]
        row, col = probe.cell[0] - grid.window.row0, probe.cell[1] - grid.window.col0
        if touch.zone != BEHIND:
            assert touch.after == grid.probability[row, col]
        belief = touch.after
    final = next(a for a in artifacts if isinstance(a, Snapshot) and a.final)
    assert probe.beliefs["ping"] == final.layer.probability[probe.cell] == pytest.approx(belief)


@settings(deadline=None, max_examples=25)
@given(st.floats(-0.99, 2.99), st.floats(-0.99, 1.99), st.sampled_from(["bayes", "sum", "himm"]))
def test_every_change_of_the_cell_is_some_readings_doing(x: float, y: float, rule: str) -> None:
    """Nothing is missed: the changes in the stream are those of the touches, one for one."""
    messages = [*poses(), *(ping(k, 0.5 + 0.17 * k) for k in range(8))]
    artifacts = artifacts_of(messages, f"sensors.ping.update={rule}")
    probe = followed(artifacts, x, y)
    changes = {}
    for artifact in artifacts:
        if isinstance(artifact, MergedGrid):
            row, col = probe.cell[0] - artifact.window.row0, probe.cell[1] - artifact.window.col0
            if 0 <= row < artifact.window.rows and 0 <= col < artifact.window.cols:
                before, after = artifact.previous[row, col], artifact.probability[row, col]
                if before != after:
                    changes[artifact.beam.number] = (before, after)
    assert {t.reading: (t.before, t.after) for t in probe.touches if t.effect} == changes


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.99, 2.99), st.floats(-0.99, 1.99), st.floats(0.3, 2.5))
def test_a_zone_agrees_with_the_temp_grid_and_with_the_angle(
    x: float, y: float, range_m: float
) -> None:
    artifacts = artifacts_of([*poses(), ping(1, range_m)])
    probe = followed(artifacts, x, y)
    (temp,) = (a for a in artifacts if isinstance(a, TempGrid))
    row, col = probe.cell[0] - temp.window.row0, probe.cell[1] - temp.window.col0
    inside = 0 <= row < temp.window.rows and 0 <= col < temp.window.cols
    zones = [touch.zone for touch in probe.touches]
    assert (zones == [OBSTACLE]) == (inside and bool(temp.band[row, col]))
    assert (zones == [EMPTY]) == (inside and bool(temp.free[row, col]))
    if zones == [BEHIND]:
        dx, dy = probe.centre_m[0] - 0.044, probe.centre_m[1]
        assert abs(math.atan2(dy, dx)) <= math.radians(19) + 1e-9
        assert math.hypot(dx, dy) > range_m


def test_a_scan_is_judged_by_the_axis_nearest_to_the_cell() -> None:
    ranges = np.array([2.0, 0.7, 2.0])
    scan = Scan(
        t_ns=100_000_000, sensor="lidar", angle_min_rad=-0.0036, angle_increment_rad=0.02,
        ranges_m=ranges, min_range_m=0.05, max_range_m=30.0,
    )  # fmt: skip
    artifacts = artifacts_of([*poses(), scan])
    (touch,) = followed(artifacts, 1.52, 0.02).touches
    assert touch.zone == BEHIND
    assert touch.range_m == 0.7


def test_what_saw_nothing_empties_and_is_reported_as_such() -> None:
    reading = Range(
        t_ns=100_000_000, sensor="dirrs", radiation=Radiation.INFRARED,
        beam_width_rad=math.radians(6), min_range_m=0.1, max_range_m=0.8, range_m=math.inf,
    )  # fmt: skip
    (touch,) = followed(artifacts_of([*poses(), reading]), 0.72, 0.001).touches
    assert touch.zone == EMPTY
    assert math.isinf(touch.range_m)
    assert touch.effect < 0


@pytest.mark.parametrize("point", [(-1.3, 0.0), (3.01, 0.0), (0.0, 2.2), (math.nan, 0.0)])
def test_a_cell_outside_the_grid_is_refused_in_a_line(point: tuple[float, float]) -> None:
    (started, *_) = artifacts_of([*poses(), ping(1, 1.0)])
    with pytest.raises(
        BadInput, match=r"outside the grid, which covers x -1.000 to 3.000"
    ) as error:
        CellProbe(point)(started)
    assert "\n" not in str(error.value)


def test_the_cell_is_the_one_that_holds_the_point() -> None:
    artifacts = artifacts_of([*poses(), ping(1, 1.0)])
    probe = followed(artifacts, -0.999, -0.951)
    assert probe.cell == (0, 0)
    assert probe.centre_m == pytest.approx((-0.975, -0.975))
    assert isinstance(artifacts[1], Beam)
