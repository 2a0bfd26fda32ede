"""The weights of `pooled`, fitted to maps of rooms whose walls are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.scoring.truth import Truth
from mapping.update_rules.pooled_weights import SIGNS, Weights
from mapping.update_rules.state import MapState

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

GHOSTS = 0.03  # of the weight of walls: cells behind walls that were touched, wanted at one half
RIDGE = 1e-4  # on standardised weights


@dataclass(frozen=True, slots=True)
class Sample:
    """The cells of one map: its terms (N, 8), what each should be (1, 0 or 0.5), its weight.

    Terms stand in the order of ``SIGNS``; the weights of a sample add up to about 1, half of it
    for walls and half for free cells, however many there are of either.
    """

    terms: Floats
    wanted: Floats
    weight: Floats


def terms_of(sums: Sequence[Floats]) -> Floats:
    """The arrays (rows, cols) of `pooled`, in its order → terms (rows, cols, 8)."""
    names = zip(SIGNS, sums, strict=True)
    return np.stack([a if name.startswith("nearest") else np.log1p(a) for name, a in names], -1)


def sample_of(state: MapState, seen: Flags, truth: Truth) -> Sample:
    """What a map of `pooled` teaches; ``seen`` (rows, cols) are the cells that could be seen."""
    terms = terms_of([state.cells[name] for name in SIGNS])
    walls, touched = truth.wall_cells(state.geometry), state.layer("").observed
    parts = [
        (terms[which], np.full(count, wanted), np.full(count, share / count))
        for which, wanted, share in (
            (touched & seen & walls, 1.0, 0.5),
            (touched & seen & ~walls, 0.0, 0.5),
            (touched & ~seen & ~walls, 0.5, 0.5 * GHOSTS),
        )
        if (count := int(which.sum()))
    ]  # fmt: skip
    return Sample(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def fit_weights(samples: Sequence[Sample], like: Weights, *, pull: float = 0.0) -> Weights:
    """Logistic regression over all samples alike; no weight may have the wrong sign.

    Minimises the weighted log-loss and ``RIDGE`` / 2 times the square of the standardised weights,
    by L-BFGS within bounds. What is not fitted is taken from ``like``. ``pull`` holds the weights
    to those, as ``RIDGE`` does to 0: few rooms know less than the many that were learned from
    before.
    """
    from scipy.optimize import minimize

    terms = np.concatenate([each.terms for each in samples])
    wanted = np.concatenate([each.wanted for each in samples])
    weight = np.concatenate([each.weight for each in samples]) / len(samples)
    spread = np.maximum(terms.std(axis=0), 1e-9)
    columns = np.column_stack([(terms - terms.mean(axis=0)) / spread, np.ones(len(terms))])

    def loss(b: Floats) -> tuple[float, Floats]:
        log_odds = columns @ b
        slope = weight * (1.0 / (1.0 + np.exp(-log_odds)) - wanted)
        each = weight * (np.logaddexp(0.0, log_odds) - wanted * log_odds)
        drawn = np.append(RIDGE * b[:-1], 0.0)
        held = np.append(pull * (b[:-1] - before), 0.0)
        cost = 0.5 * (drawn @ b + held[:-1] @ (b[:-1] - before))
        return float(each.sum() + cost), columns.T @ slope + drawn + held

    before = np.array([like.of[name] for name in SIGNS]) * spread
    bounds: list[Any] = [(0.0, None) if sign > 0 else (None, 0.0) for sign in SIGNS.values()]
    start = np.zeros(columns.shape[1])
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=[*bounds, (None, None)]).x
    of = found[:-1] / spread
    bias = float(found[-1] - of @ terms.mean(axis=0))
    return replace(like, bias=bias, of=dict(zip(SIGNS, of.tolist(), strict=True)))
