"""The filter ``predicted``: a range is held against what the map so far predicts.

The map is that of the sensor's layer, with its model and rule, of the readings that were kept: as
it was after the last whole :data:`TOGETHER` of them, so that no reading is judged by its neighbours
and the result does not depend on how a session was cut into blocks. A range is left out where the
map knows better: it has a wall on the beam's axis well before what was measured, or the obstacle
lies in a cell that was seen free with the next wall well behind it. Where the map knows nothing,
nothing is left out; and where several readings in a row contradict it and agree with each other, it
is the room that has changed: the last of them is kept.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.beams import Beam
from mapping.config_sections import GridSection
from mapping.filters.neighbours import differs
from mapping.filters.table import PREDICTED, Verdicts, length_of, tolerance_m
from mapping.grid import GridGeometry, geometry_for
from mapping.layer_map import LayerMap
from mapping.parameters import Sensor
from mapping.prediction import nearest_in_beam_m, nearest_on_axes_m
from mapping.readings import Readings
from mapping.sensor_model import stretch_of
from recorder.columns import Floats

TOGETHER = 50  # readings of a layer that come into its map at once
_OCCUPIED, _FREE = 0.6, 0.4
_ROOM_M = 1.0  # so much more than is needed, so that the map grows seldom


class PredictionFilter:
    """The filter of all sensors that ask for it, from one block of readings to the next."""

    def __init__(self, grid: GridSection) -> None:
        self._grid = grid
        self._maps: dict[str, _MapSoFar] = {}
        self._contradicting: dict[str, list[float]] = {}  # ranges in a row, by sensor

    def take(self, readings: Readings, kept: NDArray[np.bool_]) -> Verdicts:
        """Judge the readings of a block, in their order; those not ``kept`` (N,) are passed over.

        Scans are kept, and go into the maps.
        """
        found = Verdicts.none(len(readings))
        layers = {s.layer for s in readings.sensors if s.filter == PREDICTED}
        if not layers:
            return found
        for row in np.flatnonzero(kept).tolist():
            sensor = readings.sensors[readings.sensor[row]]
            if sensor.layer not in layers:
                continue
            so_far = self._maps.setdefault(sensor.layer, _MapSoFar(sensor.layer, self._grid))
            if sensor.filter == PREDICTED:
                expected_m = so_far.expected_m(readings.beam(row), sensor)
                found.expected_m[row] = expected_m
                measured_m = float(readings.ranges_m[readings.begins[row]])
                found.rejected[row] = self._is_rejected(sensor, measured_m, expected_m)
            if not found.rejected[row]:
                so_far.take(readings[row : row + 1])
        return found

    def _is_rejected(self, sensor: Sensor, measured_m: float, expected_m: float) -> bool:
        """Whether it contradicts the map, and too few before it did so in the same way."""
        row = self._contradicting.setdefault(sensor.name, [])
        if np.isnan(expected_m):
            row.clear()
            return False
        earlier = [each for each in row if not differs(measured_m, each, sensor)]
        row[:] = [*earlier, measured_m]
        return len(row) < length_of(sensor)


class _MapSoFar:
    """The map of one layer, which grows with what comes into it."""

    def __init__(self, layer: str, grid: GridSection) -> None:
        self._layer, self._grid = layer, grid
        self._map: LayerMap | None = None
        self._merged: list[Readings] = []
        self._waiting: list[Readings] = []
        self._occupied = self._free = np.zeros((0, 0), np.bool_)

    def take(self, reading: Readings) -> None:
        """Take one more reading."""
        self._waiting.append(reading)
        if len(self._waiting) == TOGETHER:
            self._merge(Readings.joined(self._waiting))
            self._waiting = []

    def _merge(self, stretch: Readings) -> None:
        self._merged.append(stretch)
        sensors = stretch.sensors
        if self._map is None or self._map.sensors != sensors or not self._holds(stretch):
            every = Readings.joined(self._merged)
            self._map, stretch = LayerMap(self._layer, sensors, self._roomy(every)), every
        self._map.merge_many(stretch)
        probability = self._map.layer().probability
        self._occupied, self._free = probability > _OCCUPIED, probability < _FREE

    def expected_m(self, beam: Beam, sensor: Sensor) -> float:
        """The range that the map predicts, where that contradicts a ranger's; else NaN."""
        if self._map is None:
            return math.nan
        occupied, geometry = self._occupied, self._map.geometry
        measured_m = float(beam.ranges_m[0])
        on_axis_m = float(nearest_on_axes_m(beam, occupied, geometry)[0])
        if measured_m - on_axis_m > _allowed_m(sensor, on_axis_m):
            return on_axis_m
        nearest_m = float(nearest_in_beam_m(beam, occupied, geometry)[0])
        if math.isinf(nearest_m) or nearest_m - measured_m <= _allowed_m(sensor, nearest_m):
            return math.nan
        cells = geometry.cells_of(beam.points_m)
        seen_through = geometry.contains(cells).all() and self._free[cells[0, 0], cells[0, 1]]
        return nearest_m if seen_through else math.nan

    def _holds(self, stretch: Readings) -> bool:
        assert self._map is not None
        low, high = _box_of(stretch)
        geometry = self._map.geometry
        origin = np.array(geometry.origin_m)
        return bool((low >= origin).all() and (high <= origin + geometry.size_m).all())

    def _roomy(self, every: Readings) -> GridGeometry:
        low, high = _box_of(every)
        return geometry_for(
            low, high, resolution_m=self._grid.resolution_m, max_cells=self._grid.max_cells,
            margin_m=max(_ROOM_M, float((high - low).max()) / 4.0),
        )  # fmt: skip


def _box_of(readings: Readings) -> tuple[Floats, Floats]:
    return readings.bounds_m([stretch_of(sensor) for sensor in readings.sensors])


def _allowed_m(sensor: Sensor, expected_m: float) -> float:
    return float(tolerance_m(sensor, np.array([expected_m]))[0])
