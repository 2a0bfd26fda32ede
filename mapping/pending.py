"""Readings that have no place yet, of rangers and of scanners alike, as columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.config import MappingConfig
from mapping.parameters import Sensor
from mapping.sensors import with_one_rule_a_layer
from recorder.columns import Block, Floats, Ints, RangeColumns, ScanColumns
from recorder.messages import Range, Scan

LEAST_M = 1e-9  # no shorter range can be mapped


class SensorTable:
    """The sensors by number, in the order of their first readings, and their limits as columns."""

    def __init__(self, sensors: Iterable[Sensor]) -> None:
        self.names: list[str] = []
        self.number: dict[str, int] = {}
        self.settled: dict[str, Sensor] = {}
        self.sensors: tuple[Sensor, ...] = ()
        for sensor in sensors:
            self.number_of(sensor.name)
            self.settled[sensor.name] = sensor
        self._refresh()

    def number_of(self, name: str) -> int:
        """The number of a sensor, a new one for a new name."""
        if name not in self.number:
            self.number[name] = len(self.names)
            self.names.append(name)
        return self.number[name]

    def join(self, settled: dict[str, Sensor], config: MappingConfig) -> None:
        """Take more; one that comes later joins the layer of its kind where there is one."""
        shared = {sensor.layer for sensor in self.settled.values()}
        for name, sensor in settled.items():
            joins = sensor.layer == name and sensor.kind in shared
            self.settled[name] = replace(sensor, layer=sensor.kind) if joins else sensor
        self.settled = with_one_rule_a_layer(self.settled, config)
        self._refresh()

    def _refresh(self) -> None:
        self.sensors = tuple(self.settled[name] for name in self.names if name in self.settled)
        self.min_m = np.array([sensor.min_range_m for sensor in self.sensors])
        self.max_m = np.array([sensor.max_range_m for sensor in self.sensors])
        self.clear_to_m = np.array([s.clear_to_m or np.inf for s in self.sensors])
        self.scale = np.array([sensor.range_scale for sensor in self.sensors])
        self.bias_m = np.array([sensor.range_bias_m for sensor in self.sensors])
        self.filters = any(sensor.filter != "off" for sensor in self.sensors)
        self.skips = np.array([sensor.no_echo == "skipped" for sensor in self.sensors], np.bool_)

    def mended(self, ranges_m: Floats, sensor: Ints) -> Floats:
        """Ranges as they should have been measured, where the configuration knows better."""
        if (self.scale == 1.0).all() and (self.bias_m == 0.0).all():
            return ranges_m
        mended: Floats = (ranges_m - self.bias_m[sensor]) / self.scale[sensor]
        return np.where(ranges_m > 0.0, np.maximum(mended, LEAST_M), ranges_m)


@dataclass(frozen=True, slots=True)
class Pending:
    """N readings that have no place yet, K ranges in all: see :class:`~mapping.readings.Readings`.

    ``is_scan``, ``angle_min_rad`` and ``angle_increment_rad`` are (N,).
    """

    t_ns: Ints
    sensor: Ints
    is_scan: NDArray[np.bool_]
    angle_min_rad: Floats
    angle_increment_rad: Floats
    begins: Ints
    ranges_m: Floats

    @classmethod
    def none(cls) -> Pending:
        """No reading at all."""
        ints, floats = np.zeros(0, np.int64), np.zeros(0)
        scans, begins = np.zeros(0, np.bool_), np.zeros(1, np.int64)
        return cls(ints, ints, scans, floats, floats, begins, floats)

    @classmethod
    def of(cls, block: Block, table: SensorTable) -> Pending:
        """The readings of a block, in its order."""
        columns = [each for each in block.columns if isinstance(each, RangeColumns | ScanColumns)]
        if not columns:
            return cls.none()
        columns.sort(key=lambda each: int(each.row[0]))
        together = cls.joined([_pending(each, table.number_of(each.sensor)) for each in columns])
        row = np.concatenate([each.row for each in columns])
        if (row[1:] < row[:-1]).any():
            return together._ordered(np.argsort(row, kind="stable"))
        return together

    @classmethod
    def joined(cls, parts: Sequence[Pending]) -> Pending:
        """Several, one behind the other."""
        parts = [part for part in parts if len(part)]
        if len(parts) < 2:
            return parts[0] if parts else cls.none()
        ends = np.cumsum([0, *(len(part.ranges_m) for part in parts)])
        begins = [part.begins[:-1] + end for part, end in zip(parts, ends[:-1], strict=True)]
        return cls(
            np.concatenate([part.t_ns for part in parts]),
            np.concatenate([part.sensor for part in parts]),
            np.concatenate([part.is_scan for part in parts]),
            np.concatenate([part.angle_min_rad for part in parts]),
            np.concatenate([part.angle_increment_rad for part in parts]),
            np.concatenate([*begins, ends[-1:]]),
            np.concatenate([part.ranges_m for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, rows: slice) -> Pending:
        first, end, _ = rows.indices(len(self))
        end = max(first, end)
        rows, axes = slice(first, end), slice(int(self.begins[first]), int(self.begins[end]))
        return Pending(
            self.t_ns[rows], self.sensor[rows], self.is_scan[rows], self.angle_min_rad[rows],
            self.angle_increment_rad[rows], self.begins[first : end + 1] - self.begins[first],
            self.ranges_m[axes],
        )  # fmt: skip

    def axes_of(self, values: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """What holds for each reading (N,), for each of its axes (K,)."""
        if not self.is_scan.any():
            return values
        return np.repeat(values, np.diff(self.begins))

    def bearings_rad(self) -> Floats:
        """Direction of each axis relative to its sensor, (K,)."""
        if not self.is_scan.any():
            return np.zeros(len(self.ranges_m))
        owner = np.repeat(np.arange(len(self)), np.diff(self.begins))
        steps = (np.arange(len(self.ranges_m)) - self.begins[:-1][owner]).astype(np.float64)
        with np.errstate(invalid="ignore", over="ignore"):  # of scans that are dropped
            turned: Floats = self.angle_min_rad[owner] + self.angle_increment_rad[owner] * steps
        return np.where(self.is_scan[owner], turned, 0.0)

    def _ordered(self, order: Ints) -> Pending:
        counts = np.diff(self.begins)[order]
        begins = np.concatenate([[0], np.cumsum(counts)])
        axes = np.repeat(self.begins[:-1][order] - begins[:-1], counts) + np.arange(begins[-1])
        return Pending(
            self.t_ns[order], self.sensor[order], self.is_scan[order], self.angle_min_rad[order],
            self.angle_increment_rad[order], begins, self.ranges_m[axes],
        )  # fmt: skip


def _pending(columns: RangeColumns | ScanColumns, number: int) -> Pending:
    count = len(columns)
    sensor, none = np.full(count, number), np.zeros(count)
    if isinstance(columns, RangeColumns):
        return Pending(
            columns.t_ns, sensor, none.astype(np.bool_), none, none, np.arange(count + 1),
            columns.range_m,
        )  # fmt: skip
    beams = columns.ranges_m.shape[1]
    return Pending(
        columns.t_ns, sensor, np.ones(count, np.bool_), columns.angle_min_rad,
        columns.angle_increment_rad, np.arange(count + 1) * beams, columns.ranges_m.reshape(-1),
    )  # fmt: skip


def first_readings(block: Block) -> dict[str, Range | Scan]:
    """The first reading of each sensor in a block, in their order."""
    columns = [each for each in block.columns if isinstance(each, RangeColumns | ScanColumns)]
    columns.sort(key=lambda each: int(each.row[0]))
    found: dict[str, Range | Scan] = {}
    for each in columns:
        if each.sensor not in found:
            found[each.sensor] = each[:1].messages()[0]
    return found
