"""Chunks unpacked within bounds: what a file claims is compared with what it has, memory aside.

131 kB can claim, and hold, 4 GB. The library believes the claim; here a chunk, and a file as a
whole, may unpack to so much only.
"""

from __future__ import annotations

import zlib

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import breakup_chunk

MOST_CHUNK_BYTES = 64 << 20
MOST_FILE_BYTES, MOST_FILE_FACTOR = 32 << 20, 100  # of a file: so much, and times its own size
_USUAL_FACTOR = 1000  # more no chunk of a recording shrinks


class UnpackingBudget:
    """How many bytes the chunks of one file may still unpack to; a failure costs some, too."""

    def __init__(self, file_bytes: int) -> None:
        self.left = MOST_FILE_BYTES + MOST_FILE_FACTOR * file_bytes

    def unpacked(self, chunk: Chunk) -> bytes:
        """What a chunk holds, checked by size and checksum.

        Raises ValueError, or what the libraries raise, where it is not that, or too much.
        """
        size = chunk.uncompressed_size
        if size > min(self.left, MOST_CHUNK_BYTES):
            raise ValueError(f"it would unpack to {size:,} bytes, which is too much for this file")
        try:
            data = _unpacked(chunk.compression, chunk.data, size)
        except Exception:
            self.left -= min(size, _USUAL_FACTOR * len(chunk.data))
            raise
        self.left -= len(data)
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise ValueError("its checksum does not match")
        return data


def _unpacked(compression: str, data: bytes, size: int) -> bytes:
    if compression == "zstd":
        if zstandard.frame_content_size(data) not in (-1, size):
            raise ValueError("it states two sizes")
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    elif compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    elif compression:
        raise ValueError("its compression is unknown")
    if len(data) != size:
        raise ValueError("it has not the size that it states")
    return data


def records_of(data: bytes) -> list[McapRecord]:
    """The records in what :func:`unpacked` gave; raises what the library does."""
    plain = Chunk(
        compression="", data=data, message_end_time=0, message_start_time=0, uncompressed_crc=0,
        uncompressed_size=len(data),
    )  # fmt: skip
    return breakup_chunk(plain)
