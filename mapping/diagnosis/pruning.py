"""Which of the numbers that were fitted together a session needs: the fewest that explain it.

Numbers feign each other: a turned mount and late poses, a bias of one sensor and a factor of the
other. Fitted together, each with the rest free, they are unsure; but their covariance tells what
would be left if some were nothing (Wald's statistic). Each number that is freed costs as much as
it takes to be sure of it, so of explanations that fit alike the one with fewer numbers is taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from mapping.diagnosis.fitting import Fit
from mapping.diagnosis.hypothesis import Number
from recorder.columns import Floats

_PRICE = 18.0  # of a number, in Wald's statistic: about 4.2 standard errors
_SLACK = 0.15  # of what is worth a word: so much no number has to explain
_MOST_TRIED = 3  # numbers at a time; more are added one by one


def needed(found: Fit, most: int) -> tuple[Number, ...]:
    """The numbers that explain a fit best, at most so many."""
    numbers, away = found.numbers, found.away
    covariance, others = _with_slack(found), range(len(found.numbers))

    def cost(free: Sequence[int]) -> float:
        return _left(away, covariance, free) + _PRICE * len(free)

    tried = [
        each
        for count in range(min(most, _MOST_TRIED) + 1)
        for each in itertools.combinations(others, count)
    ]
    best = min(tried, key=cost)
    while len(best) < most:
        more = min(((*best, each) for each in others if each not in best), key=cost, default=best)
        if cost(more) >= cost(best):
            break
        best = more
    return tuple(numbers[at] for at in sorted(best))


def standing_out(found: Fit, numbers: Sequence[Number]) -> float:
    """By how many standard errors some numbers of a fit together differ from nothing: the root of
    Wald's statistic, of a single number its significance."""
    at = [found.numbers.index(each) for each in numbers]
    away = found.away[at]
    return float(np.sqrt(away @ np.linalg.solve(found.covariance[np.ix_(at, at)], away)))


def _with_slack(found: Fit) -> Floats:
    slack = np.square([_SLACK * each.least for each in found.numbers])
    return np.asarray(found.covariance + np.diag(slack))


def _left(away: Floats, covariance: Floats, free: Sequence[int]) -> float:
    """Wald's statistic of what is not free being nothing."""
    rest = [at for at in range(len(away)) if at not in free]
    if not rest:
        return 0.0
    return float(away[rest] @ np.linalg.solve(covariance[np.ix_(rest, rest)], away[rest]))
