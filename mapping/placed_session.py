"""The readings of a finished session in the map frame, gone through as often as wanted.

The first pass over its messages finds the poses, the mounts and the sensors; each further one
places the readings, block by block. What is small is kept, so that a common session is read and
placed once; what is large is read again, so that the memory for its readings stays bounded.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from mapping.artifacts import DroppedReadings
from mapping.config import MappingConfig, Sensor
from mapping.filters import Rejections
from mapping.motion_gathering import MotionGatherer, fixed_track
from mapping.pending import first_readings
from mapping.placer import Placement, Placer, settled_sensors
from mapping.readings import Readings
from mapping.selection import Selection, timed
from mapping.smoothing import noise_of, smoothed_track
from mapping.tracks import MotionTrack
from recorder.clock import NS_PER_S
from recorder.columns import (
    ALL,
    Block,
    Choice,
    Columns,
    OtherColumns,
    PoseColumns,
    RangeColumns,
    RawColumns,
    ScanColumns,
    TransformColumns,
    block_of,
    blocks_of,
)
from recorder.errors import BadInput
from recorder.messages import Message, Record, topic_of
from recorder.numbers import distinct
from recorder.sources import Survey

KEPT_BYTES = 256 << 20
READINGS = Choice(kinds=(RangeColumns, ScanColumns))
Source = Callable[[Choice], Iterable[Block]]
_NAMES: tuple[tuple[type[Columns], str], ...] = (
    (RangeColumns, "range"), (ScanColumns, "scan"), (TransformColumns, "transform"),
    (RawColumns, "rawline"),
)  # fmt: skip


def no_poses(found: str) -> str:
    """What to do about a session without poses."""
    return f"no poses in the session (found: {found}); of a robot that stood still: --pose X,Y,DEG"


@dataclass(frozen=True, slots=True)
class Counts:
    """How many readings there were, and what became of them: by sensor, and by reason."""

    readings: int
    used: dict[str, int]
    dropped: dict[str, int]
    first_ns: int
    last_ns: int
    dropped_at: tuple[DroppedReadings, ...] = field(default=(), compare=False)
    rejections: Rejections = field(default_factory=Rejections, compare=False)


class HasBlocks(Protocol):
    """A session that can be gone through by columns, again and again."""

    def blocks(self, choice: Choice = ALL) -> Iterable[Block]:
        """What of it is wanted."""


def place_session(
    session: HasBlocks | Iterable[Message | Record], config: MappingConfig
) -> PlacedSession:
    """The readings of a session, or of any messages (which are kept), in the map frame.

    Raises BadInput, in one line, where the session has no readings, no poses, or none that fit.
    """
    if not isinstance(session, Iterable):
        return PlacedSession(session.blocks, config)
    records = (
        each if isinstance(each, Record) else Record(topic_of(each), each.t_ns, each)
        for each in session
    )
    kept = list(blocks_of(records))
    return PlacedSession(lambda choice: map(choice.of, kept), config)


class PlacedSession:
    """A finished session, each time anew: ``for readings in placed``."""

    def __init__(
        self, source: Source, config: MappingConfig, *, kept_bytes: int = KEPT_BYTES
    ) -> None:
        """``source(choice)`` gives the blocks of the session, as often as it is called.

        Raises BadInput, in one line, where the session has no readings, no poses, or none that fit.
        """
        self._source = source
        known = _Knowledge(config, kept_bytes)
        for block in source(ALL):
            known.take(block)
        self._kept: list[Block] | None = known.kept
        self._placed: list[Readings] | None = None
        self._room_bytes = kept_bytes
        self._counts: Counts | None = None
        self.placement, self._bad_poses, self._selection = known.placement()
        self._given, self._config = config, self._selection.config
        self._found = known.found

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """What is held of each sensor, by its name, in the order of their first readings."""
        return {sensor.name: sensor for sensor in self.placement.sensors}

    @property
    def notes(self) -> tuple[str, ...]:
        """What was taken otherwise than it came, or assumed, one line each."""
        selection = self._selection
        return (*selection.notes, *selection.mount_notes(self.placement.sensors))

    @property
    def counts(self) -> Counts:
        """What all readings came to. Raises BadInput where not one can be mapped."""
        if self._counts is None:
            for _ in self:
                pass
        assert self._counts is not None
        return self._counts

    def __iter__(self) -> Iterator[Readings]:
        if self._placed is not None:
            yield from self._placed
            return
        placer = Placer(self._config, self.placement)
        placed: list[Readings] = []
        size, times = 0, _Span()
        for block in self._kept if self._kept is not None else self._source(READINGS):
            readings = placer.take(self._selection.readings(timed(block, self._given)))
            if len(readings):
                times.take(int(readings.t_ns.min()), int(readings.t_ns.max()))
                size += readings.nbytes
                if size <= self._room_bytes:
                    placed.append(readings)
                yield readings
        self._counts = self._counted(placer, times)
        if size <= self._room_bytes:
            self._placed, self._kept = placed, None

    def columns(self) -> Iterator[Block]:
        """The readings that are mapped, as they were measured: before any is dropped."""
        for block in self._source(READINGS):
            yield self._selection.readings(timed(block, self._given))

    @property
    def by_odometry(self) -> bool:
        """Whether the poses are dead reckoning, not a tracker's."""
        return self._selection.sources.by_odometry

    @property
    def topics(self) -> Mapping[str, str]:
        """The topic of each sensor, by its name."""
        return {name: key[0] for key, name in self._selection.sources.names.items()}

    def _counted(self, placer: Placer, times: _Span) -> Counts:
        dropped = {**self._bad_poses, **placer.dropped}
        if times.last_ns is None or times.first_ns is None:
            why = ", ".join(f"{count} {reason}" for reason, count in dropped.items())
            text = f"not one reading can be mapped: {why} (found: {self._found})"
            raise BadInput("; ".join([text, *self._selection.notes]))
        used = dict(placer.used)
        return Counts(
            placer.readings, used, dropped, times.first_ns, times.last_ns, placer.dropped_at,
            placer.rejections,
        )  # fmt: skip


@dataclass(slots=True)
class _Span:
    """The first and the last of some times."""

    first_ns: int | None = None
    last_ns: int | None = None

    def take(self, first_ns: int, last_ns: int) -> None:
        self.first_ns = first_ns if self.first_ns is None else min(self.first_ns, first_ns)
        self.last_ns = last_ns if self.last_ns is None else max(self.last_ns, last_ns)


class _Knowledge:
    """All that is found in the first pass."""

    def __init__(self, config: MappingConfig, kept_bytes: int) -> None:
        self._config, self._room_bytes = config, kept_bytes
        self._motion = MotionGatherer(
            round(config.pose.max_gap_s * NS_PER_S), math.radians(config.pose.heading_offset_deg)
        )
        self._survey = Survey()
        self._counts: Counter[str] = Counter()
        self._times = _Span()
        self._size = 0
        self.kept: list[Block] | None = []

    def take(self, block: Block) -> None:
        """Note what a block holds, and keep its readings while there is room."""
        given, block = block, timed(block, self._config)
        self._survey.take(block)
        for each in block.columns:
            self._count(each)
            self._times.take(int(each.t_ns.min()), int(each.t_ns.max()))
        readings = Block(given.of(RangeColumns) + given.of(ScanColumns))
        self._size += readings.nbytes
        if self._size > self._room_bytes:
            self.kept = None
        if self.kept is not None and readings.columns:
            self.kept.append(readings)

    def placement(self) -> tuple[Placement, dict[str, int], Selection]:
        """What it comes to, how many poses were left out, by reason, and what is mapped."""
        if not self._survey.readings:
            raise BadInput(f"no range readings in the session (found: {self.found})")
        selection = Selection(self._survey, self._config)
        first = [Record(each.topic, 0, each.first) for each in self._survey.readings.values()]
        motion = selection.motion()
        self._motion.take(motion)
        try:
            track, bad_poses = self._track(motion, selection.config)
        except BadInput as error:
            raise BadInput("; ".join([str(error), *selection.notes])) from None
        frames = self._motion.frames()
        of_each = first_readings(selection.readings(block_of(first)))
        settled = settled_sensors(of_each, frames, selection.config)
        odometry = self._odometry(motion)
        return Placement(track, frames, tuple(settled.values()), odometry), bad_poses, selection

    @property
    def found(self) -> str:
        """What the session holds, in one line."""
        counts = sorted(self._counts.items())
        return ", ".join(f"{count} {name}" for name, count in counts) or "nothing"

    def _odometry(self, chosen: Block) -> MotionTrack | None:
        """Dead reckoning beside other poses."""
        kinds = {each.by_odometry for each in chosen.of(PoseColumns) if len(each)}
        return self._motion.track(by_odometry=True) if len(kinds) == 2 else None

    def _count(self, columns: Columns) -> None:
        if isinstance(columns, PoseColumns):
            self._counts["odometry" if columns.by_odometry else "pose"] += len(columns)
        elif isinstance(columns, OtherColumns):
            self._counts.update(type(message).__name__.lower() for message in columns.objects)
        else:
            name = next(name for kind, name in _NAMES if isinstance(columns, kind))
            self._counts[name] += len(columns)

    def _track(self, chosen: Block, config: MappingConfig) -> tuple[MotionTrack, dict[str, int]]:
        pose, motion = config.pose, self._motion
        if pose.fixed is not None:
            assert self._times.first_ns is not None
            assert self._times.last_ns is not None
            return fixed_track(config, self._times.first_ns, self._times.last_ns), {}
        kinds = {each.by_odometry for each in chosen.of(PoseColumns) if len(each)}
        by_odometry = pose.topic == "/odom" or False not in kinds
        if by_odometry not in kinds:
            raise BadInput(no_poses(self.found))
        bad = motion.bad_poses[by_odometry]
        track = motion.track(by_odometry=by_odometry)
        if by_odometry and pose.odom_start == "tracker":
            track = laid_on(track, motion.track(by_odometry=False))
        if pose.smooth:
            track = smoothed_track(track, noise_of(pose), self._odometry(chosen))
        return track, {"pose not finite or too far": bad} if bad else {}


def laid_on(odometry: MotionTrack, tracker: MotionTrack) -> MotionTrack:
    """Dead reckoning moved as a whole, so that it starts where the tracker has the robot.

    At the first time that both know: ``world_from_odom = world_from_base @ odom_from_base⁻¹``.
    Raises BadInput where the two have no time in common.
    """
    times = distinct(np.concatenate([odometry.t_ns, tracker.t_ns]))
    (world, seen), (odom, reckoned) = tracker.at(times), odometry.at(times)
    both = np.flatnonzero(seen & reckoned)
    if not len(both):
        raise BadInput(
            "there is no time at which the tracker and dead reckoning both know the pose"
        )
    at = int(both[0])
    moved = odometry.motions.after(world.one(at) @ odom.one(at).inverse())
    return MotionTrack(odometry.t_ns, moved, odometry.max_gap_ns)
