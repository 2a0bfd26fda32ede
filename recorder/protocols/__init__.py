"""Bytes of a device ↔ reports: one small interface, and one table of the protocols that exist.

A protocol is pure and incremental: it takes bytes as they arrive, in pieces of any size, and knows
no port and no clock. To add one, write its class in a file of its own and name it in ``PROTOCOLS``.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping

from recorder.protocols.echogrid import EchogridProtocol
from recorder.protocols.reports import Packet


class Protocol(typing.Protocol):
    """Cuts a stream of bytes into packets; their ``raw`` bytes, joined, are the stream again."""

    name: typing.ClassVar[str]
    default_baud: typing.ClassVar[int]

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that are complete now; it never raises, whatever the bytes are."""

    def close(self) -> list[Packet]:
        """The link went away: what is unfinished, as a fault; feeding may begin afresh."""


PROTOCOLS: Mapping[str, type[Protocol]] = {
    EchogridProtocol.name: EchogridProtocol,
}
