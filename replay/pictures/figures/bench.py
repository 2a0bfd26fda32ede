"""A session laid out for figures: its sensors by role, and maps of it made in any way, at once.

The grid holds path and walls alone and is as fine as a picture can show. A map of a variant is made
once. Long sessions are thinned to what a minute allows, evenly, and that is reported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, TempGrid
from mapping.beams import Beam
from mapping.borders import find_borders, threshold_layer
from mapping.config import BordersSection, MappingConfig
from mapping.grid import GridGeometry, Layer, geometry_for
from mapping.layer_map import LayerMap
from mapping.parameters import Sensor
from mapping.placed_session import place_session
from mapping.readings import Readings
from mapping.sensor_model import make_temp_grid
from recorder.messages import Radiation
from recorder.session.columns import open_session
from recorder.truth import true_walls
from replay.pictures.figures.figure import BOTH, NARROW, SONAR, LeftOut
from replay.pictures.from_session import clearest_points, path_of
from replay.pictures.parts import Box, Floats
from replay.pictures.views import around_session, frame_around

MOST_READINGS, MOST_AXES, MOST_SLOW = 20_000, 120_000, 500
_MOST_CELLS = 420  # along the longer side
_FINER = 200  # cells across the picture of one reading
# The chapter's own choices; a simple model has no Gaussians, and says nothing of what is in front.
CHAPTER: dict[str, Any] = {
    "model": "regions", "regions": 12, "gaussian": "both", "emptiness": "combined",
    "update": "bayes", "rasteriser": "cells", "second_grid": True,
}  # fmt: skip
SIMPLE: dict[str, Any] = {**CHAPTER, "gaussian": "none", "emptiness": "none", "update": "count"}


@dataclass(frozen=True, slots=True)
class Role:
    """The sensors of one layer: its name, the first of them, and which readings are theirs."""

    layer: str
    sensor: Sensor
    rows: NDArray[np.int64]


class Bench:
    """One session, opened and placed. Raises what opening and placing raise."""

    def __init__(self, path: Path, config: MappingConfig) -> None:
        session = open_session(path)
        placed = place_session(session, config)
        readings = Readings.joined(list(placed))
        known = true_walls(session.attachments)
        self.damage = session.damage
        self.walls_m: Floats = np.zeros((0, 2, 2)) if known is None else known
        self.path_m = path_of(readings)
        around = around_session(self.path_m, clearest_points(placed), self.walls_m)
        frame = frame_around(around, self.walls_m, self.walls_m[:0])
        assert frame is not None
        self.frame: Box = frame
        self.total = len(readings)
        self.readings = _thinned(readings)
        self.geometry = _grid_for(frame, config)
        self.sensors = tuple(sensor.name for sensor in self.readings.sensors)
        self._maps: dict[tuple[str, str], Layer] = {}

    # Roles

    @property
    def sonar(self) -> Role:
        """The layer of the widest ultrasound. Raises LeftOut where there is none."""
        return self._role(SONAR, Radiation.ULTRASOUND)

    @property
    def narrow(self) -> Role:
        """The layer of infrared, or else of a laser. Raises LeftOut where there is none."""
        return self._role(NARROW, Radiation.INFRARED, Radiation.LASER)

    @property
    def both(self) -> tuple[Role, Role]:
        """The two that are fused. Raises LeftOut where one is missing."""
        try:
            return self.sonar, self.narrow
        except LeftOut:
            raise LeftOut(f"the session has not {BOTH}") from None

    @property
    def any_ranger(self) -> Role:
        """The sonar, or else the narrow one."""
        try:
            return self.sonar
        except LeftOut:
            return self.narrow

    def _role(self, what: str, *radiations: Radiation) -> Role:
        for radiation in radiations:
            for sensor in self.readings.sensors:
                if sensor.radiation == radiation:
                    mine = [s.layer == sensor.layer for s in self.readings.sensors]
                    rows = np.flatnonzero(np.array(mine)[self.readings.sensor])
                    if len(rows):
                        return Role(sensor.layer, sensor, rows)
        raise LeftOut(f"the session has not {what}")

    # What was measured

    def beams(self, role: Role) -> Iterator[Beam]:
        """The readings of a role, in order."""
        return (self.readings.beam(row) for row in role.rows.tolist())

    def points(self, role: Role) -> tuple[Floats, Floats]:
        """The obstacle points (N, 2) and where the robot's centre was at each, (N, 2), metres."""
        points, row = self.readings.points_m()
        mine = np.isin(row, role.rows)
        base = self.readings.world_from_base[row[mine]]
        return points[mine], np.column_stack([base.x_m, base.y_m])

    def typical(self, role: Role) -> Beam:
        """A reading to look at: it saw something inside the picture, at a middling range."""
        found: list[tuple[float, int]] = []
        for row in role.rows.tolist():
            beam = self.readings.beam(row)
            seen = beam.ranges_m[beam.saw_something]
            if len(seen) and _inside(beam, self.frame):
                found.append((float(np.median(seen)), row))
        if not found:
            raise LeftOut(f"{role.sensor.name} saw nothing")
        middle = float(np.quantile([range_m for range_m, _ in found], 0.5))
        _, row = min(found, key=lambda each: (abs(each[0] - middle), each[1]))
        return self.readings.beam(row)

    # Maps

    def layer(self, role: Role, most: int = 0, **changes: Any) -> Layer:
        """The map of a role's readings with a sensor changed so, from the chapter's choices.

        ``most`` bounds how many readings go in, spread evenly (0: all).
        """
        key = (role.layer, repr((most, sorted({**CHAPTER, **changes}.items()))))
        if key not in self._maps:
            sensors = tuple(
                replace(sensor, **{**CHAPTER, **changes}) for sensor in self.readings.sensors
            )
            rows = role.rows
            if most and len(rows) > most:
                rows = rows[np.linspace(0, len(rows) - 1, most).astype(np.int64)]
            readings = some_of(replace(self.readings, sensors=sensors), rows)
            made = LayerMap(role.layer, sensors, self.geometry)
            made.merge_many(readings)
            self._maps[key] = made.layer()
        return self._maps[key]

    def temp(self, role: Role, beam: Beam, **changes: Any) -> TempGrid:
        """The evidence of one reading on a grid of its own, fine enough to see its cells."""
        sensor = replace(role.sensor, **{**CHAPTER, **changes})
        return make_temp_grid(beam, sensor, fine_grid(beam))

    def temp_on_map(self, role: Role, beam: Beam, **changes: Any) -> TempGrid:
        """The same on the grid of the maps."""
        return make_temp_grid(beam, replace(role.sensor, **{**CHAPTER, **changes}), self.geometry)

    def borders(self, layer: Layer, threshold: float) -> tuple[NDArray[np.bool_], list[Border]]:
        """The cells above a threshold, and their borders by the right tracer."""
        thresholded = threshold_layer(layer, threshold)
        return thresholded.occupied, find_borders(thresholded, BordersSection(threshold=threshold))


def fine_grid(beam: Beam) -> GridGeometry:
    """A grid around a beam and a fifth more, of a fixed number of cells."""
    low, high = beam.bounds_m(1.2)
    side = float(max(high - low))
    return geometry_for(
        low, high, resolution_m=side / _FINER, margin_m=0.03 * side, max_cells=10_000_000
    )


def box_of_beam(beam: Beam) -> Box:
    """The frame of a picture of one reading."""
    low, high = beam.bounds_m(1.15)
    base = beam.world_from_base
    points = np.array([low, high, [base.x_m, base.y_m]])
    return Box.around(points, 0.06)


def some_of(readings: Readings, rows: NDArray[np.int64]) -> Readings:
    """Some rows of readings, in their order."""
    counts = np.diff(readings.begins)
    taken = np.zeros(len(readings), np.bool_)
    taken[rows] = True
    axes = np.repeat(taken, counts)
    return Readings(
        readings.sensors, 0, readings.t_ns[rows], readings.sensor[rows],
        readings.world_from_base[rows], readings.world_from_sensor[rows],
        np.concatenate([[0], np.cumsum(counts[rows])]), readings.bearings_rad[axes],
        readings.ranges_m[axes], readings.reach_m[axes],
    )  # fmt: skip


def _thinned(readings: Readings) -> Readings:
    """At most so many readings, and axes of them, evenly spread over the session."""
    most = min(MOST_READINGS, int(MOST_AXES * len(readings) / max(len(readings.ranges_m), 1)))
    if len(readings) <= most:
        return readings
    return some_of(readings, np.linspace(0, len(readings) - 1, most).astype(np.int64))


def _grid_for(frame: Box, config: MappingConfig) -> GridGeometry:
    """Cells of the configured size, or of the next round size that a picture can show."""
    wanted = max(frame.width_m, frame.height_m) / _MOST_CELLS
    resolution_m = config.grid.resolution_m
    while resolution_m < wanted:
        power = 10.0 ** math.floor(math.log10(resolution_m) + 1e-9)
        factor = resolution_m / power
        resolution_m = power * (2.0 if factor < 1.5 else 5.0 if factor < 3.5 else 10.0)
    low, high = frame.corners_m
    return geometry_for(
        low, high, resolution_m=resolution_m, margin_m=2 * resolution_m, max_cells=10_000_000
    )


def _inside(beam: Beam, frame: Box) -> bool:
    x, y = np.median(beam.points_m, axis=0)
    return bool(frame.x0 <= x <= frame.x1 and frame.y0 <= y <= frame.y1)
