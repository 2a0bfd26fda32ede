"""May a file be written there, and how: so that nothing is lost and no half file bears the name."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from recorder.errors import BadInput, OutputExists

_REASONS = {
    errno.ENOSPC: "no space left on the disk of {folder}",
    errno.EDQUOT: "your share of the disk of {folder} is used up",
    errno.EFBIG: "a file may not become that large (ulimit -f)",
}
NO_ROOM = tuple(_REASONS)


def check_output(output: Path, inputs: Iterable[Path] = (), *, force: bool) -> None:
    """Raises OutputExists where ``output`` exists without ``force``, BadInput where it is an input.

    An input is never replaced by what is made of it, ``force`` or not.
    """
    if not output.exists():
        return
    for each in inputs:
        if each.exists() and output.samefile(each):
            raise BadInput(f"{output} is an input as well: choose another output")
    if not force:
        raise OutputExists(output)


def check_room(path: Path, more_bytes: int) -> None:
    """Raises BadInput where the file at ``path`` cannot grow by so much.

    The disk may be full, or the user's share of it, or a file may not become so large. The last
    two are found by taking the room and giving it back at once, on systems that can.
    """
    try:
        if shutil.disk_usage(path.parent).free < more_bytes:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if hasattr(os, "posix_fallocate"):
            with tempfile.TemporaryFile(dir=path.parent) as probe:
                size = path.stat().st_size if path.exists() else 0
                os.posix_fallocate(probe.fileno(), size, more_bytes)
    except OSError as error:
        if error.errno in NO_ROOM:
            reason = _REASONS[error.errno].format(folder=path.parent)
            raise BadInput(f"{path.parent / path.name.removesuffix('.part')}: {reason}") from None


@contextmanager
def written_beside(path: Path) -> Iterator[Path]:
    """A name beside ``path`` to write to; what stands there takes ``path``'s place at the end.

    Where anything is raised meanwhile, ``path`` stays as it was and nothing is left beside it.
    """
    part = path.with_name(path.name + ".part")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
