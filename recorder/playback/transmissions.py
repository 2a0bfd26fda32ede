"""A session said again: what a device and a tracker sent, as bytes and poses with their times.

Raw lines are sent as they came, byte by byte. A session without any (simulated, imported) is said
in the ``echogrid`` protocol: ranges in whole millimetres, angles in hundredths of a degree. What a
serial line has no word for (scans, odometry without wheel counts) is left out and counted.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from recorder.clock import NS_PER_MS, NS_PER_S, Clock
from recorder.errors import BadInput
from recorder.link import LinkEvent, LinkState, Received
from recorder.messages import (
    BASE_FRAME,
    Diagnostics,
    Message,
    Pose,
    Range,
    RawLine,
    Record,
    Transform,
)
from recorder.protocols.echogrid import DEVICE_MS_RANGE, PROTOCOL_VERSION, SEQ_RANGE, encode
from recorder.protocols.reports import (
    HeadReport,
    HelloReport,
    PoseReport,
    RangeReport,
    Report,
)
from recorder.tracker import TrackedPose

HELLO = HelloReport(PROTOCOL_VERSION, "replayed", "echogrid")
FASTEST = 0.0  # as a speed: nothing is waited for
MOST_SPEED = 1000.0
_LONGEST_WAIT_S = 0.05  # how soon `stop` is heeded

Heard = TypeVar("Heard", bytes, Pose)


@dataclass(frozen=True, slots=True)
class Said:
    """What reached the host at ``log_ns``: bytes of the device, or a pose of the tracker."""

    log_ns: int
    what: bytes | Pose


@dataclass(frozen=True, slots=True)
class Playback:
    """All that a session has to say again, in the order in which it was heard.

    ``raw``: the bytes are those of the device itself. ``left_out`` counts messages by topic that
    cannot be said.
    """

    said: tuple[Said, ...]
    raw: bool
    left_out: Mapping[str, int]

    @property
    def first_ns(self) -> int:
        """When the first of it was heard."""
        return self.said[0].log_ns

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last."""
        return (self.said[-1].log_ns - self.first_ns) / NS_PER_S


def playback_of(records: Iterable[Record], *, poses_in_line: bool = False) -> Playback:
    """What to say of a session's records.

    ``poses_in_line``: without raw lines, poses are lines of the device instead of a tracker's.
    Raises BadInput where there is nothing to say.
    """
    ordered = sorted(records, key=lambda record: record.log_ns)
    raw = any(isinstance(record.message, RawLine) for record in ordered)
    if raw:
        said, left_out = _as_it_came(ordered)
    else:
        said, left_out = _encoded(ordered, poses_in_line=poses_in_line)
    if not said:
        raise BadInput("the session holds nothing that a device or a tracker would say")
    return Playback(tuple(said), raw, dict(left_out))


def _as_it_came(records: list[Record]) -> tuple[list[Said], Counter[str]]:
    """The raw lines; and the poses, unless the lines say these too."""
    said: list[Said] = []
    left_out: Counter[str] = Counter()
    texts = (r.message.text for r in records if isinstance(r.message, RawLine))
    tracked = not any(text.startswith("$POS,") for text in texts)
    for record in records:
        match record.message:
            case RawLine():
                said.append(Said(record.log_ns, record.message.text.encode("latin-1")))
            case Pose() if tracked:
                said.append(Said(record.log_ns, record.message))
            case _:
                pass  # it follows from the lines, or from how they are recorded
    return said, left_out


def _encoded(records: list[Record], *, poses_in_line: bool) -> tuple[list[Said], Counter[str]]:
    said: list[Said] = []
    left_out: Counter[str] = Counter()
    device = _Device(min((r.message.t_ns for r in records), default=0))
    for record in records:
        message = record.message
        report = _report(message)
        if isinstance(message, Pose) and not poses_in_line:
            said.append(Said(record.log_ns, message))
        elif report is not None:
            if device.silent:
                said.append(Said(record.log_ns, device.line(HELLO, message.t_ns)))
            said.append(Said(record.log_ns, device.line(report, message.t_ns)))
        elif not (isinstance(message, Diagnostics) or _is_mount(message)):
            left_out[record.topic] += 1
    return said, left_out


def _report(message: Message) -> Report | None:
    """What the line says of a message; None where it has no word for it."""
    match message:
        case Range():
            return RangeReport(message.sensor, message.range_m)
        case Transform(parent=parent, static=False) if parent == BASE_FRAME:
            return HeadReport(message.child, message.parent_from_child.heading_rad)
        case Pose():
            pose = message.world_from_base
            return PoseReport(pose.x_m, pose.y_m, pose.heading_rad)
        case _:
            return None


def _is_mount(message: Message) -> bool:
    return isinstance(message, Transform) and message.static


class _Device:
    """Numbers the lines and stamps them with the clock of a device that booted at ``boot_ns``."""

    def __init__(self, boot_ns: int) -> None:
        self._boot_ns = boot_ns
        self._seq = 0

    @property
    def silent(self) -> bool:
        return self._seq == 0

    def line(self, report: Report, t_ns: int) -> bytes:
        device_ms = (t_ns - self._boot_ns) // NS_PER_MS % DEVICE_MS_RANGE
        line = encode(report, self._seq % SEQ_RANGE, device_ms)
        self._seq += 1
        return line


def check_speed(speed: float) -> float:
    """A speed that makes sense; BadInput otherwise."""
    if not (speed == FASTEST or 0.01 <= speed <= MOST_SPEED):
        raise BadInput(f"the speed must be 0 or between 0.01 and {MOST_SPEED:g}, not {speed:g}")
    return speed


class Timetable:
    """The session's times laid onto the host's clock, from ``start_ns`` on.

    At speed 0 times keep their distances, so that what is heard at once is dated as it was.
    """

    def __init__(self, first_ns: int, speed: float, clock: Clock, start_ns: int) -> None:
        self.speed = check_speed(speed)
        self._first_ns = first_ns
        self._clock = clock
        self._start_ns = start_ns

    def now(self, t_ns: int) -> int:
        """A time of the session on the host's clock."""
        return self._start_ns + round((t_ns - self._first_ns) / (self.speed or 1.0))

    def wait_for(
        self, t_ns: int, stop: threading.Event, meanwhile: Callable[[], object] = lambda: None
    ) -> bool:
        """Wait until a time of the session has come; False when ``stop`` came first."""
        while not stop.is_set():
            meanwhile()
            wait_s = (self.now(t_ns) - self._clock.now_ns()) / NS_PER_S
            if self.speed == FASTEST or wait_s <= 0.0:
                return True
            stop.wait(min(wait_s, _LONGEST_WAIT_S))
        return False


class _Turns:
    """Lets two threads speak in the order of one session."""

    def __init__(self) -> None:
        self._next = 0
        self._changed = threading.Condition()

    def wait(self, turn: int, stop: threading.Event) -> bool:
        """Wait until all before have spoken; False when ``stop`` came first."""
        with self._changed:
            while self._next < turn and not stop.is_set():
                self._changed.wait(_LONGEST_WAIT_S)
            return self._next >= turn

    def over(self) -> None:
        """The next one may speak."""
        with self._changed:
            self._next += 1
            self._changed.notify_all()


class _Voice:
    """One of the two that speak: says what is of its kind, each at its turn and time."""

    def __init__(self, playback: Playback, timetable: Timetable, turns: _Turns) -> None:
        self._playback = playback
        self._timetable = timetable
        self._turns = turns

    def _spoken(self, kind: type[Heard], stop: threading.Event) -> Iterator[tuple[Heard, int]]:
        for turn, said in enumerate(self._playback.said):
            if isinstance(said.what, kind):
                if not self._turns.wait(turn, stop):
                    return
                if not self._timetable.wait_for(said.log_ns, stop):
                    return
                yield said.what, self._timetable.now(said.log_ns)
                self._turns.over()


class ReplayedLink(_Voice):
    """The device of a session as a source of bytes, as :class:`recorder.link.Link` is one.

    It ends when the session does, its tracker included.
    """

    def open(self) -> None:
        """It always is."""

    def close(self) -> None:
        """Nothing to let go of."""

    def write(self, data: bytes) -> bool:
        """Nobody listens: the device has said all that it will."""
        return False

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        """The bytes at their times, until all is said or ``stop`` is set."""
        yield LinkEvent(LinkState.OPENED, self._timetable.now(self._playback.first_ns), "replay")
        for data, arrival_ns in self._spoken(bytes, stop):
            yield Received(data, arrival_ns)
        self._turns.wait(len(self._playback.said), stop)


class ReplayedTracker(_Voice):
    """The tracker of a session, as :class:`recorder.tracker.Tracker`; stamps shifted to now."""

    def events(self, stop: threading.Event) -> Iterator[TrackedPose]:
        """The poses at their times, until they are all said or ``stop`` is set."""
        for pose, arrival_ns in self._spoken(Pose, stop):
            shifted = replace(pose, t_ns=self._timetable.now(pose.t_ns))
            yield TrackedPose(shifted, arrival_ns, dated_by_arrival=False)


def replayed(
    playback: Playback, *, clock: Clock, speed: float = 1.0
) -> tuple[ReplayedLink, ReplayedTracker | None]:
    """The device and the tracker of a session, for :func:`recorder.recording.record`.

    The session begins now. At speed 0 nothing is waited for and all is dated as far apart as it
    was. The tracker is None where the session has no poses of one; where there is one, both must
    be listened to, each in a thread, for they speak in turns.
    """
    timetable = Timetable(playback.first_ns, speed, clock, clock.now_ns())
    turns = _Turns()
    link = ReplayedLink(playback, timetable, turns)
    if not any(isinstance(said.what, Pose) for said in playback.said):
        return link, None
    return link, ReplayedTracker(playback, timetable, turns)


def mounts_of(records: Iterable[Record]) -> tuple[Transform, ...]:
    """Where the session says that everything sits: the line does not."""
    messages = [record.message for record in records]
    return tuple(m for m in messages if isinstance(m, Transform) and m.static)


def wheels_of(metadata: Mapping[str, object]) -> dict[str, Any] | None:
    """The wheel geometry that the session was recorded with, if it says so."""
    wheels = metadata.get("wheels")
    return dict(wheels) if isinstance(wheels, Mapping) else None
