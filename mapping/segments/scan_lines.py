"""The walls that a laser scanner saw from many places: lines of each scan, joined over all scans.

Each scan is cut into lines on its own, as its beams lie side by side. A line joins the wall that it
continues: nearly parallel, seen from the same side, close across and not far along
(:mod:`mapping.line_kernels.walls`); the longest lines begin, as they point most surely.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment
from mapping.beams import Beam
from mapping.config import SegmentsSection, Sensor
from mapping.readings import Readings
from mapping.segments.chains import chains_from_scan
from mapping.segments.least_squares import FittedLine, FloatArray, fit_line
from mapping.segments.methods import line_method
from mapping.segments.raw import raw_segment
from recorder.messages import Radiation

_ACROSS = 2.0  # of epsilon: how far poses of scans may disagree across a wall
_TURNED = 0.10  # radians between a line and the wall that it continues, at most
MOST_SCANS = 10_000  # are looked at for lines
_FEWEST_SCANS = 2  # a wall that one scan alone saw is mostly a thing that moved


def segments_of_scans(
    beams: Sequence[Beam], config: SegmentsSection, *, layer: str
) -> list[Segment]:
    """Lines through the returns of all scans of one laser, each wall once, in the map frame.

    Raises BadInput for a method that is not known.
    """
    found = [(line, beam) for beam in beams for line in _lines_of_scan(beam, config)]
    found.sort(key=lambda each: -each[0].length_m)
    few = min(_FEWEST_SCANS, len(beams))
    walls: dict[int, list[tuple[FittedLine, Beam]]] = {}
    for number, each in zip(_walls_of(found, config), found, strict=True):
        walls.setdefault(number, []).append(each)
    return [
        raw_segment(line, layer, config)
        for of_wall in walls.values()
        if len({beam.number for _, beam in of_wall}) >= few
        for line in _pieces(np.concatenate([line.points_m for line, _ in of_wall]), config)
    ]


def of_lidar_only(layer: str, sensors: Iterable[Sensor]) -> bool:
    """Whether nothing but lasers fills a layer; the fused one is filled by all sensors."""
    kinds = [(sensor.layer, sensor.radiation is Radiation.LASER) for sensor in sensors]
    own = [laser for name, laser in kinds if name == layer]
    return all(own or [laser for _, laser in kinds])


def scans_of(placed: Iterable[Readings], sensor: str, total: int = 0) -> list[Beam]:
    """The scans of a sensor, in their order; none of one whose readings are single ranges.

    Of ``total`` readings of the sensor, ``MOST_SCANS`` at most, spread evenly over the session.
    """
    found: list[Beam] = []
    before = 0
    for readings in placed:
        mine = np.array([each.name == sensor for each in readings.sensors], np.bool_)
        scans = np.diff(readings.begins) > 1
        of_sensor = mine[readings.sensor] if len(mine) else np.zeros(len(readings), np.bool_)
        scans &= of_sensor
        if total > MOST_SCANS:
            place = np.cumsum(of_sensor) - 1 + before
            scans &= place * MOST_SCANS // total != (place + 1) * MOST_SCANS // total
            before += int(of_sensor.sum())
        found += [readings.beam(row) for row in np.flatnonzero(scans).tolist()]
    return found


def _lines_of_scan(beam: Beam, config: SegmentsSection) -> list[FittedLine]:
    chains = chains_from_scan(beam.ranges_m, beam.bearings_rad, sigma_m=config.epsilon_m / 4.0)
    placed = type(chains)(
        beam.world_from_sensor.transform(chains.points_m), chains.offsets, chains.closed
    )
    return line_method(config.method).lines(placed, config, None)


def _walls_of(found: Sequence[tuple[FittedLine, Beam]], config: SegmentsSection) -> list[int]:
    """The number of the wall that each line of a scan is of."""
    if not found:
        return []
    from mapping.kernels.loops import walls_of_lines

    lines = [line for line, _ in found]
    sensor = [beam.world_from_sensor for _, beam in found]
    centre, along = (
        np.array([getattr(line, name) for line in lines]) for name in ("centre_m", "along")
    )
    to_sensor = np.array([(pose.x_m, pose.y_m) for pose in sensor]) - centre
    on_left = along[:, 0] * to_sensor[:, 1] - along[:, 1] * to_sensor[:, 0] >= 0.0
    points, counts = (
        np.concatenate([line.points_m for line in lines]),
        [len(line.points_m) for line in lines],
    )
    begins = np.cumsum([0, *counts[:-1]])
    mean = np.add.reduceat(points, begins) / np.array(counts)[:, None]
    x, y = (points - np.repeat(mean, counts, axis=0)).T
    sums = np.add.reduceat(np.column_stack([x * x, x * y, y * y]), begins)
    table = np.column_stack([
        [line.start_m for line in lines], [line.end_m for line in lines],
        np.where(on_left[:, None], along, -along), counts, mean, sums,
    ])  # fmt: skip
    numbers: list[int] = walls_of_lines(
        table, math.cos(_TURNED), _ACROSS * config.epsilon_m, config.gap_m
    ).tolist()
    return numbers


def _pieces(points_m: FloatArray, config: SegmentsSection) -> list[FittedLine]:
    """The line through a wall's points, cut where nothing was seen for longer than ``gap_m``."""
    line = fit_line(points_m)
    t = (points_m - line.centre_m) @ line.along
    order = np.argsort(t, kind="stable")
    cuts = np.flatnonzero(np.diff(t[order]) > config.gap_m) + 1
    groups: list[NDArray[np.int64]] = np.split(order, cuts)
    return [
        fitted
        for group in groups
        if len(group) >= config.min_points
        and (fitted := fit_line(points_m[group])).length_m >= config.min_length_m
    ]
