"""The numbers of a hypothesis that make all pieces of wall thinnest, and how sure they are.

How the points of a patch would move with each number is known, so the numbers follow from least
squares. Where a patch lies and how it is turned is fitted along (variable projection: Golub and
Pereyra, 1973), so that nothing needs to be known of the walls. Cones that meet a patch squarely
(:mod:`mapping.diagnosis.square`) count as points of it: they see the same wall from farther away.
Two grids are laid over the points, and what follows from each alone tells how much of an answer is
owed to where its squares lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from mapping.diagnosis.hypothesis import Hypothesis, Number
from mapping.diagnosis.patches import NO_FAULT, Patches, Points, ThinBeams, find_patches
from mapping.diagnosis.slopes import Met, slopes
from mapping.diagnosis.square import Squares, pings_of, squares
from mapping.readings import Readings
from recorder.columns import Floats, Ints

_ROUNDS = 12
_WIDEST = 4.0
_SHIFTS = (0.0, 0.5)  # of two grids: which pieces a wall falls into is chance, too
_NARROWEST = 0.5  # times what is assumed: sensors may well be better
_FEWEST_POINTS = 60
_KEPT_SHARE = 0.5  # of the points in patches at first: who loses more has left the room


@dataclass(frozen=True, slots=True)
class Fit:
    """The hypothesis that makes the patches thinnest, and how sure its numbers are.

    ``covariance`` (P, P) counts whole blocks of readings as one draw, and holds by how much two
    grids laid over the points differ. ``width`` is how much wider than the sensors' own errors the
    points scatter about the walls.
    """

    hypothesis: Hypothesis
    numbers: tuple[Number, ...]
    covariance: Floats
    points: int
    width: float = 1.0
    failed: bool = False

    @property
    def error(self) -> Floats:
        """Standard errors (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def away(self) -> Floats:
        """How far each number is from nothing, (P,)."""
        return np.array([self.value(each) - each.neutral for each in self.numbers])

    def value(self, number: Number) -> float:
        """What it has found for a number."""
        return self.hypothesis.number(number)

    def error_of(self, number: Number) -> float:
        """The standard error of a number."""
        return float(self.error[self.numbers.index(number)])

    def significance(self, number: Number) -> float:
        """By how many standard errors a number differs from its neutral value."""
        error = self.error_of(number)
        return (self.value(number) - number.neutral) / error if error > 0 else 0.0


def fit(
    beams: ThinBeams,
    numbers: Sequence[Number],
    start: Hypothesis = NO_FAULT,
    *,
    cones: Sequence[str] = (),
    rounds: int = _ROUNDS,
) -> Fit:
    """The numbers that make the patches thinnest, by Gauss and Newton from ``start``.

    ``cones`` are sensors whose pings count where they meet a patch squarely.
    """
    found, first, used, wide, wide_cones = start, 0, 0, _WIDEST, _WIDEST
    pings = pings_of(beams.session, list(cones))
    prior = np.array([each.usual for each in numbers])
    most = np.array([each.most for each in numbers])
    covariance = np.diag(np.square(prior))
    for turn in range(rounds):
        readings = beams.session.under(found)
        points = beams.placed(readings)
        grids = [find_patches(points, shift=each, wide=wide) for each in _SHIFTS]
        used = sum(int((patches.weight > 0).sum()) for patches in grids) // len(grids)
        first = first or used
        if used < _FEWEST_POINTS or used < _KEPT_SHARE * first:
            return Fit(start, tuple(numbers), covariance, used, failed=True)
        wide = min(max(*(_width(points, patches) for patches in grids), _NARROWEST), wide)
        of_grids = [
            _equations(beams, found, numbers, readings, points, patches,
                       squares(readings, pings, points, patches, wide_cones))
            for patches in grids
        ]  # fmt: skip
        wide_cones = max(1.0, 0.6 * wide_cones)
        away = np.array([found.number(each) - each.neutral for each in numbers])
        step, covariance = _step(_Equations.joined(of_grids), away, prior)
        apart = [_step(each, away, prior)[0] for each in of_grids] - step
        step *= min(1.0, float(np.min(0.5 * most / np.maximum(np.abs(step), 1e-12))))
        step = np.clip(away + step, -most, most) - away
        covariance = covariance + apart.T @ apart / len(of_grids)
        for number, more in zip(numbers, step.tolist(), strict=True):
            found = found.with_number(number, found.number(number) + more)
        if turn > 3 and all(
            abs(more) < 0.05 * each.least for each, more in zip(numbers, step, strict=True)
        ):
            break
    return Fit(found, tuple(numbers), covariance, used, wide)


def _step(rows: _Equations, away: Floats, prior: Floats) -> tuple[Floats, Floats]:
    """How much to add to each number (P,), which are ``away`` from nothing, and its covariance."""
    system, right, scatter = rows.normal()
    alike = _alike(system, scatter)
    penalty = np.diag(alike / np.square(prior))
    inverse = np.linalg.inv(system + penalty)
    return (
        inverse @ (right - penalty @ away),
        inverse @ (scatter + penalty * alike) @ inverse,
    )


def _alike(system: Floats, scatter: Floats) -> float:
    """How many neighbouring points err as one: what the covariance of blocks is to that of points.

    A prior that is to be worth as much as the readings must count them likewise.
    """
    of_each = np.diag(scatter) / np.maximum(np.diag(system), 1e-300)
    return max(1.0, float(np.median(of_each)))


def _width(points: Points, patches: Patches) -> float:
    """How much wider than assumed the points of patches scatter, robustly; wide at first, so that
    a large fault does not tear its own patches."""
    used = patches.weight > 0
    if not used.any():
        return 1.0
    along = points.range_m[used] - patches.expected_m[used]
    return 1.4826 * float(np.median(np.abs(along) / patches.spread_m[used]))


@dataclass(frozen=True, slots=True)
class _Equations:
    """K points: how each moves away from its wall with each number (K, P), and how far it lies
    behind it (K,); where along the wall, of which patch, with which weight, of which block."""

    slope: Floats
    behind_m: Floats
    across_m: Floats
    patch: Ints
    weight: Floats
    block: Ints

    @classmethod
    def joined(cls, parts: Sequence[_Equations]) -> _Equations:
        """Those of several grids, whose patches are not the same."""
        firsts = np.cumsum([0, *(int(each.patch.max(initial=-1)) + 1 for each in parts)])
        columns = {
            each.name: np.concatenate([getattr(part, each.name) for part in parts])
            for each in fields(cls)
        }
        columns["patch"] = np.concatenate(
            [part.patch + first for part, first in zip(parts, firsts[:-1], strict=True)]
        )
        return cls(**columns)

    def normal(self) -> tuple[Floats, Floats, Floats]:
        """(P, P), (P,) with what each patch fits for itself projected out; (P, P) their scatter."""
        _, patch = np.unique(self.patch, return_inverse=True)
        patch = patch.reshape(-1)
        columns = _projected(
            np.column_stack([self.slope, self.behind_m]), self.across_m, patch, self.weight
        )
        slope, residual, weight = columns[:, :-1], columns[:, -1], self.weight
        system = slope.T @ (slope * weight[:, None])
        right = -slope.T @ (residual * weight)
        blocks, of = np.unique(self.block, return_inverse=True)
        of = of.reshape(-1)
        # A patch that few blocks saw follows them: what is left of their errors is too small.
        left = residual / (1.0 - _leverage(patch, of, weight))
        sums = np.zeros((len(blocks), slope.shape[1]))
        np.add.at(sums, of, slope * (left * weight)[:, None])
        return system, right, sums.T @ sums * len(blocks) / max(len(blocks) - 1, 1)


def _leverage(patch: Ints, block: Ints, weight: Floats) -> Floats:
    """The share of a block in each patch's place (K,), held at a half."""
    _, pair = np.unique(np.stack([patch, block]), axis=1, return_inverse=True)
    pair = pair.reshape(-1)
    share = np.bincount(pair, weights=weight)[pair] / np.bincount(patch, weights=weight)[patch]
    return np.minimum(share, 0.5)


def _equations(
    beams: ThinBeams, at: Hypothesis, numbers: Sequence[Number], readings: Readings,
    points: Points, patches: Patches, squarely: Squares | None,
) -> _Equations:  # fmt: skip
    """The points of patches, and the pings that meet them."""
    used = np.flatnonzero(patches.weight > 0)
    normal, heading_rad = patches.normal[used], points.heading_rad[used]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    met = Met(points.row[used], points.axis[used], normal,
              np.column_stack([np.cos(heading_rad), np.sin(heading_rad)]),
              patches.expected_m[used])  # fmt: skip
    columns = [
        slopes(beams.session, at, numbers, readings, met), patches.behind_m[used],
        (points.at_m[used] * tangent).sum(axis=1), patches.patch[used], patches.weight[used],
        points.block[used],
    ]  # fmt: skip
    if squarely is not None:
        met = Met(squarely.row, squarely.axis, squarely.normal, squarely.normal,
                  squarely.range_m - squarely.behind_m, is_cone=True)  # fmt: skip
        of_pings = [
            slopes(beams.session, at, numbers, readings, met), squarely.behind_m,
            squarely.across_m, squarely.patch, squarely.weight, beams.block[squarely.row],
        ]  # fmt: skip
        columns = [np.concatenate(pair) for pair in zip(columns, of_pings, strict=True)]
    return _Equations(*columns)


def _projected(columns: Floats, t: Floats, patch: Ints, weight: Floats) -> Floats:
    """Columns (K, C) less what a line over ``t`` explains of them in each patch."""
    count = int(patch.max(initial=-1)) + 1

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
