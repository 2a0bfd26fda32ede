"""Messages to a process that follows, over a bounded queue; the giver never waits.

A follower that lags, hangs or dies costs only what it would have shown: a message that finds the
queue full is counted and left to the session file, which has it anyway.
"""

from __future__ import annotations

import multiprocessing
import queue
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import TYPE_CHECKING, Self

from recorder.errors import EchogridError
from recorder.messages import Diagnostics, Message, RawLine

if TYPE_CHECKING:
    from multiprocessing.queues import Queue

CAPACITY = 4000  # messages; some 20 s of a busy robot
_LATE = 100  # messages that wait: from here on the follower should hurry
_LOOK_S = 0.5  # how often a follower looks whether the giver is still there

Work = Callable[[Iterator[Message], Callable[[], bool]], str]
"""What a follower does with the messages; the second argument is whether it is late. It returns
the report to print at the end. It must be importable by its name, as it goes to another process."""


@dataclass(frozen=True, slots=True)
class LiveEnd:
    """How following ended: its report, why it failed (if so), how many messages it did not get."""

    report: str
    failure: str
    not_followed: int


class LiveFeed:
    """A follower in a process of its own, alive between ``__enter__`` and ``__exit__``."""

    def __init__(self, work: Work, *, capacity: int = CAPACITY) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would copy threads half
        self.not_followed = 0
        self._queue: Queue[Message | None] = context.Queue(capacity)
        self._answer, theirs = context.Pipe(duplex=False)
        self._theirs: Connection = theirs
        self._process = context.Process(
            target=_follow, args=(work, self._queue, theirs), name="live map", daemon=True
        )

    def __enter__(self) -> Self:
        self._process.start()
        self._theirs.close()  # so that the pipe breaks when the follower dies
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._queue.cancel_join_thread()
        self._queue.close()
        if self.is_following:
            self._process.kill()
        self._process.join()
        self._answer.close()

    @property
    def process_id(self) -> int | None:
        """Of the follower."""
        return self._process.pid

    @property
    def is_following(self) -> bool:
        """Whether the follower is still there."""
        return self._process.is_alive()

    def offer(self, message: Message) -> None:
        """Hand over a message, or count it when there is no room; returns at once."""
        if isinstance(message, RawLine | Diagnostics):  # no use to a map
            return
        try:
            self._queue.put_nowait(message)
        except queue.Full:
            self.not_followed += 1

    def finish(self, patience_s: float) -> LiveEnd:
        """Nothing more comes: wait for the follower's end, but not for ever."""
        end_s = time.monotonic() + patience_s
        while self.is_following and time.monotonic() < end_s:
            try:
                self._queue.put(None, timeout=_LOOK_S)
                break
            except queue.Full:
                continue
        report, failure = "", "it did not come to an end in time"
        try:
            if self._answer.poll(max(end_s - time.monotonic(), 0.0)):
                report, failure = self._answer.recv()
        except EOFError:
            self._process.join(1.0)
            failure = f"its process ended (exit code {self._process.exitcode})"
        return LiveEnd(report, failure, self.not_followed)


def _follow(work: Work, incoming: Queue[Message | None], answer: Connection) -> None:
    """The follower's process. Ctrl-C is the giver's business: it ends what is given."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def is_late() -> bool:
        try:
            return incoming.qsize() > _LATE
        except NotImplementedError:  # macOS
            return False

    try:
        answer.send((work(_messages(incoming), is_late), ""))
    except EchogridError as error:
        answer.send(("", str(error)))


def _messages(incoming: Queue[Message | None]) -> Iterator[Message]:
    """What comes, until the giver marks the end, or is gone."""
    giver = multiprocessing.parent_process()
    while True:
        try:
            message = incoming.get(timeout=_LOOK_S)
        except queue.Empty:
            if giver is not None and not giver.is_alive():
                return
            continue
        if message is None:
            return
        yield message
