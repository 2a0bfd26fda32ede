"""May a file be written there, and how: so that nothing is lost and no half file bears the name.

A file is written under a private name in its folder and takes its own name when it is complete. The
private name cannot be guessed, is created anew and belongs to one process: nobody's file is
replaced and no link is followed. While it is written it is locked, so that a second writer of the
same file is refused; the lock ends with its process, so a killed one is in nobody's way.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import math
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from recorder.errors import BadInput, OutputExists
from recorder.inputs import is_input

if sys.platform != "win32":
    import fcntl

PART = ".part"
_REASONS = {
    errno.ENOSPC: "no space left on the disk of {folder}",
    errno.EDQUOT: "your share of the disk of {folder} is used up",
    errno.EFBIG: "a file may not become that large (ulimit -f)",
}
NO_ROOM = tuple(_REASONS)
_PROBE_BYTES = 4096
_LONGEST_NAME_BYTES = 255
_TOKEN_BYTES = 5
_PRIVATE = re.compile(rf"(?:\.[0-9a-f]{{{2 * _TOKEN_BYTES}}})?{re.escape(PART)}$")
_PATIENCE_S = 5.0  # for another process that looks into the same folder
_POLL_S = 0.01
_CREATE = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
_PEEK = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)
_unfinished: dict[Path, int] = {}  # what must not outlive this process, and whose it is


def check_output(output: Path, inputs: Iterable[Path] = (), *, force: bool) -> None:
    """Raises OutputExists where ``output`` exists without ``force``, BadInput where it is an input.

    An input is never replaced by what is made of it, ``force`` or not.
    """
    if not os.path.lexists(output):  # what a link without an end leads to is somebody's as well
        return
    for each in inputs:
        if output.exists() and each.exists() and output.samefile(each):
            raise _an_input(output)
    if is_input(output):
        raise _an_input(output)
    if not force:
        raise OutputExists(output)


def _an_input(output: Path) -> BadInput:
    return BadInput(f"{output} is an input as well: choose another output")


def check_room(path: Path, more_bytes: int) -> None:
    """Raises BadInput where the file at ``path`` cannot grow by so much.

    The disk may be full, or a file may not become so large, or the user's share of the disk is
    used up already. A share that is nearly used up is not noticed. Where the system does not
    know, there is room.
    """
    lacking = _what_lacks(path, more_bytes)
    if lacking is not None:
        named = path.parent / _PRIVATE.sub("", path.name)
        raise BadInput(f"{named}: {_REASONS[lacking].format(folder=path.parent)}")


def _what_lacks(path: Path, more_bytes: int) -> int | None:
    """The error that writing so much would come to."""
    size = path.stat().st_size if path.exists() else 0
    try:
        if shutil.disk_usage(path.parent).free < more_bytes:
            return errno.ENOSPC
        if size + more_bytes > _largest_file():
            return errno.EFBIG
        with tempfile.TemporaryFile(dir=path.parent) as probe:
            probe.write(bytes(_PROBE_BYTES))
    except OSError as error:
        return error.errno if error.errno in NO_ROOM else None
    return None


def _largest_file() -> float:
    """Bytes that a file of this process may have."""
    if sys.platform == "win32":
        return math.inf
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return math.inf if soft == resource.RLIM_INFINITY else soft


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A private name beside ``path`` to write to; what stands there takes its place at the end.

    Where anything is raised meanwhile, ``path`` stays as it was and nothing is left beside it.
    Raises BadInput where another process writes ``path``, OSError where none can.
    """
    output = Beside(path)
    try:
        yield output.part
        output.finish()
    finally:
        output.discard()


class Beside:
    """A file that is written under a private name, ``part``, until :meth:`finish` names it.

    Raises BadInput where another process writes ``path``, OSError where the folder takes no file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with _alone_in(path.parent):
            _refuse_second_writer(path)
            self.part, self._descriptor = _create_beside(path)
            _lock(self._descriptor)

    def finish(self) -> None:
        """Give it its name, and the permissions of any new file. Raises BadInput or OSError."""
        with _alone_in(self.path.parent):
            if _is_locked(self.path):  # a recording that began meanwhile
                raise _written_by_another(self.path)
            if sys.platform != "win32":
                os.fchmod(self._descriptor, 0o666 & ~_umask())
            else:
                self._let_go()
            os.replace(self.part, self.path)
        _unfinished.pop(self.part, None)
        self._let_go()

    def discard(self) -> None:
        """Leave nothing behind; nothing happens after :meth:`finish`."""
        self._let_go()
        if _unfinished.pop(self.part, None) is not None:
            self.part.unlink(missing_ok=True)

    def _let_go(self) -> None:
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)


def open_live(path: Path, *, force: bool) -> int:
    """The descriptor of a new file that stands under its own name from its first byte, locked.

    The lock lasts until it is closed. Raises OutputExists, BadInput where another process writes
    ``path``, OSError.
    """
    with _alone_in(path.parent):
        _refuse_second_writer(path)
        if not force:
            try:
                descriptor = os.open(path, _CREATE, 0o666)
            except FileExistsError:
                raise OutputExists(path) from None
            _lock(descriptor)
            return descriptor
        part, descriptor = _create_beside(path)
        try:
            _lock(descriptor)
            if sys.platform != "win32":
                os.fchmod(descriptor, 0o666 & ~_umask())
            os.replace(part, path)
        except OSError:
            os.close(descriptor)
            part.unlink(missing_ok=True)
            raise
        finally:
            _unfinished.pop(part, None)
        return descriptor


def _create_beside(path: Path) -> tuple[Path, int]:
    """A new, empty file that only we may open, under a name that cannot be known before."""
    while True:
        part = path.with_name(f"{_stem(path)}{os.urandom(_TOKEN_BYTES).hex()}{PART}")
        _unfinished[part] = os.getpid()  # first, so that a signal leaves nothing behind
        try:
            return part, os.open(part, _CREATE, 0o600)
        except FileExistsError:
            del _unfinished[part]
        except OSError:
            del _unfinished[part]
            raise


def _stem(path: Path) -> str:
    """What the private names of ``path`` begin with: short enough for any file system."""
    longest = _LONGEST_NAME_BYTES - 2 * _TOKEN_BYTES - len(PART) - 1
    name = os.fsencode(path.name)
    if len(name) <= longest:
        return f"{path.name}."
    from hashlib import sha256  # of a hundredth of a start

    return f"{sha256(name).hexdigest()[:32]}."


def _refuse_second_writer(path: Path) -> None:
    """Raises BadInput where somebody writes ``path`` at this moment, or it must not be replaced."""
    if is_input(path):
        raise _an_input(path)
    if path.exists() and not path.is_file():
        raise BadInput(f"{path}: no regular file, so it is not replaced")
    stem = _stem(path)
    others: list[Path] = []
    with contextlib.suppress(OSError):  # a folder that may not be listed
        others = [
            path.with_name(name)
            for name in os.listdir(path.parent)
            if name.startswith(stem) and name.endswith(PART)
        ]
    if any(_is_locked(each) for each in (path, *others)):
        raise _written_by_another(path)


def _written_by_another(path: Path) -> BadInput:
    return BadInput(f"{path}: another run is writing it: wait for its end or choose another output")


def _is_locked(path: Path) -> bool:
    """Whether somebody holds the lock of a regular file."""
    if sys.platform == "win32":
        return False
    try:
        if not stat.S_ISREG(path.lstat().st_mode):
            return False
        descriptor = os.open(path, _PEEK)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EWOULDBLOCK, errno.EACCES)
    finally:
        os.close(descriptor)
    return False


def _lock(descriptor: int) -> None:
    """Lock a new file as long as it is open; a file system without locks has none."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Nobody else looks for writers in this folder meanwhile, so that of two only one begins."""
    if sys.platform == "win32":
        yield
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:  # creating a file there tells why, if it matters
        yield
        return
    try:
        give_up_s = time.monotonic() + _PATIENCE_S
        while not _got(descriptor) and time.monotonic() < give_up_s:
            time.sleep(_POLL_S)
        yield
    finally:
        os.close(descriptor)


def _got(descriptor: int) -> bool:
    """Whether the lock of a folder is ours now, or there are no locks on its file system."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
    return True


def _umask() -> int:
    """The permissions that new files of this process do not get."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


@atexit.register
def remove_unfinished() -> None:
    """Take away what was never finished: whatever ends the process in order leaves nothing."""
    for part, owner in list(_unfinished.items()):
        if owner == os.getpid():
            with contextlib.suppress(OSError):
                part.unlink()
            _unfinished.pop(part, None)
