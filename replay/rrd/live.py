"""Artifacts → a viewer that is open already, while they come about.

Nothing is written to a file. A viewer that was closed is no error: what would have been shown is
lost, and nothing else.
"""

from __future__ import annotations

import logging
import socket
import time
import urllib.parse
import uuid
from collections.abc import Callable

import rerun as rr

from mapping.artifacts import Artifact, Started
from replay.rrd.blueprints import default_blueprint
from replay.rrd.writer import APPLICATION, RrdWriter

_SHOW_EVERY_S = 0.2
_LOOK_S = 2.0
_FLUSH_S = 5.0  # a viewer that takes longer is gone or hangs

_log = logging.getLogger(__name__)


class LiveWriter:
    """Shows each run of artifacts in the viewer at ``url``; a grown map is a new recording there.

    ``now_s`` is a steady clock.
    """

    def __init__(
        self, url: str, *, config_text: str, name: str, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._url, self._config_text, self._name, self._now_s = url, config_text, name, now_s
        self._run: _Run | None = None

    def __call__(self, artifact: Artifact) -> None:
        """Show one artifact; the first is :class:`Started`."""
        if isinstance(artifact, Started):
            self.close()
            self._run = _Run(self._url, self._config_text, self._name, self._now_s)
            self._run.is_gone = not _somebody_listens(self._url)
        if self._run is None:
            raise TypeError(f"the first artifact is Started, not {type(artifact).__name__}")
        if not self._run.is_gone:
            self._run(artifact)

    def close(self) -> None:
        """Show what waits, and let go of the viewer, which stays."""
        if self._run is not None:
            self._run.close()
            self._run = None


class _Run(RrdWriter):
    """A writer whose rows go to a viewer, several times a second."""

    def __init__(self, url: str, config_text: str, name: str, now_s: Callable[[], float]) -> None:
        super().__init__(name, config_text=config_text, name=name)
        self._url, self._now_s = url, now_s
        self._shown_s = now_s()
        self.is_gone = False

    def _open(self, started: Started) -> rr.RecordingStream:
        recording = rr.RecordingStream(APPLICATION, recording_id=str(uuid.uuid4()))
        recording.set_log_time_enabled(False)
        recording.connect_grpc(
            self._url, default_blueprint=default_blueprint(started, following=True)
        )
        recording.send_recording_name(self._name)
        return recording

    def _review(self) -> None:
        if self._now_s() - self._shown_s >= _SHOW_EVERY_S:
            self._flush()
            self._shown_s = self._now_s()

    def _flush(self) -> None:
        if self._recording is None or self.is_gone:
            return
        for rows in self._buffers():
            rows.send()
        try:
            self._recording.flush(timeout_sec=_FLUSH_S)
        except (RuntimeError, OSError, TimeoutError) as error:
            self.is_gone = True  # waiting for it again at every flush would hold up the map
            _log.info("the viewer does not answer: %s", error)

    def close(self) -> None:
        """Show what waits, and let go of the viewer."""
        self._flush()
        if self._recording is not None and not self.is_gone:  # a lost one is waited for in vain
            self._recording.disconnect()
        self._recording = None


def _somebody_listens(url: str) -> bool:
    """Whether there is a viewer: Rerun itself would wait for one, several seconds each time."""
    parts = urllib.parse.urlsplit(url)
    try:
        with socket.create_connection((parts.hostname or "", parts.port or 0), _LOOK_S):
            return True
    except OSError:
        return False
