"""The map of one layer, and the way in which each sensor's readings come into it.

A stretch of readings that nobody looks at goes through the batch kernels as a whole. A reading
that somebody watches goes as beam, temp grid and merged grid, and is added by the same kernel,
alone, to a copy of the cells that it can change: so both give the same map, to the bit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mapping.artifacts import Artifact
from mapping.batches import Adder, adder_of, adders, runs_of
from mapping.config_sections import GridSection
from mapping.grid import GridGeometry, Layer, check_memory
from mapping.parameters import Sensor
from mapping.readings import Readings
from mapping.sensor_model import make_temp_grid
from mapping.update_rules import UPDATE_RULES, start
from recorder.columns import Ints

_SLOWLY = ""


class LayerMap:
    """A map without readings at first; ``sensors`` are all of the session's, by number."""

    def __init__(
        self, name: str, sensors: Sequence[Sensor], geometry: GridGeometry, *, threads: int = 1
    ) -> None:
        mine = [number for number, sensor in enumerate(sensors) if sensor.layer == name]
        last = sensors[mine[-1]]
        self.name, self.geometry, self.sensors = name, geometry, tuple(sensors)
        self.state = start(last.update, geometry, last.own, forget_s=last.forget_s)
        self._threads = threads
        rule = self.state.rule
        self._adders: dict[str, Adder] = {}
        if last.forget_s is None:  # the kernels know no time
            self._adders = adders(rule, sensors, mine)
        self._names = [_SLOWLY, *self._adders]
        self._is_mine = np.zeros(len(sensors), np.bool_)
        self._is_mine[mine] = True
        self._single = np.zeros(len(sensors), np.int64)  # index into the names, by sensor
        self._scans = np.zeros(len(sensors), np.int64)
        for number in mine:
            way = adder_of(rule, sensors, number)
            self._single[number] = self._names.index(way) if way in self._adders else 0
            scans = f"scans {number}"
            self._scans[number] = self._names.index(scans) if scans in self._adders else 0

    def merge_many(self, readings: Readings) -> None:
        """Merge those readings of a stretch that are the layer's, in their order."""
        rows = np.flatnonzero(self._is_mine[readings.sensor])
        ways = self._ways(readings, rows)
        for first, end in runs_of(ways):
            way, some = self._names[ways[first]], rows[first:end]
            if way == _SLOWLY:
                for row in some.tolist():
                    beam = readings.beam(row)
                    temp = make_temp_grid(beam, readings.model(row), self.geometry)
                    self.state.merge_unseen(temp)
            else:
                self.state.merge_many(
                    lambda target, way=way, some=some: self._adders[way].add(  # type: ignore[misc]
                        target, readings, some, self._threads
                    )
                )

    def merge_one(self, readings: Readings, row: int) -> Iterator[Artifact]:
        """Merge one reading that is the layer's, and show how: beam, temp grid, merged grid."""
        beam = readings.beam(row)
        yield beam
        temp = make_temp_grid(beam, readings.model(row), self.geometry)
        yield temp
        rows = np.array([row])
        way = self._names[int(self._ways(readings, rows)[0])]
        if way == _SLOWLY:
            yield self.state.merge(temp)
        else:
            adder = self._adders[way]
            yield self.state.merge(temp, lambda target: adder.add(target, readings, rows, 1))

    def layer(self) -> Layer:
        """The whole map as it stands; a copy, read-only."""
        return self.state.layer(self.name)

    def _ways(self, readings: Readings, rows: Ints) -> Ints:
        """The kernel of each of some readings, as an index into the names."""
        axes = readings.begins[rows + 1] - readings.begins[rows]
        sensor = readings.sensor[rows]
        return np.where(axes == 1, self._single[sensor], self._scans[sensor])


def empty_maps(
    sensors: Sequence[Sensor], geometry: GridGeometry, section: GridSection, *, threads: int = 1
) -> dict[str, LayerMap]:
    """A map without readings for each layer that the sensors fill, by name.

    Raises BadInput where they would take more memory than the configuration allows.
    """
    layers = {sensor.layer: len(UPDATE_RULES[sensor.update].start) for sensor in sensors}
    check_memory(geometry, list(layers.values()), section.max_memory_mb)
    return {name: LayerMap(name, sensors, geometry, threads=threads) for name in layers}
