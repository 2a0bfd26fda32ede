"""A recording whose writer was killed, or whose end is missing, is read as far as it goes."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from made_run import MadeRun

from mapping.artifacts import MergedGrid, TempGrid
from mapping.beams import Beam
from recorder.errors import BadInput
from replay.rrd import writer as writing
from replay.rrd.reader import RrdRecording, read_rrd
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.writer import RrdWriter

READINGS = 300
_WRITE = """
import sys
from made_run import MadeRun
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.writer import RrdWriter
with RrdWriter(sys.argv[1], RunDrawer(), name="killed", flush_readings=20) as writer:
    for artifact in MadeRun(readings=int(sys.argv[2])).artifacts():
        writer(artifact)
        print(type(artifact).__name__, flush=True)
"""


def values_after(layer: str) -> dict[int, np.ndarray]:
    """The whole grid of a layer after each reading of the run, by step."""
    grids, grid = {}, np.full(MadeRun().geometry.shape, 0.5, np.float32)
    for step, artifact in enumerate(MadeRun(readings=READINGS).artifacts()):
        if isinstance(artifact, MergedGrid) and artifact.layer == layer:
            grid[artifact.window.slices] = artifact.values
            grids[step] = grid.copy()
    return grids


@pytest.fixture(scope="module")
def expected() -> dict[int, np.ndarray]:
    return values_after("ping")


def all_there_is_right(recording: RrdRecording, expected: dict[int, np.ndarray]) -> int:
    """How many grids there are, each of which is as it was written."""
    found = 0
    for step, grid in recording.grids("ping"):
        found += 1
        if step in expected:
            assert grid.tobytes() == expected[step].tobytes()
    steps = [step.step for step in recording.steps]
    assert steps == list(range(len(steps)))
    beams = [beam.number for _, beam in recording.beams()]
    assert beams == list(range(len(beams)))
    return found


@pytest.mark.parametrize("seed", [1, 2])
def test_a_killed_writer_loses_no_more_than_what_was_not_yet_written(
    tmp_path: Path, expected: dict[int, np.ndarray], seed: int
) -> None:
    artifacts = random.Random(seed).randrange(300, 3 * READINGS)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    path = tmp_path / "killed.rrd"
    with subprocess.Popen(
        [sys.executable, "-c", _WRITE, str(path), str(READINGS)],
        stdout=subprocess.PIPE, env=environment, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        for _ in range(artifacts):
            assert process.stdout.readline(), "the writer ended by itself"
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    [part] = tmp_path.glob("killed.rrd.*.part")
    recording = read_rrd(part)
    assert recording.damaged
    # The first look at the file's size comes after 50 readings, and then half as late again.
    written = artifacts // 3
    assert all_there_is_right(recording, expected) >= (written - max(53, written // 2)) // 2


def test_any_beginning_of_a_file_is_read_or_refused_in_one_line(
    tmp_path: Path, expected: dict[int, np.ndarray]
) -> None:
    whole = tmp_path / "whole.rrd"
    with RrdWriter(whole, RunDrawer(), name="cut", flush_readings=60) as writer:
        for artifact in MadeRun(readings=READINGS).artifacts():
            writer(artifact)
    data, choose = whole.read_bytes(), random.Random(5)
    most, refusals = 0, list[str]()
    for size in [100, *(choose.randrange(len(data)) for _ in range(6)), len(data) - 1]:
        cut = tmp_path / "cut.rrd"
        cut.write_bytes(data[:size])
        try:
            recording = read_rrd(cut)
        except BadInput as error:
            refusals.append(str(error))
            continue
        assert recording.damaged
        most = max(most, all_there_is_right(recording, expected))
    assert most > 50
    assert len(refusals) < 4
    assert all("cannot be read" in text and "\n" not in text for text in refusals)


def test_what_waits_in_memory_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows wait up to a bound of bytes, and are in the file before more come."""
    bound = 400_000
    monkeypatch.setattr(writing, "_BUFFER_BYTES", bound)
    most, sizes = 0, set()
    with RrdWriter(
        tmp_path / "x.rrd", RunDrawer(), name="x", budget_mb=1000.0, flush_readings=10**6
    ) as writer:
        for artifact in MadeRun(readings=READINGS).artifacts():
            writer(artifact)
            if not isinstance(artifact, Beam | TempGrid | MergedGrid):
                continue  # the end writes all its maps at once
            waiting = writer.waiting_bytes
            most = max(most, waiting)
            if waiting == 0:
                sizes.add(writer.part.stat().st_size)
            sizes.add(writer.part.stat().st_size)
    one_reading = 60_000  # of this grid, roughly: its pictures, patches, texts
    assert bound / 2 < most < bound + one_reading
    assert len(sizes) > 3
