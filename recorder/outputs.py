"""May a file be written there, and how: so that nothing is lost and no half file bears the name."""

from __future__ import annotations

import errno
import math
import os
import shutil
import sys
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
_PROBE_BYTES = 4096


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

    The disk may be full, or a file may not become so large, or the user's share of the disk is
    used up already. A share that is nearly used up is not noticed. Where the system does not
    know, there is room.
    """
    lacking = _what_lacks(path, more_bytes)
    if lacking is not None:
        reason = _REASONS[lacking].format(folder=path.parent)
        raise BadInput(f"{path.parent / path.name.removesuffix('.part')}: {reason}")


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
    """A name beside ``path`` to write to; what stands there takes ``path``'s place at the end.

    Where anything is raised meanwhile, ``path`` stays as it was and nothing is left beside it.
    """
    part = path.with_name(path.name + ".part")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
