"""May a file be written there, and how: so that nothing is lost and no half file bears the name."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from recorder.errors import BadInput, OutputExists


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
