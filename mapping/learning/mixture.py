"""The beam mixture of one sensor, fitted to ranges whose true distance is known.

A reading is a hit about the true distance, too short, without echo, or anything at all (Thrun,
Burgard, Fox, Probabilistic Robotics, 2005, section 6.3). Two things are done otherwise than in the
book: the short readings' exponential is cut off at the true distance and solved so, for the book's
step is wrong by nearly half however many the readings; and the hits' mean and spread depend on the
distance, for that is what an engineer asks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recorder.columns import Floats, Ints
from recorder.errors import BadInput

FEWEST = 50  # readings that a fit needs
_LEAST_SPREAD_M = 5e-4
_LEAST_SHARE = 1e-4
_MOST_ROUNDS, _SETTLED = 500, 1e-7  # of the mean log-likelihood
_MAD = 1.4826  # from the median absolute deviation to the standard deviation of a normal one
_STEEPEST_PER_M = 50.0
NAMES = (
    "hit", "short", "none", "random", "bias_m", "scale", "spread_m", "spread_rel", "short_per_m",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Pairs:
    """Readings and what they should have been: both (N,) metres; a range of +Inf had no echo.

    ``reach_m`` is the farthest that the sensor reports. Readings of one ``block`` (N,) err
    together: intervals allow for it.
    """

    range_m: Floats
    true_m: Floats
    reach_m: float
    block: Ints

    def select(self, rows: NDArray[np.bool_] | Ints) -> Pairs:
        """Some of them."""
        return Pairs(self.range_m[rows], self.true_m[rows], self.reach_m, self.block[rows])


@dataclass(frozen=True, slots=True)
class BeamMixture:
    """How a sensor errs. Shares sum to 1: hit, too short, none (no echo), random.

    A hit at the distance d reads ``bias_m`` + ``scale`` · d, with the standard deviation
    ``spread_m`` + ``spread_rel`` · d. Short readings fall off with ``short_per_m`` (1 / m).
    """

    hit: float
    short: float
    none: float
    random: float
    bias_m: float
    scale: float
    spread_m: float
    spread_rel: float
    short_per_m: float

    @property
    def values(self) -> Floats:
        """All of them in the order of ``NAMES``."""
        return np.array([getattr(self, name) for name in NAMES])

    def mean_m(self, true_m: Floats | float) -> Floats:
        """What a hit reads on the average."""
        return np.asarray(self.bias_m + self.scale * np.asarray(true_m))

    def std_m(self, true_m: Floats | float) -> Floats:
        """The standard deviation of a hit."""
        return np.asarray(self.spread_m + self.spread_rel * np.asarray(true_m))

    def densities(self, pairs: Pairs) -> Floats:
        """Of each reading by each cause, (N, 4), shares included; those of no echo are masses.

        A reading without echo has no density of another cause, nor any other a mass: else a far
        hit and no echo would be mixed up.
        """
        z, d = pairs.range_m, pairs.true_m
        seen = np.isfinite(z)
        std = self.std_m(d)
        with np.errstate(over="ignore", invalid="ignore"):
            hit = np.exp(-0.5 * np.square((z - self.mean_m(d)) / std)) / (
                math.sqrt(2.0 * math.pi) * std
            )
            cut = -np.expm1(-self.short_per_m * d)
            short = np.where(z < d, self.short_per_m * np.exp(-self.short_per_m * z) / cut, 0.0)
        none = (~seen).astype(np.float64)
        columns = [
            np.where(seen, hit, 0.0), np.where(seen, short, 0.0), none,
            np.where(seen, 1.0 / pairs.reach_m, 0.0),
        ]  # fmt: skip
        shares = np.array([self.hit, self.short, self.none, self.random])
        return np.asarray(shares * np.column_stack(columns))

    def log_likelihoods(self, pairs: Pairs) -> Floats:
        """Of each reading, (N,)."""
        return np.asarray(np.log(np.maximum(self.densities(pairs).sum(axis=1), 1e-300)))


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted mixture, its mean log-likelihood, and a 95 % interval of each number by its name.

    ``readings`` were fitted. ``fixed`` names what was not fitted but held.
    """

    mixture: BeamMixture
    log_likelihood: float
    readings: int
    interval: dict[str, tuple[float, float]]
    fixed: tuple[str, ...] = ()


def fit_mixture(pairs: Pairs, *, unbiased: bool = False) -> Fit:
    """Maximum likelihood by expectation and maximisation.

    ``unbiased`` holds bias and scale at 0 and 1: where the distances come from the sensor's own
    map, it agrees with itself whatever its scale. Raises BadInput for fewer than fifty readings,
    or fewer than that with an echo.
    """
    known = np.isfinite(pairs.true_m) & (pairs.true_m > 0.0) & ~np.isnan(pairs.range_m)
    pairs = pairs.select(known)
    if int(np.isfinite(pairs.range_m).sum()) < FEWEST:
        count = int(np.isfinite(pairs.range_m).sum())
        raise BadInput(f"{count} readings with an echo and a known distance; {FEWEST} are needed")
    mixture = _first_guess(pairs, unbiased=unbiased)
    before = -math.inf
    for _ in range(_MOST_ROUNDS):
        densities = mixture.densities(pairs)
        total = np.maximum(densities.sum(axis=1), 1e-300)
        value = float(np.log(total).mean())
        if value - before < _SETTLED:
            break
        before = value
        mixture = _maximised(mixture, pairs, densities / total[:, None], unbiased=unbiased)
    held = ("bias_m", "scale") if unbiased else ()
    interval = intervals(mixture, pairs, held)
    return Fit(mixture, value, len(pairs.range_m), interval, held)


def _first_guess(pairs: Pairs, *, unbiased: bool) -> BeamMixture:
    """From medians: half of the readings may be anything."""
    seen = np.isfinite(pairs.range_m)
    off_m, d = (pairs.range_m - pairs.true_m)[seen], pairs.true_m[seen]
    middle = 0.0 if unbiased else float(np.median(off_m))
    near = np.abs(off_m - middle) <= np.quantile(np.abs(off_m - middle), 0.6)
    spread_m = max(_MAD * float(np.median(np.abs(off_m[near] - middle))), 0.005)
    typical_m = float(np.median(d))
    none = float((~seen).mean())
    rest = 1.0 - none
    return BeamMixture(
        hit=0.8 * rest, short=0.1 * rest, none=none, random=0.1 * rest,
        bias_m=middle, scale=1.0, spread_m=spread_m / 2.0, spread_rel=spread_m / 2.0 / typical_m,
        short_per_m=1.0 / max(typical_m, 0.05),
    )  # fmt: skip


def _maximised(mixture: BeamMixture, pairs: Pairs, cause: Floats, *, unbiased: bool) -> BeamMixture:
    """One step: ``cause`` (N, 4) is how likely each reading is of each cause."""
    share = np.maximum(cause.mean(axis=0), [_LEAST_SHARE, _LEAST_SHARE, 0.0, _LEAST_SHARE])
    share /= share.sum()
    seen = np.isfinite(pairs.range_m)
    z, d, e = pairs.range_m[seen], pairs.true_m[seen], cause[seen, 0]
    bias_m, scale = (mixture.bias_m, mixture.scale) if unbiased else _line(
        d, z, e / np.square(mixture.std_m(d))
    )  # fmt: skip
    spread_m, spread_rel = _spread(mixture, d, z - bias_m - scale * d, e)
    hit, short, none, random = share.tolist()
    return BeamMixture(
        hit, short, none, random, bias_m, scale, spread_m, spread_rel,
        _short_rate(mixture.short_per_m, z, d, cause[seen, 1]),
    )  # fmt: skip


def _line(x: Floats, y: Floats, weight: Floats) -> tuple[float, float]:
    """Offset and slope of y over x, by weighted least squares; slope 1 where x does not vary."""
    total = float(weight.sum())
    if total <= 0.0:
        return 0.0, 1.0
    mean_x, mean_y = float(weight @ x) / total, float(weight @ y) / total
    across = float(weight @ np.square(x - mean_x))
    if across <= 1e-6 * total:
        return mean_y - mean_x, 1.0
    slope = float(weight @ ((x - mean_x) * (y - mean_y))) / across
    return mean_y - slope * mean_x, slope


def _spread(mixture: BeamMixture, d: Floats, off_m: Floats, e: Floats) -> tuple[float, float]:
    """A step of Fisher scoring for std = a + b d, both kept above nothing."""
    a, b = mixture.spread_m, mixture.spread_rel
    for _ in range(3):
        std = a + b * d
        gain = e * (np.square(off_m) / std**3 - 1.0 / std)
        weight = 2.0 * e / np.square(std)
        gradient = np.array([gain.sum(), float(gain @ d)])
        information = np.array([
            [weight.sum(), float(weight @ d)], [float(weight @ d), float(weight @ np.square(d))]
        ])  # fmt: skip
        information += 1e-9 * np.trace(information) * np.eye(2)
        step = np.linalg.solve(information, gradient)
        new = np.array([a, b]) + step
        if new[1] < 0.0:  # the best within bounds lies on the edge: b = 0, and a alone
            new = np.array(
                [math.sqrt(float(e @ np.square(off_m)) / max(float(e.sum()), 1e-9)), 0.0]
            )
        elif new[0] < _LEAST_SPREAD_M:
            rel = math.sqrt(float(e @ np.square(off_m / d)) / max(float(e.sum()), 1e-9))
            new = np.array([_LEAST_SPREAD_M, max(rel - _LEAST_SPREAD_M / float(d.mean()), 0.0)])
        a, b = float(max(new[0], _LEAST_SPREAD_M)), float(new[1])
    return a, b


def _short_rate(before: float, z: Floats, d: Floats, e: Floats) -> float:
    """The rate of an exponential that is cut off at d: the root of its likelihood's derivative,
    Σ e / λ - Σ e z - Σ e d / (exp(λ d) - 1)."""
    from scipy.optimize import brentq

    count, total = float(e.sum()), float(e @ z)
    if count < 1e-6:
        return before

    def slope(rate: float) -> float:
        with np.errstate(over="ignore"):
            return count / rate - total - float(e @ (d / np.expm1(np.minimum(rate * d, 700.0))))

    lowest = 1e-6  # as good as even
    if slope(lowest) <= 0.0:
        return lowest
    if slope(_STEEPEST_PER_M) >= 0.0:
        return _STEEPEST_PER_M
    return float(brentq(slope, lowest, _STEEPEST_PER_M, xtol=1e-8))


def intervals(
    mixture: BeamMixture, pairs: Pairs, held: tuple[str, ...] = (), z_score: float = 1.96
) -> dict[str, tuple[float, float]]:
    """95 % intervals by the sandwich of Fisher information and the blocks' scores.

    (Huber 1967; White 1982.) With a block for each reading and the right model that is Fisher's;
    readings of one block may err together, and widen it. Positive numbers get an interval on
    their logarithm, so that none reaches below zero.
    """
    at_edge = _at_edge(mixture)  # of these there is no derivative
    free = [name for name in NAMES if name not in (*held, *at_edge, "random")]  # shares sum to 1
    values = mixture.values[[NAMES.index(name) for name in free]]
    steps = 1e-4 * np.maximum(np.abs(values), 1e-3)

    def at(number: int, step: float) -> Floats:
        changed = replace(mixture, **{free[number]: float(values[number] + step)})
        rest = 1.0 - changed.hit - changed.short - changed.none
        return replace(changed, random=rest).log_likelihoods(pairs)

    scores = np.column_stack([
        (at(k, step) - at(k, -step)) / (2.0 * step) for k, step in enumerate(steps)
    ])  # fmt: skip
    information = scores.T @ scores
    blocks, of = np.unique(pairs.block, return_inverse=True)
    by_block = np.zeros((len(blocks), len(free)))
    np.add.at(by_block, of, scores)
    inverse = np.linalg.pinv(information, hermitian=True)
    covariance = inverse @ (by_block.T @ by_block) @ inverse
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    found = {
        name: _interval(value, z_score * float(e), of_sign=name not in ("bias_m",))
        for name, value, e in zip(free, values.tolist(), error, strict=True)
    }
    shares = np.array([1.0 if name in ("hit", "short", "none") else 0.0 for name in free])
    random_error = math.sqrt(max(float(shares @ covariance @ shares), 0.0))
    found["random"] = _interval(mixture.random, z_score * random_error, of_sign=True)
    for name in ("hit", "short", "none", "random"):
        if name in found:
            found[name] = (found[name][0], min(found[name][1], 1.0))
        else:  # none was seen in so many: the rule of three
            found[name] = (0.0, min(3.0 / len(blocks), 1.0))
    return found


def _at_edge(mixture: BeamMixture) -> tuple[str, ...]:
    """What lies where it cannot get smaller."""
    edge = [name for name in ("short", "none") if getattr(mixture, name) <= 5.0 * _LEAST_SHARE]
    if "short" in edge:
        edge.append("short_per_m")
    if mixture.spread_m <= 1.01 * _LEAST_SPREAD_M:
        edge.append("spread_m")
    if mixture.spread_rel <= 1e-6:
        edge.append("spread_rel")
    if mixture.short_per_m <= 1e-5:
        edge.append("short_per_m")
    return tuple(edge)


def _interval(value: float, half: float, *, of_sign: bool) -> tuple[float, float]:
    if not of_sign or value <= 0.0:
        return value - half, value + half
    factor = math.exp(min(half / value, 50.0))
    return value / factor, value * factor
