"""The way to borders and lines in a recording: thresholds side by side, the tracer, the stages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from rerun.chunk import RrdReader

from mapping.artifacts import Artifact, Border, LineStage, Segment, Snapshot, TracerStep
from mapping.borders import threshold_layer, trace_borders
from mapping.config import MappingConfig, load_config
from mapping.pipeline import build_maps
from recorder.session import read_session
from replay.rrd import layout
from replay.rrd.explanation import describe, layer_of
from replay.rrd.reader import RrdRecording, read_rrd
from replay.rrd.results import arrow
from replay.rrd.writer import run_writer

STEPS = 7


def config_of(*settings: str) -> MappingConfig:
    return load_config(
        settings=["grid.resolution_m=0.05", f"rerun.tracer_steps={STEPS}", *settings]
    )


@pytest.fixture(scope="module")
def artifacts() -> list[Artifact]:
    messages = list(read_session(ROOT / "logs" / "room.mcap").messages())
    return list(build_maps(messages, config_of()))


@pytest.fixture(scope="module")
def recording(artifacts: list[Artifact], tmp_path_factory: pytest.TempPathFactory) -> RrdRecording:
    path = Path(tmp_path_factory.mktemp("rrd"), "run.rrd")
    with run_writer(path, config_of(), name="run") as writer:
        for artifact in artifacts:
            writer(artifact)
    return read_rrd(path)


def rows_of(recording: RrdRecording, entity: str, component: str) -> list[Any]:
    """Every value that a component of an entity ever had, in the order of the steps."""
    rows = []
    for chunk in RrdReader(recording.path).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            steps = batch.column(layout.STEP).to_pylist()
            rows += list(zip(steps, batch.column(component).to_pylist(), strict=True))
    return [value for _, value in sorted(rows, key=lambda row: row[0]) if value is not None]


def newest(recording: RrdRecording, entity: str, component: str) -> Any:
    """The last value of a component, or None."""
    rows = rows_of(recording, entity, component)
    return rows[-1] if rows else None


def test_every_stage_and_tracer_step_is_a_step_of_the_recording(
    artifacts: list[Artifact], recording: RrdRecording
) -> None:
    names = [type(artifact).__name__ for artifact in artifacts]
    assert [step.artifact for step in recording.steps] == names
    for kind in (TracerStep, LineStage):
        layers = [layer_of(artifact) for artifact in artifacts if isinstance(artifact, kind)]
        assert layers == [s.layer for s in recording.steps if s.artifact == kind.__name__]
        assert set(layers) <= set(recording.layers)
    assert {a.kind for a in artifacts if isinstance(a, LineStage)} == {
        "split", "merge", "fit", "corner",
    }  # fmt: skip


def test_the_tracer_walks_the_longest_border_and_points_at_its_next_cell(
    artifacts: list[Artifact],
) -> None:
    for layer in ("ping", "dirrs", "fused"):
        borders = [a for a in artifacts if isinstance(a, Border) and a.layer == layer]
        walk = [a for a in artifacts if isinstance(a, TracerStep) and a.layer == layer]
        longest = max(borders, key=lambda border: len(border.cells))
        assert len(walk) == min(STEPS, len(longest.cells))
        for number, step in enumerate(walk, 1):
            assert step.border == longest.number
            np.testing.assert_array_equal(step.cells, longest.cells[:number])
            following = tuple(longest.cells[number % len(longest.cells)].tolist())
            assert step.following == following == tuple(step.tried[-1].tolist())
            assert f"cell {number} of border {longest.number}" in describe(step)


def test_lines_and_borders_keep_their_exact_values_and_have_labels(
    artifacts: list[Artifact], recording: RrdRecording
) -> None:
    wanted = [a for a in artifacts if isinstance(a, Segment)]
    assert [(s.layer, s.start_m, s.points) for _, s in recording.segments()] == [
        (s.layer, s.start_m, s.points) for s in wanted
    ]
    borders = [a for a in artifacts if isinstance(a, Border)]
    assert [(b.layer, b.number, b.outer) for _, b in recording.borders()] == [
        (b.layer, b.number, b.outer) for b in borders
    ]
    labels = newest(recording, layout.group(layout.borders("dirrs"), 0), "LineStrips2D:labels")
    mine = [b for b in borders if b.layer == "dirrs"][: layout.GROUP]
    assert labels == [f"border {b.number}, {'outer' if b.outer else 'hole'}" for b in mine]
    labels = newest(
        recording, layout.group(layout.segments("dirrs", "raw"), 0), "LineStrips2D:labels"
    )
    first = next(s for s in wanted if (s.layer, s.source) == ("dirrs", "raw"))
    assert labels[0].startswith(f"{first.length_m:.2f} m, rms ")
    assert labels[0].endswith(f"n {first.points}")


@pytest.mark.parametrize("threshold", [0.51, 0.55, 0.60])
def test_each_threshold_has_its_cells_and_its_borders(
    artifacts: list[Artifact], recording: RrdRecording, threshold: float
) -> None:
    final = [a for a in artifacts if isinstance(a, Snapshot) and a.final]
    assert len(final) == 3
    for snapshot in final:
        root = layout.compared(snapshot.layer.name, threshold)
        occupied = threshold_layer(snapshot.layer, threshold).occupied
        tiling = layout.results_tiling_for(recording.geometry)
        for row, col in tiling:
            part = occupied[tiling.window(row, col).slices]
            shown = newest(recording, layout.tile(root, row, col), "SegmentationImage:buffer")
            cells = np.zeros(part.size, bool) if shown is None else np.array(shown[0], bool)
            np.testing.assert_array_equal(cells.reshape(part.shape), part)
        strips = newest(recording, f"{root}/borders", "LineStrips2D:strips")
        assert strips is not None
        traced = trace_borders(occupied)
        assert [len(strip) - 1 for strip in strips] == [len(border.cells) for border in traced]


def test_the_text_of_a_snapshot_has_a_row_for_each_threshold(recording: RrdRecording) -> None:
    texts = [row[0] for row in rows_of(recording, layout.EXPLANATION, "TextDocument:text")]
    tables = [text for text in texts if "Above each threshold" in text]
    assert len(tables) == 3
    assert all("| 0.51 |" in text and "| 0.6 |" in text for text in tables)


def test_stages_come_one_by_one_or_not_at_all_as_asked() -> None:
    messages = list(read_session(ROOT / "logs" / "room.mcap").messages())
    each = [
        a
        for a in build_maps(messages, config_of("rerun.line_stages=each"))
        if isinstance(a, LineStage)
    ]
    assert len(each) > 50
    assert all(max(len(stage.pieces_m), len(stage.places_m)) == 1 for stage in each)
    none = build_maps(messages, config_of("rerun.line_stages=none", "rerun.tracer_steps=0"))
    assert not any(isinstance(a, LineStage | TracerStep) for a in none)


def test_no_thresholds_no_pictures(artifacts: list[Artifact], tmp_path: Path) -> None:
    config = config_of("borders.compare=[]")
    with run_writer(tmp_path / "run.rrd", config, name="run") as writer:
        for artifact in artifacts:
            writer(artifact)
    found = read_rrd(tmp_path / "run.rrd")
    root = layout.compared("ping", 0.51)
    assert newest(found, f"{root}/borders", "LineStrips2D:strips") is None


def test_an_arrow_ends_with_its_head() -> None:
    strip = arrow(np.zeros(2), np.array([1.0, 0.0]))
    np.testing.assert_array_equal(strip[[0, 1, -1]], [[0, 0], [1, 0], [1, 0]])
    assert strip[2, 1] == -strip[3, 1] != 0.0
    assert strip[2, 0] == strip[3, 0] < 1.0
