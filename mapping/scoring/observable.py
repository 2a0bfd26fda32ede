"""Which cells the sensors of a session could have observed between true walls."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mapping.config import MappingConfig
from mapping.config_sections import sensor_section
from mapping.fusion import FUSED
from mapping.grid import GridGeometry
from mapping.readings import Readings
from mapping.scoring.truth import Truth
from recorder.messages import Radiation

Flags = NDArray[np.bool_]


def with_silent_readings(config: MappingConfig) -> MappingConfig:
    """The same configuration, but that readings without echo are kept: they look somewhere too."""
    sensors = {"*": None, **config.sensors}
    looking = {
        name: (section or sensor_section()()).model_copy(update={"no_echo": "empties"})
        for name, section in sensors.items()
    }
    return config.model_copy(update={"sensors": looking})


def observable_cells(
    placed: Iterable[Readings], truth: Truth, geometry: GridGeometry
) -> dict[str, Flags]:
    """By layer, the cells (rows, cols) that its sensors could see, walls included; and ``fused``.

    A cell counts where a straight way leads to it, within a beam's true cone and reach and past
    no wall. Light passes glass: it could see what is behind, and not the glass. The readings are
    those of :func:`with_silent_readings`, their ranges do not matter.
    """
    from mapping.kernels.visibility import mark_seen

    to_sound, to_light = (truth.wall_cells(geometry, to_light=light) for light in (False, True))
    seen: dict[str, Flags] = {}
    across = math.hypot(*geometry.shape) + 1.0
    for readings in placed:
        start, axis_row = readings.world_from_sensor, readings.axes_of(np.arange(len(readings)))
        of_axis = readings.sensor[axis_row]
        for number, sensor in enumerate(readings.sensors):
            mine = of_axis == number
            if not mine.any():
                continue
            row = axis_row[mine]
            reach = min(sensor.max_range_m / geometry.resolution_m, across)
            beams = np.column_stack([
                (start.x_m[row] - geometry.origin_m[0]) / geometry.resolution_m,
                (start.y_m[row] - geometry.origin_m[1]) / geometry.resolution_m,
                start.heading_rad[row] + readings.bearings_rad[mine],
                np.full(len(row), sensor.beam_width_rad / 2.0),
                np.full(len(row), reach),
            ])  # fmt: skip
            cells = seen.setdefault(sensor.layer, np.zeros(geometry.shape, np.bool_))
            if sensor.radiation is Radiation.ULTRASOUND:
                mark_seen(cells, to_sound, beams)
                continue
            by_light = np.zeros(geometry.shape, np.bool_)
            mark_seen(by_light, to_light, beams)
            cells |= by_light & (to_light | ~to_sound)
    if seen:
        seen.setdefault(FUSED, np.logical_or.reduce(list(seen.values())))
    return seen
