"""Artifacts → a viewer that is open already, while they come about.

Nothing is written to a file. A viewer that was closed is no error: what would have been shown is
lost, and nothing else.
"""

from __future__ import annotations

import logging
import socket
import time
import urllib.parse
from collections.abc import Callable

import rerun as rr

from mapping.artifacts import Artifact, Started
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.sink import Sink, new_recording
from replay.rrd.thinning import Detail

_SHOW_EVERY_S = 0.2
_LOOK_S = 2.0
_FLUSH_S = 5.0  # a viewer that takes longer is gone or hangs

_log = logging.getLogger(__name__)


class LiveWriter:
    """Shows each run of artifacts in the viewer at ``url``; a grown map is a new recording there.

    ``drawer`` makes what draws one run, ``now_s`` is a steady clock.
    """

    def __init__(
        self,
        url: str,
        *,
        drawer: Callable[[], RunDrawer],
        name: str,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._url, self._new_drawer, self._name, self._now_s = url, drawer, name, now_s
        self._drawer: RunDrawer | None = None
        self._recording: rr.RecordingStream | None = None
        self._shown_s = 0.0
        self._is_gone = True

    def __call__(self, artifact: Artifact) -> None:
        """Show one artifact; the first is :class:`Started`."""
        if isinstance(artifact, Started):
            self.close()
            self._begin(artifact)
        elif self._drawer is None:
            raise TypeError(f"the first artifact is Started, not {type(artifact).__name__}")
        elif not self._is_gone:
            if self._drawer.begins_reading(artifact):
                self._show_in_time()
            self._drawer.draw(artifact, Detail())

    def close(self) -> None:
        """Show what waits, and let go of the viewer, which stays."""
        if not self._is_gone:
            self._flush()
        if self._recording is not None and not self._is_gone:  # a lost one is waited for in vain
            self._recording.disconnect()
        self._drawer = self._recording = None
        self._is_gone = True

    def _begin(self, started: Started) -> None:
        self._drawer = self._new_drawer()
        self._shown_s = self._now_s()
        self._is_gone = not _somebody_listens(self._url)
        if self._is_gone:
            return
        self._recording = new_recording()
        self._recording.connect_grpc(self._url, default_blueprint=self._drawer.blueprint(started))
        self._recording.send_recording_name(self._name)
        self._drawer.begin(Sink(self._recording), started)
        self._flush()

    def _show_in_time(self) -> None:
        """What waits is shown several times a second."""
        if self._now_s() - self._shown_s >= _SHOW_EVERY_S:
            self._flush()
            self._shown_s = self._now_s()

    def _flush(self) -> None:
        assert self._drawer is not None
        assert self._recording is not None
        for rows in self._drawer.buffers:
            rows.send()
        try:
            self._recording.flush(timeout_sec=_FLUSH_S)
        except (RuntimeError, OSError, TimeoutError) as error:
            self._is_gone = True  # waiting for it again at every flush would hold up the map
            _log.info("the viewer does not answer: %s", error)


def _somebody_listens(url: str) -> bool:
    """Whether there is a viewer: Rerun itself would wait for one, several seconds each time."""
    parts = urllib.parse.urlsplit(url)
    try:
        with socket.create_connection((parts.hostname or "", parts.port or 0), _LOOK_S):
            return True
    except OSError:
        return False
