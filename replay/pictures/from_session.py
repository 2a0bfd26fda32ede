"""A session → the map of it at a moment: mapped as far as that reading, and no further."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mapping.artifacts import Artifact, Classes, MergedGrid
from mapping.beams import Beam
from mapping.config import MappingConfig
from mapping.layer_map import empty_maps
from mapping.pipeline import (
    MANY,
    Trail,
    build_maps,
    geometry_of,
    merge,
    raw_lines,
    result_stages,
    started_run,
)
from mapping.placed_session import PlacedSession, place_session
from mapping.readings import Readings, raw_points
from recorder.errors import BadInput
from recorder.session.columns import open_session
from recorder.truth import true_walls
from replay.collector import Collector
from replay.mapping_run import cores
from replay.pictures.opening import Asked, Progress, check_reading, chosen_layer
from replay.pictures.parts import Floats
from replay.pictures.views import (
    CLASSES,
    MapView,
    Overlaid,
    around_session,
    view_of_classes,
    view_of_grid,
)


def view_of_session(
    path: Path, asked: Asked, config: MappingConfig, progress: Progress | None = None
) -> MapView:
    """A layer of a session, or its class map. Raises an EchogridError in one line."""
    session = open_session(path)
    placed = place_session(session, config)
    readings = Readings.joined(list(placed))
    upto, beam = _moment(path, asked, placed, config, readings)
    results, classes = Collector(), None
    for artifact in maps_of(placed, config, readings[:upto], progress):
        results(artifact)
        if isinstance(artifact, Classes):
            classes = artifact
    layers = [*results.snapshots, *([CLASSES] if classes is not None else [])]
    usual = results.clearest if beam is None else beam.layer
    name = chosen_layer(path, asked.view, layers, usual)
    total = len(readings)
    when = "at the end" if beam is None else f"after {upto:,} of {total:,} readings"
    known = true_walls(session.attachments)
    walls_m = np.zeros((0, 2, 2)) if known is None else known
    lines = [
        (s.start_m, s.end_m) for s in results.segments if (s.layer, s.source) == (name, "grid")
    ]
    over = Overlaid(
        np.array(lines, np.float64).reshape(-1, 2, 2),
        walls_m, path_of(readings[:upto]), beam,
        around_session(path_of(readings), clearest_points(placed), walls_m),
        tuple(placed.sensors),
    )  # fmt: skip
    if classes is not None and name == CLASSES:
        return view_of_classes(
            classes.geometry, classes.names, classes.codes, over, file=path.name, when=when
        )
    snapshot = results.snapshots[name]
    layer = snapshot.layer
    return view_of_grid(
        layer.geometry, layer.probability, layer.observed, over, file=path.name, layer=name,
        when=when, rule=snapshot.rule,
    )  # fmt: skip


def path_of(readings: Readings) -> Floats:
    """Where the robot was, (N, 2), metres; where it stood still, once."""
    base = readings.world_from_base
    points = np.column_stack([base.x_m, base.y_m])
    moved = np.ones(len(points), np.bool_)
    moved[1:] = (np.diff(points, axis=0) != 0.0).any(axis=1)
    path: Floats = points[moved]
    return path


def clearest_points(placed: PlacedSession) -> Floats:
    """The obstacle points of the sensors with the narrowest beams, (N, 2), metres."""
    found = raw_points(placed)
    least = min(sensor.beam_width_rad for sensor, *_ in found)
    return np.concatenate([points for s, points, *_ in found if s.beam_width_rad == least])


def maps_of(
    placed: PlacedSession, config: MappingConfig, readings: Readings, progress: Progress | None
) -> Iterator[Artifact]:
    """The results of some readings, on the grid that all of them have."""
    sensors = placed.placement.sensors
    geometry = geometry_of(placed, config)
    maps = empty_maps(sensors, geometry, config.grid, threads=cores())
    trail = Trail(geometry)
    yield started_run(sensors, placed.counts, geometry, None)
    for first in range(0, len(readings), MANY):
        some = readings[first : first + MANY]
        yield from merge(some, maps, watched=False)
        trail.take(some)
        if progress is not None:
            progress(first + len(some), len(readings))
    raw = list(raw_lines([readings], config)) if len(readings) else []
    yield from result_stages(sensors, maps, trail, config, final=True, raw=raw)


def _moment(
    path: Path, asked: Asked, placed: PlacedSession, config: MappingConfig, readings: Readings
) -> tuple[int, Beam | None]:
    """How many readings are in the map then, and the newest one; none at the end."""
    if asked.reading is not None:
        check_reading(path, asked.reading, len(readings))
        return asked.reading + 1, readings.beam(asked.reading)
    if asked.step is None:
        return len(readings), None
    merged, newest, steps = 0, None, 0
    for artifact in itertools.islice(build_maps(placed, config), asked.step + 1):
        steps += 1
        merged += isinstance(artifact, MergedGrid)
        if isinstance(artifact, Beam):
            newest = artifact
        elif not isinstance(artifact, MergedGrid) and merged == len(readings):
            newest = None
    if steps <= asked.step:
        raise BadInput(f"{path}: there is no step {asked.step}; the last one is {steps - 1}")
    return merged, newest
