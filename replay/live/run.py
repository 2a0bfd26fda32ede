"""One live run: the recorder in this process, the map in another, the viewer in a third.

Whatever becomes of the other two, the recording goes on and loses nothing.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mapping.config import MappingConfig
from recorder.messages import Message
from recorder.recording import RecordingStatus, SessionSink
from recorder.recording.options import RecordingOptions
from recorder.recording.run import record_line
from recorder.translation import RecordingCounters
from replay.live.feed import CAPACITY, LiveEnd, LiveFeed, Work
from replay.live.show import show_live

PATIENCE_S = 60.0  # for the last results, once the recording has ended


@dataclass(frozen=True, slots=True)
class LiveResult:
    """What was recorded, and how the map that followed it ended."""

    counters: RecordingCounters
    end: LiveEnd


def record_and_show(
    source: str,
    output: Path,
    options: RecordingOptions,
    config: MappingConfig,
    *,
    viewer_url: str,
    stop: threading.Event,
    pause: threading.Event | None = None,
    on_status: Callable[[RecordingStatus], None] | None = None,
    status_period_s: float = 1.0,
    patience_s: float = PATIENCE_S,
    capacity: int = CAPACITY,
    on_follower: Callable[[int | None], None] | None = None,
) -> LiveResult:
    """Record a line as :func:`recorder.recording.run.record_line` does, and show its map meanwhile.

    The map goes to the viewer at ``viewer_url``; ``on_follower`` is told the number of the process
    that makes it. Raises what ``record_line`` raises.
    """
    with LiveFeed(_work(options, config, viewer_url, output.name), capacity=capacity) as feed:
        if on_follower is not None:
            on_follower(feed.process_id)
        counters = record_line(
            source, output, options, stop=stop, pause=pause, on_status=on_status,
            status_period_s=status_period_s, wrap=lambda session: _Tee(session, feed),
        )  # fmt: skip
        return LiveResult(counters, feed.finish(patience_s))


class _Tee:
    """A session whose messages are offered to a follower once they are written."""

    def __init__(self, session: SessionSink, feed: LiveFeed) -> None:
        self._session, self._feed = session, feed

    def write(self, message: Message, *, log_ns: int) -> None:
        """Write first; the follower gets what is safe."""
        self._session.write(message, log_ns=log_ns)
        self._feed.offer(message)

    def sync(self) -> None:
        """See to it that what was written is on the disk."""
        self._session.sync()


def _work(options: RecordingOptions, config: MappingConfig, viewer_url: str, name: str) -> Work:
    walls_m = None
    if options.walls is not None:
        from recorder.truth import walls_from_geojson

        walls_m = walls_from_geojson(options.walls)
    return functools.partial(show_live, url=viewer_url, config=config, walls_m=walls_m, name=name)
