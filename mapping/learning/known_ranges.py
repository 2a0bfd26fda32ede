"""What the readings of a sensor should have been: by walls, by a map, or by a tape measure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mapping.config import MappingConfig
from mapping.config_sections import sensor_section
from mapping.learning.mixture import Pairs
from mapping.parameters import Sensor
from mapping.readings import Readings
from mapping.scoring.held_out import blocks_of
from recorder.columns import Floats, Ints

MOST_READINGS = 20_000  # of a sensor: more say nothing new
WIDEST = 1.5  # times the stated beam: how wide a beam is looked for
REACHED = 0.88  # of its limit
_RAY_SPACING_RAD = math.radians(1.0)
_AT_ONCE = 400


@dataclass(frozen=True, slots=True)
class KnownRanges:
    """N readings of one sensor, and how far it is to the first thing along J rays of each beam.

    ``range_m`` (N,) is +Inf where there was no echo. ``bearings_rad`` (J,) are the rays' directions
    from the axis, ``true_m`` and ``incidence_rad`` (N, J) what each meets: how far (+Inf: nothing),
    and at which angle to the normal (NaN where it is not known). ``t_ns`` and ``block`` are (N,).
    """

    sensor: Sensor
    range_m: Floats
    bearings_rad: Floats
    true_m: Floats
    incidence_rad: Floats
    t_ns: Ints
    block: Ints

    def within(self, width_rad: float) -> tuple[Pairs, Floats]:
        """The readings against the nearest thing in a beam of that width, and its incidence (N,).

        What lies near the sensor's limit or beyond is left out: of it only the short half of the
        readings would come.
        """
        inside = np.flatnonzero(np.abs(self.bearings_rad) <= width_rad / 2.0 + 1e-9)
        nearest = inside[np.argmin(self.true_m[:, inside], axis=1)]
        rows = np.arange(len(self.range_m))
        true_m = self.true_m[rows, nearest]
        incidence_rad = self.incidence_rad[rows, nearest]
        near = true_m < REACHED * self.sensor.max_range_m
        pairs = Pairs(self.range_m, true_m, self.sensor.max_range_m, self.block).select(near)
        return pairs, incidence_rad[near]


def as_measured(config: MappingConfig) -> MappingConfig:
    """The configuration without what would mend or drop ranges: they are learned as they came."""
    changes = {"no_echo": "empties", "range_scale": 1.0, "range_bias_m": 0.0}
    sensors = {"*": None, **config.sensors}
    plain = {
        name: (section or sensor_section()()).model_copy(update=changes)
        for name, section in sensors.items()
    }
    return config.model_copy(update={"sensors": plain})


def from_walls(
    placed: Iterable[Readings], name: str, walls_m: Floats, *, through: Floats | None = None
) -> KnownRanges:
    """Against true walls (K, 2, 2). ``through``: what is left of them for light, past glass."""
    from recorder.messages import Radiation
    from recorder.simulator.echoes import cast

    readings, axes, row, sensor = _axes_of(placed, name)
    if through is not None and sensor.radiation is not Radiation.ULTRASOUND:
        walls_m = through
    count = max(1, math.ceil(WIDEST * sensor.beam_width_rad / 2.0 / _RAY_SPACING_RAD))
    is_scan = len(readings.ranges_m) != len(readings)
    half_rad = 0.0 if is_scan else count * _RAY_SPACING_RAD
    bearings_rad = np.zeros(1) if is_scan else np.linspace(-half_rad, half_rad, 2 * count + 1)
    start = readings.world_from_sensor
    origin_m = np.column_stack([start.x_m[row], start.y_m[row]])
    heading_rad = start.heading_rad[row] + readings.bearings_rad[axes]
    true_m, incidence_rad = [], []
    for first in range(0, len(axes), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        rays_rad = (heading_rad[some, None] + bearings_rad).ravel()
        hits = cast(walls_m, np.repeat(origin_m[some], len(bearings_rad), axis=0), rays_rad)
        true_m.append(hits.distance_m.reshape(-1, len(bearings_rad)))
        incidence_rad.append(hits.incidence_rad.reshape(-1, len(bearings_rad)))
    return _known(
        readings, axes, row, sensor, bearings_rad, np.concatenate(true_m),
        np.concatenate(incidence_rad),
    )  # fmt: skip


def from_map(
    readings: Readings,
    axes_row: Ints,
    expected_m: Floats,
    name: str,
    bearings_rad: Floats | None = None,
) -> KnownRanges:
    """Against the ranges that a map predicts for each axis, (K,) or (K, J): of J rays across it.

    ``bearings_rad`` (J,) are those of the rays; without them one stands for the whole beam.
    """
    number = next(k for k, sensor in enumerate(readings.sensors) if sensor.name == name)
    axes = _some(np.flatnonzero(readings.sensor[axes_row] == number))
    row, sensor = axes_row[axes], readings.sensors[number]
    true_m = expected_m[axes].reshape(len(axes), -1)
    across_rad = np.zeros(1) if bearings_rad is None else bearings_rad
    return _known(readings, axes, row, sensor, across_rad, true_m, np.full_like(true_m, np.nan))


def from_tape(sensor: Sensor, ranges_m: list[Floats], distances_m: list[float]) -> KnownRanges:
    """Readings taken in front of a wall at distances that were measured."""
    range_m = np.concatenate(ranges_m)
    true_m = np.repeat(distances_m, [len(each) for each in ranges_m])[:, None]
    nothing = np.zeros(len(range_m), np.int64)
    block = np.arange(len(range_m))
    return KnownRanges(sensor, range_m, np.zeros(1), true_m, np.zeros_like(true_m), nothing, block)


def _axes_of(placed: Iterable[Readings], name: str) -> tuple[Readings, Ints, Ints, Sensor]:
    """All readings, some axes of the sensor's, the row of each, and the sensor."""
    readings = Readings.joined(list(placed))
    axis_row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
    number = next(k for k, sensor in enumerate(readings.sensors) if sensor.name == name)
    axes = _some(np.flatnonzero(readings.sensor[axis_row] == number))
    return readings, axes, axis_row[axes], readings.sensors[number]


def _some(axes: Ints) -> Ints:
    """At most so many as there may be, spread evenly."""
    return axes[:: max(1, -(-len(axes) // MOST_READINGS))]


def _known(
    readings: Readings, axes: Ints, row: Ints, sensor: Sensor, bearings_rad: Floats,
    true_m: Floats, incidence_rad: Floats,
) -> KnownRanges:  # fmt: skip
    block, _ = blocks_of(len(axes))
    return KnownRanges(
        sensor, readings.ranges_m[axes], bearings_rad, true_m, incidence_rad,
        readings.t_ns[row], block,
    )  # fmt: skip
