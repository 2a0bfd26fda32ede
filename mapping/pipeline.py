"""The method on one page: messages → readings → maps → fusion → borders → lines.

A generator of artifacts: whoever shows, exports or compares takes what it yields.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Finished, RawPoints, Segment, Snapshot, Started
from mapping.borders import find_borders, threshold_layer, tracer_steps
from mapping.config import MappingConfig
from mapping.filters import Rejections
from mapping.framing import frame_of
from mapping.fusion import FUSED, classify, fuse
from mapping.grid import GridGeometry, Layer, check_size, geometry_for
from mapping.layer_map import LayerMap, empty_maps
from mapping.parameters import Sensor
from mapping.placed_session import Counts, HasBlocks, PlacedSession, place_session
from mapping.readings import Readings, raw_points
from mapping.segments import (
    NARROW_RAD,
    SightingLog,
    Stage,
    line_stages,
    of_lidar_only,
    reachable_cells,
    scans_of,
    segments_at_walls,
    segments_from_grid,
    segments_of_ranger,
    segments_of_scans,
)
from mapping.sensor_model import stretch_of
from recorder.messages import Message, Record

MARGIN_M = 0.2
MANY = 20_000  # readings merged at once


def build_maps(
    session: PlacedSession | HasBlocks | Iterable[Message | Record],
    config: MappingConfig,
    *,
    walls_m: NDArray[np.float64] | None = None,
    watched: bool = True,
    threads: int = 1,
    merged: Callable[[int], None] | None = None,
) -> Iterator[Artifact]:
    """Everything that comes about while a session becomes maps, in order.

    ``walls_m`` (K, 2, 2) are the true walls, where they are known; they are shown, never used.
    Of readings that are not ``watched`` no artifacts come (Beam, TempGrid, MergedGrid), and they
    are merged many at a time, by ``threads``: the maps are the same, to the bit. ``merged(count)``
    is called with how many readings are in the maps. Raises BadInput, before any artifact, where
    the session cannot be mapped.
    """
    placed = session if isinstance(session, PlacedSession) else place_session(session, config)
    total, sensors = sum(placed.counts.used.values()), placed.placement.sensors
    geometry = geometry_of(placed, config)
    maps, trail = empty_maps(sensors, geometry, config.grid, threads=threads), Trail(geometry)
    frame_m = frame_of(placed, walls_m) if watched else None
    yield started_run(sensors, placed.counts, geometry, walls_m, frame_m)
    every, rejections = config.rerun.stages_every, placed.counts.rejections
    for readings in stretches(placed, every):
        yield from merge(readings, maps, watched=watched, merged=merged, rejections=rejections)
        trail.take(readings)
        end = readings.first_number + len(readings)
        if every and end % every == 0 and end < total:
            yield from result_stages(sensors, maps, trail, config, final=False)
    if watched:
        yield from rejections.before(total)
    raw = list(raw_lines(placed, config))
    yield from result_stages(sensors, maps, trail, config, final=True, raw=raw)
    yield from raw
    counts = placed.counts
    yield Finished(counts.readings, counts.used, counts.dropped, placed.notes, counts.dropped_at)


def stretches(placed: Iterable[Readings], every: int) -> Iterator[Readings]:
    """The readings, as many together as is good for speed, cut after ``every`` of them (0: no)."""
    waiting: list[Readings] = []
    for readings in placed:
        while every and readings.first_number // every != (
            (readings.first_number + len(readings)) // every
        ):
            cut = every - readings.first_number % every
            yield Readings.joined([*waiting, readings[:cut]])
            waiting, readings = [], readings[cut:]
        if len(readings):
            waiting.append(readings)
        if sum(map(len, waiting)) >= MANY:
            yield Readings.joined(waiting)
            waiting = []
    if waiting:
        yield Readings.joined(waiting)


def merge(
    readings: Readings,
    maps: Mapping[str, LayerMap],
    *,
    watched: bool,
    merged: Callable[[int], None] | None = None,
    rejections: Rejections | None = None,
) -> Iterator[Artifact]:
    """Readings into the maps of their layers: one after the other, or all at once.

    Before each that is watched come those that a filter rejected since the one before.
    """
    if watched:
        for row in range(len(readings)):
            if rejections is not None:
                yield from rejections.before(readings.first_number + row)
            yield from maps[readings.sensors[readings.sensor[row]].layer].merge_one(readings, row)
            if merged is not None:
                merged(readings.first_number + row + 1)
    else:
        for each in maps.values():
            each.merge_many(readings)
        if merged is not None:
            merged(readings.first_number + len(readings))
    if len(readings):
        for each in maps.values():
            each.state.pass_time(int(readings.t_ns.max()))


def geometry_of(placed: Iterable[Readings], config: MappingConfig) -> GridGeometry:
    """The configured grid, or the one that holds every beam and a margin."""
    section = config.grid
    low, high = box_of(placed)
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


def box_of(placed: Iterable[Readings]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The corners (low, high) of a box around all that the readings can touch, metres."""
    boxes = [
        readings.bounds_m([stretch_of(sensor) for sensor in readings.sensors])
        for readings in placed if len(readings)
    ]  # fmt: skip
    return np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)


def started_run(
    sensors: Sequence[Sensor],
    counts: Counts,
    geometry: GridGeometry,
    walls_m: NDArray[np.float64] | None,
    frame_m: NDArray[np.float64] | None = None,
) -> Started:
    """The first artifact: the grid, and the layers that the sensors will fill."""
    layers = tuple(dict.fromkeys(sensor.layer for sensor in sensors))
    if len(layers) > 1:
        layers = (*layers, FUSED)
    walls = np.zeros((0, 2, 2)) if walls_m is None else walls_m
    known = {sensor.name: sensor for sensor in sensors}
    widths_rad: dict[str, float] = {}
    for sensor in (known[name] for name in counts.used):
        widths_rad.setdefault(sensor.layer, sensor.beam_width_rad)
    return Started(
        geometry,
        layers,
        walls,
        counts.first_ns,
        counts.last_ns,
        widths_rad,
        tuple(sensors),
        frame_m,
    )


class Trail:
    """Where the robot was, as the cells of a grid, and what its sensors met."""

    def __init__(self, geometry: GridGeometry) -> None:
        self._geometry = geometry
        self._cells = np.zeros(geometry.shape, np.bool_)
        self.sightings = SightingLog()

    def take(self, readings: Readings) -> None:
        """Note where the robot was at some readings, and what they met."""
        self.sightings.take(readings)
        base = readings.world_from_base
        cells = self._geometry.cells_of(np.column_stack([base.x_m, base.y_m]))
        cells = cells[self._geometry.contains(cells)]
        self._cells[cells[:, 0], cells[:, 1]] = True

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """The centres of the cells, (N, 2), metres."""
        return self._geometry.centres_of(np.argwhere(self._cells))


def result_stages(
    sensors: Sequence[Sensor],
    maps: Mapping[str, LayerMap],
    trail: Trail,
    config: MappingConfig,
    *,
    final: bool,
    raw: Sequence[Artifact] = (),
) -> Iterator[Artifact]:
    """Fusion, thresholds, borders and lines of the maps as they are now.

    ``raw`` holds the lines from raw points, where they are known already.
    """
    layers = [each.layer() for each in maps.values()]
    rules = {name: each.state.rule.name for name, each in maps.items()}
    if len(layers) > 1:
        layers.append(fuse(layers, list(sensors), config.fusion))
        yield classify(layers[:-1])
    for layer in layers:
        yield Snapshot(layer, rules.get(layer.name, config.fusion.rule), final)
    for layer in layers:
        lidar = of_lidar_only(layer.name, sensors)
        narrow = narrow_lines(raw, layer.name, sensors)
        yield from _vector_stages(layer, trail, config, final=final, lidar=lidar, raw=narrow)


def narrow_lines(raw: Sequence[Artifact], layer: str, sensors: Sequence[Sensor]) -> list[Segment]:
    """The raw lines of the narrow sensors of a layer; the fused one has all of them."""
    mine = {
        sensor.name for sensor in sensors
        if layer in (sensor.layer, FUSED) and sensor.beam_width_rad <= NARROW_RAD
    }  # fmt: skip
    return [each for each in raw if isinstance(each, Segment) and each.layer in mine]


def _vector_stages(
    layer: Layer,
    trail: Trail,
    config: MappingConfig,
    *,
    final: bool,
    lidar: bool,
    raw: Sequence[Segment],
) -> Iterator[Artifact]:
    thresholded = threshold_layer(layer, config.borders.threshold)
    yield thresholded
    borders = find_borders(thresholded, config.borders)
    yield from borders
    if final:
        yield from tracer_steps(thresholded, borders, config.rerun.tracer_steps)
    stages: list[Stage] = []
    observe = stages.append if final else None
    lines = segments_from_grid(
        thresholded, borders, config.segments, lidar=lidar, observed=layer.observed,
        reachable=reachable_cells(layer, trail.positions_m), observe=observe,
    )  # fmt: skip
    if config.segments.refits and not lidar:
        sightings = trail.sightings.of_layer(layer.name)
        lines = segments_at_walls(
            lines, raw, sightings, config.segments, layer=layer.name, observe=observe
        )
    yield from _stages_shown(stages, layer.name, "grid", config)
    yield from lines


def _stages_shown(
    stages: Sequence[Stage], layer: str, source: str, config: MappingConfig
) -> Iterator[Artifact]:
    """What was done on the way to the lines, as the configuration wants it shown."""
    how = config.rerun.line_stages
    if how != "none":
        yield from line_stages(stages, layer=layer, source=source, each=how == "each")


def readings_of_each(placed: Iterable[Readings]) -> Counter[str]:
    """How many readings each sensor has."""
    if isinstance(placed, PlacedSession):
        return Counter(placed.counts.used)
    used: Counter[str] = Counter()
    for readings in placed:
        counts = np.bincount(readings.sensor, minlength=len(readings.sensors)).tolist()
        used.update({s.name: n for s, n in zip(readings.sensors, counts, strict=True)})
    return used


def raw_lines(placed: Iterable[Readings], config: MappingConfig) -> Iterator[Artifact]:
    """The obstacle points of each sensor, and the lines fitted straight to them.

    Of a long session some, so that the memory and the time that they take are bounded.
    """
    used = readings_of_each(placed)
    for sensor, points, t_ns, from_m in raw_points(placed, used):
        yield RawPoints(sensor.name, points, t_ns)
        scans = scans_of(placed, sensor.name, used[sensor.name])
        if scans:
            yield from segments_of_scans(scans, config.segments, layer=sensor.name)
        elif len(points) >= config.segments.min_points:
            stages: list[Stage] = []
            lines = segments_of_ranger(
                points, from_m, config.segments, layer=sensor.name,
                narrow=sensor.beam_width_rad <= NARROW_RAD, observe=stages.append,
            )  # fmt: skip
            yield from _stages_shown(stages, sensor.name, "raw", config)
            yield from lines
