"""The methods that take the points in any order: RANSAC, the Hough transform, and EM.

Each guesses lines through all the points; :mod:`mapping.segments.runs` then takes the points near
a line, cuts them at gaps and fits again. They find lines that fit better than they are true: a line
across the map collects points of many walls.
"""

from __future__ import annotations

import math

import numpy as np

from mapping.config import SegmentsSection
from mapping.segments.chains import Chains
from mapping.segments.joining import merge_collinear
from mapping.segments.least_squares import FittedLine, FloatArray, fit_line
from mapping.segments.runs import Guess, meet_at_corners, peel, runs_near
from mapping.segments.stages import Observer

_SCORED = 2000  # trials are judged on at most so many points
_TRIALS = 400
_MOST_BINS = 4000
_LINES_AT_ONCE = 24
_EM_ROUNDS = 40


def ransac(
    chains: Chains, config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Random sample consensus: of many lines through two points, the one that most lie near."""

    def find(points: FloatArray, rng: np.random.Generator) -> Guess:
        i = rng.integers(0, len(points), (_TRIALS, 2))
        d = points[i[:, 1]] - points[i[:, 0]]
        length = np.hypot(d[:, 0], d[:, 1])
        good = length > config.min_length_m / 4.0
        if not good.any():
            return None
        along, start = d[good] / length[good, None], points[i[good, 0]]
        sample = points if len(points) <= _SCORED else rng.choice(points, _SCORED, replace=False)
        # The distance from a line is n . p - n . s: one matrix product for all trials.
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        distance = sample @ normal.T - (normal * start).sum(axis=1)
        best = int((np.abs(distance) <= config.epsilon_m / 2.0).sum(axis=0).argmax())
        return start[best], along[best]

    return meet_at_corners(peel(chains.points_m, config, find, observe), config, observe)


def hough(
    chains: Chains, config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Every point votes for all lines through it; bins of a degree and of half of epsilon."""

    def find(points: FloatArray, rng: np.random.Generator) -> Guess:
        sample = points if len(points) <= _SCORED else rng.choice(points, _SCORED, replace=False)
        centre = sample.mean(axis=0)
        reach = float(np.hypot(*(sample - centre).T).max())
        bin_m = max(config.epsilon_m / 2.0, 2.0 * reach / _MOST_BINS)
        angles = np.radians(np.arange(180.0))
        rho = (sample - centre) @ np.array([np.cos(angles), np.sin(angles)])
        bins = int(2.0 * reach / bin_m) + 3
        index = np.floor((rho + reach) / bin_m).astype(np.int64) + 1
        votes = np.bincount((index + bins * np.arange(180)).ravel(), minlength=180 * bins)
        votes = votes.reshape(180, bins)
        # A wall on the edge of two bins votes for both: add each to its neighbour.
        angle, place = np.unravel_index(
            int((votes[:, 1:] + votes[:, :-1]).argmax()), (180, bins - 1)
        )
        normal = np.array([math.cos(angles[angle]), math.sin(angles[angle])])
        return centre + normal * (int(place) * bin_m - reach), np.array([-normal[1], normal[0]])

    return meet_at_corners(peel(chains.points_m, config, find, observe), config, observe)


def expectation_maximisation(
    chains: Chains, config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Many lines at once, every point belonging to each with some weight.

    A line is a long thin Gaussian; its width shrinks from four times to once epsilon / 4. Points
    that none explains go to a flat background. What is left over is tried again.
    """
    rng = np.random.default_rng(config.seed)
    points = chains.points_m
    left = np.ones(len(points), np.bool_)
    lines: list[FittedLine] = []
    for _ in range(3):
        rest = np.flatnonzero(left)
        if len(rest) < config.min_points:
            break
        before = len(lines)
        for guess in _mixture_lines(points[rest], config, rng):
            open_ones = rest[left[rest]]
            for run in runs_near(points[open_ones], guess, config):
                lines.append(fit_line(points[open_ones[run]], y_on_x=config.fit == "y-on-x"))
                left[open_ones[run]] = False
        if len(lines) == before:
            break
    lines = merge_collinear(lines, config, observe)
    return meet_at_corners(lines, config, observe)


def _mixture_lines(
    points: FloatArray, config: SegmentsSection, rng: np.random.Generator
) -> list[tuple[FloatArray, FloatArray]]:
    """The lines of a mixture fitted to points (N, 2), the heaviest first."""
    sample = points if len(points) <= _SCORED else rng.choice(points, _SCORED, replace=False)
    centre, along, spread, share = _seeds(sample, config, rng)
    extent = np.ptp(sample, axis=0).max() + config.epsilon_m
    for sigma in np.geomspace(config.epsilon_m, config.epsilon_m / 4.0, _EM_ROUNDS):
        d = sample[:, None, :] - centre
        t = d[..., 0] * along[:, 0] + d[..., 1] * along[:, 1]
        e = d[..., 1] * along[:, 0] - d[..., 0] * along[:, 1]
        # In units of the flat background over the whole extent, which takes a tenth.
        density = share * np.exp(-0.5 * ((e / sigma) ** 2 + (t / spread) ** 2))
        density *= extent**2 / (2.0 * math.pi * sigma * spread)
        weight = density / (density.sum(axis=1, keepdims=True) + 0.1)
        total = weight.sum(axis=0)
        alive = total > 2.0
        weight, total = weight[:, alive], total[alive]
        if not alive.any():
            return []
        share = 0.9 * total / total.sum()
        centre = (weight.T @ sample) / total[:, None]
        d = sample[:, None, :] - centre
        xx, yy = ((weight * d[..., k] ** 2).sum(axis=0) / total for k in (0, 1))
        xy = (weight * d[..., 0] * d[..., 1]).sum(axis=0) / total
        angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        along = np.column_stack([np.cos(angle), np.sin(angle)])
        spread = np.sqrt(np.maximum(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy), sigma**2))
    order = np.argsort(-share, kind="stable")
    return [(centre[k], along[k]) for k in order]


def _seeds(
    sample: FloatArray, config: SegmentsSection, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Starting lines: fits to the neighbourhoods of points drawn far from each other."""
    from scipy.spatial import cKDTree

    count = min(_LINES_AT_ONCE, max(len(sample) // config.min_points, 1))
    near = cKDTree(sample).query(sample, min(9, len(sample)))[1].reshape(len(sample), -1)
    chosen = [int(rng.integers(len(sample)))]
    apart = np.full(len(sample), np.inf)
    while len(chosen) < count:  # farthest-point sampling
        apart = np.minimum(apart, np.hypot(*(sample - sample[chosen[-1]]).T))
        chosen.append(int(apart.argmax()))
    fits = [fit_line(sample[near[k]]) for k in chosen]
    centre = np.array([fit.centre_m for fit in fits])
    along = np.array([fit.along for fit in fits])
    spread = np.full(count, max(2.0 * config.gap_m, config.epsilon_m))
    return centre, along, spread, np.full(count, 0.9 / count)
