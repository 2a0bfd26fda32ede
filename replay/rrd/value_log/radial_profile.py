"""The evidence of a sensor's readings as a function of the distance alone, as a table.

In front of its band a reading is the same evidence for all cells at one distance, for most models.
The function itself is not known here, only its value at the centres of the cells; many readings
together sample it densely. From these samples a table is made, once for a sensor, precise enough
that the values of a map can be predicted to the last bit and need not be written down.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SPACINGS_M = tuple(0.0005 * 2.0**k for k in range(8))
_DEGREE = 11
_PIECE_M = 0.05  # one polynomial fits this far to 12 digits, for what sensor models are like
_LEAST_SAMPLES = 3 * (_DEGREE + 1)
_ENOUGH_SAMPLES = 256  # for one polynomial; that it fits is tried on all
_PRECISION = 2e-12  # relative; a few hundred readings may add up before a float32 differs


@dataclass(frozen=True, slots=True)
class RadialProfile:
    """Factors at the distances 0, ``spacing_m``, 2 ``spacing_m`` ...; cubic in between.

    Only sums, products and roots are used to look a factor up: they give the same bits everywhere.
    """

    spacing_m: float
    knots: Floats

    def cubics(self) -> Floats:
        """Coefficients (N - 3, 4) of the cubic from each knot to the next, the first left out."""
        a, b, c, d = (self.knots[k : len(self.knots) - 3 + k] for k in range(4))
        return np.stack(
            [b, c - a / 3.0 - b / 2.0 - d / 6.0, (a + c) / 2.0 - b,
             (d - a) / 6.0 + (b - c) / 2.0], axis=1,
        )  # fmt: skip


def fit_table(distance_m: Floats, factor: Floats) -> RadialProfile | None:
    """The coarsest table that gives samples (N,) of a function back; None when none does.

    None, too, when they are no smooth function of the distance at all.
    """
    order = np.argsort(distance_m)
    x, y = distance_m[order], factor[order]
    if len(x) < _LEAST_SAMPLES or not np.isfinite(y).all():
        return None
    if np.ptp(y) <= _PRECISION * abs(y[0]):
        spacing = max(float(x[-1]), 1e-3)
        return RadialProfile(spacing, np.full(5, float(np.median(y))))
    fine = _fine_knots(x, y)
    if fine is None:
        return None
    best = RadialProfile(_SPACINGS_M[0], fine)
    for k, spacing in enumerate(_SPACINGS_M[1:], 1):
        coarse = RadialProfile(spacing, fine[:: 2**k].copy())
        if _misses(coarse, x, y) > _PRECISION:
            break
        best = coarse
    return best


def _misses(table: RadialProfile, x: Floats, y: Floats) -> float:
    """The largest relative error, but for the few cells where the table's ends are."""
    from replay.rrd.value_log.loops import front_factors

    if len(table.knots) < 5:
        return math.inf
    covered = (x >= table.spacing_m) & (x <= (len(table.knots) - 3) * table.spacing_m)
    got = front_factors(table.cubics(), table.spacing_m, x[covered])
    return float(np.quantile(np.abs(got / y[covered] - 1.0), 0.98)) if covered.any() else math.inf


def _fine_knots(x: Floats, y: Floats) -> Floats | None:
    """The function at the finest spacing, from polynomials that overlap by half."""
    spacing = _SPACINGS_M[0]
    knots = np.arange(int(x[-1] / spacing) + 3) * spacing
    values = np.ones(len(knots))
    pieces = int(x[-1] / _PIECE_M) + 1
    poor = 0
    for piece in range(pieces):
        low, high = piece * _PIECE_M, (piece + 1) * _PIECE_M
        margin = _PIECE_M / 4.0
        a, b = np.searchsorted(x, [low - margin, high + margin])
        at = slice(*np.searchsorted(knots, [low, high if piece + 1 < pieces else np.inf]))
        fitted = _polynomial(x[a:b], y[a:b])
        if fitted is None:
            poor += 1
            continue
        values[at] = fitted(knots[at])
    # Close to the sensor there are few cells; elsewhere all has to fit.
    return None if poor > max(2, pieces // 10) else values


def _polynomial(x: Floats, y: Floats) -> np.polynomial.Chebyshev | None:
    if len(x) < _LEAST_SAMPLES:
        return None
    every = -(-len(x) // _ENOUGH_SAMPLES)
    with warnings.catch_warnings():  # a poor fit only takes more room
        warnings.simplefilter("ignore", np.exceptions.RankWarning)
        fitted = np.polynomial.Chebyshev.fit(x[::every], y[::every], _DEGREE, domain=[x[0], x[-1]])
    error = np.abs(fitted(x) / y - 1.0)
    # A kink between two pieces spoils one of them, which is no reason to spoil the rest.
    return fitted if float(np.quantile(error, 0.9)) <= 50 * _PRECISION else None
