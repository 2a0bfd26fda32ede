"""The recording loop: serial link and tracker, each in a thread → one queue → the session.

The queue is bounded. When the disk is slow the links wait, and the system's own buffers behind
them; nothing is dropped here. Whatever ends a recording, all that had arrived is written first.
"""

from __future__ import annotations

import logging
import threading
import typing
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from recorder.clock import NS_PER_S, Clock
from recorder.link import ByteSource, LinkEvent, LinkState, Received
from recorder.messages import Diagnostics, Message, Pose, Range, RawLine, Transform
from recorder.odometry import WheelGeometry
from recorder.protocols import Protocol
from recorder.protocols.reports import Fault, Packet
from recorder.recording.inbox import Inbox
from recorder.recording.status import Cadence, RecordingStatus
from recorder.sensors import SensorParameters
from recorder.tracker import BadTrackerLine, PoseSource, TrackerEvent
from recorder.translation import RecordingCounters, Translator, raw_line

DIAGNOSTICS_NAME = "recorder"

_STATUS_PERIOD_NS = NS_PER_S
_BAD_LINES_KEPT = 12_000  # a second: more than 115200 baud can bring

_log = logging.getLogger(__name__)


class SessionSink(typing.Protocol):
    """What a recording is written to. After an OSError no more can be written."""

    def write(self, message: Message, *, log_ns: int) -> None:
        """Append a message that reached the host at ``log_ns``."""

    def sync(self) -> None:
        """See to it that what was written is on the disk."""


def record(
    source: ByteSource,
    session: SessionSink,
    *,
    protocol: Protocol,
    clock: Clock,
    stop: threading.Event,
    tracker: PoseSource | None = None,
    duration_s: float | None = None,
    on_status: Callable[[RecordingStatus], None] | None = None,
    status_period_s: float = 1.0,
    wheels: WheelGeometry | None = None,
    sensors: Mapping[str, SensorParameters] | None = None,
    mounts: Sequence[Transform] = (),
    send: Callable[[bytes], object] | None = None,
    pause: threading.Event | None = None,
) -> RecordingCounters:
    """Write what ``source`` and ``tracker`` send to ``session`` until something ends it.

    It ends when ``stop`` is set, ``duration_s`` is over, the source ends, or the session cannot be
    written (``failure`` is the reason; what was written stays). ``sensors`` adds to the built-in
    ones and goes before them. ``mounts`` are written first. ``on_status`` is called each
    ``status_period_s`` in this thread; one that raises is not called again. What the protocol has
    for the device goes to ``send``. While ``pause`` is set all is read and counted, but only
    the diagnostics are written. The session is synced, not closed.

    Raises LinkError when a link cannot be opened at the beginning.
    """
    translator = Translator(sensors=sensors, wheels=wheels)
    screen = None if on_status is None else _Screen(on_status, status_period_s)
    loop = _Loop(session, protocol, translator, clock.now_ns(), screen, send, pause)
    loop.begin(mounts, duration_s)
    feeds: dict[str, Callable[[threading.Event], Iterable[_Event]]] = {"link": source.events}
    if tracker is not None:
        feeds["tracker"] = tracker.events
    with Inbox(feeds, _bytes_in) as inbox:
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


class _Screen:
    """Shows how it goes, each ``period_s``; one that fails must not cost the recording."""

    def __init__(self, on_status: Callable[[RecordingStatus], None], period_s: float) -> None:
        self._on_status: Callable[[RecordingStatus], None] | None = on_status
        self._period_ns = round(period_s * NS_PER_S)
        self._shown_ns: int | None = None

    def due(self, now_ns: int) -> bool:
        """Whether it is time again."""
        if self._shown_ns is None:
            self._shown_ns = now_ns
        return self._on_status is not None and now_ns >= self._shown_ns + self._period_ns

    def show(self, status: RecordingStatus) -> None:
        """Show it now."""
        self._shown_ns = status.t_ns
        if self._on_status is None:
            return
        try:
            self._on_status(status)
        except Exception:
            _log.exception("the status cannot be shown any more")
            self._on_status = None


@dataclass(slots=True)
class _Loop:
    """One recording: writes, counts, and reports once a second how it goes."""

    _session: SessionSink
    _protocol: Protocol
    _translator: Translator
    _now_ns: int
    _screen: _Screen | None
    _send: Callable[[bytes], object] | None
    _pause: threading.Event | None
    _start_ns: int = 0
    _reported_ns: int = 0
    _end_ns: int | None = None
    _paused: bool = False
    _protocol_failed: bool = False
    _ended: str = ""
    _failure: str = ""
    _link_up: bool = False
    _latest: dict[str, Range] = field(default_factory=dict)
    _readings: Counter[str] = field(default_factory=Counter)
    _rate_hz: dict[str, float] = field(default_factory=dict)
    _cadences: defaultdict[str, Cadence] = field(default_factory=lambda: defaultdict(Cadence))
    _pose: Pose | None = None
    _bad_kept: int = 0  # in the second below
    _bad_second: int = 0

    def __post_init__(self) -> None:
        self._start_ns = self._reported_ns = self._now_ns

    @property
    def ended(self) -> bool:
        """Whether nothing more is taken."""
        return bool(self._ended)

    def begin(self, mounts: Sequence[Transform], duration_s: float | None) -> None:
        """Write where everything sits, at the time of the beginning."""
        if duration_s is not None:
            self._end_ns = self._start_ns + round(duration_s * NS_PER_S)
        if self._screen is not None:
            self._screen.due(self._start_ns)
        self._write((self._start_ns, replace(mount, t_ns=self._start_ns)) for mount in mounts)

    def take(self, event: _Event, *, from_tracker: bool) -> None:
        """Write what an event brings, unless the recording has ended before it."""
        self.tick(_time_of(event))
        if self._ended:
            return
        if isinstance(event, Received):
            self._packets(self._understood(event.data), event.arrival_ns)
        elif from_tracker or not isinstance(event, LinkEvent):
            self._write(self._translator.tracker_event(event))
        else:
            _log.info("link %s: %s", event.state.value, event.reason)
            self._link_up = event.state is not LinkState.LOST
            self._packets(self._protocol.close(), event.t_ns)
            self._translator.link_event(event)
            self._greet()

    def tick(self, now_ns: int) -> None:
        """Time goes on to ``now_ns``; an earlier time than the latest moves nothing."""
        self._now_ns = max(self._now_ns, now_ns)
        if self._end_ns is not None and self._now_ns >= self._end_ns:
            self._now_ns = self._end_ns
            self._ended = self._ended or "the time is over"
        if self._ended:
            return
        self._heed_pause()
        if self._now_ns >= self._reported_ns + _STATUS_PERIOD_NS:
            self._report()
            self._greet()
        if self._screen is not None and self._screen.due(self._now_ns):
            self._screen.show(self._status())

    def end(self, reason: str) -> RecordingCounters:
        """Write what waits and the last counters, and sync; ``reason`` unless there was another."""
        for packet in self._protocol.close():  # our own cut, which nobody needs to count
            self._write([(self._now_ns, raw_line(packet, self._now_ns))])
        self._ended = self._ended or reason
        self._report()
        if self._screen is not None:
            self._screen.show(self._status())
        if not self._failure:
            try:
                self._session.sync()
            except OSError as error:
                self._fail(error)
        return self._counters()

    def _understood(self, data: bytes) -> Sequence[Packet]:
        """The packets in ``data``; a protocol of one's own that fails must not cost the bytes."""
        try:
            return self._protocol.feed(data)
        except Exception:
            if not self._protocol_failed:
                _log.exception("the protocol %s failed", self._protocol.name)
            self._protocol_failed = True
            return [Packet(data, fault=Fault.MALFORMED)]

    def _packets(self, packets: Sequence[Packet], arrival_ns: int) -> None:
        self._translator.look_ahead(packets, arrival_ns)
        for packet in packets:
            nothing_in_it = packet.fault is not None and packet.seq is None
            if nothing_in_it and not self._keeps_bad(arrival_ns):
                self._translator.count_bad(packet)
                continue
            self._write(self._translator.packet(packet, arrival_ns))
            self._send_bytes(packet.reply)

    def _keeps_bad(self, arrival_ns: int) -> bool:
        """Whether one more bad line of this second is kept: a flood is counted and dropped."""
        second = arrival_ns // NS_PER_S
        if second != self._bad_second:
            self._bad_second, self._bad_kept = second, 0
        self._bad_kept += 1
        return self._bad_kept <= _BAD_LINES_KEPT

    def _greet(self) -> None:
        if self._link_up and self._send is not None:
            self._send_bytes(self._protocol.greeting())

    def _send_bytes(self, data: bytes) -> None:
        if data and self._send is not None:
            self._send(data)

    def _heed_pause(self) -> None:
        """Pause or go on as was asked; the session has a note of when."""
        paused = self._pause is not None and self._pause.is_set()
        if paused != self._paused:
            self._paused = paused
            self._translator.tally["pauses"] += paused
            self._diagnose()

    def _write(self, messages: Iterable[tuple[int, Message]]) -> None:
        """The first error of the disk is the last: what is on it stays readable."""
        for log_ns, message in messages:
            if self._failure:
                return
            self._look_at(message)
            if self._paused and not isinstance(message, Diagnostics):
                self._translator.tally["paused_messages"] += not isinstance(message, RawLine)
                continue
            try:
                self._session.write(message, log_ns=log_ns)
            except OSError as error:
                self._fail(error)
                return
            self._translator.tally["written"] += 1

    def _look_at(self, message: Message) -> None:
        """Keep what the screen shows."""
        if isinstance(message, Range):
            self._latest[message.sensor] = message
            self._readings[message.sensor] += 1
            self._cadences[message.sensor].reading(message.t_ns)
        elif isinstance(message, Pose):
            self._pose = message

    def _fail(self, error: OSError) -> None:
        self._failure = " ".join(str(error.strerror or error).split()) or type(error).__name__
        self._ended = "the session cannot be written"
        _log.error("%s: %s", self._ended, self._failure)

    def _counters(self) -> RecordingCounters:
        return RecordingCounters(
            **self._translator.tally, ended=self._ended, failure=self._failure,
            refused=self._translator.refused,
        )  # fmt: skip

    def _report(self) -> None:
        """Once a second: the counters into the session, and the rates of that second."""
        self._diagnose()
        since_s = (self._now_ns - self._reported_ns) / NS_PER_S
        self._reported_ns = self._now_ns
        if since_s > 0.0:
            self._rate_hz = {name: n / since_s for name, n in self._readings.items()}
        self._readings = Counter(dict.fromkeys(self._latest, 0))

    def _diagnose(self) -> None:
        """Write the counters."""
        hello = self._translator.hello
        counters: dict[str, int | float | str] = {**self._counters().numbers()}
        if hello is not None:
            counters |= {"robot": hello.robot, "firmware": hello.firmware}
        counters["state"] = "paused" if self._paused else "recording"
        self._write([(self._now_ns, Diagnostics(self._now_ns, DIAGNOSTICS_NAME, counters))])

    def _status(self) -> RecordingStatus:
        return RecordingStatus(
            self._now_ns, (self._now_ns - self._start_ns) / NS_PER_S, self._link_up,
            self._counters(), dict(self._latest), self._rate_hz, self._pose,
            {name: cadence.missing for name, cadence in self._cadences.items()}, self._paused,
        )  # fmt: skip


def _bytes_in(event: _Event) -> int:
    """How much of the queue's room an event takes."""
    return len(event.data) if isinstance(event, Received) else 0


def _time_of(event: _Event) -> int:
    """When an event reached the host."""
    match event:
        case LinkEvent():
            return event.t_ns
        case BadTrackerLine():
            return 0  # it moves no clock
        case _:
            return event.arrival_ns
