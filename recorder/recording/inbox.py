"""Several sources, each read in a thread of its own, as one stream through a bounded queue."""

from __future__ import annotations

import gc
import logging
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Generic, Self, TypeVar

T = TypeVar("T")

_QUEUE_LENGTH = 4096
_MOST_WAITING = 1 << 17  # bytes: a flood waits in the system's buffers, and ends when it shall
_POLL_S = 0.1  # how soon a stop is noticed when all is quiet
_DRAIN_S = 5.0  # how long the sources may be silent before they end
_LONGEST_DRAIN_S = 120.0  # how long they may go on after they were asked to end
# How long a thread that waits for Python's lock waits at most. A serial line's buffer holds some
# milliseconds of a fast line, and reading it takes the lock several times.
_SWITCH_S = 0.0005

_log = logging.getLogger(__name__)


class _Brisk:
    """While anybody holds it, threads wait less for each other; then all is as it was before.

    What was imported is not looked through again for garbage: all threads would stand still for
    50 ms, and longer on a busy machine, and a fast line fills its buffer meanwhile.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._holders = 0
        self._switch_s = 0.0
        self._frozen = False

    def acquire(self) -> None:
        """One more holds it; to be released again."""
        with self._lock:
            self._holders += 1
            if self._holders == 1:
                self._switch_s = sys.getswitchinterval()
                sys.setswitchinterval(min(self._switch_s, _SWITCH_S))
                self._frozen = gc.get_freeze_count() == 0  # else somebody else did, and undoes it
                if self._frozen:
                    gc.freeze()

    def release(self) -> None:
        """One less holds it."""
        with self._lock:
            self._holders -= 1
            if self._holders == 0:
                sys.setswitchinterval(self._switch_s)
                if self._frozen:
                    gc.unfreeze()


_BRISK = _Brisk()


class Inbox(Generic[T]):
    """Reads its sources from ``__enter__`` to ``__exit__``; when the first one ends, all do."""

    def __init__(
        self,
        feeds: Mapping[str, Callable[[threading.Event], Iterable[T]]],
        bytes_in: Callable[[T], int] = lambda _: 0,
    ) -> None:
        self._bytes_in = bytes_in
        self._waiting_bytes = 0
        self._room = threading.Condition()
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
        _BRISK.acquire()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        _BRISK.release()
        self._halt.set()
        self._left.set()

    def halt(self) -> None:
        """Ask the sources to end; what they still bring comes out of ``events``."""
        self._halt.set()

    def events(self, stop: threading.Event) -> Iterator[tuple[str, T | Exception | None]]:
        """What the sources bring, or their exceptions, with their names; None when all is quiet.

        It ends when all sources have. When ``stop`` was set or ``halt`` called, what had come by
        then is still brought, however long the taker takes; a source that neither ends nor brings
        anything for 5 s is left alone.
        """
        halted_s = received_s = 0.0
        while self._alive:
            if stop.is_set() or self._leader not in self._alive:
                self._halt.set()
            if self._halt.is_set() and not halted_s:
                halted_s = received_s = time.monotonic()
            try:
                name, event = self._queue.get(timeout=_POLL_S)
            except queue.Empty:
                if halted_s and time.monotonic() > received_s + _DRAIN_S:
                    return self._leave_alone()
                yield "", None
                continue
            if event is not None and not isinstance(event, Exception):
                with self._room:
                    self._waiting_bytes -= self._bytes_in(event)
                    self._room.notify_all()
            received_s = time.monotonic()
            if halted_s and received_s > halted_s + _LONGEST_DRAIN_S:
                return self._leave_alone()
            if event is None:
                self._alive.discard(name)
            else:
                yield name, event

    def _leave_alone(self) -> None:
        _log.warning("still waiting for %s: left alone", ", ".join(sorted(self._alive)))

    def _pump(self, name: str, events: Callable[[threading.Event], Iterable[T]]) -> None:
        """The thread of one source."""
        try:
            for event in events(self._halt):
                self._wait_for_room(self._bytes_in(event))
                self._put(name, event)
        except Exception as error:  # whatever it is, the recording must be closed properly
            self._put(name, error)
        self._put(name, None)

    def _wait_for_room(self, more_bytes: int) -> None:
        with self._room:
            while self._waiting_bytes > _MOST_WAITING and not self._left.is_set():
                self._room.wait(_POLL_S)
            self._waiting_bytes += more_bytes

    def _put(self, name: str, event: T | Exception | None) -> None:
        while not self._left.is_set():
            try:
                self._queue.put((name, event), timeout=_POLL_S)
                return
            except queue.Full:
                continue
