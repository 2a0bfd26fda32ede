"""Cones that meet a piece of wall squarely: what a sonar adds to the walls that thin beams draw.

Sound comes back from where a wall is met squarely, so a ping that has a wall before it measures how
far that wall is, whichever way within its cone. That is one more point of the wall, along its
normal, often from much farther away than a thin beam reaches: so it tells factors and biases of
either sensor, which thin beams alone hardly see.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapping.diagnosis.hypothesis import Session
from mapping.diagnosis.patches import Patches, Points
from mapping.readings import Readings
from mapping.tracks import wrapped
from recorder.columns import Floats, Ints

_INSIDE = 0.8  # of the half cone
_LEAST_M, _MOST_M, _NEAR_M = 0.05, 0.9, 0.15  # farther away something nearer comes first
_SAME_M = 0.03  # walls that are so nearly as far away are one, and the foot decides of which piece
_SPREAD_M, _SPREAD = 0.007, 0.01
_TURNED_RAD = 0.06  # a piece whose normal is less sure seems farther away, by half its square
_TUKEY = 4.0
_MOST = 3000


@dataclass(frozen=True, slots=True)
class Squares:
    """M pings with a piece of wall squarely before them.

    ``row`` counts readings, ``axis`` all axes of the session. ``behind_m`` is how much more was
    measured than the wall is away, ``range_m`` what was; ``across_m`` where along the wall.
    """

    row: Ints
    axis: Ints
    patch: Ints
    normal: Floats
    weight: Floats
    behind_m: Floats
    range_m: Floats
    across_m: Floats


def pings_of(session: Session, sensors: list[str]) -> Ints:
    """The readings of some sensors with one axis and an echo, thinned to what a fit can afford."""
    readings = session.readings
    wanted = np.array([each.name in sensors for each in readings.sensors], np.bool_)
    first = readings.begins[:-1]
    alone = np.diff(readings.begins) == 1
    rows = np.flatnonzero(wanted[readings.sensor] & alone)
    rows = rows[np.isfinite(readings.ranges_m[first[rows]])]
    return rows[:: max(1, -(-len(rows) // _MOST))]


def squares(
    readings: Readings, rows: Ints, points: Points, patches: Patches, wide: float
) -> Squares | None:
    """Which pings meet which patch; None where none does."""
    if not patches.count or not len(rows):
        return None
    used = patches.weight > 0
    of, weight, normal = patches.patch[used], patches.weight[used], patches.normal[used]
    at = points.at_m[used]
    first = np.full(patches.count, -1)
    first[of[::-1]] = np.arange(len(of))[::-1]
    n = np.where(first[:, None] >= 0, normal[first], 0.0)
    mass = np.maximum(np.bincount(of, weights=weight, minlength=patches.count), 1e-300)
    off = np.bincount(of, weights=weight * (at * normal).sum(axis=1), minlength=patches.count)
    across = at[:, 1] * normal[:, 0] - at[:, 0] * normal[:, 1]
    middle = np.bincount(of, weights=weight * across, minlength=patches.count) / mass
    moment = np.bincount(
        of, weights=weight * np.square(across - middle[of]), minlength=patches.count
    )
    known = wide * wide < moment * _TURNED_RAD**2  # how exactly its normal is known
    low, high = np.full(patches.count, np.inf), np.full(patches.count, -np.inf)
    np.minimum.at(low, of, across)
    np.maximum.at(high, of, across)

    start, axis = readings.world_from_sensor[rows], readings.begins[rows]
    measured_m = readings.ranges_m[axis]
    away_m = off / mass - (start.x_m[:, None] * n[:, 0] + start.y_m[:, None] * n[:, 1])
    foot_m = start.y_m[:, None] * n[:, 0] - start.x_m[:, None] * n[:, 1]
    half = 0.5 * np.array([each.beam_width_rad for each in readings.sensors])
    turned = wrapped(np.arctan2(n[:, 1], n[:, 0]) - start.heading_rad[:, None])
    seen = (away_m > _LEAST_M) & (away_m < _MOST_M) & (foot_m >= low) & (foot_m <= high)
    seen &= known & (np.abs(turned) < _INSIDE * half[readings.sensor[rows]][:, None])
    nearest = np.where(seen, away_m, np.inf).min(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        aside = np.abs(foot_m - 0.5 * (low + high))
    best = np.argmin(np.where(seen & (away_m < nearest + _SAME_M), aside, np.inf), axis=1)
    distance_m = away_m[np.arange(len(rows)), best]
    behind_m = measured_m - distance_m
    kept = np.isfinite(nearest[:, 0]) & (np.abs(behind_m) < _NEAR_M)
    if not kept.any():
        return None
    spread_m = _SPREAD_M + _SPREAD * distance_m[kept]
    z = behind_m[kept] / (wide * spread_m)
    tukey = np.where(np.abs(z) < _TUKEY, np.square(1.0 - np.square(z / _TUKEY)), 0.0)
    best = best[kept]
    return Squares(
        rows[kept], axis[kept], best, n[best], tukey / np.square(spread_m), behind_m[kept],
        measured_m[kept], foot_m[np.flatnonzero(kept), best],
    )  # fmt: skip
