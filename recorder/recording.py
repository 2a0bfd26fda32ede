"""The recording loop: serial link and tracker, each in a thread → one queue → the session.

The queue is bounded. When the disk is slow the links wait, and the system's own buffers behind
them; nothing is dropped here. Whatever ends a recording, all that had arrived is written first.
"""

from __future__ import annotations

import logging
import threading
import typing
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from recorder.clock import NS_PER_S, Clock
from recorder.inbox import Inbox
from recorder.link import ByteSource, LinkEvent, LinkState, Received
from recorder.messages import Diagnostics, Message, Pose, Range, Transform
from recorder.odometry import WheelGeometry
from recorder.protocols import Protocol
from recorder.protocols.reports import HelloReport, Packet
from recorder.sensors import SensorParameters
from recorder.tracker import BadTrackerLine, Tracker, TrackerEvent
from recorder.translation import RecordingCounters, Translator, raw_line

DIAGNOSTICS_NAME = "recorder"

_STATUS_PERIOD_NS = NS_PER_S

_log = logging.getLogger(__name__)


class Session(typing.Protocol):
    """What a recording is written to. An OSError says that no more can be written."""

    def write(self, message: Message, *, log_ns: int) -> None:
        """Append a message that reached the host at ``log_ns``."""

    def sync(self) -> None:
        """See to it that what was written is on the disk."""


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """How a recording goes, once a second: for the screen."""

    t_ns: int
    elapsed_s: float
    link_up: bool
    counters: RecordingCounters
    latest: Mapping[str, Range]  # the last reading of each sensor
    rate_hz: Mapping[str, float]  # readings a second of each sensor, since the last status
    pose: Pose | None
    hello: HelloReport | None


def record(
    source: ByteSource,
    session: Session,
    *,
    protocol: Protocol,
    clock: Clock,
    stop: threading.Event,
    tracker: Tracker | None = None,
    duration_s: float | None = None,
    on_status: Callable[[RecordingStatus], None] | None = None,
    wheels: WheelGeometry | None = None,
    sensors: Mapping[str, SensorParameters] | None = None,
    mounts: Sequence[Transform] = (),
) -> RecordingCounters:
    """Write what ``source`` and ``tracker`` say to ``session`` until something ends it.

    It ends when ``stop`` is set, ``duration_s`` is over, the source ends, or the session cannot be
    written (``failure`` then says why; what was written stays). ``sensors`` adds to the built-in
    ones and goes before them. ``mounts`` are written first. ``on_status`` is called once a second
    in this thread; one that raises is not called again. The session is synced, not closed.

    Raises LinkError when a link cannot be opened at the beginning.
    """
    translator = Translator(sensors=sensors, wheels=wheels)
    loop = _Loop(session, protocol, translator, clock, on_status)
    loop.begin(mounts, duration_s)
    feeds: dict[str, Callable[[threading.Event], Iterable[_Event]]] = {"link": source.events}
    if tracker is not None:
        feeds["tracker"] = tracker.events
    with Inbox(feeds) as inbox:
        for name, event in inbox.events(stop):
            if event is None:
                loop.tick(clock.now_ns())
            elif isinstance(event, Exception):
                loop.end(f"the {name} failed")
                raise event
            else:
                loop.take(event, from_tracker=name == "tracker")
            if loop.ended:
                inbox.halt()
        return loop.end("stopped" if stop.is_set() else "the source ended")


_Event = Received | TrackerEvent


class _Loop:
    """One recording: writes, counts, and says once a second how it goes."""

    def __init__(
        self,
        session: Session,
        protocol: Protocol,
        translator: Translator,
        clock: Clock,
        on_status: Callable[[RecordingStatus], None] | None,
    ) -> None:
        self._session = session
        self._protocol = protocol
        self._translator = translator
        self._on_status = on_status
        self._now_ns = self._start_ns = self._told_ns = clock.now_ns()
        self._end_ns: int | None = None
        self._ended = ""
        self._failure = ""
        self._link_up = False
        self._latest: dict[str, Range] = {}
        self._readings: Counter[str] = Counter()
        self._pose: Pose | None = None

    @property
    def ended(self) -> bool:
        """Whether nothing more is taken."""
        return bool(self._ended)

    def begin(self, mounts: Sequence[Transform], duration_s: float | None) -> None:
        """Write where everything sits, at the time of the beginning."""
        if duration_s is not None:
            self._end_ns = self._start_ns + round(duration_s * NS_PER_S)
        self._write((self._start_ns, replace(mount, t_ns=self._start_ns)) for mount in mounts)

    def take(self, event: _Event, *, from_tracker: bool) -> None:
        """Write what an event says, unless the recording has ended before it."""
        self.tick(_time_of(event))
        if self._ended:
            return
        if isinstance(event, Received):
            self._packets(self._protocol.feed(event.data), event.arrival_ns)
        elif from_tracker or not isinstance(event, LinkEvent):
            self._write(self._translator.tracker_event(event))
        else:
            _log.info("link %s: %s", event.state.value, event.reason)
            self._link_up = event.state is not LinkState.LOST
            self._packets(self._protocol.close(), event.t_ns)
            self._translator.link_event(event)

    def tick(self, now_ns: int) -> None:
        """Time goes on to ``now_ns``; an earlier time than the latest moves nothing."""
        self._now_ns = max(self._now_ns, now_ns)
        if self._end_ns is not None and self._now_ns >= self._end_ns:
            self._now_ns = self._end_ns
            self._ended = self._ended or "the time is over"
        if not self._ended and self._now_ns >= self._told_ns + _STATUS_PERIOD_NS:
            self._tell()

    def end(self, reason: str) -> RecordingCounters:
        """Write what waits and the last counters, and sync; ``reason`` unless there was another."""
        for packet in self._protocol.close():  # our own cut, which nobody needs to count
            self._write([(self._now_ns, raw_line(packet, self._now_ns))])
        self._ended = self._ended or reason
        self._tell()
        if not self._failure:
            try:
                self._session.sync()
            except OSError as error:
                self._fail(error)
        return self._counters()

    def _packets(self, packets: Sequence[Packet], arrival_ns: int) -> None:
        for packet in packets:
            self._write(self._translator.packet(packet, arrival_ns))

    def _write(self, messages: Iterable[tuple[int, Message]]) -> None:
        """The first error of the disk is the last: what is on it stays readable."""
        for log_ns, message in messages:
            if self._failure:
                return
            try:
                self._session.write(message, log_ns=log_ns)
            except OSError as error:
                self._fail(error)
                return
            self._translator.tally["written"] += 1
            if isinstance(message, Range):
                self._latest[message.sensor] = message
                self._readings[message.sensor] += 1
            elif isinstance(message, Pose):
                self._pose = message

    def _fail(self, error: OSError) -> None:
        self._failure = " ".join(str(error.strerror or error).split()) or type(error).__name__
        self._ended = "the session cannot be written"
        _log.error("%s: %s", self._ended, self._failure)

    def _counters(self) -> RecordingCounters:
        return RecordingCounters(**self._translator.tally, ended=self._ended, failure=self._failure)

    def _tell(self) -> None:
        """The counters, into the session and onto the screen."""
        hello = self._translator.hello
        words = {"robot": hello.robot, "firmware": hello.firmware} if hello is not None else {}
        counters: dict[str, int | float | str] = {**self._counters().numbers(), **words}
        self._write([(self._now_ns, Diagnostics(self._now_ns, DIAGNOSTICS_NAME, counters))])
        since_s = (self._now_ns - self._told_ns) / NS_PER_S
        self._told_ns = self._now_ns
        rate_hz = {name: n / since_s for name, n in self._readings.items() if since_s > 0.0}
        self._readings = Counter(dict.fromkeys(self._latest, 0))
        if self._on_status is None:
            return
        status = RecordingStatus(
            self._now_ns, (self._now_ns - self._start_ns) / NS_PER_S, self._link_up,
            self._counters(), dict(self._latest), rate_hz, self._pose, hello,
        )  # fmt: skip
        try:
            self._on_status(status)
        except Exception:  # a screen that fails must not cost the recording
            _log.exception("the status cannot be shown any more")
            self._on_status = None


def _time_of(event: _Event) -> int:
    """When an event reached the host."""
    match event:
        case LinkEvent():
            return event.t_ns
        case BadTrackerLine():
            return 0  # it moves no clock
        case _:
            return event.arrival_ns
