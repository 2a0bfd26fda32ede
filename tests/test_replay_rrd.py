"""Written, then read back: everything that a recording holds comes out exactly as it went in."""

from __future__ import annotations

import dataclasses
import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import FIRST_T_NS, STEP_NS, MadeRun
from rerun.chunk import RrdReader

from mapping.artifacts import (
    Artifact,
    Border,
    MergedGrid,
    RawPoints,
    Segment,
    Snapshot,
    Started,
    TempGrid,
    Thresholded,
)
from mapping.beams import Beam
from mapping.grid import GridGeometry, Layer
from recorder.errors import BadInput
from recorder.geometry import SE2
from replay.rrd import layout
from replay.rrd.reader import RrdRecording, read_rrd
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.writer import RrdWriter

CONFIG = "[grid]\nresolution_m = 0.02  # cells\n"


def write(path: Path, artifacts: list[Artifact], **options: object) -> RrdWriter:
    with RrdWriter(path, RunDrawer(CONFIG), name="made", **options) as writer:
        for artifact in artifacts:
            writer(artifact)
    return writer


def values_after(artifacts: list[Artifact], layer: str) -> dict[int, np.ndarray]:
    """The whole grid of a layer after each step that changed it, kept the obvious way."""
    grid = np.full(artifacts[0].geometry.shape, 0.5, np.float32)
    after = {}
    for step, artifact in enumerate(artifacts):
        if isinstance(artifact, MergedGrid) and artifact.layer == layer:
            grid[artifact.window.slices] = artifact.values
        elif isinstance(artifact, Snapshot) and artifact.layer.name == layer:
            grid = artifact.layer.values.copy()
        else:
            continue
        after[step] = grid.copy()
    return after


@pytest.fixture(scope="module")
def artifacts() -> list[Artifact]:
    return list(MadeRun(readings=14).artifacts())


@pytest.fixture(scope="module")
def recording(artifacts: list[Artifact], tmp_path_factory: pytest.TempPathFactory) -> RrdRecording:
    path = tmp_path_factory.mktemp("rrd") / "made.rrd"
    write(path, artifacts)
    return read_rrd(path)


def same_bits(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def test_every_artifact_is_one_step_on_three_timelines(
    recording: RrdRecording, artifacts: list[Artifact]
) -> None:
    assert [step.step for step in recording.steps] == list(range(len(artifacts)))
    assert [step.artifact for step in recording.steps] == [type(a).__name__ for a in artifacts]
    number = 0
    for step, artifact in zip(recording.steps, artifacts, strict=True):
        if isinstance(artifact, Beam):
            number = artifact.number
        assert step.reading == number
        assert step.t_ns == FIRST_T_NS + number * STEP_NS


def test_what_the_run_was_is_kept(recording: RrdRecording, artifacts: list[Artifact]) -> None:
    assert recording.geometry == artifacts[0].geometry
    assert recording.layers == ("ping", "dirrs", "fused")
    assert same_bits(recording.walls_m, artifacts[0].walls_m)
    assert recording.config_text == CONFIG
    assert recording.kind_and_rule("ping") == ("probability", "bayes")
    assert not recording.damaged


@pytest.mark.parametrize("layer", ["ping", "dirrs", "fused"])
def test_grids_come_back_bit_for_bit_at_every_step(
    recording: RrdRecording, artifacts: list[Artifact], layer: str
) -> None:
    expected = values_after(artifacts, layer)
    got = dict(recording.grids(layer))
    assert set(got) <= set(expected)
    first = min(expected)
    for step in range(first, len(artifacts)):
        newest = expected[max(each for each in expected if each <= step)]
        assert same_bits(recording.grid(layer, step), newest), step
        if step in got:
            assert same_bits(got[step], newest), step
    # Steps that changed nothing in the file may be missing from the iteration, none else.
    assert same_bits(got[max(got)], expected[max(expected)])
    assert same_bits(recording.grid(layer), expected[max(expected)])


def test_a_layer_has_no_values_before_its_first(recording: RrdRecording) -> None:
    with pytest.raises(BadInput, match="no exact values of ping"):
        recording.grid("ping", 0)
    with pytest.raises(BadInput, match="there are ping, dirrs, fused"):
        recording.grid("sonar")
    with pytest.raises(BadInput, match="no step 4000"):
        recording.grid("ping", 4000)


def test_beams_come_back_exactly(recording: RrdRecording, artifacts: list[Artifact]) -> None:
    expected = [(i, a) for i, a in enumerate(artifacts) if isinstance(a, Beam)]
    got = list(recording.beams())
    assert len(got) == len(expected)
    for (step, beam), (want_step, want) in zip(got, expected, strict=True):
        assert step == want_step
        for field in dataclasses.fields(Beam):
            a, b = getattr(beam, field.name), getattr(want, field.name)
            assert same_bits(a, b) if isinstance(a, np.ndarray) else a == b, field.name


def test_results_come_back_exactly(recording: RrdRecording, artifacts: list[Artifact]) -> None:
    segments = [(i, a) for i, a in enumerate(artifacts) if isinstance(a, Segment)]
    for (step, segment), (want_step, want) in zip(recording.segments(), segments, strict=True):
        assert step == want_step
        assert dataclasses.replace(segment, covariance=want.covariance) == want
        assert same_bits(segment.covariance, want.covariance)
    borders = [(i, a) for i, a in enumerate(artifacts) if isinstance(a, Border)]
    for (step, border), (want_step, want) in zip(recording.borders(), borders, strict=True):
        assert (step, border.layer, border.number) == (want_step, want.layer, want.number)
        assert border.outer == want.outer
        assert same_bits(border.cells, want.cells)
    for points in (a for a in artifacts if isinstance(a, RawPoints)):
        assert same_bits(recording.raw_points_m(points.layer), points.points_m)
    for thresholded in (a for a in artifacts if isinstance(a, Thresholded)):
        got = recording.thresholded(thresholded.layer)
        assert got is not None
        assert got[0] == thresholded.threshold
        assert same_bits(got[1], thresholded.occupied)
    names, codes = recording.classes() or ((), np.zeros(0))
    assert names == artifacts[-2].names
    assert same_bits(codes, artifacts[-2].codes)


def test_odd_values_and_names_come_back(tmp_path: Path) -> None:
    """NaN, infinities, -0.0, a name that means something in a path, a rule's further arrays."""
    geometry = GridGeometry((-1.5, 2.25), 0.05, 70, 3)
    values = np.zeros(geometry.shape, np.float32)
    values[:5, 0] = [np.nan, np.inf, -np.inf, -0.0, 1e-45]
    conflict = np.linspace(0, 1, values.size, dtype=np.float32).reshape(values.shape)
    seen = np.ones(geometry.shape, bool)
    name = "left / 2nd: ünder"
    layer = Layer(name, "mass", geometry, values, conflict, seen, {"con flict": conflict})
    started = Started(geometry, (name,), np.zeros((0, 2, 2)), 5, 9)
    write(tmp_path / "odd.rrd", [started, Snapshot(layer, "dempster-shafer", True)])
    recording = read_rrd(tmp_path / "odd.rrd")
    assert recording.layers == (name,)
    assert same_bits(recording.grid(name), values)
    assert [step for step, _ in recording.grids(name)] == [1]
    assert same_bits(recording.extra(name)["con flict"], conflict)
    assert recording.walls_m.shape == (0, 2, 2)
    assert recording.kind_and_rule(name) == ("mass", "dempster-shafer")


@settings(deadline=None, max_examples=12)
@given(
    rows=st.integers(1, 150), cols=st.integers(1, 150), readings=st.integers(1, 5),
    seed=st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_any_grid_any_windows(
    tmp_path_factory: pytest.TempPathFactory, rows: int, cols: int, readings: int, seed: int
) -> None:
    """Random bits in random windows, at any size of grid, whatever the tiles."""
    random = np.random.default_rng(seed)
    run = MadeRun(GridGeometry((0.0, 0.0), 0.1, rows, cols), readings=readings)
    artifacts: list[Artifact] = []
    for artifact in run.artifacts():
        if isinstance(artifact, MergedGrid):
            bits = random.integers(0, 2**32, artifact.values.shape, dtype=np.uint32)
            artifact = dataclasses.replace(artifact, values=bits.view(np.float32))
        if isinstance(artifact, (Started, Beam, TempGrid, MergedGrid)):
            artifacts.append(artifact)
    path = tmp_path_factory.mktemp("any") / "any.rrd"
    write(path, artifacts)
    recording = read_rrd(path)
    for layer in {a.layer for a in artifacts if isinstance(a, MergedGrid)}:
        for step, want in values_after(artifacts, layer).items():
            assert same_bits(recording.grid(layer, step), want)


def test_a_scan_and_a_reading_that_saw_nothing(tmp_path: Path) -> None:
    run = MadeRun(readings=1)
    beam = run.beam(0)
    scan = dataclasses.replace(
        beam, number=1, sensor="lidar", bearings_rad=np.linspace(-1, 1, 5),
        ranges_m=np.array([0.5, np.inf, 0.7, 0.8, np.inf]), world_from_sensor=SE2(0.5, 0.5, 0.1),
    )  # fmt: skip
    nothing = dataclasses.replace(beam, number=2, ranges_m=np.array([np.inf]))
    started = next(run.artifacts())
    write(tmp_path / "scan.rrd", [started, beam, scan, nothing])
    beams = [each for _, each in read_rrd(tmp_path / "scan.rrd").beams()]
    assert [each.sensor for each in beams] == ["ping", "lidar", "ping"]
    assert same_bits(beams[1].ranges_m, scan.ranges_m)
    assert same_bits(beams[2].ranges_m, nothing.ranges_m)


def test_only_every_third_reading_is_shown_but_all_count(
    tmp_path: Path, artifacts: list[Artifact]
) -> None:
    write(tmp_path / "thin.rrd", artifacts, every=3)
    recording = read_rrd(tmp_path / "thin.rrd")
    assert [beam.number for _, beam in recording.beams()] == [0, 3, 6, 9, 12]
    numbers = {step.step for step in recording.steps}
    for layer in ("ping", "dirrs"):
        expected = values_after(artifacts, layer)
        for step, grid in recording.grids(layer):
            assert step in numbers
            assert same_bits(grid, expected[step])
        assert same_bits(recording.grid(layer), expected[max(expected)])


def hard_to_predict(run: MadeRun) -> list[Artifact]:
    """The same run with a rule that nothing can predict: values of random bits."""
    random = np.random.default_rng(7)
    artifacts: list[Artifact] = []
    for artifact in run.artifacts():
        if isinstance(artifact, MergedGrid):
            bits = random.integers(0, 2**32, artifact.values.shape, dtype=np.uint32)
            artifact = dataclasses.replace(artifact, values=bits.view(np.float32))
        artifacts.append(artifact)
    return artifacts


@pytest.mark.parametrize("hard", [False, True])
def test_a_budget_is_kept_and_reported(tmp_path: Path, hard: bool) -> None:
    run = MadeRun(readings=700)
    artifacts = hard_to_predict(run) if hard else list(run.artifacts())
    whole = write(tmp_path / "whole.rrd", artifacts, budget_mb=1000.0)
    assert whole.left_out == ""
    whole_mb = (tmp_path / "whole.rrd").stat().st_size / 1e6
    budget_mb = whole_mb * (0.5 if hard else 0.75)
    writer = write(tmp_path / "small.rrd", artifacts, budget_mb=budget_mb)
    assert (tmp_path / "small.rrd").stat().st_size <= budget_mb * 1e6
    assert "All readings go into the map" in writer.left_out
    assert ("exact values are kept at one of" in writer.left_out) == hard
    small = read_rrd(tmp_path / "small.rrd")
    for layer in small.layers:
        expected = values_after(artifacts, layer)
        assert same_bits(small.grid(layer), expected[max(expected)])
        exact = {step.step for step in small.steps if layer in step.exact}
        for step, grid in small.grids(layer):
            assert step in exact
            assert same_bits(grid, expected[step])


def test_a_budget_too_small_for_the_maps_alone_is_reported(tmp_path: Path) -> None:
    writer = write(tmp_path / "tiny.rrd", list(MadeRun(readings=60).artifacts()), budget_mb=0.1)
    size_mb = (tmp_path / "tiny.rrd").stat().st_size / 1e6
    assert writer.left_out.endswith(f"Even so it takes {size_mb:.1f} MB.")


def test_what_was_left_out_is_not_made_up(tmp_path: Path) -> None:
    """A step whose exact values were left out says so; it does not hand out older ones."""
    run = MadeRun(readings=420)
    write(tmp_path / "small.rrd", hard_to_predict(run), budget_mb=1.5)
    recording = read_rrd(tmp_path / "small.rrd")
    inexact = [s.step for s in recording.steps if "ping" not in s.exact and s.step > 200]
    assert inexact
    with pytest.raises(BadInput, match="the nearest before it that does is"):
        recording.grid("ping", inexact[0])


def test_the_file_has_its_name_only_when_whole(tmp_path: Path, artifacts: list[Artifact]) -> None:
    path = tmp_path / "run.rrd"
    with RrdWriter(path, RunDrawer(), name="run") as writer:
        for artifact in artifacts:
            writer(artifact)
            assert not path.exists()
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


def test_an_error_leaves_nothing(tmp_path: Path, artifacts: list[Artifact]) -> None:
    ends_badly = [artifacts[0], artifacts[1], "no artifact"]
    with pytest.raises(TypeError):
        write(tmp_path / "x.rrd", ends_badly)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_the_first_artifact_opens_the_run(tmp_path: Path, artifacts: list[Artifact]) -> None:
    with pytest.raises(TypeError, match="first artifact is Started, not Beam"):
        write(tmp_path / "x.rrd", artifacts[1:])


def test_a_full_disk_is_reported_before_anything_hangs(
    tmp_path: Path, artifacts: list[Artifact], monkeypatch: pytest.MonkeyPatch
) -> None:
    full = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: full)
    with pytest.raises(BadInput, match="no space left"):
        write(tmp_path / "x.rrd", artifacts)
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_gets_one_line(
    tmp_path: Path, artifacts: list[Artifact]
) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(BadInput, match="cannot be written") as caught:
        write(tmp_path / "file" / "x.rrd", artifacts)
    assert "\n" not in str(caught.value)


def test_many_borders_are_all_drawn_and_go_when_the_stage_starts_anew(tmp_path: Path) -> None:
    geometry = GridGeometry((0.0, 0.0), 0.1, 40, 40)
    occupied = np.ones(geometry.shape, bool)
    cells = np.array([[1, 1], [1, 2], [2, 2]])
    again = Thresholded("ping", geometry, 0.5, occupied)
    borders = [Border("ping", number, True, geometry, cells) for number in range(70)]
    started = Started(geometry, ("ping",), np.zeros((0, 2, 2)), 5, 9)
    write(tmp_path / "b.rrd", [started, again, *borders, again, borders[0]])
    drawn = np.zeros((74, 3), int)
    stream = RrdReader(tmp_path / "b.rrd").store().stream()
    for chunk in stream.filter(content=f"{layout.borders('ping')}/**", is_static=False):
        batch = chunk.to_record_batch()
        if chunk.entity_path.endswith("/newest"):
            continue
        if "LineStrips2D:strips" in batch.schema.names:
            steps = batch.column("step").to_pylist()
            counts = [len(row) for row in batch.column("LineStrips2D:strips").to_pylist()]
            for step, count in zip(steps, counts, strict=True):
                drawn[step:, int(chunk.entity_path[-3:])] = count
    assert drawn.sum(axis=1)[1:].tolist() == [*range(71), 0, 1]
    assert [border.number for _, border in read_rrd(tmp_path / "b.rrd").borders()] == [
        *range(70),
        0,
    ]


def interrupted(tmp_path: Path, artifacts: list[Artifact]) -> Path:
    """What a process killed in the middle leaves: flushed, but never ended."""
    writer = RrdWriter(tmp_path / "killed.rrd", RunDrawer(CONFIG), name="x", flush_readings=1)
    for artifact in artifacts[: len(artifacts) // 2]:
        writer(artifact)
    copy = tmp_path / "copy.rrd"
    copy.write_bytes(writer.part.read_bytes())
    writer.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    return copy


@pytest.mark.parametrize("cut", [0, 700])
def test_an_interrupted_recording_is_read_as_far_as_it_goes(
    tmp_path: Path, artifacts: list[Artifact], cut: int
) -> None:
    path = interrupted(tmp_path, list(MadeRun(readings=160).artifacts()))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - cut])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = read_rrd(path)
    assert recording.damaged
    assert recording.config_text == CONFIG
    expected = values_after(list(MadeRun(readings=160).artifacts()), "ping")
    got = list(recording.grids("ping"))
    assert len(got) >= 10
    for step, grid in got:
        assert same_bits(grid, expected[step])


@pytest.mark.parametrize("data", [b"", b"RRF2", b"not a recording at all" * 40])
def test_what_is_no_recording_gets_one_line(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "bad.rrd"
    path.write_bytes(data)
    with pytest.raises(BadInput) as caught:
        read_rrd(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(BadInput, match="no such file"):
        read_rrd(tmp_path / "none.rrd")
