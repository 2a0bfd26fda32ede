"""The frames of an MCAP file: an opcode, a length, and a record, which the mcap library parses.

Everything is checked that can be: the library takes what is too short, and what is too long.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    Schema,
    Statistics,
)

from recorder.session.format import UNREADABLE, short_reason

FRAME = struct.Struct("<BQ")
LONGEST_RECORD = 1 << 30
_CHUNK_FIELDS = 8 + 8 + 8 + 4 + 4 + 8  # the sizes of its fields without its compression and data
_LONGEST_NAME = 8  # of a compression
LONGEST_CHUNK_HEAD = FRAME.size + _CHUNK_FIELDS + _LONGEST_NAME

PARSERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: Header.read,
    Opcode.FOOTER: Footer.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.METADATA: Metadata.read,
    Opcode.DATA_END: DataEnd.read,
}
SKIPPED = (
    Opcode.MESSAGE_INDEX, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
)  # fmt: skip


class InvalidFrame(Exception):
    """The bytes at this place are no frame."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One record as it stands in the file."""

    opcode: int
    content: bytes
    end: int  # offset of the byte behind it


class _Exact(io.BytesIO):
    """Bytes that are never read short: the library does not look at how many it got."""

    def read(self, size: int | None = -1, /) -> bytes:
        data = super().read(size)
        if size is not None and len(data) < size:
            raise EOFError("it ends within a field")
        return data


def parsed(
    parser: Callable[[ReadDataStream], McapRecord], content: bytes, exact: bool
) -> McapRecord:
    """The record in ``content``; ``exact``: which it must fill (later versions may add fields)."""
    stream = ReadDataStream(_Exact(content))
    try:
        record = parser(stream)
    except UNREADABLE as error:
        raise InvalidFrame(short_reason(error)) from None
    if exact and stream.count != len(content):
        raise InvalidFrame("a record is longer than what it holds")
    return record


def chunk_size(chunk: Chunk) -> int:
    """How many bytes its fields take."""
    return _CHUNK_FIELDS + len(chunk.compression.encode()) + len(chunk.data)


def chunk_length(head: bytes) -> int | None:
    """The length of the chunk that begins so; None where it is none. Cheap: most bytes are none."""
    _, length = FRAME.unpack_from(head.ljust(LONGEST_CHUNK_HEAD, b"\0"))
    name_at = FRAME.size + 32
    name_size = int.from_bytes(head[name_at - 4 : name_at], "little")
    if name_size > _LONGEST_NAME or length > LONGEST_RECORD:
        return None
    data_at = name_at + name_size
    data_size = int.from_bytes(head[data_at : data_at + 8], "little")
    return length if length == _CHUNK_FIELDS + name_size + data_size else None


def is_message_index(content: bytes) -> bool:
    """Whether its length is the one that its own field states."""
    return len(content) >= 6 and (len(content) - 6) % 16 == 0 and (
        int.from_bytes(content[2:6], "little") == len(content) - 6
    )  # fmt: skip


def attachment_is_sound(content: bytes) -> bool:
    """Whether its own checksum is right, or it has none."""
    written = int.from_bytes(content[-4:], "little")
    return written in (0, zlib.crc32(content[:-4]))
