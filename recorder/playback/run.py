"""Plays a session to the outside: a device on a line, a tracker on a port, each thing at its time.

Recorded hardware then stands in for hardware: whoever records it hears the bytes that the device
sent, and poses whose stamps are shifted to now.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from recorder.clock import NS_PER_S, Clock
from recorder.errors import LinkError
from recorder.messages import Pose
from recorder.playback.outlets import Outlet
from recorder.playback.transmissions import FASTEST, Playback, Timetable
from recorder.simulator.tracker_server import TrackerServer


@dataclass(frozen=True, slots=True)
class PlayedCounts:
    """What was said; ``ended`` tells why it stopped before its end, empty when it did not."""

    pieces: int
    sent_bytes: int
    poses: int
    ended: str = ""


def play(
    playback: Playback,
    outlet: Outlet | None,
    tracker: TrackerServer | None,
    *,
    speed: float,
    clock: Clock,
    stop: threading.Event,
    on_second: Callable[[float], None] = lambda _: None,
) -> PlayedCounts:
    """Say it all once somebody listens at each end that there is, then close them.

    ``speed`` is how many seconds of the session pass in one; at 0 each thing is said as soon as the
    one before is taken, and poses are dated now. ``on_second`` hears, about once a second of the
    session, how many have passed.
    """
    try:
        if not _listened_to(outlet, tracker, stop):
            return PlayedCounts(0, 0, 0, "stopped")
        return _played(playback, outlet, tracker, speed, clock, stop, on_second)
    finally:
        if outlet is not None:
            outlet.close()
        if tracker is not None:
            tracker.close()


def _listened_to(
    outlet: Outlet | None, tracker: TrackerServer | None, stop: threading.Event
) -> bool:
    if outlet is not None and not outlet.ready(stop):
        return False
    while tracker is not None and tracker.clients == 0:
        if stop.wait(0.02):
            return False
        tracker.accept()
    return True


def _played(
    playback: Playback, outlet: Outlet | None, tracker: TrackerServer | None, speed: float,
    clock: Clock, stop: threading.Event, on_second: Callable[[float], None],
) -> PlayedCounts:  # fmt: skip
    timetable = Timetable(playback.first_ns, speed, clock, clock.now_ns())
    meanwhile: Callable[[], object] = (lambda: None) if tracker is None else tracker.accept
    pieces = sent_bytes = poses = told_s = 0
    for said in playback.said:
        if not timetable.wait_for(said.log_ns, stop, meanwhile):
            return PlayedCounts(pieces, sent_bytes, poses, "stopped")
        if isinstance(said.what, Pose):
            if tracker is not None:
                t_ns = clock.now_ns() if speed == FASTEST else timetable.now(said.what.t_ns)
                tracker.send(t_ns / NS_PER_S, said.what.world_from_base)
                poses += 1
        elif outlet is not None:
            try:
                outlet.send(said.what)
            except LinkError as error:
                return PlayedCounts(pieces, sent_bytes, poses, str(error))
            pieces, sent_bytes = pieces + 1, sent_bytes + len(said.what)
        passed_s = (said.log_ns - playback.first_ns) // NS_PER_S
        if passed_s > told_s:
            told_s = passed_s
            on_second(float(passed_s))
    return PlayedCounts(pieces, sent_bytes, poses)
