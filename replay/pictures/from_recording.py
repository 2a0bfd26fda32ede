"""A recording (.rrd) → the map in it at a step, from its exact values."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mapping.artifacts import MergedGrid, RejectedReading
from mapping.beams import Beam
from recorder.errors import BadInput
from replay.diff.layers import never_seen, value_layer
from replay.pictures.opening import Asked, check_reading, chosen_layer
from replay.pictures.parts import Floats
from replay.pictures.views import (
    CLASSES,
    MapView,
    Overlaid,
    around_session,
    view_of_classes,
    view_of_grid,
)
from replay.rrd.reader import RrdRecording, map_names, read_rrd
from replay.rrd.steps import Step

_AFTER_READINGS = ("Snapshot", "Finished", "Classes", "Thresholded", "Border", "Segment")


def views_of_recording(path: Path, asked: Asked) -> list[MapView]:
    """The map of a recording, or each of those that it compares; FILE.rrd#NAME is one of them.

    Raises BadInput in one line.
    """
    file, mark, name = path.name.rpartition("#")
    if mark and not path.exists():
        whole = path.with_name(file)
        return [_view(read_rrd(whole, name), path.name, asked)]
    names = map_names(path)
    if names:
        return [_view(read_rrd(path, each), f"{path.name}#{each}", asked) for each in names]
    return [_view(read_rrd(path), path.name, asked)]


def _view(recording: RrdRecording, file: str, asked: Asked) -> MapView:
    beams = list(recording.beams())
    last = _step_of(recording, beams, asked)
    left_out = last.artifact == RejectedReading.__name__
    beam = _beam_at(recording, recording.rejected() if left_out else beams, last)
    classes = recording.classes() if asked.view == CLASSES else None
    layers = [*_exact_layers(recording), CLASSES]
    usual = _clearest(recording, beams) if beam is None else beam.layer
    name = chosen_layer(recording.path, asked.view, layers, usual)
    shown = [each for step, each in beams if step <= last.step]
    over = Overlaid(
        _lines_at(recording, name, last), recording.walls_m, _path(shown), beam,
        around_session(_path([b for _, b in beams]), _clearest_points(beams), recording.walls_m),
        tuple(dict.fromkeys(each.sensor for _, each in beams)),
    )  # fmt: skip
    when = _when(last, beam, left_out=left_out)
    if name == CLASSES:
        if classes is None or beam is not None:
            raise BadInput(f"{recording.path}: the classes are known at the end alone")
        return view_of_classes(
            recording.geometry, classes[0], classes[1], over, file=file, when=when
        )
    kind, rule = recording.kind_and_rule(name)
    exact = [s.step for s in recording.steps if name in s.exact and s.step <= last.step]
    start = recording.start_value(name)
    if exact:
        values = recording.grid(name, exact[-1])
    else:
        values = np.full(recording.geometry.shape, start or 0.0, np.float32)
    extra = recording.extra(name) if beam is None else {}
    layer = value_layer(
        name, kind or "probability", recording.geometry, values, rule=rule, start=start, extra=extra
    )
    return view_of_grid(
        recording.geometry, layer.probability, ~never_seen(layer), over, file=file, layer=name,
        when=when, rule=rule,
    )  # fmt: skip


def _when(last: Step, beam: Beam | None, *, left_out: bool) -> str:
    """Which moment of the run is shown, in words."""
    if beam is None:
        return "at the end"
    reading = f"a reading of {beam.sensor} left out" if left_out else f"reading {beam.number:,}"
    return f"at step {last.step:,}, {reading}"


def _exact_layers(recording: RrdRecording) -> list[str]:
    exact = {name for step in recording.steps for name in step.exact}
    return [name for name in recording.layers if name in exact]


def _step_of(recording: RrdRecording, beams: list[tuple[int, Beam]], asked: Asked) -> Step:
    """The step that is asked for; of a reading the one that brings it into the map."""
    steps = recording.steps
    if not steps:
        raise BadInput(f"{recording.path}: a recording without steps")
    if asked.step is not None:
        found = [each for each in steps if each.step == asked.step]
        if not found:
            raise BadInput(
                f"{recording.path}: there is no step {asked.step}; the last one is {steps[-1].step}"
            )
        return found[0]
    if asked.reading is None:
        return steps[-1]
    check_reading(recording.path, asked.reading, 1 + max((b.number for _, b in beams), default=-1))
    merged = MergedGrid.__name__
    found = [each for each in steps if (each.reading, each.artifact) == (asked.reading, merged)]
    if not found:
        raise BadInput(f"{recording.path}: reading {asked.reading} is not shown in it")
    return found[-1]


def _beam_at(recording: RrdRecording, beams: list[tuple[int, Beam]], last: Step) -> Beam | None:
    """The newest reading at a step; none once the results are shown."""
    before = [beam for step, beam in beams if step <= last.step]
    if not before or last.artifact in _AFTER_READINGS:
        return None
    return before[-1]


def _path(beams: list[Beam]) -> Floats:
    points = [(beam.world_from_base.x_m, beam.world_from_base.y_m) for beam in beams]
    return np.array(points, np.float64).reshape(-1, 2)


def _clearest_points(beams: list[tuple[int, Beam]]) -> Floats:
    """The obstacle points of the narrowest beams, (N, 2), metres."""
    least = min((beam.beam_width_rad for _, beam in beams), default=0.0)
    found = [beam.points_m for _, beam in beams if beam.beam_width_rad == least]
    return np.concatenate([np.zeros((0, 2)), *found])


def _lines_at(recording: RrdRecording, layer: str, last: Step) -> Floats:
    """The lines of the layer's grid that were found last before a step."""
    whole = [s.step for s in recording.steps if (s.artifact, s.layer) == ("Snapshot", layer)]
    since = max((step for step in whole if step <= last.step), default=None)
    if since is None:
        return np.zeros((0, 2, 2))
    found = [
        (segment.start_m, segment.end_m)
        for step, segment in recording.segments()
        if since <= step <= last.step and (segment.layer, segment.source) == (layer, "grid")
    ]
    return np.array(found, np.float64).reshape(-1, 2, 2)


def _clearest(recording: RrdRecording, beams: list[tuple[int, Beam]]) -> str:
    """The layer of the narrowest beams; the last one, fused where there is one, if many are so."""
    layers = _exact_layers(recording)
    if not layers:
        raise BadInput(f"{recording.path}: holds no layer with exact values")
    widths: dict[str, float] = {}
    for _, beam in beams:
        widths.setdefault(beam.layer, beam.beam_width_rad)
    narrowest = [name for name in layers if widths.get(name) == min(widths.values(), default=0.0)]
    return narrowest[0] if len(narrowest) == 1 else layers[-1]
