"""What a step says of itself: the right numbers, in a few lines that a student can read."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from made_run import MadeRun, segment_between

from mapping.artifacts import (
    Artifact,
    Border,
    Classes,
    Finished,
    MergedGrid,
    RawPoints,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
)
from mapping.beams import Beam
from mapping.grid import GridGeometry, Window
from recorder.geometry import SE2
from replay.rrd.explanation import LEGEND, describe, layer_of

GRID = GridGeometry((0.0, 0.0), 0.1, 20, 30)
BEAM = Beam(
    number=7, t_ns=0, sensor="ping", layer="ping", world_from_base=SE2(1.0, 1.0, np.pi / 2),
    world_from_sensor=SE2(1.0, 1.044, np.pi / 2), bearings_rad=np.zeros(1),
    ranges_m=np.array([0.5]), beam_width_rad=np.deg2rad(38.0), reach_m=4.0,
)  # fmt: skip


@pytest.fixture(scope="module")
def artifacts() -> list[Artifact]:
    return list(MadeRun(readings=6).artifacts())


def test_every_artifact_is_described_shortly(artifacts: list[Artifact]) -> None:
    assert {type(a) for a in artifacts} == {
        Started, Beam, TempGrid, MergedGrid, Snapshot, Thresholded, Classes, Border, RawPoints,
        Segment, Finished,
    }  # fmt: skip
    for artifact in artifacts:
        text = describe(artifact)
        assert text.startswith("## ")
        assert 20 < len(text) < 900
        assert "nan" not in text.lower().split()
        assert "np." not in text


def test_what_is_no_artifact_is_refused() -> None:
    with pytest.raises(TypeError, match="str is no artifact"):
        describe("a map")  # type: ignore[arg-type]


def test_a_beam_states_where_from_where_to_and_how_far() -> None:
    text = describe(BEAM)
    assert "Reading 7: ping measures **0.500 m**" in text
    assert "(1.000, 1.000) m and faces 90.0°" in text
    assert "sits at (1.000, 1.044) m and looks along 90.0°" in text
    assert "38° wide" in text
    assert "(1.000, 1.544) m" in text


def test_a_beam_that_saw_nothing_is_described_so() -> None:
    text = describe(dataclasses.replace(BEAM, ranges_m=np.array([np.inf])))
    assert "measures **nothing**" in text
    assert "No echo came back" in text


def test_a_scan_states_its_nearest() -> None:
    ranges = np.array([2.0, np.inf, 0.75])
    scan = dataclasses.replace(BEAM, sensor="lidar", bearings_rad=np.zeros(3), ranges_m=ranges)
    assert "lidar measures 3 beams, 2 with an obstacle, the nearest at **0.750 m**" in describe(
        scan
    )


def test_a_temp_grid_counts_its_cells() -> None:
    probability = np.array([[0.5, 0.42, 0.31], [0.5, 0.6, 0.558243]])
    band, free = probability > 0.5, probability < 0.5
    text = describe(TempGrid(BEAM, GRID, Window(0, 0, 2, 3), probability, band, free))
    assert "**Red, 2 cells**" in text
    assert "up to 60.0 %" in text
    assert "**Blue, 2 cells**" in text
    assert "down to 31.0 %" in text
    empty = TempGrid(
        BEAM, GRID, Window(0, 0, 2, 3), probability * 0 + 0.5, band & False, band & False
    )
    assert "touches no cell" in describe(empty)


def test_a_merge_states_what_changed_most_and_where() -> None:
    before = np.array([[0.5, 0.5, 0.5]], np.float32)
    after = np.array([[0.5, 0.55, 0.2]], np.float32)
    merged = MergedGrid(
        BEAM, "ping", "bayes", "probability", GRID, Window(4, 10, 1, 3), after, after, before
    )
    text = describe(merged)
    assert "Rule: **bayes**. **2 cells changed**: 1 more occupied, 1 more free" in text
    assert "cell at (1.250, 0.450) m (row 4, column 12) went from 50.0 % to **20.0 %**" in text
    same = dataclasses.replace(merged, previous=after)
    assert "No cell changed" in describe(same)


def test_small_changes_near_a_half_have_more_digits() -> None:
    before = np.array([[0.5]], np.float32)
    after = np.array([[0.5002]], np.float32)
    merged = MergedGrid(
        BEAM, "ping", "bayes", "probability", GRID, Window(0, 0, 1, 1), after, after, before
    )
    assert "from 50.0 % to **50.020 %**" in describe(merged)


def test_a_segment_states_its_line() -> None:
    text = describe(segment_between("ping", (0.0, 1.0), (2.0, 1.0)))
    assert "From (0.000, 1.000) to (2.000, 1.000) m, **2.000 m** long" in text
    assert "37 points along border 0 (magenta)" in text
    assert "4.0 mm" in text
    assert "ρ = 1.0000" in text
    assert "α = 90.00" in text


def test_the_rest_state_their_numbers(artifacts: list[Artifact]) -> None:
    started = describe(artifacts[0])
    assert "120 × 90 cells of 0.02 m: 2.4 m wide, 1.8 m high" in started
    assert "**ping, dirrs, fused**" in started
    assert "The 4 true walls" in started
    for artifact in artifacts:
        text = describe(artifact)
        match artifact:
            case Thresholded():
                assert f"**{artifact.occupied.sum():,} cells**" in text
                assert "above 55.0 %" in text
            case RawPoints():
                assert f"**{len(artifact.points_m)} points**" in text
            case Border():
                assert "counter-clockwise: **4 cells**" in text
            case Snapshot():
                assert artifact.layer.name in text
    assert "**6 readings**; used: ping 3, dirrs 3" in describe(artifacts[-1])
    assert "- 2 dropped: out of range" in describe(artifacts[-1])


def test_classes_state_the_colour_they_are_drawn_in() -> None:
    names = ("unknown", "agree occupied", "agree empty", "contradict", "ping alone occupied",
             "ping alone empty", "dirrs alone occupied", "dirrs alone empty")  # fmt: skip
    codes = np.array([[0, 0, 0, 1, 3, 4, 4, 7]], np.uint8)
    text = describe(Classes(GRID, codes, names))
    for row in (
        "unknown | blue-grey | 3",
        "agree occupied | black | 1",
        "contradict | red | 1",
        "ping alone occupied | orange | 2",
        "dirrs alone empty | pale blue | 1",
    ):
        assert f"| {row} |" in text


def test_each_artifact_belongs_to_its_layer(artifacts: list[Artifact]) -> None:
    for artifact in artifacts:
        expected = getattr(artifact, "layer", "")
        if isinstance(artifact, Snapshot):
            expected = artifact.layer.name
        elif isinstance(artifact, TempGrid):
            expected = artifact.beam.layer
        assert layer_of(artifact) == expected


def test_the_legend_names_every_colour_that_is_drawn() -> None:
    for word in ("white", "black", "blue-grey", "red", "blue", "teal", "green", "yellow",
                 "orange", "magenta", "violet"):  # fmt: skip
        assert word in LEGEND
