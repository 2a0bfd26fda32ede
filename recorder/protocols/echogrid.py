"""The ``echogrid`` serial protocol, both ways: lines of ASCII with a number, a time and a CRC-32.

``$KIND,SEQ,MS,value,...*XXXXXXXX`` CR LF. The checksum is zlib's CRC-32 of what stands between
``$`` and ``*``, in hex; a line has at most 96 bytes, its end included. SEQ (16 bits, one count for
all kinds) and MS (32 bits, device milliseconds at the measurement) wrap around. All numbers are
whole numbers. ``$`` starts a line wherever it stands, so a cut line costs only itself.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from recorder.errors import BadInput
from recorder.names import FRAME_NAME
from recorder.protocols.interface import Protocol
from recorder.protocols.reports import (
    Fault,
    HeadReport,
    HelloReport,
    LogReport,
    Packet,
    PoseReport,
    RangeReport,
    Report,
    WheelReport,
)

PROTOCOL_VERSION = 1
MAX_LINE_BYTES = 96
SEQ_RANGE = 1 << 16
DEVICE_MS_RANGE = 1 << 32
NOTHING_SEEN_MM = -1
TOO_CLOSE_MM = -2

_INT32_MAX = (1 << 31) - 1
# The stretches into which a stream falls: up to a line feed, up to the next `$`, or as many bytes
# as a line may have. Which stretch a byte belongs to does not depend on how the bytes arrive.
_STRETCH = re.compile(
    rb"[^\n][^$\n]{0,94}\n|\n|[^\n][^$\n]{0,95}(?=\$)|[^\n][^$\n]{95}",
)
_FRAME = re.compile(rb"\$([^$*]*)\*([0-9A-Fa-f]{8})(?:\r?\n|\r)?", re.DOTALL)
_PRINTABLE = re.compile(rb"[\x20-\x7e]*")
_INTEGER = re.compile(r"-?[0-9]{1,10}")
_KIND = re.compile(r"[A-Z][A-Z0-9]{0,7}")
_WORD = re.compile(r"[^,$*\x00-\x1f\x7f-\U0010ffff]{1,32}")
_TEXT = re.compile(r"[^$*\x00-\x1f\x7f-\U0010ffff]*")


class _Malformed(ValueError):
    """A sound line whose values are not those of its kind."""


class EchogridProtocol(Protocol):
    """Cuts a stream of bytes into packets of the ``echogrid`` protocol; knows no port."""

    name: ClassVar[str] = "echogrid"
    default_baud: ClassVar[int] = 115200

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete now, in order; an unfinished line waits for its rest."""
        stream = self._pending + data
        packets = []
        start = 0
        while match := _STRETCH.match(stream, start):
            packets.append(_decode(match.group()))
            start = match.end()
        self._pending = stream[start:]
        return packets

    def close(self) -> list[Packet]:
        """The link went away: what waits is a cut line, and the next byte starts afresh."""
        raw, self._pending = self._pending, b""
        if not raw:
            return []
        return [Packet(raw, fault=Fault.CUT if raw.startswith(b"$") else Fault.NOISE)]


def encode(report: Report, seq: int, device_ms: int) -> bytes:
    """The line, CR LF included, that carries ``report``.

    ``seq`` is 0..65535 and ``device_ms`` 0..2**32 - 1. Ranges are rounded to millimetres, angles to
    hundredths of a degree. Raises BadInput on what no line can carry.
    """
    if not 0 <= seq < SEQ_RANGE or not 0 <= device_ms < DEVICE_MS_RANGE:
        raise BadInput(f"seq {seq} or device time {device_ms} ms is out of range")
    kind, layout = _layout_of(report)
    fields = layout.write(report)
    body = ",".join([kind, str(seq), str(device_ms), *fields]).encode("ascii", "replace")
    line = b"$%b*%08X\r\n" % (body, zlib.crc32(body))
    try:
        layout.read(fields)
    except _Malformed as error:
        raise BadInput(f"cannot send {report}: {error}") from None
    if len(line) > MAX_LINE_BYTES:
        raise BadInput(f"cannot send {report}: the line is longer than {MAX_LINE_BYTES} bytes")
    return line


def _decode(raw: bytes) -> Packet:
    """One stretch of the stream as a packet."""
    if not raw.startswith(b"$"):
        return Packet(raw, fault=Fault.NOISE)
    if len(raw) >= MAX_LINE_BYTES and not raw.endswith(b"\n"):
        return Packet(raw, fault=Fault.OVERLONG)
    frame = _FRAME.fullmatch(raw)
    if frame is None:
        return Packet(raw, fault=Fault.MALFORMED if raw.endswith(b"\n") else Fault.CUT)
    body, checksum = frame.groups()
    if zlib.crc32(body) != int(checksum, 16):
        return Packet(raw, fault=Fault.BAD_CHECKSUM)
    if not _PRINTABLE.fullmatch(body):
        return Packet(raw, fault=Fault.MALFORMED)
    return _decode_body(raw, body.decode("ascii").split(","))


def _decode_body(raw: bytes, fields: list[str]) -> Packet:
    """The packet of a line whose checksum is right."""
    try:
        if len(fields) < 3 or not _KIND.fullmatch(fields[0]):
            raise _Malformed("KIND, SEQ and MS are needed")
        seq = _integer(fields[1], 0, SEQ_RANGE - 1)
        device_ms = _integer(fields[2], 0, DEVICE_MS_RANGE - 1)
    except _Malformed:
        return Packet(raw, fault=Fault.MALFORMED)
    layout = KINDS.get(fields[0])
    if layout is None:
        return Packet(raw, None, seq, device_ms, Fault.UNKNOWN_KIND)
    try:
        return Packet(raw, layout.read(fields[3:]), seq, device_ms)
    except _Malformed:
        return Packet(raw, None, seq, device_ms, Fault.MALFORMED)


@dataclass(frozen=True, slots=True)
class Layout:
    """How the values of one kind of line are read and written."""

    report: type[Report]
    values: str
    read: Callable[[list[str]], Report]
    write: Callable[[Any], list[str]]


def _layout_of(report: Report) -> tuple[str, Layout]:
    for kind, layout in KINDS.items():
        if isinstance(report, layout.report):
            return kind, layout
    raise BadInput(f"no kind of line carries {report}")


def _integer(text: str, lowest: int = -_INT32_MAX - 1, highest: int = _INT32_MAX) -> int:
    if not _INTEGER.fullmatch(text) or not lowest <= int(text) <= highest:
        raise _Malformed(f"{text!r} is no whole number from {lowest} to {highest}")
    return int(text)


def _matching(pattern: re.Pattern[str], text: str) -> str:
    if not pattern.fullmatch(text):
        raise _Malformed(f"{text!r} cannot stand in a line")
    return text


def _values(fields: list[str], count: int) -> list[str]:
    if len(fields) != count:
        raise _Malformed(f"{len(fields)} values instead of {count}")
    return fields


def _read_hello(fields: list[str]) -> HelloReport:
    version, robot, firmware = _values(fields, 3)
    return HelloReport(
        _integer(version, lowest=0), _matching(_WORD, robot), _matching(_WORD, firmware)
    )


def _write_hello(report: HelloReport) -> list[str]:
    return [str(report.protocol_version), report.robot, report.firmware]


def _read_range(fields: list[str]) -> RangeReport:
    sensor, text = _values(fields, 2)
    range_mm = _integer(text, lowest=TOO_CLOSE_MM)
    special = {NOTHING_SEEN_MM: math.inf, TOO_CLOSE_MM: -math.inf}
    return RangeReport(_matching(FRAME_NAME, sensor), special.get(range_mm, range_mm / 1000.0))


def _write_range(report: RangeReport) -> list[str]:
    if math.isinf(report.range_m):
        range_mm = NOTHING_SEEN_MM if report.range_m > 0 else TOO_CLOSE_MM
    elif report.range_m >= 0.0:
        range_mm = round(report.range_m * 1000.0)
    else:  # negative or NaN; -0.5 mm must not become "nothing seen"
        raise _unsendable(report)
    return [report.sensor, str(range_mm)]


def _read_head(fields: list[str]) -> HeadReport:
    head, angle_cdeg = _values(fields, 2)
    return HeadReport(_matching(FRAME_NAME, head), math.radians(_integer(angle_cdeg) / 100.0))


def _write_head(report: HeadReport) -> list[str]:
    return [report.head, _scaled(report, math.degrees(report.angle_rad), 100.0)]


def _read_wheels(fields: list[str]) -> WheelReport:
    left, right = _values(fields, 2)
    return WheelReport(_integer(left), _integer(right))


def _write_wheels(report: WheelReport) -> list[str]:
    return [str(report.left), str(report.right)]


def _read_pose(fields: list[str]) -> PoseReport:
    x_mm, y_mm, heading_cdeg = (_integer(field) for field in _values(fields, 3))
    return PoseReport(x_mm / 1000.0, y_mm / 1000.0, math.radians(heading_cdeg / 100.0))


def _write_pose(report: PoseReport) -> list[str]:
    return [
        _scaled(report, report.x_m, 1000.0),
        _scaled(report, report.y_m, 1000.0),
        _scaled(report, math.degrees(report.heading_rad), 100.0),
    ]


def _read_log(fields: list[str]) -> LogReport:
    return LogReport(_matching(_TEXT, ",".join(fields)))


def _write_log(report: LogReport) -> list[str]:
    return report.text.split(",")


def _scaled(report: Report, value: float, scale: float) -> str:
    if not math.isfinite(value):
        raise _unsendable(report)
    return str(round(value * scale))


def _unsendable(report: Report) -> BadInput:
    return BadInput(f"cannot send {report}: a number is out of range")


KINDS: Mapping[str, Layout] = {
    "HEL": Layout(HelloReport, "protocol version, robot, firmware", _read_hello, _write_hello),
    "RNG": Layout(RangeReport, "sensor, mm", _read_range, _write_range),
    "HED": Layout(HeadReport, "head, centidegrees", _read_head, _write_head),
    "WHL": Layout(WheelReport, "left counts, right counts", _read_wheels, _write_wheels),
    "POS": Layout(PoseReport, "x mm, y mm, centidegrees", _read_pose, _write_pose),
    "LOG": Layout(LogReport, "text", _read_log, _write_log),
}
