"""What a recording claims to unpack to, looked at before Rerun believes it.

A recording is a row of messages, each with its kind and length before it. A chunk is a protobuf
message that states, as its third field, how many bytes its own data unpack to; the LZ4 that follows
cannot give more.
"""

from __future__ import annotations

import struct
from pathlib import Path

from recorder.errors import BadInput
from recorder.foreign import check_file, reading

MOST_CHUNK_BYTES = 128 << 20
MOST_FILE_BYTES, MOST_FILE_FACTOR = 128 << 20, 100  # of a file: so much, and times its own size
_MAGIC = b"RRF2"
_STREAM_HEADER_BYTES = 12
_MESSAGE = struct.Struct("<QQ")
_CHUNK_KIND = 2
_UNPACKED_FIELD, _PAYLOAD_FIELD = 3, 5
_LOOKED_AT = 4096  # bytes of a message: its first fields are small


def check_claims(path: Path) -> None:
    """Raises BadInput for what is no file, or would unpack to too much."""
    size = check_file(path)
    left = MOST_FILE_BYTES + MOST_FILE_FACTOR * size
    with reading(path, "a Rerun recording"), path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            return  # of another version, which Rerun knows or refuses
        at = _STREAM_HEADER_BYTES
        while at + _MESSAGE.size <= size:
            file.seek(at)
            head = file.read(_MESSAGE.size + _LOOKED_AT)
            kind, length = _MESSAGE.unpack_from(head)
            claimed = _claimed(head[_MESSAGE.size :][:length]) if kind == _CHUNK_KIND else 0
            left -= claimed
            if claimed > MOST_CHUNK_BYTES or left < 0:
                raise BadInput(f"{path}: it would unpack to more than it may for its size")
            at += _MESSAGE.size + length


def _claimed(message: bytes) -> int:
    """The bytes that a chunk states; 0 where its first fields are none."""
    at = 0
    while at < len(message):
        key, at = varint(message, at)
        number, wire_type = key >> 3, key & 7
        if number >= _PAYLOAD_FIELD or wire_type not in (0, 2):
            return 0
        value, at = varint(message, at)
        if number == _UNPACKED_FIELD and wire_type == 0:
            return value
        at += value if wire_type == 2 else 0
    return 0


def varint(data: bytes, at: int) -> tuple[int, int]:
    """A number in seven bits a byte, and where the next thing begins."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(data):
            break
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            break
    return value, at
