"""What is known of a run as a whole, where the viewer lists a recording's properties.

A folder of runs is a table in the viewer; these are its columns. A number that judges a run once it
is known belongs here, too: :func:`note` adds it, under a name of its own.
"""

from __future__ import annotations

from typing import Any

import rerun as rr

from mapping.artifacts import Finished, Started
from replay.rrd.sink import Sink

_ENTITY = "/__properties/run"  # the viewer's own name for properties
COLUMN = "property:run:"  # what a table calls them


def note(sink: Sink, **values: Any) -> None:
    """Add values (text or number each, or a list of one of them) to what is known of a run.

    Of several maps in one recording nothing is noted: its properties would be of all of them.
    """
    if not sink.root:
        sink.log(_ENTITY, rr.AnyValues(**values))


def note_start(sink: Sink, started: Started, config_text: str) -> None:
    """What is known before the first reading."""
    geometry = started.geometry
    note(
        sink,
        layers=", ".join(started.layers),
        cells=f"{geometry.cols} x {geometry.rows}",
        cell_m=geometry.resolution_m,
        duration_s=round((started.last_t_ns - started.first_t_ns) / 1e9, 3),
        rules=", ".join(f"{sensor.name} {sensor.update}" for sensor in started.sensors),
        configuration=config_text,
    )


def note_end(sink: Sink, finished: Finished) -> None:
    """What is known after the last one."""
    note(
        sink,
        sensors=", ".join(finished.used),
        readings=finished.readings,
        dropped=sum(finished.dropped.values()),
    )
