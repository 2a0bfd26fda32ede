"""What is being compiled: a first run on a machine waits for it, and should say why."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

_reports: list[Callable[[str], None]] = []


@contextmanager
def compiling_reported(report: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each loop that has to be compiled first, as long as the context.

    Of several such contexts the innermost is called.
    """
    _reports.append(report)
    try:
        yield
    finally:
        _reports.remove(report)


def compiling(name: str) -> None:
    """A loop is about to be compiled: whoever wants to know is called."""
    if _reports:
        _reports[-1](name)
