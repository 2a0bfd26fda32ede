"""The slow, obvious twin of the sensor models: every formula written out, cell by cell.

It looks at every cell of the whole grid, knows no window and no trick, and imports none of the code
that it checks. Next to its answer it tells which cells lie so close to an edge (of the beam, the
band or a region) that rounding decides on which side they are.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

EDGE = 1e-8


def wrap(angle):
    while angle >= math.pi:
        angle -= 2 * math.pi
    while angle < -math.pi:
        angle += 2 * math.pi
    return angle


def table_of(n):
    if n == 6:
        half = [0.0214, 0.1359, 0.3413]
    elif n == 12:
        half = [0.0049, 0.0166, 0.0440, 0.0919, 0.1498, 0.1915]
    else:
        cdf = [0.5 * (1 + math.erf((-3 + 6 * k / n) / math.sqrt(2))) for k in range(n // 2 + 1)]
        half = [b - a for a, b in itertools.pairwise(cdf)]
    return half + half[::-1]


def region(fraction, n):
    return min(max(math.floor(fraction * n), 0), n - 1)


def band_of(sensor, d):
    if sensor.model == "fading":
        return d * (1 - sensor.before), d * (1 + sensor.behind)
    return d * (1 - sensor.range_error), d * (1 + sensor.range_error)


def angle_factor(sensor, alpha, half):
    if sensor.gaussian not in ("angle", "both"):
        return 1.0, 1.0
    table = table_of(sensor.regions)
    return table[region((alpha + half) / (2 * half), sensor.regions)], max(table)


def distance_factor(sensor, rho, start, end):
    if sensor.gaussian not in ("distance", "both"):
        return 1.0, 1.0
    table = table_of(sensor.regions)
    fraction = (rho - start) / (end - start) if end > start else 0.5
    return table[region(fraction, sensor.regions)], max(table)


def emptiness(sensor, t):
    if sensor.emptiness == "none":
        return 0.0
    if sensor.emptiness == "constant":
        return -1.0
    if sensor.emptiness == "linear":
        return -(1 - t)
    return -min(1.0, 2 * (1 - t))


def in_the_band(sensor, rho, alpha, d, start, end, half):
    if sensor.model == "fading":
        return 1 / (1 + math.exp(-sensor.hit / (1 + (d / sensor.fade_m) ** 2)))
    a, a_max = angle_factor(sensor, alpha, half)
    q, q_max = distance_factor(sensor, rho, start, end)
    if sensor.model == "regions":
        return 0.5 + a * q / 2
    return 0.5 + (sensor.p_hit - 0.5) * a * q / (a_max * q_max)


def in_front(sensor, rho, alpha, start, half):
    if sensor.model == "fading":
        near = 1 + sensor.near * math.exp(-((rho / 0.35) ** 2))
        return 1 / (1 + math.exp(sensor.miss * near / (1 + (rho / sensor.fade_m) ** 2)))
    a, a_max = angle_factor(sensor, alpha, half)
    q = emptiness(sensor, rho / start)
    if sensor.model == "regions":
        return 0.5 + a * q / 2
    return 0.5 - (0.5 - sensor.p_miss) * a / a_max * abs(q)


@dataclass
class NaiveTemp:
    probability: np.ndarray
    band: np.ndarray
    free: np.ndarray
    unsure: np.ndarray


def naive_temp_grid(beam, sensor, geometry):
    """The temp grid over the whole grid, and where rounding decides."""
    shape = (geometry.rows, geometry.cols)
    out = NaiveTemp(np.full(shape, 0.5), np.zeros(shape, bool), np.zeros(shape, bool),
                    np.zeros(shape, bool))  # fmt: skip
    has_band = [False] * len(beam.ranges_m)
    unsure_band = [False] * len(beam.ranges_m)
    for row in range(geometry.rows):
        for col in range(geometry.cols):
            _one_cell(beam, sensor, geometry, row, col, out, has_band, unsure_band)
    _own_cells(beam, sensor, geometry, out, has_band, unsure_band)
    return out


def _one_cell(beam, sensor, geometry, row, col, out, has_band, unsure_band):
    x = geometry.origin_m[0] + (col + 0.5) * geometry.resolution_m - beam.world_from_sensor.x_m
    y = geometry.origin_m[1] + (row + 0.5) * geometry.resolution_m - beam.world_from_sensor.y_m
    rho, half = math.hypot(x, y), beam.beam_width_rad / 2
    heading = beam.world_from_sensor.heading_rad
    off = [wrap(math.atan2(y, x) - heading - bearing) for bearing in beam.bearings_rad]
    nearest = sorted(range(len(off)), key=lambda k: abs(off[k]))
    axis = nearest[0]
    alpha, d = off[axis], beam.ranges_m[axis]
    if abs(alpha) > half + EDGE:
        return
    edges = [abs(alpha) - half]
    if len(nearest) > 1:
        edges.append(abs(off[nearest[1]]) - abs(alpha))
    if math.isnan(d) or (math.isinf(d) and sensor.no_echo == "skipped"):
        out.unsure[row, col] |= min(map(abs, edges)) < EDGE
        return
    start, end = band_of(sensor, d) if math.isfinite(d) else (beam.reach_m, -1.0)
    edges += [rho - start, rho - end]
    n = sensor.regions
    if sensor.model != "fading" and rho <= max(start, end):
        place = (alpha + half) / (2 * half) * n
        edges.append(place - round(place))
        if start <= rho <= end and start < end:
            place = (rho - start) / (end - start) * n
            edges.append(place - round(place))
    out.unsure[row, col] |= min(map(abs, edges)) < EDGE
    if abs(alpha) > half:
        return
    if rho < start:
        out.free[row, col] = True
        out.probability[row, col] = in_front(sensor, rho, alpha, start, half)
    elif end > start and rho <= end:
        out.band[row, col] = has_band[axis] = True
        unsure_band[axis] |= bool(out.unsure[row, col])
        out.probability[row, col] = in_the_band(sensor, rho, alpha, d, start, end, half)


def _own_cells(beam, sensor, geometry, out, has_band, unsure_band):
    axes = [k for k, d in enumerate(beam.ranges_m) if math.isfinite(d)]
    for axis in sorted(axes, key=lambda k: -beam.ranges_m[k]):
        d = beam.ranges_m[axis]
        angle = beam.world_from_sensor.heading_rad + beam.bearings_rad[axis]
        x = beam.world_from_sensor.x_m + d * math.cos(angle) - geometry.origin_m[0]
        y = beam.world_from_sensor.y_m + d * math.sin(angle) - geometry.origin_m[1]
        col, row = math.floor(x / geometry.resolution_m), math.floor(y / geometry.resolution_m)
        if not (0 <= row < geometry.rows and 0 <= col < geometry.cols):
            continue
        if unsure_band[axis]:
            out.unsure[row, col] = True
        if has_band[axis]:
            continue
        near_edge = [v / geometry.resolution_m for v in (x, y)]
        if any(abs(v - round(v)) < EDGE for v in near_edge):
            out.unsure[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] = True
        start, end = band_of(sensor, d)
        out.band[row, col], out.free[row, col] = True, False
        out.unsure[row, col] = any(abs(v - round(v)) < EDGE for v in near_edge)
        out.probability[row, col] = in_the_band(
            sensor, d, 0.0, d, start, end, beam.beam_width_rad / 2
        )


def naive_arc_samples(beam, sensor, geometry):
    """The chapter's loops for one ranger: (row, col, probability, in band) of every sample."""
    half, d = beam.beam_width_rad / 2, beam.ranges_m[0]
    heading = beam.world_from_sensor.heading_rad
    if math.isfinite(d):
        start, end = band_of(sensor, d)
    else:
        start, end = beam.reach_m, -1.0
    step = geometry.resolution_m / 2
    ranges, rho = [], 0.0
    while rho < start:
        ranges.append((rho, False))
        rho = len(ranges) * step
    k = 0
    while start + k * step <= end + 1e-9 * step:
        ranges.append((start + k * step, True))
        k += 1
    samples = []
    for rho, in_band in ranges:
        ends = [(rho * math.cos(heading + a), rho * math.sin(heading + a)) for a in (-half, half)]
        chord = math.dist(*ends) / geometry.resolution_m
        interval = 2 * half / chord if chord > 0 else math.inf
        if sensor.gaussian != "none":
            interval /= 2
        interval = min(interval, 2 * half)
        k = 0
        while k * interval <= 2 * half * (1 + 1e-9):
            alpha = min(k * interval - half, half)
            x = beam.world_from_sensor.x_m + rho * math.cos(heading + alpha)
            y = beam.world_from_sensor.y_m + rho * math.sin(heading + alpha)
            col = math.floor((x - geometry.origin_m[0]) / geometry.resolution_m)
            row = math.floor((y - geometry.origin_m[1]) / geometry.resolution_m)
            if in_band:
                evidence = in_the_band(sensor, rho, alpha, d, start, end, half)
            else:
                evidence = in_front(sensor, rho, alpha, start, half)
            samples.append((row, col, evidence, in_band))
            k += 1
    return samples
