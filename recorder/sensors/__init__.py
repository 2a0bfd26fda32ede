"""The catalogue of sensors: all that is known of a kind stands in its entry, and nowhere else.

A new sensor is one entry, in the file of its family. Configuration, simulator, importers,
protocols, ``info`` and docs/sensors.md read it from here.
"""

from __future__ import annotations

import re

from recorder.messages import Radiation
from recorder.sensors import infrared, lidars, time_of_flight, ultrasonic
from recorder.sensors.kinds import Faults, ScanPattern, SensorKind, SensorParameters

__all__ = [
    "CATALOGUE", "DEFAULT_SENSORS", "UNKNOWN_KIND", "Faults", "ScanPattern", "SensorKind",
    "SensorParameters", "guess_kind", "kind_of", "kind_of_radiation",
]  # fmt: skip

CATALOGUE: dict[str, SensorKind] = {
    kind.name: kind
    for family in (ultrasonic, infrared, time_of_flight, lidars)
    for kind in family.KINDS
}
DEFAULT_SENSORS = ("ping", "dirrs")  # of the course's robot, and of the simulated one
UNKNOWN_KIND = CATALOGUE["ping"]  # of a sensor that nobody described
_OF_RADIATION = {
    Radiation.ULTRASOUND: "ping", Radiation.INFRARED: "dirrs", Radiation.LASER: "lidar",
}  # fmt: skip


def kind_of_radiation(radiation: Radiation) -> SensorKind:
    """The entry that stands for all sensors of a radiation."""
    return CATALOGUE[_OF_RADIATION[radiation]]


def kind_of(name: str, radiation: Radiation) -> SensorKind:
    """The kind of the sensor ``name``: the one that its name holds, or else its radiation's."""
    return guess_kind(name) or kind_of_radiation(radiation)


def guess_kind(name: str) -> SensorKind | None:
    """``ping``, ``ping2``, ``left_ping`` and ``HC-SR04_left`` name their kind; the longest wins."""
    words = re.findall(r"[a-z0-9]+", name.lower())
    spellings = {
        _plain(spelling): kind
        for kind in CATALOGUE.values()
        for spelling in (kind.name, *kind.aliases)
    }
    runs = ["".join(words[i:k]) for i in range(len(words)) for k in range(i + 1, len(words) + 1)]
    for run in sorted(runs, key=len, reverse=True):
        kind = spellings.get(run) or spellings.get(run.rstrip("0123456789"))
        if kind is not None:
            return kind
    return None


def _plain(spelling: str) -> str:
    return re.sub(r"[^a-z0-9]", "", spelling.lower())
