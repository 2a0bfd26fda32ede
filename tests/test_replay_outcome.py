"""What the end of a recording reports, and what it leaves on the maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from rerun.chunk import RrdReader

from mapping.artifacts import Artifact, Segment
from mapping.beams import Beam
from mapping.config import MappingConfig, load_config
from mapping.framing import frame_around
from mapping.fusion import FUSED
from mapping.grid import GridGeometry, Layer
from mapping.pipeline import build_maps
from recorder.session import read_session
from replay.rrd import layout
from replay.rrd.axes import Frame, axes_of, bar_of, nice_step, ticks
from replay.rrd.outcome import LISTED, lost_in_fusion
from replay.rrd.writer import run_writer


@pytest.fixture(scope="module")
def config() -> MappingConfig:
    return load_config(settings=["grid.resolution_m=0.05", "rerun.display=[]"])


@pytest.fixture(scope="module")
def artifacts(config: MappingConfig) -> list[Artifact]:
    return list(build_maps(read_session(ROOT / "logs" / "room.mcap").messages(), config))


@pytest.fixture(scope="module")
def path(
    artifacts: list[Artifact], config: MappingConfig, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("outcome") / "room.rrd"
    with run_writer(path, config, name="room") as writer:
        for artifact in artifacts:
            writer(artifact)
    return path


def rows_of(path: Path, entity: str, component: str) -> list[tuple[int, object]]:
    """Step and value of each row of a component of one entity."""
    found = []
    for chunk in RrdReader(path).store().stream().filter(content=entity, is_static=False):
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            steps = batch.column("step").to_pylist()
            found += zip(steps, batch.column(component).to_pylist(), strict=True)
    return sorted(found, key=lambda row: row[0])


def at_the_end(path: Path, entity: str, component: str) -> object:
    rows = rows_of(path, entity, component)
    return rows[-1][1] if rows else None


def test_the_end_leaves_the_maps_and_their_lines(path: Path, artifacts: list[Artifact]) -> None:
    for layer in ("ping", "dirrs", FUSED):
        lines = [a for a in artifacts if isinstance(a, Segment) and a.layer == layer]
        grid = [a for a in lines if a.source == "grid"]
        group = layout.group(layout.segments(layer, "grid"), 0)
        assert len(at_the_end(path, group, "LineStrips2D:strips")) == len(grid) > 0
        border = layout.group(layout.borders(layer), 0)
        assert at_the_end(path, border, "LineStrips2D:strips") == []
        kept = at_the_end(path, f"{layout.kept(layer)}/borders", "LineStrips2D:strips")
        assert len(kept) > 0
        cells = at_the_end(
            path, f"{layout.kept(layer)}/above_threshold", "SegmentationImage:buffer"
        )
        assert any(cells[0])
    beams = [a for a in artifacts if isinstance(a, Beam)]
    assert len(at_the_end(path, layout.KEPT_PATH, "Points2D:positions")) == len(beams)
    assert at_the_end(path, layout.ROBOT, "Arrows2D:origins") == []
    for entity in (layout.PATH, layout.points("ping")):
        assert at_the_end(path, layout.digit(entity, 0), "Points2D:positions") == []


def test_a_line_step_shows_its_line_and_pales_the_others(path: Path) -> None:
    group = layout.group(layout.segments("dirrs", "grid"), 0)
    first, *_, last = rows_of(path, group, "LineStrips2D:colors")
    as_number = [int.from_bytes(bytes(c)) for c in (layout.PALE_SEGMENT, layout.SEGMENT)]
    assert [first[1], last[1]] == [[as_number[0]], [as_number[1]]]
    newest = rows_of(path, layout.newest(layout.segments("dirrs", "grid")), "LineStrips2D:strips")
    shown = [step for step, strips in newest if strips]
    drawn = [step for step, _ in rows_of(path, group, "LineStrips2D:strips")]
    assert shown == drawn, "each line stands out at its own step"


def test_the_list_lies_at_the_readings_and_the_text_names_the_walls(
    path: Path, artifacts: list[Artifact]
) -> None:
    listed = rows_of(path, layout.MATTERS, "TextLog:text")
    assert 10 <= len(listed) <= LISTED
    for step, (text,) in listed:
        beam = artifacts[step]
        assert isinstance(beam, Beam)
        assert text.startswith(f"step {step}: reading {beam.number}, {beam.sensor}")
    text = at_the_end(path, layout.EXPLANATION, "TextDocument:text")[0]
    walls = [a for a in artifacts if isinstance(a, Segment) and a.layer == FUSED]
    longest = max(wall.length_m for wall in walls)
    assert f"**{len(walls)} walls**" in text
    assert f"**{longest:.2f} m**" in text
    assert "contradict" in text
    assert layout.KEPT_TITLE in text


def test_the_text_of_the_fused_map_tells_what_was_lost_and_to_whom() -> None:
    geometry = GridGeometry((0.0, 0.0), 0.1, 1, 3)

    def layer(name: str, *p: float) -> Layer:
        values = np.array([p], np.float32)
        return Layer(name, "probability", geometry, values, values, np.ones((1, 3), bool), {})

    maps = {
        "ping": layer("ping", 0.9, 0.9, 0.2), "dirrs": layer("dirrs", 0.1, 0.1, 0.2),
        FUSED: layer(FUSED, 0.5, 0.9, 0.1),
    }  # fmt: skip
    text = lost_in_fusion(maps, "bayes", 0.55)
    assert "**1 of 2** that ping holds occupied: dirrs saw 1 of them free" in text
    assert lost_in_fusion({"ping": maps["ping"], FUSED: maps["ping"]}, "bayes", 0.55) == ""


def test_a_frame_holds_the_path_and_leaves_a_ghost_out() -> None:
    rng = np.random.default_rng(1)
    walls = rng.uniform(0.0, 2.0, (500, 2))
    ghosts = np.array([[9.0, 9.0], [-9.0, 3.0]])
    path = np.array([[0.5, 0.5], [2.5, 1.0]])
    low, high = frame_around(path, np.concatenate([walls, ghosts]))
    assert (low > -0.1).all()
    assert high[0] == 2.5
    assert high[1] < 2.1
    known = np.array([[[0.0, 0.0], [3.0, 0.0]]])
    assert frame_around(path, walls, known).tolist() == [[0.0, 0.0], [3.0, 1.0]]


def test_axes_have_round_numbers_and_a_bar_of_a_round_length() -> None:
    frame = Frame("frame", (-0.13, 0.2), (2.33, 1.7))
    strips, places, numbers = axes_of(frame)
    assert numbers == ["0", "0.5", "1", "1.5", "2", "0.5", "1", "1.5"]
    assert len(places) == len(numbers) == len(strips) - 1
    bar, length_m = bar_of(frame)
    assert length_m == pytest.approx(bar[1, 0] - bar[0, 0])
    assert [nice_step(x) for x in (0.3, 1.0, 4.1, 70.0)] == [0.5, 1.0, 5.0, 100.0]
    assert ticks(-1.0, 1.0, 0.5) == [-1.0, -0.5, 0.0, 0.5, 1.0]
