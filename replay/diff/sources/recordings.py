"""Recordings (.rrd): the last exact values of each layer, with borders, lines and the steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mapping.fusion import FUSED
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
from replay.rrd.reader import RrdRecording, map_names, read_rrd


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
        steps = {step.step: step for step in self.recording.steps}
        for number, grid in self.recording.grids(layer):
            step = steps.get(number)
            reading, artifact = (step.reading, step.artifact) if step else (0, "")
            yield Moment(number, reading, artifact), grid


def read_recording(path: Path, name: str = "") -> Source:
    """All layers of a recording at its end; ``name`` is that of one of several maps in it.

    Raises BadInput for a file that holds none, and where the map is not named that is meant.
    """
    recording = _opened(path, name)
    exact = {name for step in recording.steps for name in step.exact}
    widths_rad = _beam_widths_rad(recording)
    layers = {
        each: _layer(recording, each, widths_rad.get(each))
        for each in recording.layers
        if each in exact
    }
    if not layers:
        raise BadInput(f"{path}: holds no layer with exact values")
    notes = []
    if recording.damaged:
        notes.append(f"{path.name} was not ended properly; it is compared as far as it goes")
    missing = [each for each in recording.layers if each not in exact]
    if missing:
        notes.append(f"{path.name} holds no exact values of {', '.join(missing)}")
    shown = path.with_name(f"{path.name}#{name}") if name else path
    return Source(
        shown, "recording", layers, config_toml=recording.config_text, notes=tuple(notes),
        damaged=recording.damaged, history=RecordedSteps(recording),
    )  # fmt: skip


def _opened(path: Path, name: str) -> RrdRecording:
    if name:
        names = map_names(path)
        if name not in names:
            there = f"the maps in it are {', '.join(names)}" if names else "it holds a single map"
            raise BadInput(f"{path}: no map {name!r}; {there}")
        return read_rrd(path, name)
    try:
        return read_rrd(path)
    except BadInput:
        names = map_names(path)
        if not names:
            raise
        raise BadInput(
            f"{path}: holds several maps: {', '.join(names)}; name one, as in {path}#{names[0]}"
        ) from None


def _beam_widths_rad(recording: RrdRecording) -> dict[str, float]:
    """The width of the first beam of each layer that has beams of its own."""
    awaited = set(recording.layers) - {FUSED}
    widths_rad: dict[str, float] = {}
    for _, beam in recording.beams():
        widths_rad.setdefault(beam.layer, beam.beam_width_rad)
        if awaited <= set(widths_rad):
            break
    return widths_rad


def _layer(recording: RrdRecording, name: str, beam_width_rad: float | None) -> MapLayer:
    """Only the newest lines and borders count: those of the last time they were worked out."""
    kind, rule = recording.kind_and_rule(name)
    snapshots = [s.step for s in recording.steps if s.artifact == "Snapshot" and s.layer == name]
    since = snapshots[-1] if snapshots else 0
    segments = [s for step, s in recording.segments() if s.layer == name and step >= since]
    borders = [b for step, b in recording.borders() if b.layer == name and step >= since]
    return value_layer(
        name, kind or "probability", recording.geometry, recording.grid(name), rule=rule,
        start=recording.start_value(name),
        extra=recording.extra(name), lines=tuple(line_of(s) for s in segments),
        borders=tuple(outline_of(b) for b in borders), beam_width_rad=beam_width_rad,
    )  # fmt: skip
