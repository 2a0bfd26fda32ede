"""What is being compiled: a first run on a machine waits for it, and should say why."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.event import Event, Listener, install_listener


class _Names(Listener):  # type: ignore[misc]
    """Calls with the name of each loop that is compiled, but for those that another one needs."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report, self._depth = report, 0

    def on_start(self, event: Event) -> None:
        """A loop that was found in no cache."""
        found: Any = event.data
        if self._depth == 0:
            self._report(found["dispatcher"].py_func.__name__)
        self._depth += 1

    def on_end(self, event: Event) -> None:
        """It is compiled."""
        self._depth -= 1


@contextmanager
def compiling_reported(report: Callable[[str], None]) -> Iterator[None]:
    """Call with the name of each loop that has to be compiled first, as long as the context."""
    with install_listener("numba:compile", _Names(report)):
        yield
