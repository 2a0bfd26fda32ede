"""Sessions of any length, written as fast as a disk takes them: whole chunks made by NumPy.

A robot drives in a circle within four walls, 20 ticks a second: each is a pose, a sonar reading and
an infrared one. The file is one that echogrid itself might have written, checksums and numbers
included; only its index is left out, which no reader of ours needs.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Metadata, Schema
from numpy.typing import NDArray

from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, topic_of
from recorder.ros_definitions import DEFINITIONS
from recorder.ros_layouts import Layout, layout_of, parse_definition
from recorder.ros_types import encode, type_name
from recorder.session.format import LIBRARY, METADATA, checked_json
from recorder.session.scan import MAGIC

START_NS = 1_700_000_000 * 1_000_000_000
TICK_NS = 50_000_000
READINGS_A_TICK = 2
MESSAGES_A_TICK = 3
HALF_ROOM_M = 1.5
CIRCLE_M = 0.8
TURN_RAD = 0.011  # each tick
_HEAD_BYTES = 31  # of a message within a chunk, before its data


@dataclass(frozen=True, slots=True)
class _Kind:
    """A message of the session, as bytes, and where its fields lie."""

    message: Message
    data: bytes
    layout: Layout

    @classmethod
    def of(cls, message: Message) -> _Kind:
        name, data = type_name(message), encode(message)
        definition = parse_definition(name, DEFINITIONS[name])
        assert definition is not None
        layout = layout_of(definition, data)
        assert layout is not None
        return cls(message, data, layout)

    @property
    def size(self) -> int:
        return _HEAD_BYTES + len(self.data)


KINDS = (
    _Kind.of(Pose(0, SE2(0.0, 0.0, 0.0))),
    _Kind.of(Range(0, "ping", 1.0, math.radians(38), 0.02, 4.0, Radiation.ULTRASOUND)),
    _Kind.of(Range(0, "dirrs", 1.0, math.radians(6), 0.1, 0.8, Radiation.INFRARED)),
)


def write_session(path: Path, readings: int, *, ticks_a_chunk: int = 1000) -> int:
    """Write a session of at least so many readings; how many messages it has."""
    ticks = -(-readings // READINGS_A_TICK)
    with path.open("wb") as file:
        file.write(MAGIC)
        _write(file, Header("ros2", LIBRARY), Metadata(name=METADATA, metadata=checked_json({})))
        for first in range(0, ticks, ticks_a_chunk):
            count = min(ticks_a_chunk, ticks - first)
            data = _messages(first, count)
            _write(file, _chunk(data if first else _definitions() + data))
        _write(file, DataEnd(0), Footer(summary_start=0, summary_offset_start=0, summary_crc=0))
        file.write(MAGIC)
    return ticks * MESSAGES_A_TICK


def _write(file: BinaryIO, *records: McapRecord) -> None:
    file.write(_bytes_of(*records))


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def _definitions() -> bytes:
    records: list[McapRecord] = []
    for number, kind in enumerate(KINDS, 1):
        name = type_name(kind.message)
        records.append(
            Schema(id=number, name=name, encoding="ros2msg", data=DEFINITIONS[name].encode())
        )
        topic = topic_of(kind.message)
        records.append(
            Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=number)
        )
    return _bytes_of(*records)


def _chunk(data: bytes) -> Chunk:
    return Chunk(
        compression="zstd",
        data=zstandard.ZstdCompressor(level=1).compress(data),
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    )


def _messages(first: int, count: int) -> bytes:
    """The messages of some ticks, one tick a row."""
    tick = np.arange(first, first + count)
    t_ns = START_NS + tick * TICK_NS
    along = tick * TURN_RAD
    x_m, y_m, heading_rad = CIRCLE_M * np.cos(along), CIRCLE_M * np.sin(along), 2.0 * along
    seen_m = _to_wall_m(x_m, y_m, heading_rad)
    size = sum(kind.size for kind in KINDS)
    out = np.zeros((count, size), np.uint8)
    at = 0
    for number, kind in enumerate(KINDS, 1):
        part = out[:, at : at + kind.size]
        part[:, _HEAD_BYTES:] = np.frombuffer(kind.data, np.uint8)
        _put(part, 0, "u1", 5)
        _put(part, 1, "<u8", kind.size - 9)
        _put(part, 9, "<u2", number)
        _put(part, 11, "<u4", tick + 1)
        _put(part, 15, "<u8", t_ns)
        _put(part, 23, "<u8", t_ns)
        fields = {"header.stamp.sec": t_ns // 10**9, "header.stamp.nanosec": t_ns % 10**9}
        if isinstance(kind.message, Pose):
            fields |= {"pose.position.x": x_m, "pose.position.y": y_m}
            fields |= {"pose.orientation.z": np.sin(heading_rad / 2)}
            fields |= {"pose.orientation.w": np.cos(heading_rad / 2)}
        else:
            fields |= {"range": seen_m - 0.05}
        for path, values in fields.items():
            offset, kind_of_value, _ = kind.layout.values[path]
            _put(part, _HEAD_BYTES + offset, kind_of_value, values)
        at += kind.size
    return out.tobytes()


def _put(part: NDArray[np.uint8], at: int, kind: str, values: NDArray[np.generic] | int) -> None:
    """Write a column of numbers into rows of bytes."""
    column = np.broadcast_to(np.asarray(values), len(part)).astype(kind)
    width = column.dtype.itemsize
    part[:, at : at + width] = column.view(np.uint8).reshape(-1, width)


def _to_wall_m(
    x_m: NDArray[np.float64], y_m: NDArray[np.float64], heading_rad: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How far the walls are straight ahead, (N,)."""
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    with np.errstate(divide="ignore", invalid="ignore"):
        across = (np.sign(c) * HALF_ROOM_M - x_m) / c
        up = (np.sign(s) * HALF_ROOM_M - y_m) / s
    return np.minimum(np.where(c == 0, np.inf, across), np.where(s == 0, np.inf, up))
