"""Whether a sensor wants two models, one for near readings and one for far ones.

What a map holds of a model is one spread relative to the range. A sensor that errs by a centimetre
everywhere, or that gets coarse beyond a certain range, is not like that. Two spreads are taken
where readings that they were not fitted to are surely better explained by them than by one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.learning.mixture import FEWEST, BeamMixture, Pairs
from recorder.columns import Floats

_FOLDS = 5
_TRIED = 12  # places to part near from far
_ROUNDS = 30
_LEAST_RELATIVE = 1e-3
_WORTH = 1.25  # spreads that differ by less are one, however surely they differ
_Z = 1.96
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class NearFar:
    """Two models, ``up_to_m`` and beyond: the standard deviation of a hit relative to its range.

    ``gain`` is how much better readings that were kept out are explained by two than by one, in
    log-likelihood a reading, and ``gain_error`` its standard error over blocks.
    """

    up_to_m: float
    near: float
    far: float
    gain: float
    gain_error: float


def near_and_far(mixture: BeamMixture, pairs: Pairs) -> NearFar | None:
    """The two models of a sensor whose mixture is fitted; None where one will do.

    The place to part them and both spreads are fitted to four fifths of the blocks, and judged by
    the last, in turn: the gain must exceed what the blocks' differences come to by chance (95 %).
    """
    seen = np.isfinite(pairs.range_m)
    pairs = pairs.select(seen)
    rest = mixture.densities(pairs)[:, 1:].sum(axis=1)
    off = _Offs((pairs.range_m - mixture.mean_m(pairs.true_m)) / pairs.true_m, rest, mixture.hit,
                pairs.true_m)  # fmt: skip
    blocks, of = np.unique(pairs.block, return_inverse=True)
    gain = np.zeros(len(blocks))
    for fold in range(_FOLDS):
        kept = of % _FOLDS != fold
        known, out = off.select(kept), off.select(~kept)
        parted, one = _parted(known), known.spread()
        if parted is None:
            return None
        difference = out.log_likelihoods(*parted) - out.log_likelihoods(math.inf, one, one)
        gain += np.bincount(of[~kept], difference, minlength=len(blocks))
    found = _parted(off, finely=True)
    mean, error = float(gain.sum()) / len(of), float(gain.std()) * math.sqrt(len(blocks)) / len(of)
    if found is None or mean <= _Z * error or len(blocks) < 2 * _FOLDS:
        return None
    up_to_m, near, far = found
    if max(near, far) < _WORTH * min(near, far):
        return None
    return NearFar(up_to_m, near, far, mean, error)


@dataclass(frozen=True, slots=True)
class _Offs:
    """How far N readings are off, relative to their distances, and how likely they are no hits."""

    off: Floats
    rest: Floats
    hit: float
    true_m: Floats

    def select(self, rows: Flags) -> _Offs:
        return _Offs(self.off[rows], self.rest[rows], self.hit, self.true_m[rows])

    def spread(self) -> float:
        """The relative standard deviation of the hits, by expectation and maximisation."""
        spread = max(1.4826 * float(np.median(np.abs(self.off))), _LEAST_RELATIVE)
        for _ in range(_ROUNDS):
            hits = self._hits(np.full(len(self.off), spread))
            share = hits / (hits + self.rest)
            wanted = math.sqrt(float(share @ np.square(self.off)) / max(float(share.sum()), 1e-9))
            spread = max(wanted, _LEAST_RELATIVE)
        return spread

    def log_likelihoods(self, up_to_m: float, near: float, far: float) -> Floats:
        """Of each reading, (N,), in metres."""
        of_each = np.where(self.true_m <= up_to_m, near, far)
        return np.asarray(np.log(np.maximum(self._hits(of_each) + self.rest, 1e-300)))

    def _hits(self, spread: Floats) -> Floats:
        density = np.exp(-0.5 * np.square(self.off / spread)) / math.sqrt(2.0 * math.pi)
        return np.asarray(self.hit * density / (spread * self.true_m))


def _parted(off: _Offs, *, finely: bool = False) -> tuple[float, float, float] | None:
    """The place with the greatest likelihood, and the spreads on both its sides."""
    places = np.arange(1, _TRIED) / _TRIED
    best = _best(off, places)
    if best is None or not finely:
        return best
    around = float((off.true_m <= best[0]).mean())
    return _best(off, around + np.linspace(-1.0, 1.0, 2 * _TRIED + 1) / _TRIED)


def _best(off: _Offs, shares: Floats) -> tuple[float, float, float] | None:
    """The best of some places, given as shares of the readings nearer than it."""
    best, best_value = None, -math.inf
    inside = shares[(shares > 0.0) & (shares < 1.0)]
    for place_m in np.unique(np.quantile(off.true_m, inside)).tolist():
        near = off.true_m <= place_m
        if min(int(near.sum()), int((~near).sum())) < FEWEST:
            continue
        spreads = off.select(near).spread(), off.select(~near).spread()
        value = float(off.log_likelihoods(place_m, *spreads).sum())
        if value > best_value:
            best, best_value = (place_m, *spreads), value
    return best
