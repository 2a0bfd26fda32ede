"""What runs on the simulated device: reports → the bytes of a protocol, and answers to the host."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from recorder.odometry import COUNTER_RANGE
from recorder.protocols.echogrid import DEVICE_MS_RANGE, SEQ_RANGE, encode
from recorder.protocols.rbc import ANSWER, GO, HELLO, INFRARED, INVALID_CM, SONAR, sensor_packet
from recorder.protocols.reports import LogReport, RangeReport, Report, WheelReport

CSV_COLUMNS = "t_ms,ping:mm,dirrs:mm"


class Firmware:
    """The ``echogrid`` protocol: lines with sequence numbers and the device's own clock.

    ``corrupt_rate`` is the share of bytes that arrive wrong; which ones follows from ``rng``.
    """

    protocol: ClassVar[str] = "echogrid"

    def __init__(self, corrupt_rate: float, rng: np.random.Generator) -> None:
        self._corrupt_rate = corrupt_rate
        self._rng = rng
        self.boot(0)

    def boot(self, now_ns: int) -> None:
        """Start anew: sequence numbers, device time and wheel counts begin at 0."""
        self._booted_ns = now_ns
        self._seq = 0
        self._wheels_at_boot: WheelReport | None = None

    def line(self, report: Report, t_ns: int) -> bytes:
        """The bytes of ``report``, measured at ``t_ns`` of the clock that ``boot`` got.

        Empty where the protocol cannot carry it.
        """
        if isinstance(report, WheelReport):
            report = self._since_boot(report)
        line = encode(report, self._seq, self._device_ms(t_ns))
        self._seq = (self._seq + 1) % SEQ_RANGE
        return self._corrupted(line)

    def receive(self, data: bytes) -> bytes:
        """What the device answers to bytes of the host."""
        return b""

    def _device_ms(self, t_ns: int) -> int:
        return max(0, t_ns - self._booted_ns) // 1_000_000 % DEVICE_MS_RANGE

    def _since_boot(self, counts: WheelReport) -> WheelReport:
        zero = self._wheels_at_boot = self._wheels_at_boot or counts
        return WheelReport(
            (counts.left - zero.left) % COUNTER_RANGE, (counts.right - zero.right) % COUNTER_RANGE
        )

    def _corrupted(self, line: bytes) -> bytes:
        if self._corrupt_rate == 0.0:
            return line
        data = np.frombuffer(line, dtype=np.uint8).copy()
        hit = self._rng.random(len(data)) < self._corrupt_rate
        data[hit] ^= self._rng.integers(1, 256, size=int(hit.sum()), dtype=np.uint8)
        return data.tobytes()


class RbcFirmware(Firmware):
    """The course's robot: silent until hands are shaken, then pairs of readings in centimetres."""

    protocol: ClassVar[str] = "rbc"

    def boot(self, now_ns: int) -> None:
        """Start anew: the host must shake hands again."""
        super().boot(now_ns)
        self._asked = self._awake = False
        self._sonar_cm: int | None = None

    def receive(self, data: bytes) -> bytes:
        """Byte 10 is answered with 8, and 11 begins it all."""
        answer = b""
        for byte in data:
            if bytes([byte]) == HELLO:
                self._asked = True
                answer += ANSWER
            elif bytes([byte]) == GO and self._asked:
                self._awake = True
        return answer

    def line(self, report: Report, t_ns: int) -> bytes:
        """A packet with each reading of the infrared ranger, or a sonar's without one."""
        if not self._awake or not isinstance(report, RangeReport):
            return b""
        waiting, self._sonar_cm = self._sonar_cm, None
        if report.sensor == INFRARED:
            sonar_cm = INVALID_CM if waiting is None else waiting
            return self._corrupted(sensor_packet(sonar_cm, _whole_cm(report)))
        self._sonar_cm = _whole_cm(report)
        return b"" if waiting is None else self._corrupted(sensor_packet(waiting, INVALID_CM))


class CsvFirmware(Firmware):
    """A sketch of a student: a header at boot, then rows of milliseconds and millimetres."""

    protocol: ClassVar[str] = "csv"

    def boot(self, now_ns: int) -> None:
        """Start anew, with the header first."""
        super().boot(now_ns)
        self._sonar = "nan"

    def line(self, report: Report, t_ns: int) -> bytes:
        """A row with each reading of the infrared ranger and the latest of the sonar."""
        if isinstance(report, LogReport):
            return b"t_ms,ping_mm,dirrs_mm\r\n"
        if not isinstance(report, RangeReport):
            return b""
        text = f"{report.range_m * 1000.0:.0f}" if math.isfinite(report.range_m) else "0"
        if report.sensor == SONAR:
            self._sonar = text
            return b""
        row = f"{self._device_ms(t_ns)},{self._sonar},{text}\r\n"
        self._sonar = "nan"  # each reading is sent once
        return self._corrupted(row.encode("ascii"))


FIRMWARES: Mapping[str, type[Firmware]] = {
    firmware.protocol: firmware for firmware in (Firmware, RbcFirmware, CsvFirmware)
}


def _whole_cm(report: RangeReport) -> int:
    """A range as the robot sends it; -1: nothing seen."""
    return round(report.range_m * 100.0) if math.isfinite(report.range_m) else -1
