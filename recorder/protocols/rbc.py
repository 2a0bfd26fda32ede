"""The ``rbc`` protocol: the bytes of the course's robot, a Parallax Propeller with two rangers.

The host sends byte 10, the robot answers 8, the host sends 11; from then on the robot sends
packets, ``02 cmd [flag] size payload``. There is neither checksum nor escape: after a lost byte
the next 02 may be the start of a packet or a number, so what cannot be a reading is not taken for
one, and the search goes on behind its 02.
"""

from __future__ import annotations

import math
from typing import ClassVar

from recorder.protocols.interface import Protocol
from recorder.protocols.reports import Fault, HelloReport, LogReport, Packet, RangeReport
from recorder.sensors import CATALOGUE

START = 0x02
HELLO, ANSWER, GO = b"\x0a", b"\x08", b"\x0b"
SENSOR_PACKET = b"\x02\x05\x01\x04"
SONAR, INFRARED = "ping", "dirrs"
INVALID_CM = round(100.0 * CATALOGUE[SONAR].invalid_m[0])

_TEXT_COMMANDS = (1, 2, 3, 4)
_PLANNER_COMMAND = 5
_PLANNER_FLAGS = (1, 2, 3, 4)
_BARE_COMMANDS = {7: "input on", 8: "input off", 9: "clear", 12: "image reset"}
_FARTHEST_SONAR_CM = 500
_FARTHEST_INFRARED_CM = 255  # a -1 that was read as one unsigned byte
_SILENT_ASKS = 5  # seconds of silence after which the robot is greeted anew


class RbcProtocol(Protocol):
    """Cuts the stream of the course's robot into packets, and shakes hands with it."""

    name: ClassVar[str] = "rbc"
    default_baud: ClassVar[int] = 9600
    checked: ClassVar[bool] = False

    def __init__(self) -> None:
        self._pending = b""
        self._awake = False  # whether a packet came since the link opened
        self._silent_asks = 0

    def greeting(self) -> bytes:
        """Byte 10 until a packet comes, and again after seconds of silence: it was reset."""
        self._silent_asks += 1
        if self._awake and self._silent_asks > _SILENT_ASKS:
            self._awake = False
        return b"" if self._awake else HELLO

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete now, in order."""
        self._pending += data
        packets = []
        while (packet := self._next()) is not None:
            self._pending = self._pending[len(packet.raw) :]
            packets.append(packet)
            # An answer alone does not count: our 11 that follows it may get lost.
            if packet.fault is None and packet.raw != ANSWER:
                self._awake, self._silent_asks = True, 0
        return packets

    def close(self) -> list[Packet]:
        """The link went away: hands must be shaken anew."""
        raw, self._pending = self._pending, b""
        self._awake, self._silent_asks = False, 0
        if not raw:
            return []
        return [Packet(raw, fault=Fault.CUT if raw[0] == START else Fault.NOISE)]

    def _next(self) -> Packet | None:
        """The packet at the front of what waits; None while it is not complete."""
        data = self._pending
        if not data:
            return None
        if data[0] == START:
            return _packet(data)
        if not self._awake and data[:1] == ANSWER:
            return Packet(ANSWER, HelloReport(0, "rbc", "unknown"), reply=GO)
        return self._noise(data)

    def _noise(self, data: bytes) -> Packet:
        """The bytes up to the next start, or up to an answer that is waited for."""
        ends = [data.find(START, 1)]
        if not self._awake:
            ends.append(data.find(ANSWER, 1))
        end = min((end for end in ends if end > 0), default=len(data))
        return Packet(data[:end], fault=Fault.NOISE)


def sensor_packet(sonar_cm: int, infrared_cm: int) -> bytes:
    """The bytes that carry one reading of each sensor, as the robot sends them."""
    values = (value.to_bytes(2, "big", signed=True) for value in (sonar_cm, infrared_cm))
    return SENSOR_PACKET + b"".join(values)


def _packet(data: bytes) -> Packet | None:
    """The packet that begins with the first byte, which is a start; None while it is cut."""
    if len(data) < 2:
        return None
    command = data[1]
    if command in _BARE_COMMANDS:
        return Packet(data[:2], LogReport(_BARE_COMMANDS[command]))
    flags = 1 if command == _PLANNER_COMMAND else 0
    known = command in _TEXT_COMMANDS or flags == 1
    if not known or (flags and len(data) > 2 and data[2] not in _PLANNER_FLAGS):
        return Packet(data[:1], fault=Fault.MALFORMED)
    size_at = 2 + flags
    if len(data) <= size_at or len(data) < size_at + 1 + data[size_at]:
        return None
    raw = data[: size_at + 1 + data[size_at]]
    if raw.startswith(SENSOR_PACKET):
        return _readings(raw)
    if flags:
        return Packet(raw, fault=Fault.UNKNOWN_KIND)
    return Packet(raw, LogReport(raw[size_at + 1 :].decode("latin-1")))


def _readings(raw: bytes) -> Packet:
    """A sensor packet: centimetres, 16 bits with a sign, the sonar first."""
    sonar_cm = int.from_bytes(raw[4:6], "big", signed=True)
    infrared_cm = int.from_bytes(raw[6:8], "big", signed=True)
    if not (-1 <= sonar_cm <= _FARTHEST_SONAR_CM and -1 <= infrared_cm <= _FARTHEST_INFRARED_CM):
        return Packet(raw[:1], fault=Fault.MALFORMED)
    readings = []
    if sonar_cm != INVALID_CM:
        readings.append(RangeReport(SONAR, _range_m(sonar_cm)))
    known = CATALOGUE[INFRARED]
    valid = known.min_range_m <= infrared_cm / 100.0 <= known.max_range_m  # else it sees ghosts
    if infrared_cm <= 0 or valid:
        readings.append(RangeReport(INFRARED, _range_m(infrared_cm)))
    invalid = 2 - len(readings)
    if not readings:
        return Packet(raw, LogReport("no valid reading"), invalid=invalid)
    return Packet(raw, readings[0], more=tuple(readings[1:]), invalid=invalid)


def _range_m(range_cm: int) -> float:
    """0 or less: nothing was seen."""
    return range_cm / 100.0 if range_cm > 0 else math.inf
