"""One file of a session, written so that a killed process or a power cut costs its last second.

The file has the profile ``ros2``: ROS 2 definitions as schemas, CDR as message encoding, so that
ROS tools open it. Each second the open chunk is closed and synced to the disk off the write path.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
import typing
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from recorder.errors import BadInput, OutputExists
from recorder.messages import Message, topic_of
from recorder.outputs import check_room
from recorder.ros_definitions import DEFINITIONS
from recorder.ros_types import encode, type_name
from recorder.session.format import LIBRARY, METADATA, checked_json
from recorder.session.index import ChunkIndexes

_CHUNK_BYTES = 256 * 1024
_SYNC_PERIOD_S = 0.8  # a second may be lost, no more
_FIRST_SYNC_S = (
    0.1  # the first ones follow sooner: a session that is killed at once holds something
)
_BYTES_AROUND_A_MESSAGE = 31
_BEGIN_BYTES = 1000  # of a file before its first message, besides the metadata
_BYTES_AROUND_A_DEFINITION = 128  # at most, names included


class SessionWriter:
    """Writes a session. Thread-safe; a context manager.

    ``live`` recordings stand under their own name from the first byte, so that a killed one is
    found; others are written beside and renamed when they are complete. The first OSError (disk
    full) is the last: what was written before it stays readable. Raises OutputExists.
    """

    def __init__(
        self,
        path: Path,
        *,
        metadata: Mapping[str, object] | None = None,
        force: bool = False,
        live: bool = False,
        compress: bool = True,
    ) -> None:
        if path.is_dir():
            raise BadInput(f"{path}: it is a folder")
        if path.exists() and not force:
            raise OutputExists(path)
        if not path.parent.is_dir():
            raise BadInput(f"{path}: there is no folder {path.parent}")
        self._path = path
        self._part = path if live else path.with_name(path.name + ".part")
        described = checked_json(metadata or {})
        check_room(self._part, _BEGIN_BYTES + sum(map(len, described.values())))
        try:
            self._file: BinaryIO = self._part.open("wb")
            self._indexes = ChunkIndexes(path.parent)
            self._writer = new_writer(self._file, self._indexes, compress=compress)
            self._writer.start(profile="ros2", library=LIBRARY)
            self._writer.add_metadata(METADATA, described)
            self._file.flush()  # killed from here on, its metadata can be read
            _sync_folder(path.parent)
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror or error}") from None
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._sequence: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._failure: OSError | None = None
        self._closed = False
        self._written_bytes = self._open_bytes = 0
        self._stop = threading.Event()
        self._unsynced = threading.Event()  # the system holds more than the disk may
        self._threads = [
            threading.Thread(target=target, daemon=True)
            for target in (self._flush_each_second, self._sync_what_was_flushed)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def size_bytes(self) -> int:
        """The size of the file if it were closed now, at most, but for the index at its end."""
        return self._written_bytes + self._open_bytes

    def write(self, message: Message, *, log_ns: int) -> None:
        """Append a message that reached the host at ``log_ns``. Raises OSError (disk full)."""
        topic, data = topic_of(message), encode(message)
        with self._lock, self._noting_failure():
            self._sequence[topic] += 1
            self._writer.add_message(
                channel_id=self._channel(topic, type_name(message)),
                log_time=max(log_ns, 0),
                publish_time=max(message.t_ns, 0),
                sequence=self._sequence[topic] & 0xFFFFFFFF,
                data=data,
            )
            self._open_bytes += len(data) + _BYTES_AROUND_A_MESSAGE
            if self._open_bytes > _CHUNK_BYTES:  # not each time: it is a call of the system
                self._measure()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Keep a file in the session: such as the true walls of a simulated room."""
        with self._lock, self._noting_failure():
            self._writer.add_attachment(0, 0, name, media_type, data)
            self._measure()

    def sync(self) -> None:
        """Close the open chunk and see to it that the disk holds it. Raises OSError."""
        self._flush()
        self._sync_file()

    def _flush(self) -> None:
        """Close the open chunk and hand it to the system: killed from here on, it is kept."""
        with self._lock, self._noting_failure():
            self._writer.flush()  # type: ignore[no-untyped-call]
            self._file.flush()
            self._measure()

    def _sync_file(self) -> None:
        """See to it that the disk holds what the system does: what the loss of power spares."""
        with self._lock, self._noting_failure():
            descriptor = os.dup(self._file.fileno())
        try:
            os.fsync(descriptor)  # outside the lock: a slow disk must not hold up the writer
        except OSError as error:
            self._failure = self._failure or error
            raise
        finally:
            os.close(descriptor)

    def close(self) -> None:
        """Finish the file and give it its name.

        Raises OSError where the disk is full; nothing where a write has raised it before.
        """
        if self._closed:
            return
        failed_before = self._failure is not None
        self._end_threads()
        try:
            self._finish()
        except OSError:
            if not failed_before:
                raise
        finally:
            self._let_go()
        if self._part != self._path:
            self._part.replace(self._path)
            _sync_folder(self._path.parent)

    def _finish(self) -> None:
        with self._lock, self._noting_failure():
            self._writer.finish()  # type: ignore[no-untyped-call]
            self._file.flush()
            os.fsync(self._file.fileno())

    def _discard(self) -> None:
        """Leave nothing behind: what was written beside is not the whole of it."""
        self._end_threads()
        self._let_go()
        self._part.unlink(missing_ok=True)

    def _end_threads(self) -> None:
        self._stop.set()
        self._unsynced.set()
        for thread in self._threads:
            thread.join()

    def _let_go(self) -> None:
        self._closed = True
        with contextlib.suppress(OSError):  # what is left in the buffer finds no room either
            self._file.close()
        self._indexes.close()

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> None:
        if self._part == self._path:
            self.close()
            return
        try:
            if kind is None:
                self.close()
            elif isinstance(error, OSError) and error is self._failure:
                raise error
            else:
                self._discard()
        except OSError as failure:
            self._discard()
            raise BadInput(f"{self._path}: {failure.strerror or failure}") from None

    @contextlib.contextmanager
    def _noting_failure(self) -> typing.Iterator[None]:
        if self._closed:
            raise ValueError(f"{self._path} is closed")
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            self._failure = error
            raise

    def _measure(self) -> None:
        """A chunk that was closed has become smaller."""
        written_bytes = self._file.tell()
        if written_bytes != self._written_bytes:
            self._written_bytes, self._open_bytes = written_bytes, 0

    def _channel(self, topic: str, name: str) -> int:
        if topic not in self._channels:
            if name not in self._schemas:
                text = DEFINITIONS[name].encode()
                self._schemas[name] = self._writer.register_schema(name, "ros2msg", text)
                self._open_bytes += len(text) + _BYTES_AROUND_A_DEFINITION
            self._channels[topic] = self._writer.register_channel(
                topic, "cdr", self._schemas[name], {"offered_qos_profiles": ""}
            )
            self._open_bytes += len(topic) + _BYTES_AROUND_A_DEFINITION
        return self._channels[topic]

    def _flush_each_second(self) -> None:
        """At its times, however long the disk takes: a killed process loses no more for it."""
        period_s, next_s = _FIRST_SYNC_S, time.monotonic() + _FIRST_SYNC_S
        while not self._stop.wait(next_s - time.monotonic()):
            try:
                self._flush()
            except OSError:
                return
            self._unsynced.set()
            period_s = min(2.0 * period_s, _SYNC_PERIOD_S)
            next_s = max(next_s + period_s, time.monotonic())

    def _sync_what_was_flushed(self) -> None:
        while self._unsynced.wait() and not self._stop.is_set():
            self._unsynced.clear()
            try:
                self._sync_file()
            except OSError:
                return


def new_writer(file: BinaryIO, indexes: ChunkIndexes, *, compress: bool = True) -> Writer:
    """The library's writer with all checksums on and in chunks: only these carry checksums.

    ``indexes`` holds its index until it is finished, and is closed after that.
    """
    writer = Writer(
        file,
        chunk_size=_CHUNK_BYTES,
        compression=CompressionType.ZSTD if compress else CompressionType.NONE,
        enable_data_crcs=True,
        use_summary_offsets=False,
    )
    indexes.serve(writer)
    return writer


def _sync_folder(folder: Path) -> None:
    """See to it that the disk knows a new name; not every system lets a folder be opened."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
