"""The follower's work: messages → maps → the viewer, and a picture in words at the end."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Finished, Snapshot
from mapping.config import MappingConfig
from mapping.config_text import commented_toml
from mapping.live_pipeline import build_live_maps
from recorder.messages import Message
from replay.terminal import map_lines


def show_live(
    messages: Iterator[Message],
    is_late: Callable[[], bool],
    *,
    url: str,
    config: MappingConfig,
    walls_m: NDArray[np.float64] | None,
    name: str,
) -> str:
    """Map what comes, show it in the viewer at ``url``, and say at the end what came of it.

    A viewer that is closed meanwhile ends nothing. Raises BadInput when nothing could be mapped.
    """
    # A viewer that was closed is reported by Rerun itself, in its own log lines, over and over.
    os.environ.setdefault("RUST_LOG", "off")
    from replay.rrd.live import LiveWriter

    writer = LiveWriter(url, config_text=commented_toml(config), name=name)
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
