"""A session: one recording in MCAP, written with a bounded loss and read with tolerance.

The only place that imports mcap. The file has the profile ``ros2``: ROS 2 definitions as schemas,
CDR as message encoding, so that ROS tools open it. Each second the open chunk is closed and synced
to the disk off the write path. Reading checks every checksum and says what was lost.
"""

from __future__ import annotations

import json
import os
import struct
import threading
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer

from recorder.errors import BadInput, OutputExists
from recorder.messages import Message, Record, topic_of
from recorder.ros_definitions import DEFINITIONS
from recorder.ros_types import Decoder, encode, type_name

LIBRARY = "echogrid"
METADATA = "echogrid"
ATTACHED = "echogrid.attachment"
WALLS = "truth.geojson"
_CHUNK_BYTES = 256 * 1024
_SYNC_PERIOD_S = 1.0
# Whatever the libraries raise on damaged bytes; no common base covers them.
_DAMAGE = (
    McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, RuntimeError,
    MemoryError, EOFError, OverflowError, IndexError, TypeError,
)  # fmt: skip


class SessionWriter:
    """Writes a session. Thread-safe; a context manager.

    ``live`` recordings stand under their own name from the first byte, so that a killed one is
    found; others are written beside and renamed when they are complete. Raises OutputExists.
    """

    def __init__(
        self,
        path: Path,
        *,
        metadata: Mapping[str, object] | None = None,
        force: bool = False,
        live: bool = False,
    ) -> None:
        if path.exists() and not force:
            raise OutputExists(path)
        self._path = path
        self._part = path if live else path.with_name(path.name + ".part")
        try:
            self._file: BinaryIO = self._part.open("wb")
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror or error}") from None
        self._writer = Writer(
            self._file,
            chunk_size=_CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
            use_summary_offsets=False,
        )
        self._writer.start(profile="ros2", library=LIBRARY)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._sequence: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._failure: OSError | None = None
        self._closed = False
        self._add_metadata(metadata or {})
        self._stop = threading.Event()
        self._syncer = threading.Thread(target=self._sync_each_second, daemon=True)
        self._syncer.start()

    def write(self, message: Message, *, log_ns: int) -> None:
        """Append a message that reached the host at ``log_ns``. Raises OSError (disk full)."""
        topic, data = topic_of(message), encode(message)
        with self._lock:
            if self._failure is not None:
                raise self._failure
            self._sequence[topic] += 1
            self._writer.add_message(
                channel_id=self._channel(topic, type_name(message)),
                log_time=max(log_ns, 0),
                publish_time=max(message.t_ns, 0),
                sequence=self._sequence[topic] & 0xFFFFFFFF,
                data=data,
            )

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Keep a file in the session: the true walls of a simulated room, say."""
        with self._lock:
            # MCAP readers skip an attachment's own checksum: it gets one that ours checks.
            self._writer.add_metadata(ATTACHED, {"name": name, "crc32": _crc(data)})
            self._writer.add_attachment(0, 0, name, media_type, data)

    def sync(self) -> None:
        """Close the open chunk and see to it that the disk holds it."""
        with self._lock:
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._file.flush()
            descriptor = os.dup(self._file.fileno())
        try:
            os.fsync(descriptor)  # outside the lock: a slow disk must not hold up the writer
        finally:
            os.close(descriptor)

    def close(self) -> None:
        """Finish the file and give it its name."""
        if self._closed:
            return
        self._closed = True
        self._stop.set()
        self._syncer.join()
        with self._file:
            if self._failure is None:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._file.flush()
                os.fsync(self._file.fileno())
        if self._part != self._path:
            self._part.replace(self._path)

    def _discard(self) -> None:
        """Leave nothing behind: what was written beside is not the whole of it."""
        self._closed = True
        self._stop.set()
        self._syncer.join()
        self._file.close()
        if self._part != self._path:
            self._part.unlink(missing_ok=True)

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if kind is not None and self._part != self._path:
            self._discard()
        else:
            self.close()

    def _channel(self, topic: str, name: str) -> int:
        if topic not in self._channels:
            if name not in self._schemas:
                text = DEFINITIONS[name].encode()
                self._schemas[name] = self._writer.register_schema(name, "ros2msg", text)
            self._channels[topic] = self._writer.register_channel(
                topic, "cdr", self._schemas[name], {"offered_qos_profiles": ""}
            )
        return self._channels[topic]

    def _add_metadata(self, metadata: Mapping[str, object]) -> None:
        # MCAP readers do not check the checksums of metadata: it carries one of its own.
        text = json.dumps(metadata, sort_keys=True)
        self._writer.add_metadata(METADATA, {"json": text, "crc32": _crc(text.encode())})

    def _sync_each_second(self) -> None:
        while not self._stop.wait(_SYNC_PERIOD_S):
            try:
                self.sync()
            except OSError as error:
                self._failure = error
                return


@dataclass(slots=True)
class Damage:
    """What could not be read of a file, counted; ``said`` are the reasons, one line each."""

    said: list[str] = field(default_factory=list)

    def note(self, reason: str) -> None:
        """Add a reason, once."""
        if reason not in self.said:
            self.said.append(reason)


@dataclass(frozen=True, slots=True)
class Session:
    """A session as it was read. Its records are kept: they can be gone through again."""

    path: Path
    records: tuple[Record, ...]
    metadata: Mapping[str, object]
    attachments: Mapping[str, bytes]
    damage: tuple[str, ...]

    def messages(self) -> Iterator[Message]:
        """The messages in the order in which they reached the host."""
        return (record.message for record in self.records)


def read_session(path: Path) -> Session:
    """Read a session as far as it goes; ``damage`` says what was lost.

    Raises BadInput, in one line, where the file is none or nothing of it can be used.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            return _Reading(path, size).read(file)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from None


class _Reading:
    """One file being read, record by record, in file order."""

    def __init__(self, path: Path, size: int) -> None:
        self._path, self._size = path, size
        self._damage = Damage()
        self._records: list[Record] = []
        self._metadata: dict[str, object] = {}
        self._attachments: dict[str, bytes] = {}
        self._checksums: dict[str, str] = {}
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._decoders: dict[int, Decoder | None] = {}

    def read(self, file: BinaryIO) -> Session:
        if self._size == 0:
            raise BadInput(f"{self._path}: an empty file, not a session")
        # A record longer than the file is nonsense, not a reason to ask for the memory.
        reader = StreamReader(
            file, emit_chunks=True, record_size_limit=self._size, validate_crcs=True
        )
        try:
            for record in reader.records:
                self._take(record)
        except _DAMAGE as error:
            if not self._records and not self._channels and not self._metadata:
                raise BadInput(f"{self._path}: not an MCAP file ({_why(error)})") from None
            self._damage.note(f"the file ends early or is damaged ({_why(error)})")
        return Session(
            self._path, tuple(self._records), self._metadata, self._attachments,
            tuple(self._damage.said),
        )  # fmt: skip

    def _take(self, record: McapRecord) -> None:
        match record:
            case Chunk():
                try:
                    inner = breakup_chunk(record, validate_crc=True)
                except _DAMAGE as error:
                    self._damage.note(f"a damaged chunk was left out ({_why(error)})")
                    return
                for each in inner:
                    self._take(each)
            case Schema():
                self._schemas[record.id] = record
            case Channel():
                self._channels[record.id] = record
            case McapMessage():
                self._take_message(record)
            case Metadata() if record.name == METADATA:
                self._take_metadata(record)
            case Metadata() if record.name == ATTACHED:
                self._checksums[record.metadata.get("name", "")] = record.metadata.get("crc32", "")
            case Attachment():
                if self._checksums.get(record.name) == _crc(record.data):
                    self._attachments[record.name] = record.data
                else:
                    self._damage.note(f"attachment {record.name!r} is damaged and was left out")

    def _take_message(self, message: McapMessage) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            self._damage.note("messages without a channel were left out")
            return
        decoder = self._decoder(channel)
        if decoder is None:
            return
        try:
            decoded = decoder.decode(message.data, channel.topic, message.publish_time)
        except BadInput as error:
            self._damage.note(str(error))
            return
        self._records += [Record(channel.topic, message.log_time, each) for each in decoded]

    def _decoder(self, channel: Channel) -> Decoder | None:
        """A channel that cannot be decoded costs only itself."""
        if channel.id not in self._decoders:
            schema = self._schemas.get(channel.schema_id)
            usable = schema is not None and channel.message_encoding == "cdr"
            self._decoders[channel.id] = None
            if usable and schema is not None and schema.encoding == "ros2msg":
                try:
                    self._decoders[channel.id] = Decoder(schema.name, schema.data)
                except BadInput as error:
                    self._damage.note(f"{channel.topic}: {error}")
        return self._decoders[channel.id]

    def _take_metadata(self, record: Metadata) -> None:
        text = record.metadata.get("json", "")
        if _crc(text.encode()) != record.metadata.get("crc32"):
            self._damage.note("the session's metadata is damaged and was left out")
            return
        self._metadata = dict(json.loads(text))


def _crc(data: bytes) -> str:
    return f"{zlib.crc32(data):08X}"


def _why(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}"[:120] if text else type(error).__name__
