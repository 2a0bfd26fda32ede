"""Cones of sound against the walls that thin beams have drawn: two sensors on the same walls.

Sound comes back from where a wall is met squarely. From how far to either side of its axis a sonar
measures walls at all tells the width of the cone, and where its middle is, how it is turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mapping.diagnosis.case import Case
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.diagnosis.patches import find_patches
from mapping.readings import Readings
from mapping.tracks import wrapped
from recorder.columns import Floats, Ints

_LEAST_M = 0.05
_FEWEST = 80


@dataclass(frozen=True, slots=True)
class Walls:
    """J pieces of wall: normals (J, 2) away from the robot, offsets along them, ends across."""

    normal: Floats
    offset_m: Floats
    low_m: Floats
    high_m: Floats


def walls_of(case: Case, hypothesis: Hypothesis) -> Walls:
    """The walls that the thin beams draw, if a hypothesis holds."""
    points = case.beams(case.thin).points(hypothesis)
    patches = find_patches(points)
    rows = []
    for number in range(patches.count):
        mine = (patches.patch == number) & (patches.weight > 0)
        n, weight = patches.normal[mine][0], patches.weight[mine]
        tangent = np.array([-n[1], n[0]])
        across = points.at_m[mine] @ tangent
        offset = np.average(points.at_m[mine] @ n, weights=weight)
        rows.append((*n, offset, across.min(), across.max()))
    table = np.array(rows, np.float64).reshape(-1, 5)
    return Walls(table[:, :2], table[:, 2], table[:, 3], table[:, 4])


@dataclass(frozen=True, slots=True)
class View:
    """N pings and J walls, (N, J) each: how far a wall is, where across it, how far to the left.

    ``measured_m`` is (N,).
    """

    away_m: Floats
    across_m: Floats
    angle_rad: Floats
    measured_m: Floats


def _view(readings: Readings, rows: Ints, walls: Walls) -> View:
    start = readings.world_from_sensor[rows]
    at = np.column_stack([start.x_m, start.y_m])
    tangent = np.column_stack([-walls.normal[:, 1], walls.normal[:, 0]])
    facing_rad = np.arctan2(walls.normal[:, 1], walls.normal[:, 0])
    return View(
        walls.offset_m - at @ walls.normal.T, at @ tangent.T,
        wrapped(facing_rad - start.heading_rad[:, None]), readings.ranges_m[readings.begins[rows]],
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Acceptance:
    """How often a wall is measured, by how far to the left of the axis the robot has it square.

    ``angle_rad`` (B,) are the middles of bins, ``share`` (B,) how often (NaN: never there), and
    ``right_rad``, ``left_rad`` where it falls below a half. A cone of half width w receives walls
    up to about w and :data:`RETURNED_RAD` to either side, for a wall returns sound that meets it
    nearly square.
    """

    angle_rad: Floats
    share: Floats
    right_rad: float
    left_rad: float

    @property
    def yaw_rad(self) -> float:
        """The middle: how far the sensor is turned to the left."""
        return 0.5 * (self.left_rad + self.right_rad)

    @property
    def half_width_rad(self) -> float:
        """Half the cone that explains it."""
        return (0.5 * (self.left_rad - self.right_rad) - RETURNED_RAD) / _LOUD


RETURNED_RAD = math.radians(20.0)
_LOUD = 0.82  # of the half cone: beyond that hardly any echo is loud enough
_BIN_RAD = math.radians(4.0)
_WIDEST_RAD = math.radians(76.0)
_FEWEST_IN_BIN = 12


def acceptance(case: Case, hypothesis: Hypothesis, sensor: str, walls: Walls) -> Acceptance | None:
    """From all pairs of a ping and a wall that it could have met; None where edges are not seen."""
    readings = case.session.under(hypothesis)
    rows = case.rows_of(sensor)
    if not len(walls.offset_m) or len(rows) < _FEWEST:
        return None
    view = _view(readings, rows, walls)
    measured_m, away_m, angle = view.measured_m[:, None], view.away_m, view.angle_rad
    near_m = np.maximum(0.04, 0.03 * away_m)
    there = (away_m > _LEAST_M) & (np.abs(angle) < _WIDEST_RAD)
    there &= (view.across_m > walls.low_m) & (view.across_m < walls.high_m)
    there &= ~(measured_m < away_m - near_m)  # something nearer came first
    met = np.abs(measured_m - away_m) < near_m
    edges = np.arange(-_WIDEST_RAD, _WIDEST_RAD + _BIN_RAD / 2, _BIN_RAD)
    of = np.digitize(angle[there], edges) - 1
    count = np.bincount(of, minlength=len(edges))[: len(edges) - 1]
    hits = np.bincount(of, weights=met[there].astype(np.float64), minlength=len(edges))
    middle = edges[:-1] + _BIN_RAD / 2
    share = np.where(count >= _FEWEST_IN_BIN, hits[: len(middle)] / np.maximum(count, 1), np.nan)
    right, left = (_falls(sign * middle[::sign], share[::sign]) for sign in (-1, 1))
    if right is None or left is None:
        return None
    return Acceptance(middle, share, -right, left)


def _falls(angle_rad: Floats, share: Floats) -> float | None:
    """Where the share falls below a half for the first two bins in a row, going outwards."""
    known = np.isfinite(share) & (angle_rad > 0.0)
    angle_rad, share = angle_rad[known], share[known]
    low = share < 0.5
    both = np.flatnonzero(low[:-1] & low[1:])
    if not len(both) or both[0] == 0:
        return None
    at = int(both[0])
    above, below = share[at - 1], share[at]
    part = (above - 0.5) / max(above - below, 1e-9)
    return float(angle_rad[at - 1] + part * (angle_rad[at] - angle_rad[at - 1]))
