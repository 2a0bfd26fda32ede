"""A session: one recording in MCAP. The face of the modules that write, read and mend it.

:class:`SessionWriter` writes a file, :class:`PartedWriter` a live recording in parts;
:class:`SessionReader` goes through a file in the memory of a chunk, :func:`read_session` keeps its
records, and several files are read as one. No other package imports mcap.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorder.errors import BadInput
from recorder.session.join import join_sessions
from recorder.session.opening import session_files
from recorder.session.reader import Session, SessionReader
from recorder.session.scan import MAGIC

if TYPE_CHECKING:
    from recorder.session.parts import Limits, PartedWriter
    from recorder.session.writer import SessionWriter

__all__ = [
    "Limits", "PartedWriter", "Session", "SessionReader", "SessionWriter", "looks_like_session",
    "read_session", "session_files",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """What writes is loaded by those who write."""
    if name == "SessionWriter":
        from recorder.session.writer import SessionWriter

        return SessionWriter
    if name in ("Limits", "PartedWriter"):
        from recorder.session import parts

        return getattr(parts, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def read_session(path: Path, *more: Path) -> Session:
    """Read a session as far as it goes; ``damage`` lists what was lost.

    A folder is a bag as rosbag2 leaves it: its files. With ``more`` files, parts of the recording
    or other recordings, all are one session: see :func:`~recorder.session.join.join_sessions`.
    Raises BadInput, in one line, where a file is no session or nothing of it can be used.
    """
    return join_sessions([_read(each) for each in session_files(path, *more)])


def looks_like_session(path: Path) -> bool:
    """Whether a file begins as an MCAP file does. Raises BadInput where it cannot be read."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from None


def _read(path: Path) -> Session:
    reader = SessionReader(path)
    records = tuple(reader.records())
    return Session(path, records, reader.metadata, reader.attachments, reader.damage)
