"""Where drawing goes: a Rerun recording, or the part of it that lies below one root.

Rows wait here, by entity, and go to the recording many at a time. Calling the viewer's ``log`` once
for each thing of each step would take far longer, and versions of one tile that lie next to each
other compress far better.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from replay.rrd import layout
from replay.rrd.background import Background

APPLICATION = "echogrid"

Columns = list[rr.ComponentColumn]
Pack = Callable[[Sequence[Any]], Columns]
"""Turns the values of many rows into columns; knows what an entity looks like, not when."""


def new_recording() -> rr.RecordingStream:
    """A recording that is not yet anywhere, without Rerun's own clock."""
    recording = rr.RecordingStream(APPLICATION, recording_id=str(uuid.uuid4()))
    recording.set_log_time_enabled(False)
    return recording


@dataclass(frozen=True, slots=True)
class Stamp:
    """When something is shown, on each of the three timelines."""

    step: int
    reading: int
    t_ns: int


@dataclass(frozen=True, slots=True)
class Sink:
    """A recording, in a file or a viewer; of several maps each has a ``root`` of its own in it.

    Entities that begin with one of ``without`` are left out.
    """

    recording: rr.RecordingStream
    root: str = ""
    without: tuple[str, ...] = ()

    def log(self, entity: str, *what: rr.AsComponents) -> None:
        """Write something that never changes."""
        if not entity.startswith(self.without):
            self.recording.log(self.root + entity, *what, static=True, strict=True)

    def send(self, entity: str, stamps: Sequence[Stamp], what: Columns) -> None:
        """Write many rows of one entity."""
        if entity.startswith(self.without):
            return
        times = np.array([stamp.t_ns for stamp in stamps], np.int64)
        indexes = [
            rr.TimeColumn(layout.STEP, sequence=[stamp.step for stamp in stamps]),
            rr.TimeColumn(layout.READING, sequence=[stamp.reading for stamp in stamps]),
            rr.TimeColumn(layout.TIME, timestamp=times.view("datetime64[ns]")),
        ]
        self.recording.send_columns(self.root + entity, indexes, what, strict=True)


class RowBuffer:
    """Rows by entity and pack, until they are sent.

    ``bytes`` is roughly what waits, ``chunks`` how many were sent; ``exact_bytes`` is what exact
    values took of all that was ever added; ``background`` makes what is added in a while.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self.background = Background()
        self._rows: dict[tuple[str, Pack], tuple[list[Stamp], list[Any]]] = {}
        self._before_sending: list[Callable[[], None]] = []
        self.bytes = 0
        self.chunks = 0
        self.exact_bytes = 0

    def add(self, entity: str, pack: Pack, stamp: Stamp, value: Any, size: int = 64) -> None:
        """Keep one row; ``size`` is how many bytes its value takes."""
        stamps, values = self._rows.setdefault((entity, pack), ([], []))
        stamps.append(stamp)
        values.append(value)
        self.bytes += size

    def add_exact(self, entity: str, pack: Pack, stamp: Stamp, value: Any, size: int) -> None:
        """Keep one row of exact values."""
        self.add(entity, pack, stamp, value, size)
        self.exact_bytes += size

    def before_sending(self, last_call: Callable[[], None]) -> None:
        """Call this before rows are sent, to add what was held back."""
        self._before_sending.append(last_call)

    def send(self) -> None:
        """Hand all rows to the sink, as one chunk for each entity and pack.

        The records of the steps go last: a file that was cut off never lists a step whose values
        it lost.
        """
        for last_call in self._before_sending:
            last_call()
        in_order = sorted(self._rows.items(), key=lambda rows: rows[0][0] == layout.STEPS)
        for (entity, pack), (stamps, values) in in_order:
            self._sink.send(entity, stamps, pack(values))
        self.chunks += len(self._rows)
        self._rows.clear()
        self.bytes = 0
