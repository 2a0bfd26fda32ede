"""Columns in, readings in the map frame out: one placer for a finished session and for a live one.

Of a finished session all poses, mounts and sensors are known beforehand (:class:`Placement`), and
each reading is placed as it comes. While messages still arrive a reading waits until the poses
reach past its time, and no longer; one that no pose follows within ``pose.max_gap_s`` could not be
placed later either. What is dropped is counted by reason.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.config import MappingConfig, Sensor
from mapping.placing import settle_sensors
from mapping.poses import FrameTree, Track, is_sane
from mapping.readings import Readings
from mapping.tracks import Frames, Motions, MotionTrack
from recorder.clock import NS_PER_S
from recorder.columns import (
    Block,
    Floats,
    Ints,
    MotionColumns,
    PoseColumns,
    RangeColumns,
    ScanColumns,
    TransformColumns,
)
from recorder.errors import BadInput
from recorder.geometry import IDENTITY, SE2
from recorder.messages import HEAD_FRAME, Range, Scan, Transform

WARM_UP_S = 2.0  # until then it is not known which sensors and which poses a live session has
_KEPT_NS = 60 * NS_PER_S  # of a live track, behind the newest message
_ALWAYS_NS = (1 << 62) - 1
_LEAST_M = 1e-9
_TOO_FAR = "pose not finite or too far"
_STEPPED_BACK = "clock stepped back (reading kept)"
# Why a reading is dropped; of several reasons the first one counts. 0: it is not.
REASONS = (
    "", "not a number", "too close", "zero or negative", "below the sensor's minimum",
    "saw nothing (skipped)", "no usable beam", "no pose at that time", "no head angle at that time",
)  # fmt: skip
_NOT_A_NUMBER, _TOO_CLOSE, _NEGATIVE, _BELOW, _SKIPPED, _NO_BEAM, _NO_POSE, _NO_ANGLE = range(1, 9)


@dataclass(frozen=True, slots=True)
class Placement:
    """What must be known to place a reading: poses and frames over time, and the sensors."""

    track: MotionTrack
    frames: Frames
    sensors: tuple[Sensor, ...]


class Placer:
    """Takes blocks of messages in order, gives the readings that are decided, in theirs."""

    def __init__(self, config: MappingConfig, known: Placement | None = None) -> None:
        """``known``: of a finished session, whose poses need not come again."""
        self.readings = 0
        self.used: Counter[str] = Counter()
        self._config = config
        self._known = known
        self._live = None if known is not None else _LiveMotion(config)
        self._table = _SensorTable(() if known is None else known.sensors)
        self._waiting = Pending.none()
        self._first: dict[str, Range | Scan] = {}  # of each sensor that is not settled yet
        self._dropped: Counter[str] = Counter()
        self._placed = 0
        self._last_ns: int | None = None
        self._clock_steps = 0

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
            self._table.join(settled_sensors(self._first, frames, self._config))
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
        pose, there = track.at(pending.t_ns)
        why[(why == 0) & ~there] = _NO_POSE
        base, sensor_pose, there = _world_from_sensor(pending, table, pose, frames, self._config)
        why[(why == 0) & ~there] = _NO_ANGLE
        kept = why == 0
        self._count(why, pending, table)
        first, self._placed = self._placed, self._placed + int(kept.sum())
        if not kept.all():
            base, sensor_pose = base[kept], sensor_pose[kept]
            usable &= pending.axes_of(kept)
        begins = pending.begins
        if not usable.all():
            numbers = np.concatenate([[0], np.cumsum(usable)])
            counts = (numbers[begins[1:]] - numbers[begins[:-1]])[kept]
            begins = np.concatenate([[0], np.cumsum(counts)])
            ranges_m = ranges_m[usable]
        return Readings(
            table.sensors, first, pending.t_ns[kept], pending.sensor[kept], base, sensor_pose,
            begins, pending.bearings_rad()[usable], ranges_m,
        )  # fmt: skip

    def _count(self, why: NDArray[np.int8], pending: Pending, table: _SensorTable) -> None:
        """Count what is used and what is dropped, in the order in which they come up."""
        used = pending.sensor[why == 0]
        for each, count in _in_order(used):
            self.used[table.names[each]] += count
        for each, count in _in_order(why[why != 0]):
            self._dropped[REASONS[each]] += count

    def _count_clock_steps(self, t_ns: Ints) -> None:
        last_ns = int(t_ns[0]) if self._last_ns is None else self._last_ns
        self._clock_steps += int((t_ns[1:] < t_ns[:-1]).sum()) + (int(t_ns[0]) < last_ns)
        self._last_ns = int(t_ns[-1])


class _SensorTable:
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

    def join(self, settled: dict[str, Sensor]) -> None:
        """Take more; one that comes later joins the layer of its kind where there is one."""
        shared = {sensor.layer for sensor in self.settled.values()}
        for name, sensor in settled.items():
            joins = sensor.layer == name and sensor.kind in shared
            self.settled[name] = replace(sensor, layer=sensor.kind) if joins else sensor
        self._refresh()

    def _refresh(self) -> None:
        self.sensors = tuple(self.settled[name] for name in self.names if name in self.settled)
        self.min_m = np.array([sensor.min_range_m for sensor in self.sensors])
        self.max_m = np.array([sensor.max_range_m for sensor in self.sensors])
        self.skips = np.array([sensor.no_echo == "skipped" for sensor in self.sensors], np.bool_)


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
    def of(cls, block: Block, table: _SensorTable) -> Pending:
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
        if len(self.ranges_m) == len(self):
            return values
        return np.repeat(values, np.diff(self.begins))

    def bearings_rad(self) -> Floats:
        """Direction of each axis relative to its sensor, (K,)."""
        if not self.is_scan.any():
            return np.zeros(len(self.ranges_m))
        owner = np.repeat(np.arange(len(self)), np.diff(self.begins))
        steps = (np.arange(len(self.ranges_m)) - self.begins[:-1][owner]).astype(np.float64)
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


def _in_order(values: NDArray[np.integer]) -> list[tuple[int, int]]:
    """Each value and how often it comes, in the order of their first places."""
    if len(values) == 0:
        return []
    counts = np.bincount(values)
    present = np.flatnonzero(counts)
    first = [int(np.argmax(values == each)) for each in present]
    return [(int(present[i]), int(counts[present[i]])) for i in np.argsort(first)]


def _checked(
    pending: Pending, table: _SensorTable
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


def _checked_ranges(
    d: Floats, sensor: Ints, table: _SensorTable
) -> tuple[NDArray[np.int8], Floats]:
    """Of rangers (M,): why each is dropped, and the ranges, +Inf: nothing seen."""
    why = np.zeros(len(d), np.int8)
    ranges_m: Floats = np.where(d >= table.max_m[sensor], np.inf, d)
    with np.errstate(invalid="ignore"):
        why[np.isinf(ranges_m) & table.skips[sensor]] = _SKIPPED
        why[ranges_m < table.min_m[sensor]] = _BELOW
        why[d <= 0] = _NEGATIVE
    why[d == -np.inf] = _TOO_CLOSE
    why[np.isnan(d)] = _NOT_A_NUMBER
    return why, ranges_m


def _checked_scans(pending: Pending, table: _SensorTable) -> tuple[Floats, NDArray[np.bool_]]:
    """Ranges of the beams (K,), and which are usable: one past the limit saw nothing."""
    sensor = np.repeat(pending.sensor, np.diff(pending.begins))
    ranges_m = pending.ranges_m.copy()
    with np.errstate(invalid="ignore"):
        usable = ranges_m >= np.maximum(table.min_m, _LEAST_M)[sensor]
        ranges_m[usable & (ranges_m >= table.max_m[sensor])] = np.inf
    return ranges_m, usable


def _world_from_sensor(
    pending: Pending, table: _SensorTable, pose: Motions, frames: Frames, config: MappingConfig
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
    pending: Pending, table: _SensorTable, frames: Frames, known: NDArray[np.bool_]
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


def first_readings(block: Block) -> dict[str, Range | Scan]:
    """The first reading of each sensor in a block, in their order."""
    columns = [each for each in block.columns if isinstance(each, RangeColumns | ScanColumns)]
    columns.sort(key=lambda each: int(each.row[0]))
    found: dict[str, Range | Scan] = {}
    for each in columns:
        if each.sensor not in found:
            found[each.sensor] = each.message(0)
    return found


def settled_sensors(
    first: dict[str, Range | Scan], frames: Frames, config: MappingConfig
) -> dict[str, Sensor]:
    nothing = Track([], [], 0)
    moving = {child: (parent, nothing) for child, (parent, _) in frames.moving.items()}
    return settle_sensors(first.values(), FrameTree(dict(frames.static), moving), config)


def in_order(columns: Sequence[MotionColumns]) -> tuple[Ints, Motions, Ints]:
    """Times, motions and rows of several columns in the order of the session."""
    t_ns = np.concatenate([each.t_ns for each in columns])
    row = np.concatenate([each.row for each in columns])
    motions = Motions.joined([Motions.of(each) for each in columns])
    if len(columns) > 1:
        order = np.argsort(row, kind="stable")
        return t_ns[order], motions[order], row[order]
    return t_ns, motions, row


class MotionGatherer:
    """Collects poses and transforms: the tracks of a session as far as it has come."""

    def __init__(self, max_gap_ns: int) -> None:
        self.max_gap_ns = max_gap_ns
        self.static: dict[str, Transform] = {}
        self.parents: dict[str, str] = {}
        self.moving: dict[str, list[tuple[Ints, Motions]]] = {}
        self.poses: dict[bool, list[tuple[Ints, Motions]]] = {False: [], True: []}
        self.bad_poses = {False: 0, True: 0}  # by whether they are dead reckoning

    def take(self, block: Block) -> None:
        """Note the poses, mounts and turning frames of a block."""
        for by_odometry in (False, True):
            columns = [c for c in block.of(PoseColumns) if c.by_odometry is by_odometry]
            if columns:
                t_ns, motions, _ = in_order(columns)
                sane = motions.sane()
                self.bad_poses[by_odometry] += int((~sane).sum())
                self.poses[by_odometry].append((t_ns[sane], motions[sane]))
        transforms = block.of(TransformColumns)
        for child in dict.fromkeys(each.child for each in transforms):
            of_child = [each for each in transforms if each.child == child]
            self._take_static([each for each in of_child if each.static])
            self._take_moving(child, [each for each in of_child if not each.static])

    def _take_static(self, columns: Sequence[TransformColumns]) -> None:
        """The last one of a frame counts."""
        found = [
            (int(row), each.message(at)) for each in columns for at, row in enumerate(each.row)
        ]
        for _, mount in sorted(found, key=lambda pair: pair[0]):
            if is_sane(mount.parent_from_child):
                self.static[mount.child] = mount

    def _take_moving(self, child: str, columns: Sequence[TransformColumns]) -> None:
        sane = [kept for each in columns if len(kept := each.where(Motions.of(each).sane()))]
        if not sane:
            return
        t_ns, motions, _ = in_order(sane)
        self.moving.setdefault(child, []).append((t_ns, motions))
        self.parents[child] = max(sane, key=lambda each: int(each.row[-1])).parent

    def track(self, *, by_odometry: bool) -> MotionTrack:
        """All poses so far, sorted by their times."""
        return MotionTrack.empty(self.max_gap_ns).with_more(self.poses[by_odometry])

    def frames(self) -> Frames:
        """All mounts and turning frames so far."""
        empty = MotionTrack.empty(self.max_gap_ns)
        moving = {
            child: (self.parents[child], empty.with_more(parts))
            for child, parts in self.moving.items()
        }
        return Frames(self.static, moving)


class _LiveMotion:
    """Poses and frames of a session that goes on."""

    def __init__(self, config: MappingConfig) -> None:
        if config.pose.odom_start == "tracker":
            raise BadInput('pose.odom_start = "tracker" needs a finished session, not a live one')
        self._config = config
        self._gap_ns = round(config.pose.max_gap_s * NS_PER_S)
        self._tracks = {
            False: MotionTrack.empty(self._gap_ns),
            True: MotionTrack.empty(self._gap_ns),
        }
        self._first_ns: int | None = None
        self.frames = Frames({}, {})
        self.newest_ns = 0
        self.bad_poses = 0

    def take(self, block: Block) -> None:
        """Sort in what a block tells of poses and frames."""
        if not block.columns:
            return
        if self._first_ns is None:
            first = min(block.columns, key=lambda each: int(each.row[0]))
            self._first_ns = int(first.t_ns[0])
        newest_ns = max(int(each.t_ns.max()) for each in block.columns)
        self.newest_ns = max(self.newest_ns, newest_ns)
        news = MotionGatherer(self._gap_ns)
        news.take(block)
        self.bad_poses += sum(news.bad_poses.values())
        for by_odometry, parts in news.poses.items():
            self._tracks[by_odometry] = self._tracks[by_odometry].with_more(parts)
        moving = dict(self.frames.moving)
        for child, parts in news.moving.items():
            _, track = moving.get(child, ("", MotionTrack.empty(self._gap_ns)))
            moving[child] = news.parents[child], track.with_more(parts)
        self.frames = Frames({**self.frames.static, **news.static}, moving)

    @property
    def is_warm(self) -> bool:
        """Whether enough has come to know which sensors and poses there are."""
        return (
            self._first_ns is not None and self.newest_ns - self._first_ns >= WARM_UP_S * NS_PER_S
        )

    @property
    def track(self) -> MotionTrack:
        """The poses in force: those of a finished session with the same messages."""
        if self._config.pose.fixed is not None:
            return fixed_track(self._config, -_ALWAYS_NS, _ALWAYS_NS)
        by_odometry = self._config.pose.topic == "/odom" or not len(self._tracks[False].t_ns)
        return self._tracks[by_odometry]

    def ripe(self, t_ns: Ints, track: MotionTrack) -> int:
        """For how many of the first waiting readings waiting on could change nothing."""
        reach_ns = [each.t_ns[-1] if len(each.t_ns) else -_ALWAYS_NS for each in
                    (track, *(moving for _, moving in self.frames.moving.values()))]  # fmt: skip
        ripe = (self.newest_ns - t_ns > self._gap_ns) | (t_ns <= min(reach_ns))
        return len(ripe) if ripe.all() else int(np.argmin(ripe))

    def forget(self, oldest_ns: int) -> None:
        """Let go of what no reading will ask for, now and then, so that it costs nothing."""
        before_ns = oldest_ns - _KEPT_NS
        self._tracks = {key: _shortened(track, before_ns) for key, track in self._tracks.items()}
        moving = {
            child: (parent, _shortened(track, before_ns))
            for child, (parent, track) in self.frames.moving.items()
        }
        self.frames = Frames(self.frames.static, moving)


def _shortened(track: MotionTrack, before_ns: int) -> MotionTrack:
    useless = int(np.searchsorted(track.t_ns, before_ns))
    return track.since(useless) if useless > len(track.t_ns) // 2 else track


def fixed_track(config: MappingConfig, first_ns: int, last_ns: int) -> MotionTrack:
    """A robot that stands still, from one time to another."""
    assert config.pose.fixed is not None
    x_m, y_m, heading_deg = config.pose.fixed
    motions = Motions.same(SE2(x_m, y_m, math.radians(heading_deg)), 2)
    return MotionTrack(np.array([first_ns, last_ns]), motions, last_ns - first_ns + 1)
