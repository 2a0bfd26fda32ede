"""What a session's device and tracker sent: bytes and poses with the times of their arrival.

Raw lines are sent as they came, byte by byte. A session without any (simulated, imported) is
encoded in the ``echogrid`` protocol: ranges in whole millimetres, angles in hundredths of a degree.
What no line can carry (scans, odometry without wheel counts) is left out and counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from recorder.clock import NS_PER_MS, NS_PER_S
from recorder.errors import BadInput
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
from recorder.odometry import WheelGeometry
from recorder.protocols.echogrid import DEVICE_MS_RANGE, PROTOCOL_VERSION, SEQ_RANGE, encode
from recorder.protocols.reports import HeadReport, HelloReport, PoseReport, RangeReport, Report

HELLO = HelloReport(PROTOCOL_VERSION, "replayed", "echogrid")


@dataclass(frozen=True, slots=True)
class Transmission:
    """What reached the host at ``log_ns``: bytes of the device, or a pose of the tracker."""

    log_ns: int
    payload: bytes | Pose


@dataclass(frozen=True, slots=True)
class Playback:
    """All that is sent again of a session, in the order in which it arrived.

    ``left_out`` counts messages by topic that cannot be sent.
    """

    transmissions: tuple[Transmission, ...]
    left_out: Mapping[str, int]

    @property
    def first_ns(self) -> int:
        """When the first of it arrived."""
        return self.transmissions[0].log_ns

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last."""
        return (self.transmissions[-1].log_ns - self.first_ns) / NS_PER_S


def playback_of(records: Iterable[Record], *, poses_in_line: bool = False) -> Playback:
    """What to send again of a session's records.

    ``poses_in_line``: without raw lines, poses are lines of the device instead of a tracker's.
    Raises BadInput where there is nothing to send.
    """
    ordered = sorted(records, key=lambda record: record.log_ns)
    left_out: Counter[str] = Counter()
    if any(isinstance(record.message, RawLine) for record in ordered):
        sent = list(_as_it_came(ordered))
    else:
        sent = list(_encoded(ordered, left_out, poses_in_line=poses_in_line))
    if not sent:
        raise BadInput("the session holds nothing that a device or a tracker would send")
    return Playback(tuple(sent), dict(left_out))


def _as_it_came(records: list[Record]) -> Iterator[Transmission]:
    """The raw lines; and the poses, unless the lines carry these too."""
    texts = (r.message.text for r in records if isinstance(r.message, RawLine))
    tracked = not any(text.startswith("$POS,") for text in texts)
    for record in records:
        match record.message:
            case RawLine():
                yield Transmission(record.log_ns, record.message.text.encode("latin-1"))
            case Pose() if tracked:
                yield Transmission(record.log_ns, record.message)
            case _:
                pass  # it follows from the lines, or from how they are recorded


def _encoded(
    records: list[Record], left_out: Counter[str], *, poses_in_line: bool
) -> Iterator[Transmission]:
    """Lines of a device that measured the same, and poses; what no line carries is counted."""
    device = _Device(min((r.message.t_ns for r in records), default=0))
    for record in records:
        message = record.message
        report = _report(message)
        if isinstance(message, Pose) and not poses_in_line:
            yield Transmission(record.log_ns, message)
        elif report is not None:
            if device.silent:
                yield Transmission(record.log_ns, device.line(HELLO, message.t_ns))
            yield Transmission(record.log_ns, device.line(report, message.t_ns))
        elif not (isinstance(message, Diagnostics) or _is_mount(message)):
            left_out[record.topic] += 1


def _report(message: Message) -> Report | None:
    """A message as a report of the device; None where no line can carry it."""
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


def mounts_of(records: Iterable[Record]) -> tuple[Transform, ...]:
    """Where the session has its sensors mounted: the line does not carry it."""
    messages = [record.message for record in records]
    return tuple(m for m in messages if isinstance(m, Transform) and m.static)


def wheels_of(metadata: Mapping[str, object]) -> WheelGeometry | None:
    """The wheel geometry that the session was recorded with, where its metadata name one."""
    wheels = metadata.get("wheels")
    return WheelGeometry(**wheels) if isinstance(wheels, Mapping) else None
