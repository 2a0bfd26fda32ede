"""What is known of a range sensor by its name: the width of its beam and its limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from recorder.messages import Radiation, Range


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """Full width of the beam, and the ranges that the sensor can measure."""

    beam_width_rad: float
    min_range_m: float
    max_range_m: float
    radiation: Radiation

    def reading(self, t_ns: int, name: str, range_m: float) -> Range:
        """What the sensor ``name``, which is like that, measured."""
        return Range(
            t_ns, name, range_m, self.beam_width_rad, self.min_range_m, self.max_range_m,
            self.radiation,
        )  # fmt: skip


BUILT_IN_SENSORS: Mapping[str, SensorParameters] = MappingProxyType(
    {
        "ping": SensorParameters(math.radians(38.0), 0.02, 4.0, Radiation.ULTRASOUND),
        "dirrs": SensorParameters(math.radians(6.0), 0.1, 0.8, Radiation.INFRARED),
    }
)
UNKNOWN_SENSOR = BUILT_IN_SENSORS["ping"]  # of a sensor that nobody described
