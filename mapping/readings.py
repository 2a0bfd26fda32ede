"""Readings placed in the map frame, as columns; a beam is a view of one row."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.beams import Beam, reach_of_axes
from mapping.config import Sensor
from mapping.tracks import Motions
from recorder.columns import Floats, Ints

# Lines need no more points of a sensor, nor would more of them be looked at in bounded time.
MOST_RAW, STRETCH = 50_000, 1000
_NEAR_M = 1e-6  # far more than rounding can move the corner of a box, far less than a cell


@dataclass(frozen=True, slots=True)
class Readings:
    """N readings in the order in which they are mapped, with K axes in all.

    ``first_number`` is that of row 0. ``sensor`` (N,) counts in ``sensors``. ``t_ns``,
    ``world_from_base`` and ``world_from_sensor`` (the beam's origin and heading) are (N,).
    ``bearings_rad`` and ``ranges_m`` are (K,), a range of +Inf saw nothing; those of row i lie
    from ``begins[i]`` to ``begins[i + 1]``: one of a ranger, as many as are usable of a scan.
    ``reach_m`` (K,) is how far an axis sees, and so how far one without return clears.
    """

    sensors: tuple[Sensor, ...]
    first_number: int
    t_ns: Ints
    sensor: Ints
    world_from_base: Motions
    world_from_sensor: Motions
    begins: Ints
    bearings_rad: Floats
    ranges_m: Floats
    reach_m: Floats

    @classmethod
    def none(cls, sensors: tuple[Sensor, ...] = (), first_number: int = 0) -> Readings:
        """No reading at all."""
        nothing, zero = np.zeros(0, np.int64), np.zeros(1, np.int64)
        motions, floats = Motions.none(), np.zeros(0)
        return cls(
            sensors, first_number, nothing, nothing, motions, motions, zero, floats, floats, floats
        )

    @classmethod
    def joined(cls, parts: Sequence[Readings]) -> Readings:
        """Several stretches, one behind the other; the last one knows all sensors."""
        if len(parts) == 1:
            return parts[0]
        ends = np.cumsum([0, *(len(part.ranges_m) for part in parts)])
        begins = [part.begins[:-1] + end for part, end in zip(parts, ends[:-1], strict=True)]
        return cls(
            parts[-1].sensors, parts[0].first_number,
            np.concatenate([part.t_ns for part in parts]),
            np.concatenate([part.sensor for part in parts]),
            Motions.joined([part.world_from_base for part in parts]),
            Motions.joined([part.world_from_sensor for part in parts]),
            np.concatenate([*begins, ends[-1:]]),
            np.concatenate([part.bearings_rad for part in parts]),
            np.concatenate([part.ranges_m for part in parts]),
            np.concatenate([part.reach_m for part in parts]),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, rows: slice) -> Readings:
        """A stretch of them, which shares the memory."""
        first, end, step = rows.indices(len(self))
        if step != 1:
            raise ValueError("readings are taken in their order")
        end = max(end, first)
        axes = slice(int(self.begins[first]), int(self.begins[end]))
        return Readings(
            self.sensors, self.first_number + first, self.t_ns[first:end], self.sensor[first:end],
            self.world_from_base[first:end], self.world_from_sensor[first:end],
            self.begins[first : end + 1] - self.begins[first], self.bearings_rad[axes],
            self.ranges_m[axes], self.reach_m[axes],
        )  # fmt: skip

    def chosen(self, kept: NDArray[np.bool_]) -> Readings:
        """Those that are kept (N,), in their order, numbered anew."""
        counts = np.diff(self.begins)
        axes = np.repeat(kept, counts)
        begins = np.concatenate([[0], np.cumsum(counts[kept])])
        return Readings(
            self.sensors, self.first_number, self.t_ns[kept], self.sensor[kept],
            self.world_from_base[kept], self.world_from_sensor[kept], begins,
            self.bearings_rad[axes], self.ranges_m[axes], self.reach_m[axes],
        )  # fmt: skip

    def model(self, row: int) -> Sensor:
        """The sensor of one row, as its model for that range has it."""
        sensor: Sensor = self.sensors[self.sensor[row]]
        return sensor.at(float(self.ranges_m[self.begins[row]])) if sensor.nearer else sensor

    def beam(self, row: int) -> Beam:
        """The beam of one row; its arrays are views."""
        sensor = self.sensors[self.sensor[row]]
        axes = slice(int(self.begins[row]), int(self.begins[row + 1]))
        bearings_rad, ranges_m = self.bearings_rad[axes], self.ranges_m[axes]
        bearings_rad.flags.writeable = ranges_m.flags.writeable = False
        return Beam(
            number=self.first_number + row, t_ns=int(self.t_ns[row]), sensor=sensor.name,
            layer=sensor.layer, world_from_base=self.world_from_base.one(row),
            world_from_sensor=self.world_from_sensor.one(row), bearings_rad=bearings_rad,
            ranges_m=ranges_m, beam_width_rad=sensor.beam_width_rad,
            reach_m=reach_of_axes(self.reach_m[axes]), mark_to_m=sensor.mark_to_m or math.inf,
            model=_named(sensor, self.model(row)),
        )  # fmt: skip

    def beams(self) -> Iterator[Beam]:
        """All beams in their order."""
        return (self.beam(row) for row in range(len(self)))

    @property
    def nbytes(self) -> int:
        """The memory that they take, at most."""
        own = (self.t_ns, self.sensor, self.begins, self.bearings_rad, self.ranges_m)
        return sum(each.nbytes for each in own) + self.reach_m.nbytes + 6 * 8 * len(self)

    def axes_of(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """What holds for each reading (N,), for each of its axes (K,)."""
        return np.repeat(values, np.diff(self.begins))

    def points_m(self) -> tuple[Floats, Ints]:
        """The obstacle points (M, 2), metres, map frame, and the row of each, (M,).

        Cosines are NumPy's, as those of :attr:`~mapping.beams.Beam.points_m`.
        """
        seen = np.isfinite(self.ranges_m)
        row = np.repeat(np.arange(len(self)), np.diff(self.begins))[seen]
        start, d = self.world_from_sensor, self.ranges_m[seen]
        heading = self.bearings_rad[seen] + start.heading_rad[row]
        points = np.column_stack(
            [start.x_m[row] + d * np.cos(heading), start.y_m[row] + d * np.sin(heading)]
        )
        return points, row

    def bounds_m(self, stretch: Sequence[float]) -> tuple[Floats, Floats]:
        """A box (low, high) that holds all beams; ``stretch``: of each sensor's ranges, a factor.

        It is the box of their :meth:`~mapping.beams.Beam.bounds_m`, to the bit: these are asked of
        the readings that come near to an edge of it.
        """
        corners = self._corners_m(np.array(stretch))
        low, high = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
        outermost = (corners[:, :2] <= low + _NEAR_M) | (corners[:, 2:] >= high - _NEAR_M)
        rows = np.flatnonzero(outermost.any(axis=1))
        rows = rows[np.unique(corners[rows], axis=0, return_index=True)[1]]
        boxes = [self.beam(row).bounds_m(stretch[self.sensor[row]]) for row in rows.tolist()]
        return np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)

    def _corners_m(self, stretch: Floats) -> Floats:
        """The box of each reading (N, 4): low x and y, high x and y, but for rounding."""
        half_rad = np.array([sensor.beam_width_rad for sensor in self.sensors])[self.sensor] / 2.0
        single = len(self.ranges_m) == len(self)  # no scan among them
        far_m = np.where(np.isfinite(self.ranges_m), self.ranges_m, self.reach_m)
        lowest_rad = highest_rad = self.bearings_rad
        if not single:
            begins = self.begins[:-1]
            far_m = np.maximum.reduceat(far_m, begins)
            lowest_rad = np.minimum.reduceat(self.bearings_rad, begins)
            highest_rad = np.maximum.reduceat(self.bearings_rad, begins)
        reach_m, start = far_m * stretch[self.sensor], self.world_from_sensor
        low_rad = start.heading_rad + (lowest_rad - half_rad)
        high_rad = start.heading_rad + (highest_rad + half_rad)
        columns = []
        for sign, function, turn in (
            (np.minimum, np.cos, 0.5), (np.minimum, np.sin, 0.75),
            (np.maximum, np.cos, 0.0), (np.maximum, np.sin, 0.25),
        ):  # fmt: skip
            edge = sign(sign(function(low_rad), function(high_rad)), 0.0)
            crossed = _crosses(low_rad, high_rad, turn * 2.0 * math.pi)
            edge[crossed] = -1.0 if sign is np.minimum else 1.0
            columns.append(reach_m * edge + (start.x_m if function is np.cos else start.y_m))
        return np.column_stack(columns)


def raw_points(
    placed: Iterable[Readings], used: Mapping[str, int] | None = None
) -> list[tuple[Sensor, Floats, Ints, Floats]]:
    """Of each sensor that was used: its obstacle points (M, 2), their times, where it stood then.

    In the order of the sensors' first readings; metres, map frame. ``used``, how many readings each
    sensor has, bounds what is kept: of a sensor with more than ``MOST_RAW`` only those of stretches
    of ``STRETCH`` readings, spread evenly over the session.
    """
    found: dict[str, tuple[Sensor, list[tuple[Floats, Ints, Floats]]]] = {}
    before: Counter[str] = Counter()
    for readings in placed:
        points_m, row = readings.points_m()
        start, of = readings.world_from_sensor, readings.sensor[row]
        from_m = np.column_stack([start.x_m[row], start.y_m[row]])
        numbers, first = np.unique(readings.sensor, return_index=True)
        for number in numbers[np.argsort(first)].tolist():
            mine, sensor = of == number, readings.sensors[number]
            _, parts = found.setdefault(sensor.name, (sensor, []))
            if used is not None and used[sensor.name] > MOST_RAW:
                own = readings.sensor == number
                place = np.cumsum(own) - 1 + before[sensor.name]
                before[sensor.name] += int(own.sum())
                mine &= chosen_stretches(place, used[sensor.name])[row]
            parts.append((points_m[mine], readings.t_ns[row][mine], from_m[mine]))
    joined = []
    for sensor, parts in found.values():
        points_m, t_ns, from_m = (np.concatenate(each) for each in zip(*parts, strict=True))
        points_m.flags.writeable = t_ns.flags.writeable = False
        joined.append((sensor, points_m, t_ns, from_m))
    return joined


def chosen_stretches(place: Ints, total: int) -> NDArray[np.bool_]:
    """Which readings, by their places (N,) among ``total``, are of the stretches that are kept."""
    kept, stretches, at = MOST_RAW // STRETCH, -(-total // STRETCH), place // STRETCH
    chosen: NDArray[np.bool_] = at * kept // stretches != (at + 1) * kept // stretches
    return chosen


def _named(sensor: Sensor, model: Sensor) -> str:
    """Which model of a sensor it is; "" where there is one alone."""
    if not sensor.nearer:
        return ""
    if model.up_to_m < math.inf:
        return f"up to {model.up_to_m:g} m"
    return f"beyond {sensor.nearer[-1].up_to_m:g} m"


def _crosses(low_rad: Floats, high_rad: Floats, direction_rad: float) -> NDArray[np.bool_]:
    """Between which angles (N,) a direction lies, any number of turns on."""
    turns = 1.0 / (2.0 * math.pi)
    first = np.ceil((low_rad - direction_rad) * turns - _NEAR_M)
    crosses: NDArray[np.bool_] = first <= (high_rad - direction_rad) * turns + _NEAR_M
    return crosses
