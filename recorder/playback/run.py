"""Plays a session to the outside: a device on a line, a tracker on a port, each thing at its time.

Recorded hardware then stands in for hardware: whoever records it gets the bytes that the device
sent, and poses whose stamps are shifted to now.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from recorder.clock import NS_PER_S, Clock
from recorder.errors import LinkError
from recorder.messages import Pose
from recorder.playback.link import FASTEST, ReplayedLink
from recorder.playback.outlets import Outlet
from recorder.playback.transmissions import Playback
from recorder.simulator.tracker_server import TrackerServer


@dataclass(frozen=True, slots=True)
class PlayedCounts:
    """What was sent; ``ended``: why it stopped before its end, empty when it did not."""

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
    """Send it all once somebody listens at each end that there is, then close them.

    ``speed`` is how many seconds of the session pass in one; at 0 each thing is sent as soon as the
    one before is taken, and poses are dated now. ``on_second`` gets, about once a second of the
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
    link = ReplayedLink(playback, clock=clock, speed=speed)
    meanwhile: Callable[[], object] = (lambda: None) if tracker is None else tracker.accept
    pieces = sent_bytes = poses = reported_s = 0
    for sent in playback.transmissions:
        if not link.wait_for(sent.log_ns, stop, meanwhile):
            return PlayedCounts(pieces, sent_bytes, poses, "stopped")
        if isinstance(sent.payload, Pose):
            if tracker is not None:
                t_ns = clock.now_ns() if speed == FASTEST else link.host_ns(sent.payload.t_ns)
                tracker.send(t_ns / NS_PER_S, sent.payload.world_from_base)
                poses += 1
        elif outlet is not None:
            try:
                outlet.send(sent.payload)
            except LinkError as error:
                return PlayedCounts(pieces, sent_bytes, poses, str(error))
            pieces, sent_bytes = pieces + 1, sent_bytes + len(sent.payload)
        passed_s = (sent.log_ns - playback.first_ns) // NS_PER_S
        if passed_s > reported_s:
            reported_s = passed_s
            on_second(float(passed_s))
    return PlayedCounts(pieces, sent_bytes, poses)
