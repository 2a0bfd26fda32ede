"""What writing, reading and recovering a session share: names, checksums, and a list of damage."""

from __future__ import annotations

import json
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.exceptions import McapError

from recorder.errors import BadInput

LIBRARY = "echogrid"
METADATA = "echogrid"
RECOVERED = "echogrid.recovered"
ATTACHED = "echogrid.attachment"  # earlier sessions hold a checksum of each attachment so
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_LZ4_MAGIC = b"\x04\x22\x4d\x18"
# Whatever the libraries raise on damaged bytes; no common base covers them.
UNREADABLE = (
    McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, RuntimeError,
    MemoryError, EOFError, OverflowError, IndexError, TypeError,
)  # fmt: skip


@dataclass(slots=True)
class Damage:
    """What could not be read of a file: reasons, each one line, and how often each came up."""

    reasons: Counter[str] = field(default_factory=Counter)

    def note(self, reason: str, count: int = 1) -> None:
        """Count a reason."""
        self.reasons[reason] += count

    def __bool__(self) -> bool:
        return bool(self.reasons)

    @property
    def lines(self) -> tuple[str, ...]:
        """One line a reason, in the order in which they came up."""
        return tuple(
            reason if count == 1 else f"{reason} ({count} times)"
            for reason, count in self.reasons.items()
        )


def plain_message(data: bytes) -> bytes:
    """A message as it was before it was compressed by itself, as rosbag2 can.

    Raises one of :data:`UNREADABLE` where it is damaged.
    """
    if data.startswith(ZSTD_MAGIC):
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    if data.startswith(_LZ4_MAGIC):
        return bytes(lz4.frame.decompress(data))
    return data


def checked_json(content: Mapping[str, object]) -> dict[str, str]:
    """The fields of a metadata record, with a checksum: other readers do not check metadata."""
    text = json.dumps(content, sort_keys=True)
    return {"json": text, "crc32": checksum(text.encode())}


def read_checked_json(fields: Mapping[str, str]) -> dict[str, object]:
    """What :func:`checked_json` wrote. Raises BadInput where it is not whole."""
    text = fields.get("json", "")
    if checksum(text.encode()) != fields.get("crc32"):
        raise BadInput("the checksum of the metadata does not match")
    try:
        return dict(json.loads(text))
    except (ValueError, TypeError):
        raise BadInput("the metadata is not a JSON object") from None


def checksum(data: bytes) -> str:
    """CRC-32 (zlib's) as eight hexadecimal digits."""
    return f"{zlib.crc32(data):08X}"


def short_reason(error: BaseException) -> str:
    """An error of a library as a short piece of one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}"[:120] if text else type(error).__name__
