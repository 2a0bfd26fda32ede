"""A recorded session as a source: its device and its tracker, each thing at its time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeVar

from recorder.clock import NS_PER_S, Clock
from recorder.errors import BadInput
from recorder.link import LinkEvent, LinkState, Received
from recorder.messages import Pose
from recorder.playback.transmissions import Playback
from recorder.tracker import TrackedPose

FASTEST = 0.0  # as a speed: nothing is waited for
MOST_SPEED = 1000.0
_LONGEST_WAIT_S = 0.05  # how soon `stop` is heeded

Payload = TypeVar("Payload", bytes, Pose)


def check_speed(speed: float) -> float:
    """A speed that makes sense; BadInput otherwise."""
    if not (speed == FASTEST or 0.01 <= speed <= MOST_SPEED):
        raise BadInput(f"the speed must be 0 or between 0.01 and {MOST_SPEED:g}, not {speed:g}")
    return speed


class ReplayedLink:
    """The device of a session as a source of bytes, as :class:`recorder.link.Link` is one.

    It lays the session's times onto the host's clock: the session begins now, and ``speed`` seconds
    of it pass in one. At speed 0 nothing is waited for and times keep their distances, so that what
    arrives at once is dated as it was. It ends when the session does, poses included.

    ``tracker`` brings the poses, None where the session has none. Where there is one, both must be
    read, each in a thread, for they send in turns.
    """

    def __init__(self, playback: Playback, *, clock: Clock, speed: float = 1.0) -> None:
        self.speed = check_speed(speed)
        self.playback = playback
        self._clock = clock
        self._start_ns = clock.now_ns()
        self._next_turn = 0
        self._turn_over = threading.Condition()
        has_poses = any(isinstance(sent.payload, Pose) for sent in playback.transmissions)
        self.tracker = ReplayedTracker(self) if has_poses else None

    def host_ns(self, t_ns: int) -> int:
        """A time of the session on the host's clock."""
        return self._start_ns + round((t_ns - self.playback.first_ns) / (self.speed or 1.0))

    def wait_for(
        self, t_ns: int, stop: threading.Event, meanwhile: Callable[[], object] = lambda: None
    ) -> bool:
        """Wait until a time of the session has come; False when ``stop`` came first."""
        while not stop.is_set():
            meanwhile()
            wait_s = (self.host_ns(t_ns) - self._clock.now_ns()) / NS_PER_S
            if self.speed == FASTEST or wait_s <= 0.0:
                return True
            stop.wait(min(wait_s, _LONGEST_WAIT_S))
        return False

    def in_turn(self, kind: type[Payload], stop: threading.Event) -> Iterator[tuple[Payload, int]]:
        """What is sent of one kind, and its arrival (host clock), in the order of the session."""
        for turn, sent in enumerate(self.playback.transmissions):
            if isinstance(sent.payload, kind):
                if not (self._wait_for_turn(turn, stop) and self.wait_for(sent.log_ns, stop)):
                    return
                yield sent.payload, self.host_ns(sent.log_ns)
                with self._turn_over:
                    self._next_turn += 1
                    self._turn_over.notify_all()

    def _wait_for_turn(self, turn: int, stop: threading.Event) -> bool:
        """Wait until all before has been sent; False when ``stop`` came first."""
        with self._turn_over:
            while self._next_turn < turn and not stop.is_set():
                self._turn_over.wait(_LONGEST_WAIT_S)
            return self._next_turn >= turn

    def open(self) -> None:
        """It always is."""

    def close(self) -> None:
        """Nothing to let go of."""

    def write(self, data: bytes) -> bool:
        """Nobody receives: the device has sent all that it will."""
        return False

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        """The bytes at their times, until all is sent or ``stop`` is set."""
        yield LinkEvent(LinkState.OPENED, self.host_ns(self.playback.first_ns), "replay")
        for data, arrival_ns in self.in_turn(bytes, stop):
            yield Received(data, arrival_ns)
        self._wait_for_turn(len(self.playback.transmissions), stop)


class ReplayedTracker:
    """The tracker of a session, as :class:`recorder.tracker.Tracker`; stamps shifted to now."""

    def __init__(self, link: ReplayedLink) -> None:
        self._link = link

    def events(self, stop: threading.Event) -> Iterator[TrackedPose]:
        """The poses at their times, until all are sent or ``stop`` is set."""
        for pose, arrival_ns in self._link.in_turn(Pose, stop):
            shifted = replace(pose, t_ns=self._link.host_ns(pose.t_ns))
            yield TrackedPose(shifted, arrival_ns, dated_by_arrival=False)
