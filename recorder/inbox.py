"""Several sources, each read in a thread of its own, as one stream through a bounded queue."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Generic, Self, TypeVar

T = TypeVar("T")

_QUEUE_LENGTH = 4096
_POLL_S = 0.1  # how soon a stop is noticed when all is quiet
_DRAIN_S = 5.0  # how long the sources may take to end

_log = logging.getLogger(__name__)


class Inbox(Generic[T]):
    """Reads its sources from ``__enter__`` to ``__exit__``; when the first one ends, all do."""

    def __init__(self, feeds: Mapping[str, Callable[[threading.Event], Iterable[T]]]) -> None:
        self._queue: queue.Queue[tuple[str, T | Exception | None]] = queue.Queue(_QUEUE_LENGTH)
        self._halt = threading.Event()  # the sources shall end
        self._left = threading.Event()  # nobody takes from the queue any more
        self._alive = set(feeds)
        self._leader = next(iter(feeds))
        self._threads = [
            threading.Thread(target=self._pump, args=feed, name=feed[0], daemon=True)
            for feed in feeds.items()
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._halt.set()
        self._left.set()

    def halt(self) -> None:
        """Tell the sources to end; what they still bring comes out of ``events``."""
        self._halt.set()

    def events(self, stop: threading.Event) -> Iterator[tuple[str, T | Exception | None]]:
        """What the sources bring, or their exceptions, with their names; None when all is quiet.

        It ends when all sources have, at the latest 5 s after ``stop`` was set or ``halt`` called.
        """
        give_up_s = None
        while self._alive:
            if stop.is_set() or self._leader not in self._alive:
                self._halt.set()
            if self._halt.is_set():
                give_up_s = give_up_s or time.monotonic() + _DRAIN_S
                if time.monotonic() > give_up_s:
                    _log.warning("still waiting for %s: left alone", ", ".join(sorted(self._alive)))
                    return
            try:
                name, event = self._queue.get(timeout=_POLL_S)
            except queue.Empty:
                yield "", None
                continue
            if event is None:
                self._alive.discard(name)
            else:
                yield name, event

    def _pump(self, name: str, events: Callable[[threading.Event], Iterable[T]]) -> None:
        """The thread of one source."""
        try:
            for event in events(self._halt):
                self._put(name, event)
        except Exception as error:  # whatever it is, the recording must be closed properly
            self._put(name, error)
        self._put(name, None)

    def _put(self, name: str, event: T | Exception | None) -> None:
        while not self._left.is_set():
            try:
                self._queue.put((name, event), timeout=_POLL_S)
                return
            except queue.Full:
                continue
