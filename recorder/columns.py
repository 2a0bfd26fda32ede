"""Messages as columns: many of one kind and one source, each field an array.

What a session holds a million times is handled a thousand at a time; a message is a view of one
row, made on demand. ``row`` numbers the messages of a session as they stand in it, so that columns
of several topics can be put into order again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import islice
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
_RADIATIONS = {int(each): each for each in Radiation}
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

    def messages(self) -> Sequence[Message]:
        """The message of each row."""
        raise NotImplementedError

    def message(self, at: int) -> Message:
        """The message of one row."""
        return self[at : at + 1].messages()[0]

    def records(self) -> list[Record]:
        """The message of each row as it stands in the session."""
        rows = zip(self.log_ns.tolist(), self.messages(), strict=True)
        return [Record(self.topic, log_ns, message) for log_ns, message in rows]

    def __getitem__(self, kept: NDArray[np.bool_] | slice) -> Self:
        """Some of the rows."""
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

    def motions(self) -> Iterator[SE2]:
        """The motion of each row."""
        values = (self.x_m.tolist(), self.y_m.tolist(), self.heading_rad.tolist())
        return (SE2(x_m, y_m, heading_rad) for x_m, y_m, heading_rad in zip(*values, strict=True))


@dataclass(frozen=True, slots=True)
class PoseColumns(MotionColumns):
    """Poses of the robot; ``by_odometry``: in the frame ``odom``, else in ``map``."""

    by_odometry: bool

    def messages(self) -> list[Message]:
        """The message of each row."""
        kind = Odometry if self.by_odometry else Pose
        return list(map(kind, self.t_ns.tolist(), self.motions()))


@dataclass(frozen=True, slots=True)
class TransformColumns(MotionColumns):
    """Where one frame stands in another."""

    parent: str
    child: str
    static: bool
    up: Floats

    def messages(self) -> list[Transform]:
        """The message of each row."""
        rows = zip(self.t_ns.tolist(), self.motions(), self.up.tolist(), strict=True)
        return [
            Transform(t_ns, self.parent, self.child, motion, self.static, up)
            for t_ns, motion, up in rows
        ]


@dataclass(frozen=True, slots=True)
class RangeColumns(Columns):
    """Readings of one ranger, each array (N,). +Inf: nothing seen; -Inf: too close (REP 117)."""

    sensor: str
    range_m: Floats
    beam_width_rad: Floats
    min_range_m: Floats
    max_range_m: Floats
    radiation: Ints
    frame: str = ""

    def messages(self) -> list[Range]:
        """The message of each row."""
        values = (self.range_m, self.beam_width_rad, self.min_range_m, self.max_range_m)
        rows = zip(*(each.tolist() for each in (self.t_ns, *values, self.radiation)), strict=True)
        return [
            Range(
                t_ns,
                self.sensor,
                range_m,
                width_rad,
                min_m,
                max_m,
                _RADIATIONS[radiation],
                self.frame,
            )
            for t_ns, range_m, width_rad, min_m, max_m, radiation in rows
        ]


@dataclass(frozen=True, slots=True)
class ScanColumns(Columns):
    """Scans of one lidar with equally many beams: ``ranges_m`` (N, B), the others (N,)."""

    sensor: str
    ranges_m: Floats
    angle_min_rad: Floats
    angle_increment_rad: Floats
    min_range_m: Floats
    max_range_m: Floats
    frame: str = ""

    def messages(self) -> list[Scan]:
        """The message of each row; its ranges are a view."""
        values = (self.angle_min_rad, self.angle_increment_rad, self.min_range_m, self.max_range_m)
        rows = zip(*(each.tolist() for each in (self.t_ns, *values)), strict=True)
        ranges_m = self.ranges_m.view()
        ranges_m.flags.writeable = False
        return [
            Scan(t_ns, self.sensor, ranges, first_rad, step_rad, min_m, max_m, self.frame)
            for ranges, (t_ns, first_rad, step_rad, min_m, max_m) in zip(
                ranges_m, rows, strict=True
            )
        ]


@dataclass(frozen=True, slots=True)
class RawColumns(Columns):
    """Lines of a serial link: ``starts`` and ``ends`` (N,) of their texts in ``data``."""

    data: bytes
    starts: Ints
    ends: Ints

    def messages(self) -> list[Message]:
        """The message of each row."""
        rows = zip(self.t_ns.tolist(), self.starts.tolist(), self.ends.tolist(), strict=True)
        return [RawLine(t_ns, self.data[start:end].decode()) for t_ns, start, end in rows]


@dataclass(frozen=True, slots=True)
class OtherColumns(Columns):
    """Messages of a kind that comes seldom, as they are: ``objects`` (N,)."""

    objects: NDArray[np.object_]

    def messages(self) -> list[Message]:
        """The message of each row."""
        return list(self.objects)


@dataclass(frozen=True, slots=True)
class Block:
    """A stretch of a session: columns of all kinds, whose rows follow those of the block before."""

    columns: tuple[Columns, ...]

    def records(self) -> Iterator[Record]:
        """The messages of all columns in the order of the session."""
        records = [record for each in self.columns for record in each.records()]
        rows = np.concatenate([np.zeros(0, np.int64), *(each.row for each in self.columns)])
        return (records[at] for at in np.argsort(rows, kind="stable").tolist())

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

    def of(self, block: Block) -> Block:
        """What of a block is wanted."""
        kept = (each for each in block.columns if self.takes(each.topic, type(each)))
        if self.t_ns is not None:
            first_ns, end_ns = self.t_ns
            kept = (each[(each.t_ns >= first_ns) & (each.t_ns < end_ns)] for each in kept)
        return Block(tuple(each for each in kept if len(each)))


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


def blocks_of(records: Iterable[Record], size: int = 1000) -> Iterator[Block]:
    """Any messages as blocks of at most so many."""
    rest, first_row = iter(records), 0
    while part := list(islice(rest, size)):
        yield block_of(part, first_row)
        first_row += len(part)


def columns_of(records: Iterable[tuple[int, Record]]) -> list[Columns]:
    """Numbered messages as columns, one for each source."""
    groups: dict[tuple[object, ...], list[tuple[int, Record]]] = {}
    for row, record in records:
        groups.setdefault((record.topic, *_source(record.message)), []).append((row, record))
    return [_group(found) for found in groups.values()]


def _source(message: Message) -> tuple[object, ...]:
    match message:
        case Range():
            return Range, message.sensor, message.frame
        case Scan():
            return Scan, message.sensor, message.frame, len(message.ranges_m)
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
                first.frame,
            )  # fmt: skip
        case Scan():
            return ScanColumns(
                topic, row, log_ns, t_ns, first.sensor, column("ranges_m"),
                column("angle_min_rad"), column("angle_increment_rad"), column("min_range_m"),
                column("max_range_m"), first.frame,
            )  # fmt: skip
        case Pose() | Odometry() | Transform():
            x_m, y_m, heading_rad = _motions(messages)
            if isinstance(first, Transform):
                return TransformColumns(
                    topic, row, log_ns, t_ns, x_m, y_m, heading_rad,
                    first.parent, first.child, first.static, column("up"),
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
