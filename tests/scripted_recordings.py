"""Recordings without hardware: a session in memory, and a device that plays a script."""

from __future__ import annotations

import errno
import threading
from typing import Any

from fake_links import ManualClock, ScriptedSource

from recorder.clock import NS_PER_MS, NS_PER_S
from recorder.link import LinkEvent, LinkState, Received
from recorder.messages import Message
from recorder.protocols.echogrid import EchogridProtocol, encode
from recorder.protocols.reports import RangeReport
from recorder.recording import record
from recorder.translation import RecordingCounters

START_NS = 1_700_000_000 * NS_PER_S


class ListSession:
    """A session in memory, on a disk with room for so many messages."""

    def __init__(self, room: int = 10**9) -> None:
        self.written: list[tuple[int, Message]] = []
        self.synced = 0
        self.changed = threading.Condition()
        self._room = room

    def write(self, message: Message, *, log_ns: int) -> None:
        if len(self.written) >= self._room:
            raise OSError(errno.ENOSPC, "No space left on device")
        with self.changed:
            self.written.append((log_ns, message))
            self.changed.notify_all()

    def sync(self) -> None:
        self.synced += 1

    def of(self, kind: type[Any]) -> list[Any]:
        return [message for _, message in self.written if isinstance(message, kind)]

    def wait_for(self, kind: type[Any], count: int) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.of(kind)) >= count, timeout=20)


def ping_line(seq: int, ms: int, range_m: float = 1.0) -> bytes:
    return encode(RangeReport("ping", range_m), seq % 2**16, ms)


def steady_run(seconds: float, rate_hz: int = 20) -> list[Received | LinkEvent]:
    """A device that sends a reading ``rate_hz`` times a second and arrives 4 ms later."""
    events: list[Received | LinkEvent] = [LinkEvent(LinkState.OPENED, START_NS, "")]
    for seq in range(int(seconds * rate_hz)):
        ms = seq * 1000 // rate_hz
        events.append(Received(ping_line(seq, ms, seq / 1000), START_NS + (ms + 4) * NS_PER_MS))
    return events


def play(
    events: list[Received | LinkEvent], session: ListSession, **options: Any
) -> RecordingCounters:
    clock = ManualClock(START_NS)
    options.setdefault("stop", threading.Event())
    return record(
        ScriptedSource(clock, events),
        session,
        protocol=EchogridProtocol(),
        clock=clock,
        **options,
    )
