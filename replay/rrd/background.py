"""Work that the mapping need not wait for, done by one other thread, in the order it comes.

The compiled loops and the packing that a recording takes let other threads run meanwhile.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ParamSpec, TypeVar

_MOST_WAITING = 64  # pieces of work: some ten readings, so that little memory is held for them

P = ParamSpec("P")
T = TypeVar("T")


class Background:
    """One thread that is never more than a few pieces of work behind."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "recording")
        self._waiting: deque[Future[Any]] = deque()

    def do(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have something done after all that was given before.

        Raises what an earlier piece of work raised.
        """
        while self._waiting and (len(self._waiting) >= _MOST_WAITING or self._waiting[0].done()):
            self._waiting.popleft().result()
        future = self._pool.submit(work, *args, **kwargs)
        self._waiting.append(future)
        return future

    def wait(self) -> None:
        """Until all is done. Raises what a piece of work raised."""
        while self._waiting:
            self._waiting.popleft().result()


def done(result: T) -> Future[T]:
    """What is there already, as if it had been waited for."""
    future: Future[T] = Future()
    future.set_result(result)
    return future
