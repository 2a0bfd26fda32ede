"""Recordings (.rrd): the last exact values of each layer, with borders, lines and the steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from recorder.errors import BadInput
from replay.diff.layers import (
    MapLayer,
    Moment,
    Source,
    Values,
    line_of,
    outline_of,
    value_layer,
)
from replay.rrd.reader import RrdRecording, read_rrd


@dataclass(frozen=True, slots=True)
class RecordedSteps:
    """The steps of a recording, as :class:`replay.diff.layers.History`."""

    recording: RrdRecording

    def last_written(self, layer: str, row: int, col: int) -> Moment | None:
        """The first step from which on the cell keeps the value that it ends with."""
        held: float | None = None
        found: Moment | None = None
        for moment, grid in self.grids(layer):
            value = float(grid[row, col])
            if held is None or (value != held and not (value != value and held != held)):
                held, found = value, moment
        return found

    def grids(self, layer: str) -> Iterator[tuple[Moment, Values]]:
        """Each step at which the layer's values are exact, with the whole grid."""
        said = {step.step: step for step in self.recording.steps}
        for number, grid in self.recording.grids(layer):
            step = said.get(number)
            reading, artifact = (step.reading, step.artifact) if step else (0, "")
            yield Moment(number, reading, artifact), grid


def read_recording(path: Path) -> Source:
    """All layers of a recording at its end. Raises BadInput for a file that holds none."""
    recording = read_rrd(path)
    exact = {name for step in recording.steps for name in step.exact}
    layers = {name: _layer(recording, name) for name in recording.layers if name in exact}
    if not layers:
        raise BadInput(f"{path}: holds no layer with exact values")
    notes = []
    if recording.damaged:
        notes.append(f"{path.name} was not ended properly; it is compared as far as it goes")
    missing = [name for name in recording.layers if name not in exact]
    if missing:
        notes.append(f"{path.name} holds no exact values of {', '.join(missing)}")
    return Source(
        path, "recording", layers, config_toml=recording.config_text, notes=tuple(notes),
        damaged=recording.damaged, history=RecordedSteps(recording),
    )  # fmt: skip


def _layer(recording: RrdRecording, name: str) -> MapLayer:
    """Only the newest lines and borders count: those of the last time they were worked out."""
    kind, _ = recording.kind_and_rule(name)
    snapshots = [s.step for s in recording.steps if s.artifact == "Snapshot" and s.layer == name]
    since = snapshots[-1] if snapshots else 0
    segments = [s for step, s in recording.segments() if s.layer == name and step >= since]
    borders = [b for step, b in recording.borders() if b.layer == name and step >= since]
    return value_layer(
        name, kind or "probability", recording.geometry, recording.grid(name),
        extra=recording.extra(name), lines=tuple(line_of(s) for s in segments),
        borders=tuple(outline_of(b) for b in borders),
    )  # fmt: skip
