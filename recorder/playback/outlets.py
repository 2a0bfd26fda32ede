"""Where a replayed device sends to: a serial port, a new pseudo-terminal, a TCP server.

Nothing is thrown away here: who sends waits for who reads, for ten seconds at most.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
import typing
from urllib.parse import urlsplit

from recorder.clock import Clock
from recorder.errors import BadInput, LinkError
from recorder.link import DEFAULT_BAUD, Link

PATIENCE_S = 10.0  # how long a reader may take nothing
_POLL_S = 0.02
_SETTLE_S = 0.5  # who opens a serial port throws away what came before it was set up


class Outlet(typing.Protocol):
    """Where bytes go to. ``name`` is what the other side opens, empty for a real serial port."""

    name: str

    def ready(self, stop: threading.Event) -> bool:
        """Wait until somebody listens; False when ``stop`` came first."""

    def send(self, data: bytes) -> None:
        """Send all of it; LinkError when the other side is gone or takes nothing."""

    def close(self) -> None:
        """Let go of it, once the other side has taken all."""


def open_outlet(to: str, *, clock: Clock, baud: int = DEFAULT_BAUD) -> Outlet:
    """``pty``, ``socket``, ``socket://HOST:PORT`` (we listen) or the path of a serial port.

    Raises LinkError or BadInput, in one line.
    """
    if to == "pty":
        return PseudoTerminalOutlet()
    if to == "socket" or to.startswith("socket://"):
        return SocketOutlet(to)
    return SerialOutlet(to, baud, clock)


class SerialOutlet:
    """A real serial port; somebody is taken to listen at the other end of its cable."""

    def __init__(self, path: str, baud: int, clock: Clock) -> None:
        self.name = ""
        self._path = path
        self._link = Link(path, baud, clock=clock)
        self._link.open()

    def ready(self, stop: threading.Event) -> bool:
        """At once."""
        return not stop.is_set()

    def send(self, data: bytes) -> None:
        """Send all of it."""
        if not self._link.write(data):
            raise LinkError(f"{self._path} takes nothing more: is the device still there?")

    def close(self) -> None:
        """Let go of the port."""
        self._link.close()


class PseudoTerminalOutlet:
    """A serial port without hardware, which ``name`` leads to."""

    def __init__(self) -> None:
        try:
            import tty
        except ImportError:  # Windows
            raise LinkError("a pseudo-terminal needs Linux or macOS") from None
        try:
            self._ours, self._theirs = os.openpty()
        except OSError as error:
            raise LinkError(f"no pseudo-terminal to be had: {error.strerror}") from None
        self._set_raw = tty.setraw
        self._set_raw(self._theirs)
        self.name = os.ttyname(self._theirs)
        os.set_blocking(self._ours, False)

    def ready(self, stop: threading.Event) -> bool:
        """Wait until somebody has opened it, and set it up."""
        os.close(self._theirs)  # while nobody has it open, our end shows a hang-up
        try:
            poller = select.poll()
            poller.register(self._ours, select.POLLIN)
            while self._hung_up(poller):
                if stop.wait(_POLL_S):
                    return False
        finally:
            self._theirs = os.open(self.name, os.O_RDWR | os.O_NOCTTY)
            self._set_raw(self._theirs)
        return not stop.wait(_SETTLE_S)

    def send(self, data: bytes) -> None:
        """Send all of it; what the other side sends is thrown away."""
        give_up_s = time.monotonic() + PATIENCE_S
        while data:
            with contextlib.suppress(BlockingIOError):
                os.read(self._ours, 4096)  # so that its line never fills up
            try:
                data = data[os.write(self._ours, data) :]
            except BlockingIOError:
                if time.monotonic() > give_up_s:
                    raise LinkError(f"nobody reads {self.name}") from None
                time.sleep(_POLL_S)

    def close(self) -> None:
        """Hang up, once all was read or nobody seems to read any more.

        The system holds more than it reports, and hands it on bit by bit: all was read when
        nothing has waited for a while.
        """
        changed_s, before = time.monotonic(), self._unread()
        while time.monotonic() - changed_s < _SETTLE_S:
            time.sleep(_POLL_S)
            now = self._unread()
            if now != before:
                changed_s, before = time.monotonic(), now
        os.close(self._theirs)
        os.close(self._ours)

    def _hung_up(self, poller: select.poll) -> bool:
        return any(event & select.POLLHUP for _, event in poller.poll(0))

    def _unread(self) -> int:
        from recorder.simulator.pseudo_terminal import unread_bytes

        return unread_bytes(self._theirs)


class SocketOutlet:
    """A TCP server for one client; ``name`` is its address."""

    def __init__(self, url: str) -> None:
        try:
            parts = urlsplit(url if "://" in url else "socket://127.0.0.1:0")
            host, port = parts.hostname or "127.0.0.1", parts.port or 0
        except ValueError as error:
            raise BadInput(f"{url}: {error}") from None
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise LinkError(f"cannot listen at {host}:{port}: {error.strerror}") from None
        self._listener.settimeout(_POLL_S)
        self.name = f"socket://{host}:{self._listener.getsockname()[1]}"
        self._client: socket.socket | None = None

    def ready(self, stop: threading.Event) -> bool:
        """Wait until somebody has connected."""
        while not stop.is_set():
            with contextlib.suppress(TimeoutError):
                self._client, _ = self._listener.accept()
                self._client.settimeout(PATIENCE_S)
                return True
        return False

    def send(self, data: bytes) -> None:
        """Send all of it."""
        assert self._client is not None
        try:
            self._client.sendall(data)
        except OSError:
            raise LinkError(f"nobody reads {self.name} any more") from None

    def close(self) -> None:
        """End the stream, and hang up."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._client.shutdown(socket.SHUT_WR)
            self._client.close()
        self._listener.close()
