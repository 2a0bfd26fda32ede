"""A line of a grid moved to where the raw points have the wall.

The grid shows that there is a wall, but its band begins before or behind it. The readings that may
have met the wall each give a point of it (:mod:`.sightings`). First all lines near the grid's are
tried, a degree and half a centimetre apart, for the one along which most of the length has points:
not most points, as a robot that stood still left hundreds in one place. Then that line is fitted
to its points by weighted total least squares, points far from it losing their weight (Tukey's
biweight), until it stays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.segments.sightings import Sightings
from mapping.segments.stretch import Stretch
from recorder.numbers import median

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

TURN_RAD = math.radians(15.0)  # how far the grid may be wrong about the direction
_TURNS = 31
_REACH_M = 0.3  # points this far beyond the ends count too, by half: a wall is mostly longer
_BEYOND = 0.5
_END_M = 0.05  # the ends themselves are not surer than this
_CELL_M = (0.05, 0.005)  # along and across, in which points are counted
_NEAR_CELLS = 4  # across: points of one line
_NEARER = 0.3  # lose so much at the edge of what is searched, as the grid is not quite wrong
_STRAIGHTER = 0.15

_ROUNDS = 15
_SETTLED_M = 1e-5
_TUKEY = 3.0
_SIGMA_M = (0.004, 0.03)  # least and largest spread of points that is believed
_FIRST_SIGMA_M = 0.02
_FEW = 3  # points of one kind say nothing of its spread
_SURE_M = 0.007  # light that gives both ends so well needs no sonar
_PLACE_M = 0.1
_TURNS_ON = 0.1  # points spread over less of the length (rms) do not turn the line
_LATER_TURN_RAD = math.radians(8.0)


@dataclass(frozen=True, slots=True, eq=False)
class Refit:
    """A stretch fitted to points (M, 2) with weights (M,), and the variance of each across it."""

    stretch: Stretch
    points_m: Floats
    weights: Floats
    variances_m2: Floats

    @property
    def rms_m(self) -> float:
        """Root mean square distance of the points from the line."""
        return float(np.sqrt(np.mean(self.stretch.frame_of(self.points_m)[1] ** 2)))


def refit(line: Stretch, sightings: Sightings, *, within_m: float, min_points: int) -> Refit | None:
    """The line near ``line`` that the readings support best, or None where they are too few.

    ``within_m``: how far the grid may be wrong. The ends stay where they are along the line.
    """
    near = sightings.of(_may_have_met(line, sightings, within_m))
    if len(near) < min_points:
        return None
    found = _most_covered(line, near, within_m, min_points)
    return None if found is None else settle(found, near, min_points=min_points)


def settle(line: Stretch, sightings: Sightings, *, min_points: int) -> Refit | None:
    """``line`` fitted to its points until it stays; None where they are too few.

    The points of sonars and of light have each their own spread, found on the way.
    """
    near = sightings.of(_may_have_met(line, sightings, _TUKEY * _SIGMA_M[1]))
    first, best = line, None
    for _ in range(_ROUNDS):
        best = _fitted(line, first, near, min_points)
        if best is None:
            return None
        moved_m = float(np.abs(best.stretch.ends_m - line.ends_m).max())
        line = best.stretch
        if moved_m < _SETTLED_M:
            break
    assert best is not None  # there is more than one round
    erring = _erring_together(best)
    return replace(best, variances_m2=erring * best.variances_m2)


def _may_have_met(line: Stretch, sightings: Sightings, within_m: float) -> Flags:
    """Which readings (N,) lie near any of the lines that are tried."""
    places, can = sightings.places_on(line, TURN_RAD)
    t, off = line.frame_of(places)
    from_middle = np.abs(t - 0.5 * (line.begin_m + line.end_m))
    half = 0.5 * line.length_m + _REACH_M
    near: Flags = can & (from_middle < half)
    return near & (np.abs(off) < within_m + from_middle * math.tan(TURN_RAD))


def _most_covered(
    line: Stretch, near: Sightings, within_m: float, min_points: int
) -> Stretch | None:
    """The line within ``within_m`` and 15 degrees that has points along most of its length."""
    half, reach = 0.5 * line.length_m, 0.5 * line.length_m + _REACH_M
    long = max(math.ceil(2.0 * reach / _CELL_M[0]), 1)
    wide = 2 * max(round(within_m / _CELL_M[1]), 1)
    middles = (np.arange(long) + 0.5) * (2.0 * reach / long) - reach
    share = np.where(np.abs(middles) <= half + _END_M, 1.0, _BEYOND)
    offsets = (np.arange(wide) + 0.5) * (2.0 * within_m / wide) - within_m
    nearer = 1.0 - _NEARER * np.abs(offsets) / within_m
    best, most = None, 0.0
    heading = math.atan2(line.along[1], line.along[0])
    for turn in np.linspace(-TURN_RAD, TURN_RAD, _TURNS).tolist():
        along = np.array([math.cos(heading + turn), math.sin(heading + turn)])
        tried = Stretch(line.middle_m, along, -half, half)
        places, can = near.places_on(tried)
        t, off = tried.frame_of(places)
        can &= (np.abs(t) < reach) & (np.abs(off) < within_m)
        if can.sum() < min_points:
            continue
        row = np.minimum((t[can] + reach) * (long / (2.0 * reach)), long - 1).astype(np.int64)
        col = np.minimum((off[can] + within_m) * (wide / (2.0 * within_m)), wide - 1)
        weights = 1.0 / (1.0 + near.range_m[can])  # what is far is less sure
        cell = row * wide + col.astype(np.int64)
        counted: Floats = np.bincount(cell, weights, long * wide).astype(np.float64)
        covered = share @ np.sqrt(_around(counted.reshape(long, wide)))
        covered *= nearer * (1.0 - _STRAIGHTER * abs(turn) / TURN_RAD)
        if covered.max() > most:
            most = float(covered.max())
            level = np.flatnonzero(covered >= 0.999 * most)
            off_m = float(offsets[level[len(level) // 2]])
            best = replace(tried, place_m=tried.place_m + off_m * tried.normal)
    return best


def _around(counted: Floats) -> Floats:
    """For each cell (L, W) the sum over the cells near it across."""
    wide = counted.shape[1]
    sums = np.zeros((len(counted), wide + 1))
    np.cumsum(counted, axis=1, out=sums[:, 1:])
    at = np.arange(wide)
    high, low = np.minimum(at + _NEAR_CELLS + 1, wide), np.maximum(at - _NEAR_CELLS, 0)
    around: Floats = np.maximum(sums[:, high] - sums[:, low], 0.0)
    return around


def _fitted(line: Stretch, first: Stretch, sightings: Sightings, min_points: int) -> Refit | None:
    """One round: weights by the distances from ``line``, and the line through what has weight."""
    places, can = sightings.places_on(line)
    t, off = line.frame_of(places)
    can &= (t > line.begin_m - _END_M) & (t < line.end_m + _END_M)
    lit = ~sightings.arc & can & (np.abs(off) < _TUKEY * _FIRST_SIGMA_M)
    if _error_at_ends_m(t[lit], off[lit], line) <= _SURE_M:
        can &= ~sightings.arc
    weights, variances = np.zeros(len(t)), np.zeros(len(t))
    for kind in (sightings.arc, ~sightings.arc):
        mine = can & kind
        near = mine & (np.abs(off) < _TUKEY * _FIRST_SIGMA_M)
        if near.sum() < _FEW:
            continue
        sigma_m = float(np.clip(1.4826 * median(np.abs(off[near])), *_SIGMA_M))
        far = np.abs(off[mine]) / (_TUKEY * sigma_m)
        weights[mine] = np.where(far < 1.0, np.square(1.0 - np.square(far)), 0.0) / sigma_m**2
        variances[mine] = sigma_m**2
    has = weights > 0.0
    if has.sum() < min_points:
        return None
    points, w = places[has], weights[has]
    stretch = _through(points, w, line)
    if float(stretch.along @ first.along) < math.cos(_LATER_TURN_RAD):
        stretch = _through(points, w, line, turns=False)
    return Refit(stretch, points, w, variances[has])


def _erring_together(fit: Refit) -> float:
    """By how much errors that points in one place share make the line less sure, at least 1.

    The variances of offset and direction from the sums of the residuals place by place (the
    cluster-robust or sandwich estimate), over those of points that err each on their own.
    """
    t, off = fit.stretch.frame_of(fit.points_m)
    w = fit.weights
    tau = t - float(w @ t) / float(w.sum())
    _, place = np.unique(np.floor(t / _PLACE_M), return_inverse=True)
    many = int(place.max()) + 1
    if many < _FEW:
        return float(_FEW)
    larger = 1.0
    for lever in (w, w * tau):
        together = np.square(np.bincount(place, lever * off)).sum() * many / (many - 2.0)
        apart = float(np.square(lever) @ fit.variances_m2)
        larger = max(larger, float(together) / apart if apart > 0.0 else 1.0)
    return larger


def _error_at_ends_m(t: Floats, off: Floats, line: Stretch) -> float:
    """How well points (M,) give the line at the worse of its two ends: one standard deviation."""
    many = len(t)
    if many < _FEW:
        return math.inf
    sigma_m = float(np.clip(1.4826 * median(np.abs(off)), *_SIGMA_M))
    spread_m2 = float(np.var(t))
    far_m = max(abs(end - float(t.mean())) for end in (line.begin_m, line.end_m))
    return sigma_m * math.sqrt((1.0 + far_m**2 / max(spread_m2, 1e-9)) / many)


def _through(points_m: Floats, w: Floats, line: Stretch, *, turns: bool = True) -> Stretch:
    """The weighted total least squares line, with the ends of ``line``."""
    centre = w @ points_m / w.sum()
    d = points_m - centre
    xx, xy, yy = w @ d[:, 0] ** 2, w @ (d[:, 0] * d[:, 1]), w @ d[:, 1] ** 2
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    along = np.array([math.cos(angle), math.sin(angle)])
    if along @ line.along < 0.0:
        along = -along
    spread_m = math.sqrt(float(w @ np.square(d @ along) / w.sum()))
    if not turns or spread_m < _TURNS_ON * line.length_m:
        along = line.along
    t = (line.ends_m - centre) @ along
    return Stretch(centre, along, float(t[0]), float(t[1]))
