"""Messages as columns: many of one kind and one source, each field an array.

What a session holds a million times is handled a thousand at a time; a message is a view of one
row, made on demand. ``row`` numbers the messages of a session as they stand in it, so that columns
of several topics can be put into order again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from recorder.geometry import SE2
from recorder.messages import (
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    RawLine,
    Record,
    Scan,
    Transform,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
T = TypeVar("T")
LAST_NS = (1 << 63) - 1  # in the year 2262: no later time has room in a column


@dataclass(frozen=True, slots=True)
class Columns:
    """Messages of one topic in the order of the session: ``row``, ``log_ns``, ``t_ns`` are (N,)."""

    topic: str
    row: Ints
    log_ns: Ints
    t_ns: Ints

    def __len__(self) -> int:
        return len(self.t_ns)

    def message(self, at: int) -> Message:
        """The message of one row."""
        raise NotImplementedError

    def record(self, at: int) -> Record:
        """The message of one row as it stands in the session."""
        return Record(self.topic, int(self.log_ns[at]), self.message(at))

    def where(self, kept: NDArray[np.bool_]) -> Self:
        """The rows for which ``kept`` (N,) is true."""
        if kept.all():
            return self
        chosen: dict[str, Any] = {
            field.name: value[kept]
            for field in fields(self)
            if isinstance(value := getattr(self, field.name), np.ndarray)
        }
        return replace(self, **chosen)

    @property
    def nbytes(self) -> int:
        """The memory that the arrays take, at most."""
        values = [getattr(self, field.name) for field in fields(self)]
        return sum(value.nbytes for value in values if isinstance(value, np.ndarray))


@dataclass(frozen=True, slots=True)
class MotionColumns(Columns):
    """Rigid motions of the plane, each array (N,)."""

    x_m: Floats
    y_m: Floats
    heading_rad: Floats

    def motion(self, at: int) -> SE2:
        """The motion of one row."""
        return SE2(float(self.x_m[at]), float(self.y_m[at]), float(self.heading_rad[at]))


@dataclass(frozen=True, slots=True)
class PoseColumns(MotionColumns):
    """Poses of the robot; ``by_odometry``: in the frame ``odom``, else in ``map``."""

    by_odometry: bool

    def message(self, at: int) -> Pose | Odometry:
        """The message of one row."""
        kind = Odometry if self.by_odometry else Pose
        return kind(int(self.t_ns[at]), self.motion(at))


@dataclass(frozen=True, slots=True)
class TransformColumns(MotionColumns):
    """Where one frame stands in another."""

    parent: str
    child: str
    static: bool

    def message(self, at: int) -> Transform:
        """The message of one row."""
        return Transform(int(self.t_ns[at]), self.parent, self.child, self.motion(at), self.static)


@dataclass(frozen=True, slots=True)
class RangeColumns(Columns):
    """Readings of one ranger, each array (N,). +Inf: nothing seen; -Inf: too close (REP 117)."""

    sensor: str
    range_m: Floats
    beam_width_rad: Floats
    min_range_m: Floats
    max_range_m: Floats
    radiation: Ints

    def message(self, at: int) -> Range:
        """The message of one row."""
        return Range(
            int(self.t_ns[at]), self.sensor, float(self.range_m[at]),
            float(self.beam_width_rad[at]), float(self.min_range_m[at]),
            float(self.max_range_m[at]), Radiation(int(self.radiation[at])),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ScanColumns(Columns):
    """Scans of one lidar with equally many beams: ``ranges_m`` (N, B), the others (N,)."""

    sensor: str
    ranges_m: Floats
    angle_min_rad: Floats
    angle_increment_rad: Floats
    min_range_m: Floats
    max_range_m: Floats

    def message(self, at: int) -> Scan:
        """The message of one row."""
        ranges_m = self.ranges_m[at].copy()
        ranges_m.flags.writeable = False
        return Scan(
            int(self.t_ns[at]), self.sensor, ranges_m, float(self.angle_min_rad[at]),
            float(self.angle_increment_rad[at]), float(self.min_range_m[at]),
            float(self.max_range_m[at]),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class RawColumns(Columns):
    """Lines of a serial link: ``starts`` and ``ends`` (N,) of their texts in ``data``."""

    data: bytes
    starts: Ints
    ends: Ints

    def message(self, at: int) -> RawLine:
        """The message of one row."""
        return RawLine(int(self.t_ns[at]), self.data[self.starts[at] : self.ends[at]].decode())


@dataclass(frozen=True, slots=True)
class OtherColumns(Columns):
    """Messages of a kind that comes seldom, as they are: ``messages`` (N,) of objects."""

    messages: NDArray[np.object_]

    def message(self, at: int) -> Message:
        """The message of one row."""
        found: Message = self.messages[at]
        return found


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of a session: columns of all kinds, whose rows follow those of the block before."""

    columns: tuple[Columns, ...]

    def records(self) -> Iterator[Record]:
        """The messages of all columns in the order of the session."""
        counts = [len(each) for each in self.columns]
        rows = np.concatenate([np.zeros(0, np.int64), *(each.row for each in self.columns)])
        owner = np.repeat(np.arange(len(counts)), counts)
        place = np.concatenate([np.zeros(0, np.int64), *(np.arange(n) for n in counts)])
        for at in np.argsort(rows, kind="stable"):
            yield self.columns[owner[at]].record(int(place[at]))

    def of(self, kind: type[T]) -> tuple[T, ...]:
        """The columns of one kind."""
        return tuple(each for each in self.columns if isinstance(each, kind))

    @property
    def nbytes(self) -> int:
        """The memory that its arrays take, at most."""
        return sum(each.nbytes for each in self.columns)


@dataclass(frozen=True, slots=True)
class Choice:
    """What of a session is wanted: topics, kinds of columns, times in [from, to); None: all."""

    topics: Collection[str] | None = None
    kinds: tuple[type[Columns], ...] | None = None
    t_ns: tuple[int, int] | None = None

    def takes(self, topic: str, kind: type[Columns]) -> bool:
        """Whether messages of that kind on that topic are wanted."""
        return (self.topics is None or topic in self.topics) and (
            self.kinds is None or issubclass(kind, self.kinds)
        )

    def of(self, columns: Columns) -> Columns:
        """The rows of the times that are wanted."""
        if self.t_ns is None:
            return columns
        first_ns, end_ns = self.t_ns
        return columns.where((columns.t_ns >= first_ns) & (columns.t_ns < end_ns))


ALL = Choice()


def elementwise(function: Callable[..., float], *values: Floats) -> Floats:
    """A function of :mod:`math` for each element.

    Those of NumPy differ in the last bit on some processors; the maps may not.
    """
    return np.fromiter(map(function, *(v.tolist() for v in values)), np.float64, len(values[0]))


def block_of(records: Iterable[Record], first_row: int = 0) -> Block:
    """Single messages as columns: those of one source together, numbered from ``first_row`` on."""
    rows = enumerate(records, first_row)
    return Block(tuple(columns_of((row, record) for row, record in rows)))


def columns_of(records: Iterable[tuple[int, Record]]) -> list[Columns]:
    """Numbered messages as columns, one for each source."""
    groups: dict[tuple[object, ...], list[tuple[int, Record]]] = {}
    for row, record in records:
        groups.setdefault((record.topic, *_source(record.message)), []).append((row, record))
    return [_group(found) for found in groups.values()]


def _source(message: Message) -> tuple[object, ...]:
    match message:
        case Range():
            return Range, message.sensor
        case Scan():
            return Scan, message.sensor, len(message.ranges_m)
        case Transform():
            return Transform, message.parent, message.child, message.static
        case _:
            return (type(message),)


def _group(found: Sequence[tuple[int, Record]]) -> Columns:
    messages = [record.message for _, record in found]
    topic, first = found[0][1].topic, messages[0]
    row = np.array([row for row, _ in found], np.int64)
    log_ns = np.array([min(record.log_ns, LAST_NS) for _, record in found], np.int64)
    t_ns = np.array([min(message.t_ns, LAST_NS) for message in messages], np.int64)

    def column(name: str) -> Floats:
        return np.array([getattr(message, name) for message in messages], np.float64)

    match first:
        case Range():
            radiation = np.array([getattr(m, "radiation") for m in messages], np.int64)  # noqa: B009
            return RangeColumns(
                topic, row, log_ns, t_ns, first.sensor, column("range_m"),
                column("beam_width_rad"), column("min_range_m"), column("max_range_m"), radiation,
            )  # fmt: skip
        case Scan():
            return ScanColumns(
                topic, row, log_ns, t_ns, first.sensor, column("ranges_m"),
                column("angle_min_rad"), column("angle_increment_rad"), column("min_range_m"),
                column("max_range_m"),
            )  # fmt: skip
        case Pose() | Odometry() | Transform():
            x_m, y_m, heading_rad = _motions(messages)
            if isinstance(first, Transform):
                return TransformColumns(
                    topic, row, log_ns, t_ns, x_m, y_m, heading_rad,
                    first.parent, first.child, first.static,
                )  # fmt: skip
            by_odometry = isinstance(first, Odometry)
            return PoseColumns(topic, row, log_ns, t_ns, x_m, y_m, heading_rad, by_odometry)
        case _:
            objects = np.empty(len(messages), object)
            objects[:] = messages
            return OtherColumns(topic, row, log_ns, t_ns, objects)


def _motions(messages: Iterable[Message]) -> tuple[Floats, Floats, Floats]:
    values: list[tuple[float, float, float]] = []
    for message in messages:
        match message:
            case Pose(world_from_base=motion):
                pass
            case Odometry(odom_from_base=motion):
                pass
            case Transform(parent_from_child=motion):
                pass
            case _:
                raise TypeError(f"{type(message).__name__} is no motion")
        values.append((motion.x_m, motion.y_m, motion.heading_rad))
    x_m, y_m, heading_rad = np.array(values, np.float64).reshape(-1, 3).T.copy()
    return x_m, y_m, heading_rad
