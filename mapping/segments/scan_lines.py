"""The walls that a laser scanner saw from many places: lines of each scan, joined over all scans.

Each scan is cut into lines on its own, as its beams lie side by side. A line joins the wall that it
continues: nearly parallel, seen from the same side, close across and not far along. Walls are kept
as sums (number, mean, scatter of their points), so that joining costs the same however many points
there are; the longest lines begin, as they point most surely.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

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
    lines: list[FittedLine] = []
    sources: list[int] = []
    sides: list[float] = []
    for beam in beams:
        for line in _lines_of_scan(beam, config):
            pose = beam.world_from_sensor
            lines.append(line)
            sources.append(beam.number)
            sides.append(float((np.array([pose.x_m, pose.y_m]) - line.centre_m) @ line.normal))
    order = sorted(range(len(lines)), key=lambda i: -lines[i].length_m)
    walls = _Walls(config)
    for i in order:
        walls.add(lines[i], sides[i], sources[i])
    few = min(_FEWEST_SCANS, len(beams))
    return [raw_segment(line, layer, config) for line in walls.joined(few)]


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


@dataclass(slots=True)
class _Walls:
    """Walls so far, as arrays over walls: sums of their points, direction, extent, side.

    ``normal`` points to where the sensor was.
    """

    config: SegmentsSection
    points: list[list[FloatArray]] = field(default_factory=list)
    scans: list[set[int]] = field(default_factory=list)
    centre: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    along: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    extent: FloatArray = field(default_factory=lambda: np.empty((0, 2)))  # along, from the centre
    count: FloatArray = field(default_factory=lambda: np.empty(0))
    scatter: FloatArray = field(default_factory=lambda: np.empty((0, 2, 2)))

    def add(self, line: FittedLine, side: float, scan: int) -> None:
        """Join a line to the wall that it continues best, or begin a wall."""
        along = line.along if side >= 0.0 else -line.along  # the sensor on the left
        k = self._continued(line, along)
        if k is None:
            self._begin(line, along, scan)
        else:
            self._join(k, line, scan)

    def joined(self, fewest_scans: int) -> list[FittedLine]:
        """Each wall fitted to all of its points, cut where its pieces lie too far apart."""
        out: list[FittedLine] = []
        for points, scans in zip(self.points, self.scans, strict=True):
            if len(scans) < fewest_scans:
                continue
            out += _pieces(np.concatenate(points), self.config)
        return out

    def _continued(self, line: FittedLine, along: FloatArray) -> int | None:
        if not len(self.count):
            return None
        cosine = self.along @ along
        normal = np.stack([-self.along[:, 1], self.along[:, 0]], axis=1)
        ends = np.array([line.start_m, line.end_m])
        off = ends[:, np.newaxis] - self.centre  # (2, walls, 2)
        across = np.abs((off * normal).sum(axis=2)).max(axis=0)
        t = np.sort((off * self.along).sum(axis=2), axis=0)
        gap = np.maximum(t[0] - self.extent[:, 1], self.extent[:, 0] - t[1])
        fits = (
            (cosine > np.cos(_TURNED))
            & (across <= _ACROSS * self.config.epsilon_m)
            & (gap <= self.config.gap_m)
        )
        if not fits.any():
            return None
        return int(np.argmin(np.where(fits, across, np.inf)))

    def _begin(self, line: FittedLine, along: FloatArray, scan: int) -> None:
        d = line.points_m - line.centre_m
        t = np.sort((np.array([line.start_m, line.end_m]) - line.centre_m) @ along)
        self.points.append([line.points_m])
        self.scans.append({scan})
        self.centre = np.vstack([self.centre, line.centre_m])
        self.along = np.vstack([self.along, along])
        self.extent = np.vstack([self.extent, t])
        self.count = np.append(self.count, len(line.points_m))
        self.scatter = np.concatenate([self.scatter, (d.T @ d)[np.newaxis]])

    def _join(self, k: int, line: FittedLine, scan: int) -> None:
        """Add the line's points to a wall's sums; direction and extent follow from these."""
        n, m = self.count[k], float(len(line.points_m))
        mean = line.points_m.mean(axis=0)
        d = line.points_m - mean
        shift = mean - self.centre[k]
        self.scatter[k] += d.T @ d + np.outer(shift, shift) * n * m / (n + m)
        centre = (n * self.centre[k] + m * mean) / (n + m)
        xx, xy, yy = self.scatter[k, 0, 0], self.scatter[k, 0, 1], self.scatter[k, 1, 1]
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        along = np.array([np.cos(angle), np.sin(angle)])
        if along @ self.along[k] < 0.0:
            along = -along
        old_ends = self.centre[k] + self.extent[k][:, np.newaxis] * self.along[k]
        ends = np.vstack([old_ends, line.start_m, line.end_m])
        t = (ends - centre) @ along
        self.centre[k], self.along[k], self.count[k] = centre, along, n + m
        self.extent[k] = t.min(), t.max()
        self.points[k].append(line.points_m)
        self.scans[k].add(scan)


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
