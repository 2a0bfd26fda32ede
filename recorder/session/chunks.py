"""Chunks of an MCAP file taken apart in bulk: where the messages begin, without looking into them.

What is not quite as it should be is left to :class:`~recorder.session.scan.SessionScan`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord
from mcap.records import Message as McapMessage
from mcap.stream_reader import get_chunk_data_stream

from recorder.columns import Ints
from recorder.ros_columns import gathered
from recorder.session.format import UNREADABLE
from recorder.session.frames import FRAME, PARSERS, Frame, InvalidFrame, chunk_size, parsed
from recorder.session.scan import SessionScan

FIXED_BYTES = 22  # of a message, before its data
_FRAME_BYTES, _MESSAGE = FRAME.size, int(Opcode.MESSAGE)
_CHUNK = struct.Struct("<QQQII")  # times, size, checksum; length of the name of its compression
_FEW = 64  # so many messages are walked one by one as fast as together
_LENGTH = np.dtype(
    {"names": ["length"], "formats": ["<u8"], "offsets": [1], "itemsize": _FRAME_BYTES}
)


@dataclass(slots=True)
class Stretch(McapRecord):
    """Messages as they lie behind each other in a chunk; ``starts`` (N,) of their frames."""

    data: bytes
    starts: Ints


class ChunkScan(SessionScan):
    """A walk over a file that leaves the messages of its good chunks together."""

    def everything(self) -> Iterator[McapRecord]:
        """All records as they come: Stretch, and what :meth:`records` takes."""
        yield from self._walk()

    def count(self, channel_id: int, sequence: Ints) -> None:
        """Count messages of a channel that is known; ``sequence`` (N,) are their numbers."""
        self.counts[channel_id] += len(sequence)
        if self.ours:
            last = self._last_number.get(channel_id, 0)
            steps = np.diff(sequence, prepend=last) - 1
            self._missing[channel_id] += int(np.maximum(steps, 0).sum())
            self._last_number[channel_id] = int(sequence[-1])

    def count_one(self, message: McapMessage) -> bool:
        """Count a message whose channel may be unknown: whether it may be taken."""
        return self._count(message)

    def end(self) -> None:
        """Note what is missing, once all has been counted."""
        self._note_missing()

    def _unpack(self, frame: Frame, position: int) -> Iterator[McapRecord]:
        chunk = chunk_of(frame.content) if frame.opcode == Opcode.CHUNK else None
        if chunk is None:
            yield from super()._unpack(frame, position)
        else:
            yield from self._unpack_chunk(chunk, frame)

    def _unpack_chunk(self, chunk: Chunk, frame: Frame) -> Iterator[McapRecord]:
        found: list[McapRecord] | None = None
        if chunk_size(chunk) == len(frame.content):
            try:
                stream, size = get_chunk_data_stream(chunk, validate_crc=True)
                found = taken_apart(stream.read(size))
            except (InvalidFrame, *UNREADABLE):
                pass  # what it is, is found again and noted below
        if found is None:
            yield from super()._unpack_chunk(chunk, frame)
            return
        self._sure = frame.end
        if chunk.uncompressed_crc == 0:
            self.unverified += sum(len(s.starts) for s in found if isinstance(s, Stretch))
        yield from found


def chunk_of(content: bytes) -> Chunk | None:
    """A chunk that is as it should be, read at once; None: the library is to look at it."""
    if len(content) < _CHUNK.size:
        return None
    first_ns, last_ns, size, crc, name_size = _CHUNK.unpack_from(content)
    name = content[_CHUNK.size : _CHUNK.size + name_size]
    data_at = _CHUNK.size + name_size + 8
    data_size = int.from_bytes(content[data_at - 8 : data_at], "little")
    if name not in (b"zstd", b"lz4", b"") or data_at + data_size != len(content):
        return None
    return Chunk(
        compression=name.decode(), data=content[data_at:], message_end_time=last_ns,
        message_start_time=first_ns, uncompressed_crc=crc, uncompressed_size=size,
    )  # fmt: skip


def taken_apart(data: bytes) -> list[McapRecord] | None:
    """The definitions and stretches of messages in a chunk, in their order.

    None, or InvalidFrame or what the library raises, where it is not quite as it should be.
    """
    records: list[McapRecord] = []
    starts: list[int] = []
    at, size, unpack = 0, len(data), FRAME.unpack_from
    while at < size:
        if len(starts) == _FEW:  # definitions mostly come before the first messages
            rest = message_starts(data, at)
            if rest is not None:
                return [*records, Stretch(data, np.concatenate([np.array(starts), rest]))]
        opcode, length = unpack(data, at)
        end = at + _FRAME_BYTES + length
        if end > size:
            return None
        if opcode == _MESSAGE:
            if length < FIXED_BYTES:
                return None
            starts.append(at)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            if starts:
                records.append(Stretch(data, np.array(starts, np.int64)))
                starts = []
            records.append(parsed(PARSERS[opcode], data[at + _FRAME_BYTES : end], True))
        at = end
    if starts:
        records.append(Stretch(data, np.array(starts, np.int64)))
    return records


def message_starts(data: bytes, first: int) -> Ints | None:
    """Where messages begin that fill ``data`` from ``first`` on, (N,); None where others are among
    them.

    Each byte that could begin one is looked at; those that do are a chain without a gap, in which
    each ends where the next one begins.
    """
    size = len(data)
    values = np.frombuffer(data, np.uint8, size - first - _FRAME_BYTES + 1, first)
    at = np.flatnonzero(values == Opcode.MESSAGE) + first
    length = gathered(data, at, _LENGTH)["length"]
    likely = (length >= FIXED_BYTES) & (length <= size)
    at = at[likely]
    end = at + _FRAME_BYTES + length[likely].astype(np.int64)
    for _ in range(4):  # a chance hit is seldom the end of another one
        if len(at) and at[0] == first and end[-1] == size and np.array_equal(end[:-1], at[1:]):
            return at
        at, end = at[end <= size], end[end <= size]
        reached = np.zeros(size + 1, np.bool_)
        reached[first] = True
        reached[end] = True
        kept = reached[at]
        at, end = at[kept], end[kept]
    return None
