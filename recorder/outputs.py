"""May a file be written there? Asked before anything is opened, so that nothing is lost."""

from __future__ import annotations

from collections.abc import Iterable
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
