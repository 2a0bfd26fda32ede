"""The files that a command reads: regular ones only, and none is replaced by what is made of them.

Whoever opens an input notes it here; whoever gives a file its name (:mod:`recorder.outputs`) asks.
A run of the command line remembers its own inputs and forgets them at its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from recorder.errors import BadInput

_MADE_OF_FOLDERS = (".png", ".rrd")  # what may be replaced inside a folder that is read
_inputs: ContextVar[list[Path] | None] = ContextVar("inputs", default=None)


@contextmanager
def remembered_inputs() -> Iterator[None]:
    """What is noted within is never replaced within."""
    token = _inputs.set([])
    try:
        yield
    finally:
        _inputs.reset(token)


def note_input(path: Path) -> Path:
    """``path``, which is about to be read. Raises BadInput for a pipe, a device or a socket.

    Reading one may never end. One that is not there is reported by who reads it.
    """
    try:
        is_odd = path.exists() and not (path.is_file() or path.is_dir())
    except (OSError, ValueError):  # a name that no file can have
        return path
    if is_odd:
        raise BadInput(f"{path}: no regular file, but a pipe, a device or a socket")
    noted = _inputs.get()
    if noted is not None and path not in noted:
        noted.append(path)
    return path


def is_input(path: Path) -> bool:
    """Whether a file that is there was noted: by any of its names, or as one of a folder's."""
    return any(_holds(noted, path) for noted in _inputs.get() or () if path.exists())


def _holds(noted: Path, path: Path) -> bool:
    if not noted.exists():
        return False
    if noted.is_dir():
        inside = noted.resolve() in path.resolve().parents
        return inside and path.suffix.lower() not in _MADE_OF_FOLDERS
    return path.samefile(noted)
