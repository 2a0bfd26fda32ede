"""Straight pieces of wall that many readings of thin beams saw, and what would make them thinner.

If a mount is turned or a pose late, the same piece of wall is drawn at another place from each
direction: the points of a patch scatter. How they would move with each number of a hypothesis is
known, so the numbers that make all patches thinnest follow from least squares. Where a patch lies
and how it is turned is fitted along (variable projection: Golub and Pereyra, 1973), so that nothing
needs to be known of the walls. Residuals count along the beam, in the unit that was measured: else
shorter ranges would always seem better.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.diagnosis.hypothesis import Hypothesis, Number, Session
from mapping.scoring.held_out import Mixture
from recorder.columns import Floats, Ints

PATCH_M = 0.2
_FEWEST = 8  # points of a patch
_DIRECTIONS = 36
_WINDOW_M = 0.03
_GRAZING = 0.25  # cosine of the angle of incidence: flatter beams say little of where a wall is
_TUKEY = 4.0  # standard deviations beyond which a point does not count
_ROUNDS = 12
_SPREAD_M = 0.008
_WIDEST = 4.0
_SHIFTS = (0.0, 0.5)  # of the grid of patches, in squares
_FEWEST_POINTS = 60
_KEPT_SHARE = 0.5  # of the points in patches at first: who loses more has left the room
MOST_POINTS = 20_000
NO_FAULT = Hypothesis()


@dataclass(frozen=True, slots=True)
class Points:
    """What thin beams met, K of them.

    ``axis`` counts among all axes of the session. ``at_m`` (K, 2) are the places, ``heading_rad``
    the directions of the beams, ``range_m`` the ranges as they are taken, ``spread_m`` how they
    scatter; ``reach_m`` is the farthest that could have been measured.
    """

    axis: Ints
    at_m: Floats
    heading_rad: Floats
    range_m: Floats
    spread_m: Floats
    reach_m: Floats
    block: Ints

    def __len__(self) -> int:
        return len(self.range_m)


class ThinBeams:
    """The echoes of some sensors of a session, for any hypothesis."""

    def __init__(self, session: Session, sensors: Sequence[str], block: Ints) -> None:
        readings = session.readings
        self.session, self._block = session, block
        self._row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
        wanted = np.array([sensor.name in sensors for sensor in readings.sensors], np.bool_)
        mine = wanted[readings.sensor[self._row]] & np.isfinite(readings.ranges_m)
        axes = np.flatnonzero(mine)
        self.axis = axes[:: max(1, len(axes) // MOST_POINTS)]
        errors = np.array([Mixture.of(sensor).error for sensor in readings.sensors])
        error = errors[readings.sensor[self._row[self.axis]]]
        self._spread_m = _SPREAD_M + error * readings.ranges_m[self.axis]

    def points(self, hypothesis: Hypothesis, measured_m: Floats | None = None) -> Points:
        """Where the echoes lie; as if other ranges (K,) had been measured, where they are given."""
        if measured_m is not None:
            ranges_m = self.session.readings.ranges_m.copy()
            ranges_m[self.axis] = measured_m
            measured_m = ranges_m
        readings = self.session.under(hypothesis, measured_m=measured_m)
        row, start, range_m = self._row[self.axis], readings.world_from_sensor, readings.ranges_m
        heading_rad = start.heading_rad[row] + readings.bearings_rad[self.axis]
        along_m = range_m[self.axis]
        at_m = np.column_stack([
            start.x_m[row] + along_m * np.cos(heading_rad),
            start.y_m[row] + along_m * np.sin(heading_rad),
        ])  # fmt: skip
        return Points(
            self.axis, at_m, heading_rad, along_m, self._spread_m, readings.reach_m[self.axis],
            self._block[row],
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Patches:
    """Which patch each point is of (K,), -1: none; the normal of its wall (K, 2), and its weight.

    ``behind_m`` (K,) is how much farther than the wall the point lies along its normal, which
    points away from the sensor; ``expected_m`` the range at which its beam meets the wall.
    """

    patch: Ints
    normal: Floats
    weight: Floats
    behind_m: Floats
    expected_m: Floats

    @property
    def count(self) -> int:
        """How many patches there are."""
        return int(self.patch.max(initial=-1)) + 1


@dataclass(frozen=True, slots=True)
class Fit:
    """The hypothesis that makes the patches thinnest, and how sure its numbers are.

    ``error`` (P,) are standard errors, which count whole blocks of readings as one draw. ``width``
    is how much wider than the sensors' own errors the points scatter about the walls.
    """

    hypothesis: Hypothesis
    numbers: tuple[Number, ...]
    error: Floats
    points: int
    width: float = 1.0
    failed: bool = False

    def value(self, number: Number) -> float:
        """What it has found for a number."""
        return self.hypothesis.number(number)

    def significance(self, number: Number) -> float:
        """By how many standard errors a number differs from its neutral value."""
        error = float(self.error[self.numbers.index(number)])
        return (self.value(number) - number.neutral) / error if error > 0 else 0.0


def find_patches(points: Points, *, shift: float = 0.0, wide: float = 1.0) -> Patches:
    """Lay a grid over the points and find the straightest wall in each of its squares."""
    cells = np.floor(points.at_m / PATCH_M + shift).astype(np.int64)
    _, of = np.unique(cells, axis=0, return_inverse=True)
    of = of.reshape(-1)
    order = np.argsort(of, kind="stable")
    bounds = np.flatnonzero(np.diff(np.concatenate([[-1], of[order], [-2]])))
    patch = np.full(len(points), -1)
    normal = np.zeros((len(points), 2))
    weight, behind_m, expected_m = (np.zeros(len(points)) for _ in range(3))
    beams = np.column_stack([np.cos(points.heading_rad), np.sin(points.heading_rad)])
    count = 0
    for first, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        rows = order[first:end]
        for _ in range(2):  # a corner, or both faces of a board
            if len(rows) < _FEWEST:
                break
            found = _wall(
                points.at_m[rows],
                beams[rows],
                points.spread_m[rows],
                points.range_m[rows],
                points.reach_m[rows],
                wide,
            )
            if found is None:
                break
            near = found[3]
            mine, rows = rows[near], rows[~near]
            patch[mine], count = count, count + 1
            normal[mine], weight[mine], behind_m[mine] = (each[near] for each in found[:3])
            cosine = (beams[mine] * normal[mine]).sum(axis=1)
            expected_m[mine] = points.range_m[mine] - behind_m[mine] / cosine
    return Patches(patch, normal, weight, behind_m, expected_m)


def _wall(
    at_m: Floats, beams: Floats, spread_m: Floats, range_m: Floats, reach_m: Floats, wide: float
) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]] | None:
    """The line that most points lie near, refined, and which do; None where it is no wall."""
    angles = np.arange(_DIRECTIONS) * math.pi / _DIRECTIONS
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    middle = at_m.mean(axis=0)
    off = (at_m - middle) @ normals.T
    bins = np.floor(off / _WINDOW_M).astype(np.int64)
    bins -= bins.min()
    flat = bins + np.arange(_DIRECTIONS) * (bins.max() + 2)
    counts = np.bincount(flat.ravel(), minlength=_DIRECTIONS * (bins.max() + 2))
    pairs = counts[:-1] + counts[1:]
    best = int(np.argmax(pairs))
    k, low = divmod(best, int(bins.max()) + 2)
    n = normals[k]
    inside = (bins[:, k] == low) | (bins[:, k] == low + 1)
    side = 1.0 if np.sum(beams[inside] @ n) >= 0 else -1.0
    inside &= side * (beams @ n) > 0
    if not inside.any():
        return None
    n = side * n
    d = float(off[inside, k].mean())
    weight = inside.astype(np.float64)
    local = at_m - middle
    for _ in range(4):
        if weight.sum() < 1e-9:
            return None
        centre = np.average(local, axis=0, weights=weight)
        moved = local - centre
        spread = (moved * weight[:, None]).T @ moved
        turned = np.linalg.eigh(spread)[1][:, 0]
        n = turned if turned @ n >= 0 else -turned
        d = float(centre @ n)
        cosine = beams @ n
        off_n = local @ n - d
        facing = cosine >= _GRAZING  # and from one side
        along = off_n / np.where(facing, cosine, 1.0)  # along the beam
        z = along / (wide * spread_m)
        expected = range_m - along
        # chosen by where the wall is, not by what was measured: the reach would cut one side off
        usable = facing & (expected + 2.5 * spread_m < reach_m)
        weight = np.where(
            usable & (np.abs(z) < _TUKEY), np.square(1.0 - np.square(z / _TUKEY)), 0.0
        )
        weight = weight / np.square(spread_m * np.where(facing, cosine, 1.0))
    near = facing & (np.abs(z) < _TUKEY)
    if (weight > 0).sum() < _FEWEST or near.mean() < 0.3:
        return None
    return np.broadcast_to(n, (len(at_m), 2)), weight, off_n, near


def thickness(beams: ThinBeams, hypothesis: Hypothesis) -> float:
    """How far the points stray from walls, between 0 (not at all) and 1 (each is alone): the mean
    of Tukey's biweight of all points, those of no patch among them. For a search from afar."""
    points, total = beams.points(hypothesis), 0.0
    for shift in _SHIFTS:
        patches = find_patches(points, shift=shift)
        used = patches.patch >= 0
        z = (points.range_m[used] - patches.expected_m[used]) / points.spread_m[used]
        near = np.clip(1.0 - np.square(z / _TUKEY), 0.0, 1.0) ** 3
        total += 1.0 - float(near.sum()) / max(len(points), 1)
    return total / len(_SHIFTS)


def fit(
    beams: ThinBeams,
    numbers: Sequence[Number],
    start: Hypothesis = NO_FAULT,
    *,
    rounds: int = _ROUNDS,
) -> Fit:
    """The numbers that make the patches thinnest, by Gauss and Newton from ``start``."""
    found, first, used, wide = start, 0, 0, _WIDEST
    prior = np.array([each.usual for each in numbers])
    error = np.full(len(numbers), math.inf)
    for turn in range(rounds):
        points = beams.points(found)
        patches = find_patches(points, shift=0.5 * (turn % 2), wide=wide)
        used = int((patches.weight > 0).sum())
        wide = min(max(_width(points, patches), 1.0), wide)
        first = first or used
        if used < _FEWEST_POINTS or used < _KEPT_SHARE * first:
            return Fit(start, tuple(numbers), error, used, failed=True)
        system, right, scatter = _normal_equations(beams, found, numbers, points, patches)
        penalty = np.diag(1.0 / np.square(prior))
        away = np.array([found.number(each) - each.neutral for each in numbers])
        inverse = np.linalg.inv(system + penalty)
        step = inverse @ (right - penalty @ away)
        step *= min(1.0, float(np.min(0.5 * prior / np.maximum(np.abs(step), 1e-12))))
        error = np.sqrt(np.diag(inverse @ (scatter + penalty) @ inverse))
        for number, more in zip(numbers, step.tolist(), strict=True):
            value = found.number(number) + more
            if abs(value - number.neutral) > number.most:
                return Fit(start, tuple(numbers), error, used, failed=True)
            found = found.with_number(number, value)
        if turn > 2 and all(
            abs(more) < 0.05 * each.least for each, more in zip(numbers, step, strict=True)
        ):
            break
    return Fit(found, tuple(numbers), error, used, wide)


def _width(points: Points, patches: Patches) -> float:
    """How much wider than assumed the points of patches scatter, robustly; wide at first, so that
    a large fault does not tear its own patches."""
    used = patches.weight > 0
    if not used.any():
        return 1.0
    along = points.range_m[used] - patches.expected_m[used]
    return 1.4826 * float(np.median(np.abs(along) / points.spread_m[used]))


def _normal_equations(
    beams: ThinBeams, at: Hypothesis, numbers: Sequence[Number], points: Points, patches: Patches
) -> tuple[Floats, Floats, Floats]:
    """(P, P), (P,) with what each patch fits for itself projected out; (P, P) their scatter.

    Slopes are those of the expected ranges: the error of a measured one is in the residual as well,
    and would pretend that shorter ranges fit better.
    """
    used = np.flatnonzero(patches.weight > 0)
    measured_m = beams.session.readings.ranges_m[points.axis].copy()
    measured_m[used] *= patches.expected_m[used] / points.range_m[used]
    slopes = []
    for number in numbers:
        ahead, behind = (
            beams.points(at.with_number(number, at.number(number) + step), measured_m).at_m
            for step in (number.step, -number.step)
        )
        moved = (ahead - behind)[used] / (2.0 * number.step)
        slopes.append((moved * patches.normal[used]).sum(axis=1))
    patch, weight = patches.patch[used], patches.weight[used]
    tangent = np.column_stack([-patches.normal[used, 1], patches.normal[used, 0]])
    t = (points.at_m[used] * tangent).sum(axis=1)
    columns = _projected(
        np.column_stack([*slopes, patches.behind_m[used]]), t, patch, weight, patches.count
    )
    slope, residual = columns[:, :-1], columns[:, -1]
    system = slope.T @ (slope * weight[:, None])
    right = -slope.T @ (residual * weight)
    blocks, of = np.unique(points.block[used], return_inverse=True)
    sums = np.zeros((len(blocks), slope.shape[1]))
    np.add.at(sums, of.reshape(-1), slope * (residual * weight)[:, None])
    return system, right, sums.T @ sums


def _projected(columns: Floats, t: Floats, patch: Ints, weight: Floats, count: int) -> Floats:
    """Columns (K, C) less what a line over ``t`` explains of them in each patch."""

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(patch, weights=values, minlength=count), np.float64)

    mass = np.maximum(total(weight), 1e-300)
    t = t - (total(weight * t) / mass)[patch]
    square = np.maximum(total(weight * t * t), 1e-9 * mass)
    out = np.empty_like(columns)
    for k in range(columns.shape[1]):
        column = columns[:, k]
        mean = total(weight * column) / mass
        slope = total(weight * t * column) / square
        out[:, k] = column - mean[patch] - slope[patch] * t
    return out
