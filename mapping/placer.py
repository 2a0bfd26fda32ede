"""Columns in, readings in the map frame out: one placer for a finished session and for a live one.

Of a finished session all poses, mounts and sensors are known beforehand (:class:`Placement`), and
each reading is placed as it comes. While messages still arrive a reading waits until the poses
reach past its time, and no longer; one that no pose follows within ``pose.max_gap_s`` could not be
placed later either. What is dropped is counted by reason.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import DroppedReadings
from mapping.config import MappingConfig, Sensor
from mapping.filters import FILTERS, Neighbours, PredictionFilter, Rejections, Verdicts
from mapping.motion_gathering import LiveMotion
from mapping.pending import LEAST_M, Pending, SensorTable, first_readings
from mapping.readings import Readings
from mapping.scan_reach import ScanReach, reach_of_rangers
from mapping.sensors import resolve_sensors
from mapping.tracks import Frames, Motions, MotionTrack
from recorder.columns import Block, Floats, Ints
from recorder.geometry import IDENTITY
from recorder.messages import HEAD_FRAME, Range, Scan

MOST_DROPPED_AT = 1_000_000  # of which it is kept when they came
_TOO_FAR = "pose not finite or too far"
_STEPPED_BACK = "clock stepped back (reading kept)"
# Why a reading is dropped; of several reasons the first one counts. 0: it is not.
REASONS = (
    "", "not a number", "too close", "zero or negative", "below the sensor's minimum",
    "saw nothing (skipped)", "no usable beam", "no pose at that time", "no head angle at that time",
    *(each.reason for each in FILTERS.values()),
)  # fmt: skip
_NOT_A_NUMBER, _TOO_CLOSE, _NEGATIVE, _BELOW, _SKIPPED, _NO_BEAM, _NO_POSE, _NO_ANGLE = range(1, 9)


@dataclass(frozen=True, slots=True)
class Placement:
    """What must be known to place a reading: poses and frames over time, and the sensors.

    ``odometry`` is dead reckoning beside a tracker's poses, where there is; who only looks whether
    smoothing would help needs it.
    """

    track: MotionTrack
    frames: Frames
    sensors: tuple[Sensor, ...]
    odometry: MotionTrack | None = None


_FILTER_CODES = {name: REASONS.index(each.reason) for name, each in FILTERS.items()}
FARTHEST_TURN_RAD = 100.0  # no beam of a scan points so far around: its angle is no number


class Placer:
    """Takes blocks of messages in order, gives the readings that are decided, in theirs."""

    def __init__(self, config: MappingConfig, known: Placement | None = None) -> None:
        """``known``: of a finished session, whose poses need not come again."""
        self.readings = 0
        self.used: Counter[str] = Counter()
        self._config = config
        self._known = known
        self._live = None if known is not None else LiveMotion(config)
        self._table = SensorTable(() if known is None else known.sensors)
        self._waiting = Pending.none()
        self._first: dict[str, Range | Scan] = {}  # of each sensor that is not settled yet
        self._dropped: Counter[str] = Counter()
        self._dropped_at: list[tuple[NDArray[np.int8], Ints, Ints]] = []  # why, sensor, when
        self._placed = 0
        self._last_ns: int | None = None
        self._clock_steps = 0
        self._scan_reach = ScanReach()
        self._neighbours, self._prediction = Neighbours(), PredictionFilter(config.grid)
        self.rejections = Rejections()

    @property
    def sensors(self) -> dict[str, Sensor]:
        """What is held of each sensor, by its name."""
        return {sensor.name: sensor for sensor in self._table.sensors}

    @property
    def dropped(self) -> dict[str, int]:
        """How many readings were dropped, by reason."""
        bad_poses = 0 if self._live is None else self._live.bad_poses
        first = {_TOO_FAR: bad_poses} if bad_poses else {}
        last = {_STEPPED_BACK: self._clock_steps} if self._clock_steps else {}
        return {**first, **self._dropped, **last}

    @property
    def dropped_at(self) -> tuple[DroppedReadings, ...]:
        """When readings were dropped, by sensor and reason; of very many, of the first ones."""
        if not self._dropped_at:
            return ()
        why, sensor, t_ns = (np.concatenate(each) for each in zip(*self._dropped_at, strict=True))
        names, found = self._table.names, []
        for number, code in sorted(set(zip(sensor.tolist(), why.tolist(), strict=True))):
            mine = (sensor == number) & (why == code)
            found.append(DroppedReadings(names[number], REASONS[code], t_ns[mine]))
        return tuple(found)

    def take(self, block: Block) -> Readings:
        """The readings that can be placed now that these messages are known."""
        pending = Pending.of(block, self._table)
        self.readings += len(pending)
        if self._known is not None:
            return self._place(pending, self._known.track, self._known.frames)
        assert self._live is not None
        self._live.take(block)
        for name, reading in first_readings(block).items():
            if name not in self._table.settled:
                self._first.setdefault(name, reading)
        self._waiting = Pending.joined([self._waiting, pending])
        if not self._live.is_warm:
            return Readings.none(self._table.sensors, self._placed)
        return self._release(ended=False)

    def finish(self) -> Readings:
        """The last readings: nothing more will come."""
        if self._live is None:
            return Readings.none(self._table.sensors, self._placed)
        return self._release(ended=True)

    def _release(self, *, ended: bool) -> Readings:
        assert self._live is not None
        frames, track = self._live.frames, self._live.track
        if self._first:
            self._table.join(settled_sensors(self._first, frames, self._config), self._config)
            self._first = {}
        ripe = len(self._waiting) if ended else self._live.ripe(self._waiting.t_ns, track)
        released, self._waiting = self._waiting[:ripe], self._waiting[ripe:]
        if len(self._waiting):
            self._live.forget(int(self._waiting.t_ns[0]))
        else:
            self._live.forget(self._live.newest_ns)
        return self._place(released, track, frames)

    def _place(self, pending: Pending, track: MotionTrack, frames: Frames) -> Readings:
        """Place readings for which all is known that ever will be."""
        table, count = self._table, len(pending)
        if count == 0:
            return Readings.none(table.sensors, self._placed)
        self._count_clock_steps(pending.t_ns)
        why, ranges_m, usable = _checked(pending, table)
        verdicts = self._held_against_neighbours(pending, ranges_m, why)
        pose, there = track.at(pending.t_ns)
        why[(why == 0) & ~there] = _NO_POSE
        base, sensor_pose, there = _world_from_sensor(pending, table, pose, frames, self._config)
        why[(why == 0) & ~there] = _NO_ANGLE
        kept = why == 0
        if not kept.all():
            base, sensor_pose = base[kept], sensor_pose[kept]
            usable &= pending.axes_of(kept)
        begins = pending.begins
        if not (kept.all() and usable.all()):
            numbers = np.concatenate([[0], np.cumsum(usable)])
            counts = (numbers[begins[1:]] - numbers[begins[:-1]])[kept]
            begins = np.concatenate([[0], np.cumsum(counts)])
            ranges_m = ranges_m[usable]
        readings = Readings(
            table.sensors, self._placed, pending.t_ns[kept], pending.sensor[kept], base,
            sensor_pose, begins, pending.bearings_rad()[usable], ranges_m, ranges_m,
        )  # fmt: skip
        readings = replace(readings, reach_m=self._reach_m(readings, pending.is_scan[kept]))
        if table.filters:
            readings, why[kept] = self._filtered(readings, verdicts.of(kept))
        self._count(why, pending, table)
        self._placed += len(readings)
        return readings

    def _held_against_neighbours(
        self, pending: Pending, ranges_m: Floats, why: NDArray[np.int8]
    ) -> Verdicts:
        """What the filters say that need no map: of rangers, whether or not there is a pose."""
        if not self._table.filters:
            return Verdicts.none(len(pending))
        measured = ~pending.is_scan & ((why == 0) | (why == _SKIPPED))
        first_m = np.append(ranges_m, np.nan)[pending.begins[:-1]]
        return self._neighbours.take(first_m, pending.sensor, measured, self._table.sensors)

    def _filtered(
        self, readings: Readings, verdicts: Verdicts
    ) -> tuple[Readings, NDArray[np.int8]]:
        """Placed readings (N,) without those that a filter rejects, and why each is dropped."""
        by_map = self._prediction.take(readings, ~verdicts.rejected)
        verdicts = verdicts.joined(by_map)
        codes = np.array([_FILTER_CODES.get(s.filter, 0) for s in readings.sensors], np.int8)
        why = np.where(verdicts.rejected, codes[readings.sensor], np.int8(0))
        if not verdicts.rejected.any():
            return readings, why
        self.rejections.take(readings, verdicts)
        return readings.chosen(~verdicts.rejected), why

    def _reach_m(self, readings: Readings, is_scan: NDArray[np.bool_]) -> Floats:
        """How far each axis sees, and so clears where it saw nothing, (K,)."""
        table = self._table
        sensor = readings.axes_of(readings.sensor)
        reach_m = reach_of_rangers(readings.ranges_m, table.max_m[sensor], table.clear_to_m[sensor])
        for row in np.flatnonzero(is_scan).tolist():
            axes = slice(int(readings.begins[row]), int(readings.begins[row + 1]))
            reach_m[axes] = self._scan_reach.of_scan(
                readings.world_from_sensor.one(row), readings.bearings_rad[axes],
                readings.ranges_m[axes], table.sensors[readings.sensor[row]],
            )  # fmt: skip
        return reach_m

    def _count(self, why: NDArray[np.int8], pending: Pending, table: SensorTable) -> None:
        """Count what is used and what is dropped, in the order in which they come up."""
        used = pending.sensor[why == 0]
        for each, count in _in_order(used):
            self.used[table.names[each]] += count
        for each, count in _in_order(why[why != 0]):
            self._dropped[REASONS[each]] += count
        if sum(len(each) for each, _, _ in self._dropped_at) < MOST_DROPPED_AT:
            lost = why != 0
            self._dropped_at.append((why[lost], pending.sensor[lost], pending.t_ns[lost]))

    def _count_clock_steps(self, t_ns: Ints) -> None:
        last_ns = int(t_ns[0]) if self._last_ns is None else self._last_ns
        self._clock_steps += int((t_ns[1:] < t_ns[:-1]).sum()) + (int(t_ns[0]) < last_ns)
        self._last_ns = int(t_ns[-1])


def _in_order(values: NDArray[np.integer]) -> list[tuple[int, int]]:
    """Each value and how often it comes, in the order of their first places."""
    if len(values) == 0:
        return []
    counts = np.bincount(values)
    present = np.flatnonzero(counts)
    first = [int(np.argmax(values == each)) for each in present]
    return [(int(present[i]), int(counts[present[i]])) for i in np.argsort(first)]


def _checked(
    pending: Pending, table: SensorTable
) -> tuple[NDArray[np.int8], Floats, NDArray[np.bool_]]:
    """Why a reading is dropped (N,), its ranges (K,), and which of these are usable (K,)."""
    if not pending.is_scan.any():
        why, ranges_m = _checked_ranges(pending.ranges_m, pending.sensor, table)
        return why, ranges_m, np.ones(len(ranges_m), np.bool_)
    why = np.zeros(len(pending), np.int8)
    ranges_m, usable = _checked_scans(pending, table)
    if len(pending.ranges_m):
        usable_beams = np.add.reduceat(
            np.append(usable, False).astype(np.int64), pending.begins[:-1]
        )
    else:
        usable_beams = np.zeros(len(pending), np.int64)
    usable_beams[np.diff(pending.begins) == 0] = 0
    why[pending.is_scan & (usable_beams == 0)] = _NO_BEAM
    single = np.flatnonzero(~pending.is_scan)
    at = pending.begins[single]
    why[single], ranges_m[at] = _checked_ranges(pending.ranges_m[at], pending.sensor[single], table)
    usable[at] = True
    return why, ranges_m, usable


def _checked_ranges(d: Floats, sensor: Ints, table: SensorTable) -> tuple[NDArray[np.int8], Floats]:
    """Of rangers (M,): why each is dropped, and the ranges, +Inf: nothing seen."""
    why = np.zeros(len(d), np.int8)
    ranges_m: Floats = np.where(d >= table.max_m[sensor], np.inf, d)
    with np.errstate(invalid="ignore"):
        why[np.isinf(ranges_m) & table.skips[sensor]] = _SKIPPED
        why[ranges_m < table.min_m[sensor]] = _BELOW
        why[d <= 0] = _NEGATIVE
    why[d == -np.inf] = _TOO_CLOSE
    why[np.isnan(d)] = _NOT_A_NUMBER
    return why, table.mended(ranges_m, sensor)


def _checked_scans(pending: Pending, table: SensorTable) -> tuple[Floats, NDArray[np.bool_]]:
    """Ranges of the beams (K,), and which are usable: one past the limit saw nothing."""
    sensor = np.repeat(pending.sensor, np.diff(pending.begins))
    ranges_m = pending.ranges_m.copy()
    with np.errstate(invalid="ignore"):
        usable = ranges_m >= np.maximum(table.min_m, LEAST_M)[sensor]
        sane = np.abs(pending.angle_min_rad) <= FARTHEST_TURN_RAD
        sane &= np.abs(pending.angle_increment_rad) <= FARTHEST_TURN_RAD
        usable &= np.repeat(sane, np.diff(pending.begins))
        ranges_m[usable & (ranges_m >= table.max_m[sensor])] = np.inf
    return table.mended(ranges_m, sensor), usable


def _world_from_sensor(
    pending: Pending, table: SensorTable, pose: Motions, frames: Frames, config: MappingConfig
) -> tuple[Motions, Motions, NDArray[np.bool_]]:
    """(world_from_base, world_from_sensor) and where both are known, (N,) each."""
    base, known = pose, np.ones(len(pending), np.bool_)
    if config.pose.rides_on == "head" and HEAD_FRAME in frames.moving:
        head, known = frames.base_from(HEAD_FRAME, pending.t_ns)
        # The tag turns with the head about the robot's centre: take the head's angle out again.
        zeros = np.zeros(len(pending))
        base = pose @ Motions(zeros, zeros, head.heading_rad).inverse()
    mounted = _all_mounted(pending, table, frames, known)
    return base, base @ mounted, known


def _all_mounted(
    pending: Pending, table: SensorTable, frames: Frames, known: NDArray[np.bool_]
) -> Motions:
    """``base_from_sensor`` of each reading, (N,); what is not known is taken out of ``known``."""
    fixed = [frames.mount_of(sensor.name, sensor.mount) for sensor in table.sensors]
    places = np.array([(m.x_m, m.y_m, m.heading_rad) for m in (f or IDENTITY for f in fixed)])
    mounted = Motions(*places.T.copy()[:, pending.sensor])
    for number, sensor in enumerate(table.sensors):
        if fixed[number] is None:
            rows = np.flatnonzero(pending.sensor == number)
            found, there = _mounted(sensor, frames, pending.t_ns[rows])
            known[rows] &= there
            mounted.x_m[rows] = found.x_m
            mounted.y_m[rows] = found.y_m
            mounted.heading_rad[rows] = found.heading_rad
    return mounted


def _mounted(sensor: Sensor, frames: Frames, t_ns: Ints) -> tuple[Motions, NDArray[np.bool_]]:
    """Where a sensor that moves stands on the robot at times (N,), and where that is known."""
    if sensor.mount is None:
        return frames.base_from(sensor.name, t_ns)
    parent = frames.parent_of(sensor.name)
    assert parent is not None
    head, known = frames.base_from(parent, t_ns)
    return head @ sensor.mount, known


def settled_sensors(
    first: dict[str, Range | Scan], frames: Frames, config: MappingConfig
) -> dict[str, Sensor]:
    return resolve_sensors(first.values(), frames.parent_of, config)
