"""A recording in several files, and one that stops before the disk is full.

Each part is a session of its own: it repeats the metadata, the attachments, the mounts, and the
last pose and head angle before it, with their own times. The first part has the name that was
asked for, the others NAME-2, NAME-3 and so on.
"""

from __future__ import annotations

import errno
import itertools
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from recorder.clock import NS_PER_S
from recorder.errors import BadInput, OutputExists
from recorder.messages import Message
from recorder.session.part_names import PART, parts_beside, repeated_as
from recorder.session.writer import SessionWriter

BYTES_PER_MB = 1_000_000
_LOOK_AT_DISK_EACH_S = 1.0


@dataclass(frozen=True, slots=True)
class Limits:
    """When a recording goes on in a new file, and how much of the disk it leaves free."""

    split_mb: float | None = None
    split_s: float | None = None
    min_free_mb: float = 200.0

    @property
    def splits(self) -> bool:
        """Whether there may be several parts."""
        return self.split_mb is not None or self.split_s is not None


class PartedWriter:
    """Writes a live recording within ``limits``; used as a SessionWriter is.

    ``free_bytes`` is the room on the disk that holds a folder, ``monotonic_s`` the time.
    Raises OutputExists, and BadInput where the disk has too little room to begin with.
    """

    def __init__(
        self,
        path: Path,
        limits: Limits,
        *,
        metadata: Mapping[str, object] | None = None,
        force: bool = False,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._path, self._limits, self._metadata = path, limits, dict(metadata or {})
        self._free_bytes, self._monotonic_s = free_bytes, monotonic_s
        self._recording = secrets.token_hex(8)
        self._attachments: list[tuple[str, str, bytes]] = []
        self._latest: dict[tuple[str, ...], Message] = {}
        self._first_ns: int | None = None  # when the part began
        self._closing: threading.Thread | None = None
        self._failure: OSError | None = None
        self._look_again_s = 0.0
        self.parts: list[Path] = []
        if limits.splits and not force:
            for old in parts_beside(path):
                raise OutputExists(old)
        try:
            self._check_room()
        except FileNotFoundError:
            raise BadInput(f"{path}: there is no folder {path.parent}") from None
        except OSError as error:
            raise BadInput(f"{path}: {error.strerror}") from None
        self._writer = self._open(path, 0, force=force)

    def write(self, message: Message, *, log_ns: int) -> None:
        """Append a message that reached the host at ``log_ns``. Raises OSError (disk full)."""
        if self._failure is not None:
            raise self._failure
        self._check_room()
        if self._first_ns is None:
            self._first_ns = log_ns
        elif self._is_due(log_ns):
            self._next_part(log_ns)
        self._writer.write(message, log_ns=log_ns)
        key = repeated_as(message)
        if self._limits.splits and key is not None:
            self._latest[key] = message

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Keep a file in each part. Raises BadInput where the disk has no room for it."""
        self._attachments.append((name, media_type, data))
        try:
            self._writer.attach(name, media_type, data)
        except OSError as error:
            raise BadInput(f"{self._path}: {error.strerror or error}") from None

    def sync(self) -> None:
        """See to it that the disk holds all parts as far as they go. Raises OSError."""
        self._wait_for_closing()
        self._writer.sync()

    def close(self) -> None:
        """Finish the last part.

        Raises OSError where the disk is full; nothing where a write has raised it before.
        """
        known = self._failure
        if self._closing is not None:
            self._closing.join()
        self._writer.close()
        if self._failure is not known and self._failure is not None:
            raise self._failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self.close()
        except OSError as failure:
            if kind is None:
                raise BadInput(
                    f"{self.parts[-1]}: {failure.strerror or failure}: it has no index, but all "
                    "that was recorded can be read and recovered"
                ) from None

    def _check_room(self) -> None:
        """Look at the disk once a second; raises OSError when too little of it is free."""
        now_s = self._monotonic_s()
        if now_s < self._look_again_s:
            return
        self._look_again_s = now_s + _LOOK_AT_DISK_EACH_S
        free_mb = self._free_bytes(self._path.parent) / BYTES_PER_MB
        if free_mb < self._limits.min_free_mb:
            self._failure = OSError(
                errno.ENOSPC,
                f"only {free_mb:.0f} MB of the disk are free, {self._limits.min_free_mb:g} MB are "
                "to stay so (--min-free-mb)",
            )
            raise self._failure

    def _is_due(self, log_ns: int) -> bool:
        limits = self._limits
        assert self._first_ns is not None
        late = limits.split_s is not None and (log_ns - self._first_ns >= limits.split_s * NS_PER_S)
        return late or (
            limits.split_mb is not None
            and self._writer.size_bytes >= limits.split_mb * BYTES_PER_MB
        )

    def _next_part(self, log_ns: int) -> None:
        """Go on in a new file; the old one is finished in a thread, off the write path."""
        self._wait_for_closing()
        old = self._writer
        try:
            self._writer = self._open(self._next_path(), len(self._latest), force=False)
        except (BadInput, OutputExists) as error:
            self._failure = OSError(errno.EIO, str(error))
            raise self._failure from None
        self._closing = threading.Thread(target=self._close, args=(old,), daemon=True)
        self._closing.start()
        for message in self._latest.values():
            self._writer.write(message, log_ns=log_ns)
        self._first_ns = log_ns

    def _open(self, path: Path, repeated: int, *, force: bool) -> SessionWriter:
        metadata = dict(self._metadata)
        if self._limits.splits:
            metadata[PART] = {
                "recording": self._recording,
                "number": len(self.parts) + 1,
                "repeated": repeated,
            }
        writer = SessionWriter(path, metadata=metadata, force=force, live=True)
        self.parts.append(path)
        for attachment in self._attachments:
            writer.attach(*attachment)
        return writer

    def _next_path(self) -> Path:
        """The next name that is free: nobody's file is replaced in the middle of a recording."""
        numbers = itertools.count(len(self.parts) + 1)
        names = (part_path(self._path, number) for number in numbers)
        return next(name for name in names if not name.exists())

    def _close(self, writer: SessionWriter) -> None:
        try:
            writer.close()
        except OSError as error:
            self._failure = error

    def _wait_for_closing(self) -> None:
        if self._closing is not None:
            self._closing.join()
            self._closing = None
        if self._failure is not None:
            raise self._failure


def part_path(path: Path, number: int) -> Path:
    """The name of a part: NAME.mcap, NAME-2.mcap, NAME-3.mcap."""
    return path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
