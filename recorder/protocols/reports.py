"""What a device sends, as frozen values, whatever bytes carried it.

A protocol cuts the stream of bytes into :class:`Packet` values. Each holds the bytes as they came,
and either the report they stood for or the reason why they stood for none. Joined again, the bytes
of all packets are the stream: nothing is thrown away.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class HelloReport:
    """A device names itself: at boot, and again from time to time."""

    protocol_version: int
    robot: str
    firmware: str


@dataclass(frozen=True, slots=True)
class RangeReport:
    """One range of one sensor. +Inf: nothing seen; -Inf: too close to measure."""

    sensor: str
    range_m: float


@dataclass(frozen=True, slots=True)
class HeadReport:
    """The angle of a turning head or turret, counter-clockwise from straight ahead."""

    head: str
    angle_rad: float


@dataclass(frozen=True, slots=True)
class WheelReport:
    """The counts of both wheel encoders since boot; forwards counts up."""

    left: int
    right: int


@dataclass(frozen=True, slots=True)
class PoseReport:
    """Where a robot that knows stands in the map frame."""

    x_m: float
    y_m: float
    heading_rad: float


@dataclass(frozen=True, slots=True)
class LogReport:
    """A line of text from the firmware, for people."""

    text: str


Report = HelloReport | RangeReport | HeadReport | WheelReport | PoseReport | LogReport


class Fault(enum.Enum):
    """Why a stretch of bytes gave no report; the values are the names of the counters."""

    NOISE = "noise"  # bytes that belong to no line
    CUT = "cut"  # a line without its end
    OVERLONG = "overlong"  # longer than the protocol allows
    MALFORMED = "malformed"  # not built as the protocol requires
    BAD_CHECKSUM = "bad_checksum"
    UNKNOWN_KIND = "unknown_kind"  # sound, but of a kind that this version does not know
    HEADER = "header"  # names above columns of numbers
    BLANK = "blank"  # nothing but the end of a line


@dataclass(frozen=True, slots=True)
class Packet:
    """A stretch of the stream: ``raw`` as it came, and the report in it or why there is none.

    Exactly one of ``report`` and ``fault`` is set. ``seq`` and ``device_ms`` are known whenever
    they can be trusted, thus also for a sound line of an unknown kind. ``more`` are further reports
    of the same bytes, ``invalid`` counts values in them that mean that nothing was measured, and
    ``reply`` is what the device must be sent in answer, ``why`` what is wrong with it.
    """

    raw: bytes
    report: Report | None = None
    seq: int | None = None
    device_ms: int | None = None
    fault: Fault | None = None
    more: tuple[Report, ...] = ()
    invalid: int = 0
    reply: bytes = b""
    why: str = ""
