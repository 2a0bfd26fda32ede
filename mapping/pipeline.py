"""The method on one page: messages → beams → temp grids → maps → fusion → borders → lines.

A generator of artifacts: whoever shows, exports or compares takes what it yields.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Finished, RawPoints, Snapshot, Started
from mapping.beams import Beam
from mapping.borders import find_borders, threshold_layer, tracer_steps
from mapping.config import MappingConfig
from mapping.fusion import FUSED, classify, fuse
from mapping.grid import GridGeometry, Layer, check_size, geometry_for
from mapping.parameters import Sensor
from mapping.placing import Placed, place
from mapping.segments import (
    Stage,
    line_stages,
    reachable_cells,
    segments_from_grid,
    segments_of_ranger,
)
from mapping.sensor_model import beam_box_m, make_temp_grid
from mapping.update_rules import MapState, start
from recorder.messages import Message, Record

MARGIN_M = 0.2
NARROW_RAD = math.radians(10.0)  # what such a beam goes through is free


def build_maps(
    messages: Iterable[Message | Record],
    config: MappingConfig,
    *,
    walls_m: NDArray[np.float64] | None = None,
) -> Iterator[Artifact]:
    """Everything that comes about while a session becomes maps, in order.

    ``walls_m`` (K, 2, 2) are the true walls, where they are known; they are shown, never used.
    Raises BadInput, before any artifact, where the session cannot be mapped.
    """
    placed = place(messages, config)
    geometry = geometry_of(placed, config)
    yield started_run(placed, geometry, walls_m)
    maps = empty_maps(placed.sensors.values(), geometry)
    every = config.rerun.stages_every
    for beam in placed.beams:
        yield beam
        temp = make_temp_grid(beam, placed.sensors[beam.sensor], geometry)
        yield temp
        yield maps[beam.layer].merge(temp)
        if every and (beam.number + 1) % every == 0 and beam.number + 1 < len(placed.beams):
            yield from result_stages(placed, maps, config, final=False)
    yield from result_stages(placed, maps, config, final=True)
    yield from raw_lines(placed, config)
    yield Finished(placed.readings, placed.used, placed.dropped, placed.notes)


def geometry_of(placed: Placed, config: MappingConfig) -> GridGeometry:
    """The configured grid, or the one that holds every beam and a margin."""
    section = config.grid
    boxes = [beam_box_m(beam, placed.sensors[beam.sensor]) for beam in placed.beams]
    low = np.min([box[0] for box in boxes], axis=0)
    high = np.max([box[1] for box in boxes], axis=0)
    fitted_low = low if section.origin_m is None else np.array(section.origin_m)
    if section.size_m is None and section.origin_m is None:
        return geometry_for(
            low, high, resolution_m=section.resolution_m, margin_m=MARGIN_M,
            max_cells=section.max_cells,
        )  # fmt: skip
    resolution = section.resolution_m
    origin = np.floor((fitted_low - (0 if section.origin_m else MARGIN_M)) / resolution + 1e-9)
    size = section.size_m if section.size_m is not None else high + MARGIN_M - origin * resolution
    cols, rows = (max(int(np.ceil(float(v) / resolution - 1e-9)), 1) for v in size)
    check_size(rows, cols, resolution_m=resolution, max_cells=section.max_cells)
    corner = (float(origin[0] * resolution), float(origin[1] * resolution))
    return GridGeometry(corner, resolution, rows, cols)


def empty_maps(sensors: Iterable[Sensor], geometry: GridGeometry) -> dict[str, MapState]:
    """A map without readings for each layer that the sensors fill, by name."""
    return {each.layer: start(each.update, geometry, each.own) for each in sensors}


def started_run(
    placed: Placed, geometry: GridGeometry, walls_m: NDArray[np.float64] | None
) -> Started:
    """The first artifact: the grid, and the layers that the sensors will fill."""
    layers = tuple(dict.fromkeys(sensor.layer for sensor in placed.sensors.values()))
    if len(layers) > 1:
        layers = (*layers, FUSED)
    walls = np.zeros((0, 2, 2)) if walls_m is None else walls_m
    times = [beam.t_ns for beam in placed.beams]
    return Started(geometry, layers, walls, min(times), max(times))


def result_stages(
    placed: Placed, maps: dict[str, MapState], config: MappingConfig, *, final: bool
) -> Iterator[Artifact]:
    """Fusion, thresholds, borders and lines of the maps as they are now."""
    layers = [state.layer(name) for name, state in maps.items()]
    rules = {sensor.layer: sensor.update for sensor in placed.sensors.values()}
    if len(layers) > 1:
        layers.append(fuse(layers, list(placed.sensors.values()), config.fusion))
        yield classify(layers[:-1])
    for layer in layers:
        yield Snapshot(layer, rules.get(layer.name, config.fusion.rule), final)
    positions = np.array([[b.world_from_base.x_m, b.world_from_base.y_m] for b in placed.beams])
    for layer in layers:
        yield from _vector_stages(layer, positions, config, final=final)


def _vector_stages(
    layer: Layer, positions_m: NDArray[np.float64], config: MappingConfig, *, final: bool
) -> Iterator[Artifact]:
    thresholded = threshold_layer(layer, config.borders.threshold)
    yield thresholded
    borders = find_borders(thresholded, config.borders)
    yield from borders
    if final:
        yield from tracer_steps(thresholded, borders, config.rerun.tracer_steps)
    stages: list[Stage] = []
    lines = segments_from_grid(
        thresholded, borders, config.segments, observed=layer.observed,
        reachable=reachable_cells(layer, positions_m), observe=stages.append if final else None,
    )  # fmt: skip
    yield from _stages_shown(stages, layer.name, "grid", config)
    yield from lines


def _stages_shown(
    stages: Sequence[Stage], layer: str, source: str, config: MappingConfig
) -> Iterator[Artifact]:
    """What was done on the way to the lines, as the configuration wants it shown."""
    how = config.rerun.line_stages
    if how != "none":
        yield from line_stages(stages, layer=layer, source=source, each=how == "each")


def raw_lines(placed: Placed, config: MappingConfig) -> Iterator[Artifact]:
    """The obstacle points of each sensor, and the lines fitted straight to them."""
    by_sensor: dict[str, list[Beam]] = {}
    for beam in placed.beams:
        by_sensor.setdefault(beam.sensor, []).append(beam)
    for name, beams in by_sensor.items():
        points, t_ns = _points_of(beams)
        yield RawPoints(name, points, t_ns)
        if len(points) >= config.segments.min_points:
            sensor_positions_m = np.array(
                [[b.world_from_sensor.x_m, b.world_from_sensor.y_m] for b in beams]
            )
            narrow = beams[0].beam_width_rad <= NARROW_RAD
            stages: list[Stage] = []
            lines = segments_of_ranger(
                points,
                np.repeat(sensor_positions_m, [len(beam.points_m) for beam in beams], axis=0),
                config.segments, layer=name, narrow=narrow, observe=stages.append,
            )  # fmt: skip
            yield from _stages_shown(stages, name, "raw", config)
            yield from lines


def _points_of(beams: Sequence[Beam]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    each = [beam.points_m for beam in beams]
    points = np.concatenate([np.zeros((0, 2)), *each])
    t_ns = np.repeat([beam.t_ns for beam in beams], [len(p) for p in each]).astype(np.int64)
    points.flags.writeable = t_ns.flags.writeable = False
    return points, t_ns
