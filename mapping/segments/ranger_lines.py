"""The walls that a ranger met on its way: one line each, however often the robot passed.

The readings of one sensor come in the order of time, so a wall is met many times, and the chain of
points jumps when the beam leaves one thing for the next. First the method takes the chain as it is.
What no line took, as where a noisy heading makes the points leap to and fro, is then searched in
any order. Two kinds of lines are no walls and are left out: those that the sensor saw through, and
those along one beam, which are one place whose range was uncertain.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment
from mapping.config import SegmentsSection
from mapping.segments.chains import chains_from_points, joined
from mapping.segments.joining import merge_collinear
from mapping.segments.least_squares import FittedLine, FloatArray
from mapping.segments.methods import line_method
from mapping.segments.raw import raw_segment
from mapping.segments.runs import meet_at_corners
from mapping.segments.stages import Observer
from mapping.segments.unordered import ransac
from recorder.numbers import median

# A line within 20 degrees of most of its beams is scatter, unless the sensor moved along it.
_ALONG = math.cos(math.radians(20.0))
_MOVED = 0.5  # of the line's length
# So many beams through a line, for each point on it, are too many for a wall.
_THROUGH = 0.5
# Within this of an end a beam passes beside the line, not through it.
_BESIDE_M = 0.03
# A ranger that goes round a corner sees both walls nearly up to it; further off there is none.
_REACH_M = 0.1
# Lines found in any order are rather chance: they have to be longer.
_LONGER = 2.0


def segments_of_ranger(
    points_m: FloatArray,
    sensor_positions_m: FloatArray,
    config: SegmentsSection,
    *,
    layer: str,
    narrow: bool = True,
    observe: Observer | None = None,
) -> list[Segment]:
    """Lines through the obstacle points (N, 2) of one ranger, in the order of time, each wall once.

    ``sensor_positions_m`` (N, 2) is where the sensor was at each; both in metres, map frame.
    Neighbours more than ``raw_gap_m`` apart are not joined. ``narrow`` beams show what is free:
    lines that they go through are left out; a wide beam may have gone past. Points that are not
    finite are left out.
    Raises BadInput for a method that is not known.
    """
    points, sensor_positions_m = _distinct(points_m, sensor_positions_m)
    method = line_method(config.method)
    if len(points) < config.min_points:
        return []
    pieces = config.model_copy(update={"min_length_m": config.min_length_m / 2.0})
    chains = chains_from_points(
        points,
        order=config.order,
        gap_m=config.raw_gap_m,
        closed=False,
        origin_m=sensor_positions_m.mean(axis=0),
    )
    seen = _Seen(points, sensor_positions_m, config.epsilon_m, narrow)
    walls = seen.walls(method.lines(chains, pieces, observe), config, observe)
    if method.ordered and config.merge != "none":
        rest = joined([(points[_far_from(walls, points, config.epsilon_m)], False)])
        longer = config.model_copy(
            update={"min_length_m": _LONGER * config.min_length_m, "gap_m": config.raw_gap_m}
        )
        found = seen.walls(ransac(rest, longer, observe), longer, observe)
        walls = merge_collinear(walls + found, config, observe)
    walls = [line for line in walls if line.length_m >= config.min_length_m]
    reach = config.model_copy(update={"corner_reach_m": min(config.corner_reach_m, _REACH_M)})
    return [raw_segment(line, layer, config) for line in meet_at_corners(walls, reach, observe)]


def _distinct(
    points_m: FloatArray, sensor_positions_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Each finite place once, where it was seen first: a robot at rest measures the same again."""
    points, sensor_positions_m = (
        np.asarray(v, np.float64).reshape(-1, 2) for v in (points_m, sensor_positions_m)
    )
    finite = np.isfinite(points).all(axis=1)
    points, sensor_positions_m = points[finite], sensor_positions_m[finite]
    first = np.sort(np.unique(points, axis=0, return_index=True)[1])
    return points[first], sensor_positions_m[first]


def _as_numbers(points_m: FloatArray) -> NDArray[np.complex128]:
    """Points (N, 2) as x + iy, (N,), which can be sorted and looked up."""
    return np.ascontiguousarray(points_m, np.float64).view(np.complex128)[:, 0]


class _Seen:
    """What a sensor saw, and from where: which lines can be walls.

    ``points_m`` (N, 2) are different places; lines go through some of them.
    """

    def __init__(
        self, points_m: FloatArray, sensor_positions_m: FloatArray, epsilon_m: float, narrow: bool
    ) -> None:
        self._points, self._sensor_positions_m = points_m, sensor_positions_m
        self._epsilon_m, self._narrow = epsilon_m, narrow
        places = _as_numbers(points_m)
        self._order = np.argsort(places)
        self._sorted = places[self._order]

    def walls(
        self, lines: list[FittedLine], config: SegmentsSection, observe: Observer | None
    ) -> list[FittedLine]:
        """The lines that are no scatter, joined across gaps, and not seen through."""
        lines = [line for line in lines if not self._is_scatter(line)]
        if config.merge != "none":
            lines = merge_collinear(lines, config, observe)
        if not self._narrow:
            return lines
        return [line for line in lines if self._through(line) <= _THROUGH * len(line.points_m)]

    def _is_scatter(self, line: FittedLine) -> bool:
        at = self._order[np.searchsorted(self._sorted, _as_numbers(line.points_m))]
        sensor_positions_m = self._sensor_positions_m[at]
        beams = line.points_m - sensor_positions_m
        reach = np.maximum(np.hypot(beams[:, 0], beams[:, 1]), 1e-12)
        moved = float(np.ptp(sensor_positions_m @ line.along))
        along = median(np.abs(beams @ line.along) / reach)
        return along > _ALONG and moved < _MOVED * line.length_m

    def _through(self, line: FittedLine) -> int:
        """How many beams end further than epsilon behind the line, having crossed it."""
        before = (self._sensor_positions_m - line.centre_m) @ line.normal
        behind = (self._points - line.centre_m) @ line.normal
        crossing = (before * behind < 0.0) & (np.abs(behind) > self._epsilon_m)
        share = before[crossing] / (before[crossing] - behind[crossing])
        way = self._points[crossing] - self._sensor_positions_m[crossing]
        at = (self._sensor_positions_m[crossing] + share[:, None] * way - line.start_m) @ line.along
        return int(((at > _BESIDE_M) & (at < line.length_m - _BESIDE_M)).sum())


def _far_from(lines: list[FittedLine], points_m: FloatArray, by_m: float) -> NDArray[np.bool_]:
    """Which points (N,) lie more than ``by_m`` from every line."""
    far = np.ones(len(points_m), np.bool_)
    for line in lines:
        d = points_m - line.start_m
        beyond = d @ line.along - np.clip(d @ line.along, 0.0, line.length_m)
        far &= np.hypot(beyond, d @ line.normal) > by_m
    return far
