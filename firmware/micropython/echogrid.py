"""The echogrid protocol for MicroPython: a Pico or ESP32 that `echogrid record` understands.

    from echogrid import Echogrid
    robot = Echogrid("my_robot")
    robot.range("ping", 523)

Lines leave on USB, or on the stream that is given, such as `machine.UART(0, 115200)`.
"""

import binascii
import sys
import time

PROTOCOL_VERSION = 1
LONGEST_LINE = 96
NOTHING_SEEN = -1
TOO_CLOSE = -2
_HELLO_PERIOD_MS = 5000
_END_BYTES = 11  # `*`, eight digits, CR and LF


class Echogrid:
    """Numbers and dates the lines, and introduces the robot every 5 s."""

    def __init__(self, robot, firmware="micropython", stream=None):
        # The raw stream: text would get a second CR before each LF on some boards.
        self._stream = stream or getattr(sys.stdout, "buffer", sys.stdout)
        self._who = (PROTOCOL_VERSION, robot, firmware)
        self._seq = 0
        self._ms = 0
        self._ticks = time.ticks_ms()
        self._hello()

    def now_ms(self):
        """Milliseconds since the start, in 32 bits; call anything here at least once in 6 days.

        ticks_ms() goes round after 12 days (2**30 ms), which the protocol does not allow.
        """
        ticks = time.ticks_ms()
        self._ms = (self._ms + time.ticks_diff(ticks, self._ticks)) & 0xFFFFFFFF
        self._ticks = ticks
        return self._ms

    def range(self, sensor, mm, ms=None):
        """A range, or NOTHING_SEEN or TOO_CLOSE. `ms`: now_ms() at the measurement."""
        self._report("RNG", ms, sensor, mm)

    def head(self, centidegrees, ms=None, name="head"):
        """Where the head looks, counter-clockwise; 0 is ahead. Send it before the range."""
        self._report("HED", ms, name, centidegrees)

    def wheels(self, left, right, ms=None):
        """Counts since boot; forwards counts up."""
        self._report("WHL", ms, left, right)

    def pose(self, x_mm, y_mm, centidegrees, ms=None):
        """For a robot that knows where it is."""
        self._report("POS", ms, x_mm, y_mm, centidegrees)

    def log(self, text):
        """Words for people; what does not fit into a line is cut off."""
        self._report("LOG", None, text)

    def _hello(self):
        self._hello_ms = self.now_ms()
        self._send("HEL", self._hello_ms, self._who)

    def _report(self, kind, ms, *values):
        now_ms = self.now_ms()
        if (now_ms - self._hello_ms) & 0xFFFFFFFF >= _HELLO_PERIOD_MS:
            self._hello()
        self._send(kind, now_ms if ms is None else ms, values)

    def _send(self, kind, ms, values):
        text = ",".join([kind, str(self._seq), str(ms)] + [_value(value) for value in values])
        body = text.encode()[: LONGEST_LINE - 1 - _END_BYTES]
        self._seq = (self._seq + 1) & 0xFFFF
        self._stream.write(b"$%s*%08X\r\n" % (body, binascii.crc32(body) & 0xFFFFFFFF))


def _value(value):
    """A number as a whole one; of a text what the protocol allows."""
    if isinstance(value, str):
        return "".join(c if " " <= c <= "~" and c not in "$*" else "?" for c in value)
    return str(round(value))
