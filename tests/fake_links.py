"""Stand-ins for hardware: a serial device to unplug, a server to hang up, a hand clock."""

from __future__ import annotations

import os
import socket
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import serial
import serial.rfc2217

from recorder.link import ByteSource, LinkEvent, Received


class ManualClock:
    """Shows the time that a test sets."""

    def __init__(self, t_ns: int = 1_700_000_000_000_000_000) -> None:
        self.t_ns = t_ns

    def now_ns(self) -> int:
        return self.t_ns


class PtyDevice:
    """A pseudo-terminal behind a name that stays, as /dev/serial/by-id does."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._fds: tuple[int, int] | None = None

    def plug(self) -> None:
        ours, theirs = os.openpty()
        tty.setraw(ours)
        tty.setraw(theirs)
        self._fds = ours, theirs
        self.path.symlink_to(os.ttyname(theirs))

    def write(self, data: bytes) -> None:
        assert self._fds is not None
        while data:
            data = data[os.write(self._fds[0], data) :]

    def read(self) -> bytes:
        assert self._fds is not None
        return os.read(self._fds[0], 4096)

    def unplug(self) -> None:
        assert self._fds is not None
        self.path.unlink()
        for fd in reversed(self._fds):
            os.close(fd)
        self._fds = None


class TcpServer:
    """Listens on a free port of this machine; sends to whoever connected last."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._client: socket.socket | None = None

    def accept(self) -> None:
        self._listener.settimeout(20)
        self._client, _ = self._listener.accept()

    def send(self, data: bytes) -> None:
        assert self._client is not None
        self._client.sendall(data)

    def receive(self) -> bytes:
        assert self._client is not None
        self._client.settimeout(20)
        return self._client.recv(4096)

    def hang_up(self) -> None:
        assert self._client is not None
        self._client.close()

    def close(self) -> None:
        self._listener.close()
        if self._client is not None:
            self._client.close()


class Rfc2217Server(threading.Thread):
    """Serves a pyserial loop port to one client, as ser2net does for a real one."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.to_send = b""
        self.start()

    def run(self) -> None:
        client, _ = self._listener.accept()
        device = serial.serial_for_url("loop://", timeout=0)
        connection = threading.Event()
        writer = type("Writer", (), {"write": lambda _, data: client.sendall(data)})()
        manager = serial.rfc2217.PortManager(device, writer)
        client.settimeout(0.05)
        while not connection.is_set():
            if self.to_send:
                client.sendall(b"".join(manager.escape(self.to_send)))
                self.to_send = b""
            try:
                data = client.recv(1024)
            except TimeoutError:
                continue
            if not data:
                connection.set()
            list(manager.filter(data))
        client.close()
        self._listener.close()


class ScriptedSource:
    """A source that plays a list of events and moves a hand clock along."""

    def __init__(self, clock: ManualClock, events: list[Received | LinkEvent]) -> None:
        self._clock = clock
        self._events = events

    def events(self, stop: threading.Event) -> Iterator[Received | LinkEvent]:
        for event in self._events:
            t_ns = event.arrival_ns if isinstance(event, Received) else event.t_ns
            self._clock.t_ns = max(self._clock.t_ns, t_ns)
            yield event


class Collector(threading.Thread):
    """Iterates over a source in the background and keeps what came."""

    def __init__(self, source: ByteSource) -> None:
        super().__init__(daemon=True)
        self._source = source
        self.stop = threading.Event()
        self.changed = threading.Condition()
        self.events: list[Received | LinkEvent] = []
        self.start()

    def run(self) -> None:
        for event in self._source.events(self.stop):
            with self.changed:
                self.events.append(event)
                self.changed.notify_all()

    @property
    def data(self) -> bytes:
        return b"".join(e.data for e in self.events if isinstance(e, Received))

    @property
    def states(self) -> list[str]:
        return [e.state.value for e in self.events if isinstance(e, LinkEvent)]

    def wait_for_data(self, data: bytes) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: data in self.data, timeout=20), self.events

    def wait_for_states(self, *states: str) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: self.states == list(states), 20), self.events

    def finish(self) -> None:
        self.stop.set()
        self.join(20)
        assert not self.is_alive()
