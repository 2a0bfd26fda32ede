"""The door of every file of a foreign format, and of every call into somebody else's Python.

Their libraries raise whatever their parsers happen to: here it becomes one line that names the
file and the reason. What a file may cost is looked at before it is opened.
"""

from __future__ import annotations

import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from recorder.errors import BadInput, EchogridError
from recorder.names import printable

MOST_TEXT_BYTES = 1 << 20  # of a configuration or a description: people write these
_LONGEST_REASON = 160


@contextmanager
def reading(subject: object, what: str) -> Iterator[None]:
    """Whatever is raised within is raised as BadInput: ``SUBJECT: cannot be read as WHAT: why``.

    Errors of ours pass as they are; warnings of the libraries are left out: what they warn of is
    found, and reported, by who uses the values.
    """
    with _in_one_line(subject, f"cannot be read as {what}"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def calling(subject: object, what: str) -> AbstractContextManager[None]:
    """The same for a call of somebody else's code: ``SUBJECT: WHAT fails: why``."""
    return _in_one_line(subject, f"{what} fails")


@contextmanager
def _in_one_line(subject: object, failed: str) -> Iterator[None]:
    try:
        yield
    except EchogridError:
        raise
    except FileNotFoundError:
        raise BadInput(f"{subject}: no such file") from None
    except OSError as error:
        why = error.strerror or f"{failed}: {reason_of(error)}"
        raise BadInput(f"{subject}: {why}") from None
    except MemoryError:
        raise BadInput(f"{subject}: {failed}: it wants more memory than there is") from None
    except RecursionError:
        raise BadInput(f"{subject}: {failed}: it is nested too deeply") from None
    except (Exception, SystemExit) as error:
        raise BadInput(f"{subject}: {failed}: {reason_of(error)}") from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # of libraries in Rust
            raise
        raise BadInput(f"{subject}: {failed}: {reason_of(error)}") from None


def reason_of(error: BaseException) -> str:
    """An error of a library as a short piece of one line, with its kind where that helps."""
    if isinstance(error, SystemExit):
        return f"it calls sys.exit({error.code!r})"
    text = printable(" ".join(str(error).split()), most=_LONGEST_REASON)
    plain = isinstance(error, ValueError) and text
    return text if plain else f"{type(error).__name__}: {text}".rstrip(": ")


def check_file(path: Path, *, most_bytes: int | None = None, may_be_empty: bool = False) -> int:
    """The size of a regular file, which a link may lead to.

    Raises BadInput for one that is not there, for a folder, a pipe, a device or a socket (reading
    one may never end), and for a file that is empty (unless it may be) or over ``most_bytes``.
    """
    with _in_one_line(path, "no file"):
        found = os.stat(path)
    if stat.S_ISDIR(found.st_mode):
        raise BadInput(f"{path}: a folder, not a file")
    if not stat.S_ISREG(found.st_mode):
        raise BadInput(f"{path}: a pipe or a device, not a file")
    if not found.st_size and not may_be_empty:
        raise BadInput(f"{path}: an empty file")
    if most_bytes is not None and found.st_size > most_bytes:
        raise BadInput(f"{path}: {found.st_size:,} bytes, at most {most_bytes:,}")
    return found.st_size


def read_text(
    path: Path, what: str, *, most_bytes: int = MOST_TEXT_BYTES, may_be_empty: bool = False
) -> str:
    """A whole file of UTF-8. Raises BadInput as :func:`check_file` and :func:`reading` do."""
    check_file(path, most_bytes=most_bytes, may_be_empty=may_be_empty)
    with reading(path, what):
        return path.read_text(encoding="utf-8-sig")
