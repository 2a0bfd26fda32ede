"""A simulated overhead tracker: poses as JSON lines for whoever connects over TCP."""

from __future__ import annotations

import contextlib
import json
import math
import socket

from recorder.geometry import SE2

_BACKLOG_BYTES = 65_536


class TrackerServer:
    """Listens on a port of 127.0.0.1, by default a free one; nothing here blocks.

    A client that does not keep up misses whole lines, never parts of one; one that has not read
    for long is let go.
    """

    def __init__(self, port: int = 0) -> None:
        self._listener = socket.create_server(("127.0.0.1", port))
        self._listener.setblocking(False)
        self._waiting: dict[socket.socket, bytearray] = {}

    @property
    def url(self) -> str:
        """Where to connect: ``tcp://127.0.0.1:PORT``."""
        return f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._waiting)

    def send(self, t_s: float, world_from_base: SE2) -> None:
        """Send where the robot was at ``t_s`` (UNIX seconds of the host's clock)."""
        line = json.dumps(
            {
                "t_s": round(t_s, 6),
                "x": round(world_from_base.x_m, 4),
                "y": round(world_from_base.y_m, 4),
                "heading_deg": round(math.degrees(world_from_base.heading_rad), 2),
            }
        )
        for client in list(self._waiting):
            self._waiting[client] += line.encode("ascii") + b"\n"
            self._push(client)

    def accept(self) -> None:
        """Accept those who connected since."""
        with contextlib.suppress(BlockingIOError, ConnectionError):
            while True:
                client, _ = self._listener.accept()
                client.setblocking(False)
                self._waiting[client] = bytearray()

    def close(self) -> None:
        """Close all connections."""
        for connection in (*self._waiting, self._listener):
            connection.close()
        self._waiting.clear()

    def _push(self, client: socket.socket) -> None:
        waiting = self._waiting[client]
        try:
            del waiting[: client.send(waiting)]
            gone = False
        except BlockingIOError:
            gone = len(waiting) > _BACKLOG_BYTES
        except OSError:
            gone = True
        if gone:
            del self._waiting[client]
            client.close()
