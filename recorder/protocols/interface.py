"""The one small interface behind which every protocol stands, and a base for those made of lines.

A protocol is pure and incremental: bytes go in as they arrive, in pieces of any size, packets come
out; it knows no port and no clock. What it wants to send to the device it hands back as bytes.
"""

from __future__ import annotations

import abc
import re
from collections.abc import Sequence
from typing import ClassVar

from recorder.protocols.reports import Fault, Packet, Report


class Protocol(abc.ABC):
    """Cuts a stream of bytes into packets; their ``raw`` bytes, joined, are the stream again."""

    name: ClassVar[str]
    default_baud: ClassVar[int] = 115200
    checked: ClassVar[bool] = True  # whether a damaged number is noticed

    @abc.abstractmethod
    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete now; it never raises, whatever the bytes are."""

    @abc.abstractmethod
    def close(self) -> list[Packet]:
        """The link went away: what is unfinished, as a fault; feeding may begin afresh."""

    def greeting(self) -> bytes:
        """What the device must be sent now, if anything.

        Asked when the link opens, and once a second from then on.
        """
        return b""


class LineProtocol(Protocol):
    """A protocol of lines of ASCII text: :meth:`read` is all that is left to write.

    The first line after the link opened may lack its beginning and is not trusted. A line without
    a checksum passes when a digit of it was damaged: so ``checked`` is False.
    """

    checked: ClassVar[bool] = False
    max_line_bytes: ClassVar[int] = 256
    carriage_return_ends_lines: ClassVar[bool] = False
    """True where a CR alone ends a line, too."""

    def __init__(self) -> None:
        longest = self.max_line_bytes
        lines = rb"[^\n]{0,%d}\n|[^\n]{%d}"
        if self.carriage_return_ends_lines:  # one that ends the data so far may belong to CR LF
            lines = rb"[^\r\n]{0,%d}(?:\r*\n|\r(?=[^\r\n]))|[^\r\n]{%d}"
        self._stretch = re.compile(lines % (longest - 1, longest))
        self._ends = (b"\n", b"\r") if self.carriage_return_ends_lines else (b"\n",)
        self._pending = b""
        self._in_step = False  # whether the next byte begins a line

    def read(self, line: str) -> Report | Sequence[Report] | None:
        """The reports in a line without its end; None for a line of an unknown kind.

        A ValueError, LookupError, TypeError or ArithmeticError means that it is malformed.
        """
        raise NotImplementedError

    def packet(self, raw: bytes) -> Packet:
        """One whole line, with its end, as a packet; for protocols that ``read`` is too narrow for.

        May raise as :meth:`read` does.
        """
        found = self.read(raw.decode("ascii").strip())
        if found is None or found == ():
            return Packet(raw, fault=Fault.UNKNOWN_KIND)
        first, *more = found if isinstance(found, Sequence) else (found,)
        return Packet(raw, first, more=tuple(more))

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete now, in order; an unfinished line waits for its rest."""
        stream = self._pending + data
        packets = []
        start = 0
        while match := self._stretch.match(stream, start):
            packets.append(self._take(match.group()))
            start = match.end()
        self._pending = stream[start:]
        return packets

    def close(self) -> list[Packet]:
        """The link went away: what waits is a cut line, unless it has its end."""
        raw, self._pending = self._pending, b""
        if self._in_step and raw.endswith(self._ends):  # a CR that no LF followed
            packet, self._in_step = self._take(raw), False
            return [packet]
        fault = Fault.CUT if self._in_step else Fault.NOISE
        self._in_step = False
        return [Packet(raw, fault=fault)] if raw else []

    def _take(self, raw: bytes) -> Packet:
        was_in_step, self._in_step = self._in_step, raw.endswith(self._ends)
        if not was_in_step:
            return Packet(raw, fault=Fault.NOISE)
        if not self._in_step:
            return Packet(raw, fault=Fault.OVERLONG)
        if not raw.strip():
            return Packet(raw, fault=Fault.BLANK)
        try:
            return self.packet(raw)
        except (ValueError, LookupError, TypeError, ArithmeticError) as error:
            return Packet(raw, fault=Fault.MALFORMED, why=str(error) or type(error).__name__)
