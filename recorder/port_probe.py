"""Which serial device talks, and in what: each is listened to for a moment at usual speeds.

Nothing is written to a device unless that is asked for: nobody knows what hangs on it. Opening a
port may still restart the board behind it, as it does with most Arduinos.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from recorder.clock import HostClock
from recorder.errors import LinkError
from recorder.link import Link, LinkEvent
from recorder.protocols import Protocol
from recorder.protocols.echogrid import EchogridProtocol
from recorder.protocols.rbc import RbcProtocol
from recorder.protocols.reports import Fault, HelloReport, Packet, RangeReport

BAUDS = (115200, 9600)
LISTEN_S = 2.5  # a board that was restarted by the opening takes up to 2 s to send

_ENOUGH_ROWS = 3
_ENOUGH_BYTES = 4096  # so many without sense, and there is none at this speed
_ROW = re.compile(rb"[-+.0-9eE]+(?:[,;\t ]+[-+.0-9eE]+)*")
_SAMPLE_CHARACTERS = 32


@dataclass(frozen=True, slots=True)
class PortReport:
    """What a device was found to be. ``protocol`` is empty when nothing was understood."""

    device: str
    protocol: str = ""
    baud: int = 0
    detail: str = ""  # which robot, what was received, or why it could not be opened

    @property
    def verdict(self) -> str:
        """The finding, on one line."""
        return f"{self.protocol}, {self.baud}" if self.protocol else self.detail


def probe_ports(
    devices: Sequence[str], *, bauds: Sequence[int] = BAUDS, listen_s: float = LISTEN_S,
    write: bool = False,
) -> Iterator[PortReport]:  # fmt: skip
    """Listen to all devices at once, ``listen_s`` at each speed; the reports in their order.

    ``write`` allows to send them what the protocols begin with.
    """
    if not devices:
        return
    with ThreadPoolExecutor(len(devices)) as pool:
        yield from pool.map(lambda device: _probe(device, bauds, listen_s, write), devices)


def judge(data: bytes, *, hands_shaken: bool = False) -> tuple[str, str]:
    """What bytes are: the protocol, empty when unknown, and what describes the device."""
    packets = EchogridProtocol().feed(data)
    sound = [packet for packet in packets if packet.seq is not None]
    if sound:
        return EchogridProtocol.name, _robot(sound)
    readings = [p for p in RbcProtocol().feed(data) if isinstance(p.report, RangeReport)]
    if len(readings) >= _ENOUGH_ROWS or (hands_shaken and readings):
        return RbcProtocol.name, "the course's robot"
    rows = [line.strip() for line in data.split(b"\n")[1:-1]]  # the first and last may be cut
    widths = {len(re.split(rb"[,;\t ]+", row)) for row in rows if _ROW.fullmatch(row)}
    numbers = sum(_ROW.fullmatch(row) is not None for row in rows)
    if numbers >= _ENOUGH_ROWS and len(widths) == 1 and 2 * numbers > len(rows):
        return "csv", f"rows of {widths.pop()} numbers, such as {rows[-1].decode('ascii')}"
    return "", ""


def _probe(device: str, bauds: Iterable[int], listen_s: float, write: bool) -> PortReport:
    received = b""
    for baud in bauds:
        try:
            data, shaken = _listen(device, baud, listen_s, write)
        except LinkError as error:
            return PortReport(device, detail=str(error))
        name, detail = judge(data, hands_shaken=shaken)
        if name:
            return PortReport(device, name, baud, detail)
        received = max(received, data, key=len)
    return PortReport(device, detail=_sample(received) if received else "silent")


def _listen(device: str, baud: int, listen_s: float, write: bool) -> tuple[bytes, bool]:
    """What comes within ``listen_s``, or until it is understood; whether hands were shaken."""
    stop = threading.Event()
    link = Link(device, baud, clock=HostClock())
    link.open()
    greeter: Protocol | None = RbcProtocol() if write and baud == RbcProtocol.default_baud else None
    timer = threading.Timer(listen_s, stop.set)
    timer.start()
    data, shaken = b"", False
    try:
        if greeter is not None:
            link.write(greeter.greeting())
        for event in link.events(stop):
            if isinstance(event, LinkEvent):
                continue
            data += event.data
            for packet in greeter.feed(event.data) if greeter is not None else ():
                shaken |= bool(packet.reply) and link.write(packet.reply)
            if judge(data, hands_shaken=shaken)[0] or len(data) > _ENOUGH_BYTES:
                break
    finally:
        timer.cancel()
        link.close()
    return data, shaken


def _robot(packets: Sequence[Packet]) -> str:
    for packet in packets:
        if isinstance(packet.report, HelloReport):
            return f"{packet.report.robot} {packet.report.firmware}"
    unknown = all(packet.fault is Fault.UNKNOWN_KIND for packet in packets)
    return "only kinds of lines that are not known" if unknown else ""


def _sample(data: bytes) -> str:
    """A few characters of what was not understood."""
    start = data[:_SAMPLE_CHARACTERS].decode("latin-1")
    shown = "".join(c if c.isprintable() and c.isascii() else "·" for c in start)
    return f"talks, in nothing known: {shown}"
