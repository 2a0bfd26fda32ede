"""What readings say about a straight wall: where it lies, that it is there, that it is not.

A beam of light ends on the wall: its obstacle point is a point of it. A sonar's cone is wide, and
what comes back first is the nearest surface in it: a wall that it met touches the arc of the range
in one point, straight across from the sensor, wherever in the cone that is. So each ping gives a
point of each wall that it may have met, the *tangent point* of its arc, and only one that faces the
wall gives any.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from mapping.parameters import Sensor
from mapping.readings import Readings
from mapping.segments.stretch import Stretch
from recorder.messages import Radiation

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

NARROW_RAD = math.radians(10.0)  # what such a beam goes through is free
MOST = 40_000  # readings a layer: more do not make its lines surer
_AXES = 32  # of a scan
_FACING = 0.9  # of half the beam: further out little comes back

# A reading is explained by a wall within this of where the wall has it.
_NEAR_M, _NEAR_SHARE = 0.025, 0.03
_NEAR_END_M = 0.03
# It speaks against a wall that it should have met and that it went further than.
_PAST_M, _PAST_SHARE = 0.03, 0.03
_WELL_FACING = 0.6  # of half the beam
_GRAZING = 0.25  # cosine: a narrow beam that meets a wall flatter proves nothing
_CLOSE_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """N readings that met something, map frame, metres.

    ``from_m`` (N, 2) is where the sensor stood, ``towards`` (N, 2) the unit vector of its axis,
    ``range_m`` (N,) how far it saw, ``half_rad`` (N,) half of its beam. ``arc`` (N,): a sonar's,
    the obstacle lies anywhere on the arc; ``narrow`` (N,): what the beam went through is free.
    """

    from_m: Floats
    towards: Floats
    range_m: Floats
    half_rad: Floats
    arc: Flags
    narrow: Flags

    @classmethod
    def none(cls) -> Sightings:
        """No reading at all."""
        pairs, ones, flags = np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.bool_)
        return cls(pairs, pairs, ones, ones, flags, flags)

    @classmethod
    def joined(cls, parts: Sequence[Sightings]) -> Sightings:
        """Several, one behind the other; of more than :data:`MOST` every k-th."""
        if not parts:
            return cls.none()
        whole = cls.of_all(parts)
        step = max(-(-len(whole) // MOST), 1)
        return whole if step == 1 else whole.of(np.arange(0, len(whole), step))

    @classmethod
    def of_all(cls, parts: Sequence[Sightings]) -> Sightings:
        """Several (one at least), one behind the other."""
        return cls(
            *(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(cls))
        )

    def __len__(self) -> int:
        return len(self.range_m)

    def of(self, some: Ints | Flags) -> Sightings:
        """Some of them."""
        return Sightings(*(getattr(self, each.name)[some] for each in fields(self)))

    @property
    def points_m(self) -> Floats:
        """The obstacle points on the axes, (N, 2)."""
        return self.from_m + self.range_m[:, None] * self.towards

    def places_on(self, line: Stretch, facing_rad: float | None = None) -> tuple[Floats, Flags]:
        """Where each reading has the wall (N, 2) that runs along ``line``, and whether it can.

        A beam of light: its obstacle point. A sonar: the tangent point of its arc, where it faces
        the line within 0.9 of half its beam (or ``facing_rad`` beyond half of it).
        """
        side, facing = self._facing(line, line.frame_of(self.from_m)[1])
        limit = _FACING * self.half_rad if facing_rad is None else self.half_rad + facing_rad
        places = np.empty_like(self.from_m)
        for k, n in enumerate(line.normal.tolist()):  # column by column: rows of two are slow
            way = np.where(self.arc, side * n, self.towards[:, k])
            places[:, k] = self.from_m[:, k] + self.range_m * way
        return places, ~self.arc | (facing >= np.cos(limit))

    def _facing(self, line: Stretch, off: Floats) -> tuple[Floats, Floats]:
        """On which side the line lies (N,) of sensors ``off`` to its left, -1 or 1 (0: on it), and
        the cosine between their axes and the way straight to it."""
        side = -np.sign(off)
        x, y = line.normal.tolist()
        return side, side * (self.towards[:, 0] * x + self.towards[:, 1] * y)

    def explained_by(self, wall: Stretch) -> Flags:
        """Which readings (N,) the wall explains: light that ends on it, pings that it sent back.

        The nearest place of the wall to a sonar may be its end, as in a corner.
        """
        near_m = np.maximum(_NEAR_M, _NEAR_SHARE * self.range_m)
        t, off = wall.frame_of(self.points_m)
        inside = (t > wall.begin_m - _NEAR_END_M) & (t < wall.end_m + _NEAR_END_M)
        lit = ~self.arc & inside & (np.abs(off) < near_m)
        foot, _ = wall.frame_of(self.from_m)
        nearest = wall.place_m + np.clip(foot, wall.begin_m, wall.end_m)[:, None] * wall.along
        way = nearest - self.from_m
        far_m = np.hypot(way[:, 0], way[:, 1])
        cosine = (way * self.towards).sum(axis=1) / np.maximum(far_m, 1e-9)
        sent_back = np.abs(self.range_m - far_m) < near_m
        explained: Flags = lit | (self.arc & sent_back & (cosine >= np.cos(self.half_rad)))
        return explained

    def against(self, wall: Stretch) -> Flags:
        """Which readings (N,) went further than a wall that they should have met."""
        t, off = wall.frame_of(self.from_m)
        _, facing = self._facing(wall, off)
        margin_m = min(_NEAR_END_M, 0.2 * wall.length_m)
        low, high = wall.begin_m + margin_m, wall.end_m - margin_m
        far_m = np.abs(off)
        past_m = np.maximum(_PAST_M, _PAST_SHARE * self.range_m)
        way_m = far_m / np.maximum(facing, 1e-9)
        met = t + way_m * (self.towards @ wall.along)
        through = (self.range_m - way_m) * facing > past_m + _PAST_M
        seen = self.narrow & (facing > _GRAZING) & (met > low) & (met < high) & through
        square = self.arc & (facing >= np.cos(_WELL_FACING * self.half_rad)) & (far_m > _CLOSE_M)
        against: Flags = seen | (
            square & (t > low) & (t < high) & (self.range_m - far_m > 2.0 * past_m)
        )
        return against

    def ends_on(self, wall: Stretch) -> Floats:
        """Where on the wall each reading (N, 2) ended, if it was this wall that it met."""
        foot, _ = wall.frame_of(self.from_m)
        nearest = wall.place_m + np.clip(foot, wall.begin_m, wall.end_m)[:, None] * wall.along
        ends: Floats = np.where(self.arc[:, None], nearest, self.points_m)
        return ends


class SightingLog:
    """The sightings of each layer, gathered while the readings are merged.

    They are the same however the readings come in portions; of a sensor that met more than twice
    :data:`MOST` things every second is kept, or every fourth, and so on.
    """

    def __init__(self) -> None:
        self._of_sensor: dict[tuple[str, str], _OfSensor] = {}

    def take(self, readings: Readings) -> None:
        """Note what some readings met; a laser alone needs none of it (:mod:`.scan_lines`)."""
        if all(sensor.radiation is Radiation.LASER for sensor in readings.sensors):
            return
        for number, sensor in enumerate(readings.sensors):
            mine = readings.sensor == number
            if mine.any():
                known = self._of_sensor.setdefault((sensor.layer, sensor.name), _OfSensor())
                known.take(_sightings_of(readings, mine, sensor))

    def of_layer(self, layer: str) -> Sightings:
        """Those of the sensors of a layer; of no such layer, as of the fused one, those of all."""
        mine = [key for key in sorted(self._of_sensor) if key[0] == layer]
        keys = mine or sorted(self._of_sensor)
        return Sightings.joined([part for key in keys for part in self._of_sensor[key].parts])


class _OfSensor:
    """Every k-th sighting of one sensor."""

    def __init__(self) -> None:
        self.parts: list[Sightings] = []
        self._many, self._kept, self._step = 0, 0, 1

    def take(self, found: Sightings) -> None:
        kept = found.of(np.flatnonzero((self._many + np.arange(len(found))) % self._step == 0))
        self._many += len(found)
        self._kept += len(kept)
        self.parts.append(kept)
        while self._kept > 2 * MOST:
            whole = Sightings.of_all(self.parts).of(np.arange(0, self._kept, 2))
            self.parts, self._kept, self._step = [whole], len(whole), 2 * self._step


def _sightings_of(readings: Readings, mine: Flags, sensor: Sensor) -> Sightings:
    row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
    axis = np.arange(len(row)) - readings.begins[row]
    step = -(-np.diff(readings.begins) // _AXES)
    met = np.flatnonzero(np.isfinite(readings.ranges_m) & mine[row] & (axis % step[row] == 0))
    row, start = row[met], readings.world_from_sensor
    heading = readings.bearings_rad[met] + start.heading_rad[row]
    many = len(met)
    narrow = sensor.beam_width_rad <= NARROW_RAD
    arc = sensor.radiation is Radiation.ULTRASOUND and not narrow
    return Sightings(
        np.column_stack([start.x_m[row], start.y_m[row]]),
        np.column_stack([np.cos(heading), np.sin(heading)]),
        readings.ranges_m[met],
        np.full(many, sensor.beam_width_rad / 2.0),
        np.full(many, arc),
        np.full(many, narrow),
    )
