"""Ctrl-C and its kin end a command in the same way at every moment: one line, and nothing left."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from recorder.startup import end_now, not_ignored

STOPPED = 130  # the exit code, as shells have it: 128 and the number of SIGINT


class Stopped(KeyboardInterrupt):
    """A signal asked the program to end; ``code`` is its exit code."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number


def code_of(error: BaseException) -> int | None:
    """The exit code where a signal is behind an error, whatever was made of it; else None."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return cause.code if isinstance(cause, Stopped) else STOPPED
        cause = cause.__cause__ or cause.__context__
    return None


@contextmanager
def heeded() -> Iterator[None]:
    """The first signal raises :class:`Stopped` within, the next one ends at once.

    Outside the main thread nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, _frame: object) -> None:
        for each in before:
            signal.signal(each, end_now)
        raise Stopped(number)

    def lost(unraisable: sys.UnraisableHookArgs) -> None:
        if isinstance(unraisable.exc_value, Stopped):  # raised where Python drops what is raised
            end_now(unraisable.exc_value.code - 128)
        hook(unraisable)

    hook, sys.unraisablehook = sys.unraisablehook, lost
    before = {number: signal.getsignal(number) for number in not_ignored()}
    try:
        for each in before:
            signal.signal(each, stop)
        yield
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)
