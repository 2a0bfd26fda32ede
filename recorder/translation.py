"""What arrives from the device and the tracker → messages for the session, and what to count.

No threads and no files: packets, poses and changes of the link go in with the time of their
arrival, ``(log_ns, message)`` pairs come out, and a tally is kept of everything else.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

from recorder.clock import DeviceClock
from recorder.geometry import SE2
from recorder.link import LinkEvent, LinkState
from recorder.messages import BASE_FRAME, Message, Odometry, Pose, Range, RawLine, Transform
from recorder.odometry import DeadReckoning, WheelGeometry
from recorder.protocols.echogrid import SEQ_RANGE
from recorder.protocols.reports import (
    HeadReport,
    HelloReport,
    LogReport,
    Packet,
    PoseReport,
    RangeReport,
    Report,
    WheelReport,
)
from recorder.sensors import UNKNOWN_KIND, SensorParameters, guess_kind
from recorder.tracker import BadTrackerLine, TrackedPose, TrackerEvent

_LARGEST_GAP = 1000  # lines that may go missing at once when the device's clock does not show it
_MAX_LINES_PER_MS = 2
_SHOWN_CHARACTERS = 60

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RecordingCounters:
    """What was received, written and lost, in lines of the serial link unless noted otherwise."""

    received: int = 0  # sound, and understood
    unknown_kind: int = 0  # sound, but of a kind that we do not know
    bad_checksum: int = 0
    malformed: int = 0
    cut: int = 0
    overlong: int = 0
    noise: int = 0  # stretches of bytes that belong to no line
    header: int = 0  # names above columns of numbers
    blank: int = 0  # lines of nothing
    invalid_values: int = 0  # in lines that were received: no measurement, by the device
    gaps: int = 0  # never arrived soundly, by their sequence numbers
    duplicates: int = 0  # with the sequence number of the line before
    reconnects: int = 0
    device_restarts: int = 0
    wheel_leaps: int = 0  # wheel counts that no wheel can make: nothing was moved
    wheel_counter_range: int = 0  # after how many counts the wheels' counters begin again, if known
    unknown_sensors: int = 0  # names that had to be given the defaults
    poses: int = 0  # from the tracker
    tracker_bad_lines: int = 0
    tracker_dated_by_arrival: int = 0  # poses whose own time was missing or not to be believed
    tracker_reconnects: int = 0
    pauses: int = 0
    paused_messages: int = 0  # understood while paused, and thus not in the session
    bad_not_kept: int = 0  # bad lines that came too fast to be kept
    dated_by_arrival: int = 0  # lines whose device's clock is coarser than their arrival
    ahead_of_arrival: int = 0  # lines whose own times run ahead of their arrival, and are taken
    written: int = 0  # messages in the session
    ended: str = ""  # why the recording ended
    failure: str = ""  # why the session could not be written any more, if so
    refused: str = ""  # the first line that was malformed, and why, where that is known

    def numbers(self) -> dict[str, int]:
        """All counters that are numbers, by name."""
        return {name: n for name, n in asdict(self).items() if isinstance(n, int)}


def _shown(raw: bytes) -> str:
    """The beginning of a line as it can be shown: quoted and printable."""
    text = raw[: 2 * _SHOWN_CHARACTERS].decode("utf-8", "replace").strip()
    short = text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}..."
    return repr("".join(c if c.isprintable() else "?" for c in short))


def raw_line(packet: Packet, arrival_ns: int) -> RawLine:
    """The bytes of a packet as they came."""
    return RawLine(arrival_ns, packet.raw.decode("latin-1"))


class Translator:
    """Turns packets and tracker events into messages, and counts; one for each recording."""

    def __init__(
        self,
        *,
        sensors: Mapping[str, SensorParameters] | None = None,
        wheels: WheelGeometry | None = None,
    ) -> None:
        self.tally: Counter[str] = Counter()
        self.hello: HelloReport | None = None
        self._sensors = dict(sensors or {})
        self._dead_reckoning = DeadReckoning(wheels) if wheels is not None else None
        self.refused = ""
        self._clock = DeviceClock()
        self._seq: int | None = None

    def packet(self, packet: Packet, arrival_ns: int) -> Iterator[tuple[int, Message]]:
        """The raw line, and the messages that it carries if any."""
        yield arrival_ns, raw_line(packet, arrival_ns)
        if packet.fault is not None:
            self.tally[packet.fault.value] += 1
            if packet.why and not self.refused:
                self.refused = f"{_shown(packet.raw)}: {_shown(packet.why.encode())[1:-1]}"
        else:
            self.tally["received"] += 1
        t_ns = self._measured_ns(packet, arrival_ns)
        self.tally["invalid_values"] += packet.invalid
        for message in self.reports(packet, t_ns):
            yield arrival_ns, message

    def count_bad(self, packet: Packet) -> None:
        """A bad line that is not kept, for too many come."""
        if packet.fault is not None:
            self.tally[packet.fault.value] += 1
        self.tally["bad_not_kept"] += 1

    def look_ahead(self, packets: Sequence[Packet], arrival_ns: int) -> None:
        """What has come at once and is given to :meth:`packet` next."""
        times_ms = [packet.device_ms for packet in packets if packet.device_ms is not None]
        self._clock.look_ahead(times_ms, arrival_ns)

    def reports(self, packet: Packet, t_ns: int) -> Iterator[Message]:
        """The messages of a packet that was measured at ``t_ns``."""
        for report in () if packet.report is None else (packet.report, *packet.more):
            message = self._message(report, t_ns)
            if message is not None:
                yield message

    def link_event(self, event: LinkEvent) -> None:
        """The serial link was opened, lost or opened again."""
        if event.state is LinkState.LOST:
            self._clock.forget()
        self.tally["reconnects"] += event.state is LinkState.REOPENED

    def tracker_event(self, event: TrackerEvent) -> Iterator[tuple[int, Message]]:
        """A pose of the tracker, or something to count."""
        match event:
            case TrackedPose():
                self.tally["poses"] += 1
                self.tally["tracker_dated_by_arrival"] += event.dated_by_arrival
                yield event.arrival_ns, event.pose
            case BadTrackerLine():
                self.tally["tracker_bad_lines"] += 1
            case LinkEvent():
                self.tally["tracker_reconnects"] += event.state is LinkState.REOPENED

    def _measured_ns(self, packet: Packet, arrival_ns: int) -> int:
        """Host time of the measurement; lost lines and restarts are counted on the way."""
        t_ns, in_step_ms, restarted = arrival_ns, 0, False
        if packet.device_ms is not None:
            estimate = self._clock.estimate(packet.device_ms, arrival_ns)
            t_ns, in_step_ms, restarted = estimate.t_ns, estimate.in_step_ms, estimate.restarted
            self.tally["dated_by_arrival"] += estimate.by_arrival
            self.tally["ahead_of_arrival"] += estimate.ahead
        step = 1
        if packet.seq is not None and self._seq is not None:
            step = (packet.seq - self._seq) % SEQ_RANGE
        if not restarted and step > _LARGEST_GAP + _MAX_LINES_PER_MS * in_step_ms:
            # nothing can have sent so many lines meanwhile: the numbers began anew, although the
            # clock could pass for having gone on
            restarted = True
            self._clock.forget()
            if packet.device_ms is not None:
                t_ns = self._clock.estimate(packet.device_ms, arrival_ns).t_ns
        if packet.seq is not None:
            self._seq = packet.seq
        if restarted:
            self._restarted()
        else:
            self.tally["duplicates"] += step == 0
            self.tally["gaps"] += max(step - 1, 0)
        return t_ns

    def _restarted(self) -> None:
        self.tally["device_restarts"] += 1
        if self._dead_reckoning is not None:
            self._dead_reckoning.restart()

    def _message(self, report: Report, t_ns: int) -> Message | None:
        """What a report is in the session; None for one that only the raw line keeps."""
        match report:
            case RangeReport():
                return self._range(report, t_ns)
            case HeadReport():
                turn = SE2(0.0, 0.0, report.angle_rad)
                return Transform(t_ns, BASE_FRAME, report.head, turn, static=False)
            case PoseReport():
                return Pose(t_ns, SE2(report.x_m, report.y_m, report.heading_rad))
            case WheelReport():
                if self._dead_reckoning is None:
                    return None
                return Odometry(t_ns, self._moved(self._dead_reckoning, report, t_ns))
            case HelloReport():
                self.hello = report
                return None
            case LogReport():
                _log.info("device: %s", report.text)
                return None

    def _moved(self, reckoning: DeadReckoning, report: WheelReport, t_ns: int) -> SE2:
        """Where the wheels have brought it; what no wheel can do is counted."""
        odom_from_base = reckoning.update(report.left, report.right, t_ns)
        if reckoning.leaps:
            self.tally["wheel_leaps"] = reckoning.leaps
        if reckoning.counter_range is not None:
            self.tally["wheel_counter_range"] = reckoning.counter_range
        return odom_from_base

    def _range(self, report: RangeReport, t_ns: int) -> Range:
        sensor = self._sensors.get(report.sensor)
        if sensor is None:
            kind = guess_kind(report.sensor)
            if kind is None:
                kind = UNKNOWN_KIND
                self.tally["unknown_sensors"] += 1
                _log.warning("sensor %s is not known: taken for an ultrasonic one", report.sensor)
            sensor = self._sensors[report.sensor] = kind.parameters
        return sensor.reading(t_ns, report.sensor, report.range_m)
