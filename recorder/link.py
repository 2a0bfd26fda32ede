"""Links that bring bytes: serial devices, sockets, and the same link again after it was cut.

A link hands out what arrives, in pieces as large as they come, each stamped with its arrival, and
reports when it was opened or lost. It knows nothing of lines. This module alone imports pyserial.
"""

from __future__ import annotations

import contextlib
import enum
import errno
import os
import select
import socket
import threading
import time
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports

from recorder.clock import Clock
from recorder.errors import BadInput, LinkError

MAX_CHUNK_BYTES = 4096
DEFAULT_BAUD = 115200

_WAIT_S = 0.1  # how long a read may take, thus how soon `stop` is heeded
_WRITE_S = 1.0  # how long a write may take
_CONNECT_S = 3.0
_FIRST_BACKOFF_S = 0.05
_LAST_BACKOFF_S = 1.0
_KEEPALIVE_S = 5  # a host that vanished silently is given up after some of these


@dataclass(frozen=True, slots=True)
class Received:
    """Bytes, and when they had arrived (host clock)."""

    data: bytes
    arrival_ns: int


class LinkState(enum.Enum):
    """What became of a link."""

    OPENED = "opened"
    LOST = "lost"
    REOPENED = "reopened"


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """A link was opened, lost or opened again, and why."""

    state: LinkState
    t_ns: int
    reason: str


class ByteSource(typing.Protocol):
    """Where bytes come from. It ends when there will be no more, or soon after ``stop`` is set."""

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        """Bytes and changes of state in order of arrival; raises LinkError when it gives up."""


class Port(typing.Protocol):
    """Something open that bytes come out of."""

    def read(self) -> bytes:
        """What has arrived, at most 4096 bytes; empty after 0.1 s of silence; OSError when gone."""

    def write(self, data: bytes) -> None:
        """Send all of ``data``; OSError when it is gone or takes nothing for a second."""

    def close(self) -> None:
        """Let go of it."""


class Link:
    """A device path, ``socket://``, ``rfc2217://``, ``tcp://`` or ``udp://``, kept open.

    The first opening must succeed (LinkError otherwise), unless ``wait`` is set; a link that was
    lost is opened again and again, with pauses of 0.05 s to 1 s.
    """

    def __init__(
        self, url: str, baud: int = DEFAULT_BAUD, *, clock: Clock, wait: bool = False
    ) -> None:
        self.url = url
        self._open_port = _opener(url, baud)
        self._clock = clock
        self._wait = wait
        self._port: Port | None = None
        self._in_use = threading.Lock()  # so that nobody writes to a port that is being closed

    def open(self) -> None:
        """Open it now, so that a missing device is known before anything else is begun.

        Raises LinkError, one line with what to do about it.
        """
        if self._port is None:
            try:
                self._port = self._open_port()
            except OSError as error:
                raise LinkError(f"cannot open {self.url}: {_reason(error)}") from None

    def close(self) -> None:
        """Let go of the port. Not while another thread iterates over the events."""
        with self._in_use:
            port, self._port = self._port, None
            if port is not None:
                # what is lost already may complain about being closed
                with contextlib.suppress(OSError):
                    port.close()

    def write(self, data: bytes) -> bool:
        """Send ``data`` to the other side, from any thread; False when that was not possible.

        A link that is gone shows when it is read: nothing is raised here.
        """
        with self._in_use:
            if self._port is None:
                return False
            try:
                self._port.write(data)
            except OSError:
                return False
        return True

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        """Bytes and changes of state, until ``stop`` is set; the port is closed in the end."""
        try:
            if not self._wait:
                self.open()
            state = LinkState.OPENED
            while self._reopen(stop):
                yield LinkEvent(state, self._clock.now_ns(), self.url)
                reason = yield from self._follow(stop)
                self.close()
                if reason:
                    yield LinkEvent(LinkState.LOST, self._clock.now_ns(), reason)
                state = LinkState.REOPENED
        finally:
            self.close()

    def _reopen(self, stop: threading.Event) -> bool:
        """Try until the port is open; False when ``stop`` came first."""
        pause_s = _FIRST_BACKOFF_S
        while not stop.is_set():
            try:
                self.open()
                return True
            except LinkError:
                stop.wait(pause_s)
                pause_s = min(2.0 * pause_s, _LAST_BACKOFF_S)
        return False

    def _follow(self, stop: threading.Event) -> typing.Generator[Received, None, str]:
        """What one open port brings; returns why it ended, nothing when it was stopped."""
        assert self._port is not None
        while not stop.is_set():
            try:
                data = self._port.read()
            except OSError as error:
                return _reason(error)
            if data:
                yield Received(data, self._clock.now_ns())
        return ""


def serial_devices() -> dict[str, str]:
    """The serial devices that the system knows, by path, and what they call themselves."""
    return {
        port.device: "" if port.description == "n/a" else port.description
        for port in sorted(list_ports.comports())
    }


class _SerialPort:
    """A serial port of pyserial: a device or an RFC 2217 server."""

    def __init__(self, url: str, baud: int) -> None:
        try:
            # exclusive: two programs that read one port get half the bytes each
            self._serial = serial.serial_for_url(url, baud, timeout=_WAIT_S, exclusive=True)
            if "://" not in url:  # pyserial's RFC 2217 has no such limit
                self._serial.write_timeout = _WRITE_S
        except ValueError as error:
            raise OSError(str(error)) from None
        self._descriptor: int | None = None
        if os.name == "posix" and "://" not in url:
            self._descriptor = self._serial.fileno()

    def read(self) -> bytes:
        # never readline(): it hands out half a line when time runs out, and reads byte by byte
        if self._descriptor is not None:
            return _read_now(self._descriptor)
        data: bytes = self._serial.read(1)
        if data:
            # a hang-up shows here first; what came before it is kept, the next read has the reason
            with contextlib.suppress(OSError):
                data += self._serial.read(min(self._serial.in_waiting, MAX_CHUNK_BYTES - 1))
        return data

    def write(self, data: bytes) -> None:
        self._serial.write(data)

    def close(self) -> None:
        self._serial.close()


def _read_now(descriptor: int) -> bytes:
    """What waits, in one look and one read: each costs a wait for Python's lock."""
    ready, _, _ = select.select([descriptor], [], [], _WAIT_S)
    if not ready:
        return b""
    try:
        data = os.read(descriptor, MAX_CHUNK_BYTES)
    except BlockingIOError:
        return b""
    if not data:  # something is to be read, and it is the end
        raise OSError(errno.EIO, "the device is gone")
    return data


class _TcpPort:
    """A TCP connection. (pyserial's own ``socket://`` reads it byte by byte.)"""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), timeout=_CONNECT_S)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name in ("TCP_KEEPIDLE", "TCP_KEEPINTVL"):  # not every system has both
            if hasattr(socket, name):
                self._socket.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), _KEEPALIVE_S)
        self._socket.settimeout(_WAIT_S)

    def read(self) -> bytes:
        try:
            data = self._socket.recv(MAX_CHUNK_BYTES)
        except TimeoutError as error:
            if error.errno == errno.ETIMEDOUT:  # keep-alive found nobody
                raise ConnectionResetError("the other side does not answer") from None
            return b""
        if not data:
            raise ConnectionResetError("the other side closed the connection")
        return data

    def write(self, data: bytes) -> None:
        # not sendall(): it gives up when the read's short timeout is over
        give_up_s = time.monotonic() + _WRITE_S
        while data and time.monotonic() < give_up_s:
            with contextlib.suppress(TimeoutError):
                data = data[self._socket.send(data) :]
        if data:
            raise TimeoutError("the other side takes nothing")

    def close(self) -> None:
        self._socket.close()


class _UdpPort:
    """A bound UDP socket; each datagram ends a line."""

    def __init__(self, host: str, port: int) -> None:
        family, kind, proto, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
        )[0]
        self._socket = socket.socket(family, kind, proto)
        try:
            self._socket.bind(address)
        except OSError:
            self._socket.close()
            raise
        self._socket.settimeout(_WAIT_S)

    def read(self) -> bytes:
        try:
            data = self._socket.recv(MAX_CHUNK_BYTES)
        except TimeoutError:
            return b""
        return data if data.endswith(b"\n") or not data else data + b"\n"

    def write(self, data: bytes) -> None:
        raise OSError(errno.EDESTADDRREQ, "nobody to send to: udp:// only listens")

    def close(self) -> None:
        self._socket.close()


SOCKETS: Mapping[str, Callable[[str, int], Port]] = {
    "socket": _TcpPort,
    "tcp": _TcpPort,
    "udp": _UdpPort,
}


def _opener(url: str, baud: int) -> Callable[[], Port]:
    """What opens ``url``; raises BadInput when it can never be opened."""
    scheme, separator, _ = url.partition("://")
    if not separator or scheme == "rfc2217":
        if baud <= 0:
            raise BadInput(f"a baud rate of {baud} makes no sense")
        return lambda: _SerialPort(url, baud)
    if scheme not in SOCKETS:
        raise BadInput(f"{url}: {scheme}:// is not one of rfc2217, {', '.join(SOCKETS)}")
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
        (host or "").encode("idna")
    except ValueError as error:
        raise BadInput(f"{url}: {error}") from None
    if host is None or port is None:
        raise BadInput(f"{url}: {scheme}://HOST:PORT is wanted")
    return lambda: SOCKETS[scheme](host, port)


_ADVICE: Mapping[int, str] = {
    errno.ENOENT: "there is no such device (is it plugged in? echogrid ports lists what is there)",
    errno.EACCES: "no permission (on Linux, join the group dialout)",
    errno.EBUSY: "another program uses it",
    errno.EAGAIN: "another program uses it",
    errno.ENOTTY: "it is not a serial device",
    errno.EISDIR: "it is not a serial device",
    errno.ECONNREFUSED: "nobody listens there",
    errno.EADDRINUSE: "another program uses this port",
    errno.EIO: "the device is gone",
}


def _reason(error: OSError) -> str:
    """The reason of an error of the system, in one line."""
    number, cause = error.errno, error.__context__
    if number is None and cause is not None and cause.args:  # pyserial has it as text alone
        number = cause.args[0]
    advice = _ADVICE.get(number) if isinstance(number, int) else None
    return advice or " ".join(str(error.strerror or error).split())
