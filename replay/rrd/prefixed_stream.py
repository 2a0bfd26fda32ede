"""Several maps in one recording: each lies, whole, below a root of its own that bears its name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rerun as rr

from recorder.errors import BadInput
from replay.rrd import layout
from replay.rrd.reader import RrdRecording, map_names, read_rrd


def root_of(name: str) -> str:
    """Where all of one map lies."""
    return f"/{layout.part(name)}"


class PrefixedStream:
    """A recording stream that puts all it is handed below a root, and leaves some entities out.

    It knows the calls that drawing makes: ``log`` and ``send_columns``.
    """

    def __init__(
        self, recording: rr.RecordingStream, root: str, *, without: Sequence[str] = ()
    ) -> None:
        self._recording, self._root = recording, root
        self._without = tuple(without)

    def log(self, entity: str, *what: Any, **options: Any) -> None:
        """As of the stream itself."""
        if not entity.startswith(self._without):
            self._recording.log(self._root + entity, *what, **options)

    def send_columns(self, entity: str, *what: Any, **options: Any) -> None:
        """As of the stream itself."""
        if not entity.startswith(self._without):
            self._recording.send_columns(self._root + entity, *what, **options)


def read_maps(path: str | Path) -> dict[str, RrdRecording]:
    """All maps of a recording that compares some, each to be read like one of its own, by name.

    Raises BadInput for a file that holds no such recording.
    """
    names = map_names(path)
    if not names:
        raise BadInput(f"{path}: holds one map, not several side by side")
    return {name: read_rrd(path, root_of(name)) for name in names}
