"""Cones of sound against the walls that thin beams have drawn: two sensors on the same walls.

Sound comes back from where a wall is met squarely. From how far to either side of its axis a sonar
measures walls at all tells the width of the cone, and where its middle is, how it is turned.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.diagnosis.case import Case
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.diagnosis.patches import find_patches
from mapping.readings import Readings
from mapping.tracks import wrapped
from recorder.columns import Floats, Ints

_LEAST_M = 0.05
_PIECE_M = 0.4
_FEWEST = 80
_STEEPEST_RAD = math.radians(75.0)
_PAST_M, _PAST = 0.1, 0.05  # so much past a wall, and of its distance besides, is no noise


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
    patches = find_patches(points, size_m=_PIECE_M)  # small: a long one may hold a door
    rows = []
    for number in range(patches.count):
        mine = (patches.patch == number) & (patches.weight > 0)
        if not mine.any():
            continue
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
    ``fitted`` (B,) the likeliest curve: even between two edges, ``yaw_rad`` the middle of them and
    ``edge_rad`` how far from it they are. A cone of half width w receives walls up to about w and
    :data:`RETURNED_RAD` to either side, for a wall returns sound that meets it nearly square.
    """

    angle_rad: Floats
    share: Floats
    fitted: Floats
    yaw_rad: float
    edge_rad: float
    yaw_is_seen: bool = True  # else only one edge shows, and the yaw is taken as it is stated

    @property
    def half_width_rad(self) -> float:
        """Half the cone that explains it."""
        return max(self.edge_rad - RETURNED_RAD, _NARROWEST_RAD)


RETURNED_RAD = math.radians(12.5)  # beyond the cone, by the tolerance of ranges
_NARROWEST_RAD = math.radians(1.0)
_NEAR_M, _NEAR = 0.012, 0.012
_BIN_RAD = math.radians(2.0)
_WIDEST_RAD = math.radians(76.0)
_FEWEST_IN_BIN = 12
_YAWS_RAD = np.radians(np.arange(-20.0, 20.5, 0.5))
_EDGES_RAD = np.radians(np.arange(8.0, 71.0, 1.0))
_SLOPES_RAD = np.radians([1.5, 3.0, 5.0])
_CHANCES = (0.02, 0.08, 0.15, 0.25, 0.35)  # that a wall is as far as what was measured by accident


def acceptance(case: Case, hypothesis: Hypothesis, sensor: str, walls: Walls) -> Acceptance | None:
    """From all pairs of a ping and a wall that it could have met; None where there are too few."""
    readings = case.session.under(hypothesis)
    rows = case.rows_of(sensor)
    if not len(walls.offset_m) or len(rows) < _FEWEST:
        return None
    view = _view(readings, rows, walls)
    measured_m, away_m, angle = view.measured_m[:, None], view.away_m, view.angle_rad
    near_m = _NEAR_M + _NEAR * away_m  # so that walls met aslant do not count
    there = (away_m > _LEAST_M) & (np.abs(angle) < _WIDEST_RAD)
    there &= (view.across_m > walls.low_m) & (view.across_m < walls.high_m)
    there &= ~(measured_m < away_m - near_m)  # something nearer came first
    met = np.abs(measured_m - away_m) < near_m
    edges = np.arange(-_WIDEST_RAD, _WIDEST_RAD + _BIN_RAD / 2, _BIN_RAD)
    of, bins = np.digitize(angle[there], edges) - 1, len(edges) - 1
    count = np.bincount(of, minlength=bins)[:bins].astype(np.float64)
    hits = np.bincount(of[met[there]], minlength=bins)[:bins].astype(np.float64)
    if count.sum() < _FEWEST * 3:
        return None
    middle = edges[:-1] + _BIN_RAD / 2
    share = np.where(count >= _FEWEST_IN_BIN, hits / np.maximum(count, 1.0), np.nan)
    # Where the walls at one side were always near enough only the other edge shows, and the yaw
    # must be taken as it is stated.
    for yaws_rad in (_YAWS_RAD, np.zeros(1)):
        yaw_rad, edge_rad, fitted = likeliest_edges(middle, hits, count, yaws_rad)
        if edge_rad <= _EDGES_RAD[0]:
            return None
        if edge_rad < _EDGES_RAD[-1]:
            seen = yaws_rad is _YAWS_RAD
            return Acceptance(middle, share, fitted, yaw_rad, edge_rad, seen)
    return None


def likeliest_edges(
    angle_rad: Floats, hits: Floats, count: Floats, yaws_rad: Floats = _YAWS_RAD
) -> tuple[float, float, Floats]:
    """The middle (one of some yaws) and half the distance of two edges between which a share is
    high, and the curve.

    The best of a grid by the binomial likelihood of ``hits`` of ``count`` (B,): the edges are
    logistic, the share beyond them is chance, and between them what fits best.
    """
    best, found = -math.inf, (0.0, 0.0, np.zeros(len(angle_rad)))
    for slope_rad in _SLOPES_RAD:
        off = angle_rad[None, None, :] - yaws_rad[:, None, None]
        off = np.minimum(off + _EDGES_RAD[None, :, None], _EDGES_RAD[None, :, None] - off)
        inside = 1.0 / (1.0 + np.exp(np.clip(-off / slope_rad, -40.0, 40.0)))
        mass = np.maximum(np.square(inside) @ count, 1e-9)
        for chance in _CHANCES:
            more = np.clip(inside @ (hits - chance * count) / mass, 0.1, 0.98 - chance)
            share = np.clip(chance + more[..., None] * inside, 0.01, 0.99)
            likelihood = np.log(share) @ hits + np.log(1.0 - share) @ (count - hits)
            at = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
            if likelihood[at] > best:
                best = float(likelihood[at])
                found = float(yaws_rad[at[0]]), float(_EDGES_RAD[at[1]]), share[at]
    return found


@dataclass(frozen=True, slots=True)
class Overshoot:
    """Pings whose axis meets a wall of the thin beams: at which angle of incidence, how much
    farther than that wall they measured, and whether that is past it for certain; (N,) each."""

    angle_rad: Floats
    beyond_m: Floats
    past: NDArray[np.bool_]


def overshoot(case: Case, hypothesis: Hypothesis, sensor: str, walls: Walls) -> Overshoot | None:
    """By the nearest wall on each axis; None where too few meet one."""
    readings = case.session.under(hypothesis)
    rows = case.rows_of(sensor)
    rows = rows[np.isfinite(readings.ranges_m[readings.begins[rows]])]
    if not len(walls.offset_m) or len(rows) < _FEWEST:
        return None
    view = _view(readings, rows, walls)
    on_axis = (view.away_m > _LEAST_M) & (np.abs(view.angle_rad) < _STEEPEST_RAD)
    # Where the axis meets the wall: to the side of its foot, by the angle between the two.
    met_m = view.across_m - view.away_m * np.tan(np.where(on_axis, view.angle_rad, 0.0))
    on_axis &= (met_m > walls.low_m) & (met_m < walls.high_m)
    along_m = np.where(on_axis, view.away_m / np.cos(view.angle_rad), np.inf)
    nearest = np.argmin(along_m, axis=1)
    each = np.arange(len(rows))
    ahead_m, there = along_m[each, nearest], on_axis.any(axis=1)
    if there.sum() < _FEWEST:
        return None
    beyond_m = view.measured_m[there] - ahead_m[there]
    past = beyond_m > _PAST_M + _PAST * ahead_m[there]
    return Overshoot(np.abs(view.angle_rad[each, nearest][there]), beyond_m, past)
