"""What a sensor measures between known walls, with the faults of real ones.

A sonar measures the nearest surface in its cone that sends enough sound back. A surface does so
when the beam meets it nearly square; beyond some 25 degrees (more where it is rough, less where it
is glass) it acts as a mirror, and the echo comes from what the mirror shows, by a longer way. A
right-angled corner sends sound back whatever the angle. An infrared ranger and a laser measure
along a thin line, or average a cone, and no surface mirrors their light; it passes through glass.

``noise`` scales every fault of a kind at once: the width of the sonar's cone, the mirrors, the
share of short and lost echoes, the spread of the readings. 1 is a usual cheap sensor; 0 a perfect
one: the exact distance, along the axis alone, of the nearest wall. Only with noise are readings
whole multiples of the kind's resolution. Every reading draws equally many
random numbers, whatever ``noise`` is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.geometry import SE2
from recorder.messages import Radiation
from recorder.sensors import ScanPattern, SensorKind
from recorder.simulator.surfaces import MIRROR_DEG, WallSurfaces
from recorder.simulator.walls import Points, Walls

_MIRROR_SPREAD_DEG = 4.0
_MIRRORED_SHARE = 0.8  # of the sound is left after the detour over a mirror
_CORNER_RAD = math.radians(10.0)  # two walls that turn the sound back by this much are a corner
_CORNER_SHARE = 0.2  # of the way there: how far apart the sound may meet the corner's two walls
_EDGE_LOUDNESS = 0.4  # of the cone, against its axis
_QUIETEST, _LOUDEST = 0.15, 0.5  # how loud an echo must be: drawn for each ping
_PEAK_SHARE = 0.6  # of the least range of a triangulating sensor: nearer, its curve turns back
_ADC_STEP_V = 5.0 / 1023.0  # ten bits over five volts, as a usual board has them
_RAY_SPACING_RAD = math.radians(1.0)
_END_TOLERANCE = 1e-9  # of a wall's length: no ray slips through where two walls meet


@dataclass(frozen=True, slots=True)
class Hits:
    """What rays (N,) meet: how far, at which angle to the wall's normal, and which way it faces.

    ``distance_m`` is +Inf where there is nothing. ``incidence_rad`` lies in [0, π/2];
    ``wall_rad`` is the direction along the wall, and ``wall`` its number.
    """

    distance_m: NDArray[np.float64]
    incidence_rad: NDArray[np.float64]
    wall_rad: NDArray[np.float64]
    wall: NDArray[np.intp]

    def select(self, which: NDArray[np.bool_]) -> Hits:
        """Some of the rays."""
        return Hits(
            self.distance_m[which], self.incidence_rad[which], self.wall_rad[which],
            self.wall[which],
        )  # fmt: skip


def cast(walls_m: Walls, origins_m: Points, headings_rad: NDArray[np.float64]) -> Hits:
    """The nearest wall on each of N rays, each met at a distance above zero.

    ``walls_m`` (K, 2, 2), ``origins_m`` (N, 2) or (2,), ``headings_rad`` (N,). A wall that runs
    along a ray is met at its neighbours. Solves ``origin + t·ray = start + u·wall`` by Cramer's
    rule for all pairs at once.
    """
    ray_x, ray_y = np.cos(headings_rad)[:, None], np.sin(headings_rad)[:, None]
    wall_x, wall_y = (walls_m[:, 1] - walls_m[:, 0]).T
    origins_m = np.atleast_2d(origins_m)
    to_wall_x = walls_m[:, 0, 0] - origins_m[:, 0, None]
    to_wall_y = walls_m[:, 0, 1] - origins_m[:, 1, None]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        inverse = 1.0 / (ray_x * wall_y - ray_y * wall_x)
        along_ray = (to_wall_x * wall_y - to_wall_y * wall_x) * inverse
        along_wall = (to_wall_x * ray_y - to_wall_y * ray_x) * inverse
        met = (along_ray > 1e-9) & (np.abs(along_wall - 0.5) <= 0.5 + _END_TOLERANCE)
    distance_m = np.where(met, along_ray, np.inf)
    nearest = np.argmin(distance_m, axis=1)
    wall_rad = np.arctan2(wall_y, wall_x)[nearest]
    incidence_rad = np.arccos(np.clip(np.abs(np.sin(headings_rad - wall_rad)), 0.0, 1.0))
    return Hits(distance_m[np.arange(len(nearest)), nearest], incidence_rad, wall_rad, nearest)


def range_reading(
    walls_m: Walls,
    world_from_sensor: SE2,
    kind: SensorKind,
    noise: float,
    rng: np.random.Generator,
    surfaces: WallSurfaces | None = None,
) -> float:
    """One reading in metres; +Inf: nothing seen; -Inf: too close to measure.

    ``surfaces``: of the walls (K,), where not all are smooth.
    """
    chances, spreads = rng.random(4), rng.standard_normal(2)
    if kind.radiation is Radiation.ULTRASOUND:
        range_m = _sonar(walls_m, world_from_sensor, kind, noise, chances, spreads, surfaces)
    else:
        opaque_m = _opaque(walls_m, surfaces)
        range_m = _light(opaque_m, world_from_sensor, kind, noise, spreads)
    step_m = kind.faults.resolution_m
    if step_m and noise and math.isfinite(range_m):
        range_m = step_m * round(range_m / step_m)
    if range_m > kind.max_range_m:
        return math.inf
    if range_m < kind.min_range_m:
        return kind.min_range_m if kind.faults.clips else -math.inf
    return range_m


def scan_reading(
    walls_m: Walls,
    world_from_sensor: SE2,
    kind: SensorKind,
    pattern: ScanPattern,
    noise: float,
    rng: np.random.Generator,
    surfaces: WallSurfaces | None = None,
) -> NDArray[np.float64]:
    """One scan: ranges (N,) in metres along the beams of ``pattern``, ±Inf as for a ranger."""
    walls_m = _opaque(walls_m, surfaces)
    origin_m = np.array([world_from_sensor.x_m, world_from_sensor.y_m])
    hits = cast(walls_m, origin_m, world_from_sensor.heading_rad + pattern.bearings_rad)
    met_m = np.where(np.isfinite(hits.distance_m), hits.distance_m, 0.0)
    spread_m = kind.faults.error_m + kind.faults.error * met_m
    ranges_m = hits.distance_m + spread_m * noise * rng.standard_normal(len(met_m))
    step_m = kind.faults.resolution_m
    if step_m and noise:
        ranges_m = step_m * np.round(ranges_m / step_m)
    ranges_m[ranges_m > pattern.reach_m] = np.inf
    ranges_m[ranges_m < kind.min_range_m] = -np.inf
    return ranges_m


def fan(width_rad: float) -> NDArray[np.float64]:
    """Directions (N,) across a beam, its axis and both edges included, about a degree apart."""
    count = 2 * max(1, math.ceil(width_rad / 2.0 / _RAY_SPACING_RAD)) + 1
    return np.linspace(-width_rad / 2.0, width_rad / 2.0, count)


def _sonar(
    walls_m: Walls,
    world_from_sensor: SE2,
    kind: SensorKind,
    noise: float,
    chances: NDArray[np.float64],
    spreads: NDArray[np.float64],
    surfaces: WallSurfaces | None,
) -> float:
    """A ping before the limits of the sensor: +Inf when no echo is loud enough."""
    if noise == 0.0:
        return _along_axis(walls_m, world_from_sensor)
    faults = kind.faults
    width_rad = kind.parameters.beam_width_rad
    echo_m = _echo(walls_m, world_from_sensor, width_rad, noise, chances[0], surfaces)
    if chances[1] < faults.lost_share * noise or echo_m > kind.max_range_m:
        return math.inf
    if chances[2] < faults.short_share * noise:
        return kind.min_range_m + float(chances[3]) * max(0.0, echo_m - kind.min_range_m)
    error = 1.0 + faults.error * noise * spreads[0]
    return float(echo_m * error + faults.error_m * noise * spreads[1])


def _echo(
    walls_m: Walls, world_from_sensor: SE2, width_rad: float, noise: float, draw: float,
    surfaces: WallSurfaces | None,
) -> float:  # fmt: skip
    """How far the nearest echo seems that is loud enough: straight, over one mirror or a corner."""
    sharpness = min(1.0, noise)
    bearings_rad = sharpness * fan(width_rad)
    headings_rad = world_from_sensor.heading_rad + bearings_rad
    origin_m = np.array([world_from_sensor.x_m, world_from_sensor.y_m])
    first = cast(walls_m, origin_m, headings_rad)
    met = np.isfinite(first.distance_m)
    first, heading_in = first.select(met), headings_rad[met]
    way = np.column_stack([np.cos(heading_in), np.sin(heading_in)])
    mirror_m = origin_m + first.distance_m[:, None] * way
    heading_on = 2.0 * first.wall_rad - heading_in
    second = cast(walls_m, mirror_m, heading_on)

    straight = _returned(first, sharpness, surfaces)
    mirrored = _MIRRORED_SHARE * (1.0 - straight) * _returned(second, sharpness, surfaces)
    back = np.cos(2.0 * second.wall_rad - heading_on - heading_in) < -math.cos(_CORNER_RAD)
    corner = (1.0 - straight) * (back & (second.distance_m < _CORNER_SHARE * first.distance_m))
    loudness = np.stack([straight, mirrored, corner])
    beam = _EDGE_LOUDNESS ** np.square(2.0 * bearings_rad[met] / width_rad)
    received = loudness * beam >= _QUIETEST + (_LOUDEST - _QUIETEST) * draw
    there_m, on_m = first.distance_m, second.distance_m
    range_m = np.stack([there_m, there_m + on_m, there_m + 0.5 * on_m])
    return float(np.min(range_m, where=received, initial=np.inf))


def _returned(hits: Hits, sharpness: float, surfaces: WallSurfaces | None) -> NDArray[np.float64]:
    """Share of the sound that a surface sends straight back, from 1 (square) to 0 (grazing)."""
    mirror_deg = MIRROR_DEG if surfaces is None else surfaces.mirror_deg[hits.wall]
    limit_deg = 90.0 - (90.0 - mirror_deg) * sharpness
    excess = (np.degrees(hits.incidence_rad) - limit_deg) / _MIRROR_SPREAD_DEG
    return np.asarray(0.5 - 0.5 * np.tanh(excess / 2.0))


def _opaque(walls_m: Walls, surfaces: WallSurfaces | None) -> Walls:
    """The walls that light stops at; far away from everything where there is none."""
    if surfaces is None:
        return walls_m
    opaque_m = walls_m[surfaces.opaque]
    return opaque_m if len(opaque_m) else np.array([[[1e9, 0.0], [1e9, 1.0]]])


def _light(
    walls_m: Walls,
    world_from_sensor: SE2,
    kind: SensorKind,
    noise: float,
    spreads: NDArray[np.float64],
) -> float:
    """Light along a line that wavers a little, or averaged over a cone; no surface mirrors it."""
    faults = kind.faults
    sensor = world_from_sensor
    if faults.aim_deg:
        aim_rad = math.radians(faults.aim_deg) * noise * float(spreads[0])
        sensor = sensor @ SE2(0.0, 0.0, aim_rad)
    distance_m = _along_axis(walls_m, sensor)
    if faults.average_deg and noise:
        bearings_rad = min(1.0, noise) * fan(math.radians(faults.average_deg))
        origin_m = np.array([sensor.x_m, sensor.y_m])
        all_m = cast(walls_m, origin_m, sensor.heading_rad + bearings_rad).distance_m
        light = 1.0 / np.square(all_m)  # as much returns; nothing from where there is no wall
        if light.any():
            distance_m = float(np.average(np.where(light, all_m, 0.0), weights=light))
    error = 1.0 + faults.error * noise * float(spreads[1])
    range_m = distance_m * error + faults.error_m * noise * float(spreads[1])
    return _by_voltage(range_m, kind) if faults.volts_m and noise else range_m


def _by_voltage(range_m: float, kind: SensorKind) -> float:
    """A range as it is read from the voltage of a triangulating sensor, in steps of its converter.

    What is very near gives the voltage of something far.
    """
    faults, peak_m = kind.faults, _PEAK_SHARE * kind.min_range_m
    inverse = 1.0 / range_m if range_m >= peak_m else max(range_m, 0.0) / peak_m**2
    volts = _ADC_STEP_V * round(faults.volts_m * inverse / _ADC_STEP_V)
    return faults.volts_m / volts if volts > 0.0 else math.inf


def _along_axis(walls_m: Walls, world_from_sensor: SE2) -> float:
    origin_m = np.array([world_from_sensor.x_m, world_from_sensor.y_m])
    return float(cast(walls_m, origin_m, np.array([world_from_sensor.heading_rad])).distance_m[0])
