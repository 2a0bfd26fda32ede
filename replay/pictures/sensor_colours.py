"""One colour a sensor, by its name, the same in every picture."""

from __future__ import annotations

from collections.abc import Sequence

from replay.pictures.style import Colour
from replay.rrd import layout


def sensor_colour(sensor: str, sensors: Sequence[str]) -> Colour:
    """The colour of a sensor among all of a session."""
    known = sorted(sensors)
    number = known.index(sensor) if sensor in known else 0
    r, g, b, _ = layout.SENSORS[number % len(layout.SENSORS)]
    return r / 255.0, g / 255.0, b / 255.0
