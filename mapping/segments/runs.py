"""Pieces of a line, and lines that meet: for the methods that do not use the points' order."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping.config import SegmentsSection
from mapping.segments.least_squares import FittedLine, FloatArray, fit_line
from mapping.segments.stages import Corner, Fit, Observer, place_of

# A guess at a line through some of the points: a place on it and its direction, or None.
Guess = tuple[FloatArray, FloatArray] | None
Finder = Callable[[FloatArray, np.random.Generator], Guess]
_MOST_LINES = 500  # among 100,000 points at random there is always one line more
_MOST_MISSES = 5


def peel(
    points_m: FloatArray, config: SegmentsSection, find: Finder, observe: Observer | None
) -> list[FittedLine]:
    """Find a line, take its runs of points away, and go on with the rest."""
    rng = np.random.default_rng(config.seed)
    left = np.ones(len(points_m), np.bool_)
    lines: list[FittedLine] = []
    misses = 0
    while misses < _MOST_MISSES and len(lines) < _MOST_LINES and left.sum() >= config.min_points:
        rest = np.flatnonzero(left)
        guess = find(points_m[rest], rng)
        found = [] if guess is None else runs_near(points_m[rest], guess, config)
        if not found:
            misses += 1
            continue
        for indices in found:
            line = fit_line(points_m[rest[indices]], y_on_x=config.fit == "y-on-x")
            left[rest[indices]] = False
            lines.append(line)
            _report(line, observe)
    return lines


def runs_near(
    points_m: FloatArray, guess: tuple[FloatArray, FloatArray], config: SegmentsSection
) -> list[NDArray[np.int64]]:
    """Indices of the points within epsilon of a line, in order along it, one array a run.

    The line is fitted again to what lies near it, twice; runs end at gaps, and short ones are left
    out.
    """
    centre, along = guess
    for _ in range(2):
        near = _within(points_m, centre, along, config.epsilon_m)
        if len(near) < 2:
            return []
        line = fit_line(points_m[near])
        centre, along = line.centre_m, line.along
    near = _within(points_m, centre, along, config.epsilon_m)
    t = points_m[near] @ along
    order = np.argsort(t, kind="stable")
    cuts = np.flatnonzero(np.diff(t[order]) > config.gap_m) + 1
    runs = np.split(near[order], cuts)
    return [run for run in runs if _long_enough(points_m[run] @ along, config)]


def _within(
    points_m: FloatArray, centre: FloatArray, along: FloatArray, distance_m: float
) -> NDArray[np.int64]:
    d = points_m - centre
    return np.flatnonzero(np.abs(along[0] * d[:, 1] - along[1] * d[:, 0]) <= distance_m)


def _long_enough(t: FloatArray, config: SegmentsSection) -> bool:
    return len(t) >= config.min_points and float(t[-1] - t[0]) >= config.min_length_m


def _report(line: FittedLine, observe: Observer | None) -> None:
    if observe is not None:
        start, end = place_of(line.start_m), place_of(line.end_m)
        observe(Fit(start, end, len(line.points_m), line.rms_m))


def meet_at_corners(
    lines: list[FittedLine], config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Ends that lie near each other move to where their lines cross, the nearest pair first.

    The guards are those of neighbours in a chain: not too shallow, not too far from either end.
    """
    if len(lines) < 2:
        return lines
    ends = np.array([[line.start_m, line.end_m] for line in lines])
    taken = np.array([line.corners for line in lines])
    for i, j in _near_ends(ends.reshape(-1, 2), 2.0 * config.corner_reach_m):
        (a, side_a), (b, side_b) = divmod(i, 2), divmod(j, 2)
        if a == b or taken[a, side_a] or taken[b, side_b]:
            continue
        at = crossing(lines[a], lines[b], math.sin(math.radians(config.corner_angle_deg)))
        if at is None or max(math.dist(at, ends[a, side_a]), math.dist(at, ends[b, side_b])) > (
            config.corner_reach_m
        ):
            continue
        ends[a, side_a] = ends[b, side_b] = at
        taken[a, side_a] = taken[b, side_b] = True
        if observe is not None:
            observe(Corner(place_of(at)))
    return [
        replace(line, start_m=ends[k, 0], end_m=ends[k, 1], corners=(bool(c[0]), bool(c[1])))
        for k, (line, c) in enumerate(zip(lines, taken, strict=True))
    ]


def _near_ends(ends: FloatArray, within_m: float) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of the places (N, 2) no further apart than that, the nearest first."""
    order = np.argsort(ends[:, 0], kind="stable")
    x, first = ends[order, 0], np.arange(len(ends))
    ahead = np.searchsorted(x, x + within_m, side="right") - first - 1  # those that x lets through
    one = np.repeat(first, ahead)
    other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(ahead) - ahead, ahead)
    pairs = np.sort(np.column_stack([order[one], order[other]]), axis=1)
    apart = np.hypot(*(ends[pairs[:, 0]] - ends[pairs[:, 1]]).T)
    found = np.lexsort((pairs[:, 1], pairs[:, 0], apart))
    return [(int(i), int(j)) for i, j in pairs[found[apart[found] <= within_m]]]


def crossing(a: FittedLine, b: FittedLine, least_sine: float) -> FloatArray | None:
    """Where two lines cross, or None where they are (nearly) parallel."""
    sine = float(a.along[0] * b.along[1] - a.along[1] * b.along[0])
    if abs(sine) < max(least_sine, 1e-12):
        return None
    d = b.centre_m - a.centre_m
    place: FloatArray = a.centre_m + a.along * ((d[0] * b.along[1] - d[1] * b.along[0]) / sine)
    return place
