"""One live run: the recorder in this process, the map in another, the viewer in a third.

Whatever becomes of the other two, the recording goes on and loses nothing.
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Finished, Snapshot
from mapping.config import MappingConfig
from mapping.live_pipeline import build_live_maps
from recorder.messages import Message
from recorder.recording import RecordingStatus, SessionSink
from recorder.recording.options import RecordingOptions
from recorder.recording.run import record_line
from recorder.translation import RecordingCounters
from replay.live.feed import CAPACITY, LiveEnd, LiveFeed, Work
from replay.terminal import map_lines

STAGES_EVERY = 200  # readings, after which maps are fused anew unless the configuration says when
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

    The map goes to the viewer at ``viewer_url``; ``on_follower`` gets the number of the process
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


def show_live(
    messages: Iterator[Message],
    is_late: Callable[[], bool],
    *,
    url: str,
    config: MappingConfig,
    walls_m: NDArray[np.float64] | None,
    name: str,
) -> str:
    """Map what comes, show it in the viewer at ``url``, and return a report of what came of it.

    A viewer that is closed meanwhile ends nothing. Raises BadInput when nothing could be mapped.
    """
    # A viewer that was closed is reported by Rerun itself, in its own log lines, over and over.
    os.environ.setdefault("RUST_LOG", "off")
    from replay.rrd.live import LiveWriter
    from replay.rrd.run_drawer import live_drawer

    if not config.rerun.stages_every:  # else the fused map would be that of the first moments
        stages = config.rerun.model_copy(update={"stages_every": STAGES_EVERY})
        config = config.model_copy(update={"rerun": stages})
    writer = LiveWriter(url, drawer=functools.partial(live_drawer, config), name=name)
    last: Snapshot | None = None
    finished: Finished | None = None
    for artifact in build_live_maps(messages, config, walls_m=walls_m, is_late=is_late):
        writer(artifact)
        if isinstance(artifact, Snapshot):
            last = artifact
        elif isinstance(artifact, Finished):
            finished = artifact
    writer.close()
    if last is None or finished is None:
        return ""
    return "\n".join(map_lines(last.layer, finished))
