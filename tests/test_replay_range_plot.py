"""The ranges over seconds: points where they belong, and a lane with the state of each sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range
from replay.rrd import layout
from replay.rrd.range_plot import HEIGHT, WIDTH
from replay.rrd.writer import run_writer

S = 1_000_000_000
NO_POSE = (9, 10, 11)  # readings, half a second each


def messages() -> list[Message]:
    """Ten seconds, a reading each half: echoes, from 8 s on nothing; no poses from 4 to 6 s."""
    seen = [*range(41), *range(60, 101)]
    poses: list[Message] = [Pose(t * S // 10, SE2(0.0, 0.0, 0.0)) for t in seen]
    ranges: list[Message] = [
        Range(t * S // 2, "ping", 1.0 if t < 16 else np.inf, 0.6, 0.02, 4.0, Radiation.ULTRASOUND)
        for t in range(21)
    ]
    return sorted([*poses, *ranges], key=lambda message: message.t_ns)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, list]]:
    """What never changes below the plot's root: by entity, its components."""
    path: Path = tmp_path_factory.mktemp("plot") / "run.rrd"
    settings = ["grid.resolution_m=0.1", "sensors.ping.no_echo='empties'"]
    config = load_config(settings=settings)
    with run_writer(path, config, name="plot") as writer:
        for artifact in build_maps(messages(), config):
            writer(artifact)
    found: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(path).store().stream().filter(content=f"{layout.PLOT}/**"):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            values = batch.column(name).to_pylist()
            found.setdefault(chunk.entity_path, {}).setdefault(name, []).extend(values)
    return found


def test_a_reading_lies_at_its_second_and_its_range(drawn: dict[str, dict[str, list]]) -> None:
    ((*dots,),) = drawn[f"{layout.PLOT}/ping/measured"]["Points2D:positions"]
    mapped = [t for t in range(16) if t not in NO_POSE]
    assert [x for x, _ in dots] == pytest.approx([WIDTH * t / 2 / 10.0 for t in mapped])
    assert [y for _, y in dots] == pytest.approx([0.0] * len(mapped)), "the largest is on top"
    ((*strokes,),) = drawn[f"{layout.PLOT}/ping/spread"]["LineStrips2D:strips"]
    assert strokes[0][0][1] == pytest.approx(HEIGHT * 0.1), "ten per cent below"


def test_the_lane_tells_echo_nothing_and_no_pose(drawn: dict[str, dict[str, list]]) -> None:
    ((*labels,),) = drawn[f"{layout.PLOT}/lanes/names"]["Points2D:labels"]
    assert labels == ["nothing seen", "no pose"]
    ((*stretches,),) = drawn[f"{layout.PLOT}/lanes"]["LineStrips2D:strips"]
    assert len(stretches) == 4 + 2, "echo, no pose, echo, nothing; and a name for two of them"
    ((*numbers,),) = drawn[f"{layout.PLOT}/numbers"]["Points2D:labels"]
    assert "2 s" in numbers
    assert any(label.endswith(" m") for label in numbers)
    ((*names,),) = drawn[f"{layout.PLOT}/legend/names"]["Points2D:labels"]
    assert names == ["ping", "pale: predicted"]


def test_a_line_marks_the_reading(drawn: dict[str, dict[str, list]]) -> None:
    rows = [row for row in drawn[layout.PLOT_CURSOR]["LineStrips2D:strips"] if row]
    assert len(rows) == 21 - len(NO_POSE)
    assert rows[-1][0][0][0] == pytest.approx(WIDTH)
