"""Which numbers of a hypothesis explain a session: coarse to fine, all together, then the fewest.

From afar the score without truth shows the way, over a few values of each number; near it, what
makes walls thinnest is finer by far (:mod:`mapping.diagnosis.fitting`), where poses are good enough
to draw walls at all. All numbers are fitted together, for they feign each other, and the fewest are
kept that explain the session (:mod:`mapping.diagnosis.pruning`). Each of those counts if it differs
from nothing by many standard errors and by more than is worth a word, and if the score gains by it,
with its whole interval. Where the score cannot tell (a turn and a shift, of which one alone does
nearly as well; walls that are seen once only), more standard errors are asked for instead.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mapping.diagnosis.case import Case
from mapping.diagnosis.fitting import Fit, fit
from mapping.diagnosis.hypothesis import Hypothesis, Number, y_of, yaw_of
from mapping.diagnosis.patches import NO_FAULT
from mapping.diagnosis.pruning import PRICE, needed, unexplained
from mapping.scoring.held_out import Gain

MOST_CAUSES = 4
SURE = 4.5  # standard errors, where the score gains by a number
_SURE_BESIDE, _SURE_BY_WALLS = 6.5, 10.0  # where it does by all together; where it loses nothing
_SURE_AGAINST = 16.0  # where it loses: its cells are 2 cm, walls are seen far finer
_STATED = 1.5  # times those: as planted amounts scattered about what was found of them
_APART = 0.2  # of the usual fault: so far apart fits from other starts may come out
_BELIEVED = 0.95  # of the most that a number may come to: there it was stopped
LEAST_GAIN = 0.002  # in log-likelihood a reading: of less nobody sees anything
_PLAIN_GAIN = 0.03  # where only the score speaks
_SCORE_LEVEL = 0.99
_BESIDE = 0.15  # of the usual fault: so far from a peak it must still gain
_STARTS = 2
_FAR_LARGER = 2.0
_ALIKE = PRICE  # so much in favour of a turn or of a shift is not told apart
_SHRINK = (0.5, 0.25, 0.125)  # of the coarse step, in a search by the score alone


@dataclass(frozen=True, slots=True)
class Candidate:
    """What may be wrong: numbers that are free together, and values to start from.

    ``by_score``: the score sees it; else (scale, bias, what is wrong with a cone) only the walls
    do, from near and far. ``instead_of`` are numbers that would explain the same: they are not free
    where this candidate is tried.
    """

    numbers: tuple[Number, ...]
    coarse: tuple[tuple[float, ...], ...] = ()
    by_score: bool = True
    instead_of: tuple[Number, ...] = ()


@dataclass(frozen=True, slots=True)
class Found:
    """A number that counts: the whole hypothesis, and what the score gains by this number, or where
    it gains nothing sure by it alone, by all together.

    ``error`` is its standard error; NaN where only the score speaks.
    """

    number: Number
    hypothesis: Hypothesis
    error: float
    gain: Gain


def search(
    case: Case,
    candidates: Sequence[Candidate],
    start: Hypothesis = NO_FAULT,
    advance: Callable[[], None] = lambda: None,
) -> tuple[Hypothesis, list[Found]]:
    """The hypothesis that the candidates come to, and which of their numbers count."""
    replaced = {number for each in candidates for number in each.instead_of}
    candidates = [each for each in candidates if not replaced & set(each.numbers)]
    if case.rough:
        return _by_score_alone(case, candidates, start, advance)
    every = dict.fromkeys(n for each in candidates for n in each.numbers)
    others = [n for n in every if n.key == "bias_m" and n.sensor in case.wide]
    numbers = tuple(n for n in every if n not in others)  # a bias common to all is hardly seen
    fits = list[tuple[float, Fit]]()
    for begin in _starts(case, candidates, start, advance):
        found = fit(case.beams(case.thin), numbers, begin, cones=case.wide)
        if not found.failed:
            fits.append((case.score(found.hypothesis).scores.mean, found))
    if not fits:
        return start, []
    best = max(fits, key=lambda pair: pair[0])[1]
    seen = {n for each in candidates if each.by_score for n in each.numbers}
    few = _turned_or_shifted(case, best, needed(best, MOST_CAUSES))
    few = _whose_bias(case, best, few, others)
    alike = {n for n in numbers if _is_same_from_all(n, [each for _, each in fits], best)}
    return _those_that_count(case, best, few, seen, start, alike)


def _is_same_from_all(number: Number, fits: Sequence[Fit], best: Fit) -> bool:
    """Whether a fit comes to the same value wherever it begins: else each piece of wall fits as
    it stands there, and its small error says nothing."""
    error = max(float(each.error[each.numbers.index(number)]) for each in fits)
    slack = max(_APART * number.usual, SURE * error)
    return all(abs(each.value(number) - best.value(number)) <= slack for each in fits)


def _turned_or_shifted(case: Case, whole: Fit, numbers: Sequence[Number]) -> list[Number]:
    """The same numbers; instead of the turn of a mount its shift, or the other way round, where
    walls hardly tell the two apart and the score does."""
    few = list(numbers)
    for pair in ((yaw_of(sensor), y_of(sensor)) for sensor in case.thin):
        mine = [each for each in pair if each in few]
        if len(mine) != 1 or not set(pair) <= set(whole.numbers):
            continue
        other = pair[1] if mine[0] == pair[0] else pair[0]
        instead = [other if each == mine[0] else each for each in few]
        if unexplained(whole, instead) - unexplained(whole, few) < _ALIKE:
            fits = [(each, _only(case, whole, each, NO_FAULT)) for each in (few, instead)]
            sound = [pair for pair in fits if not pair[1].failed]
            few = max(
                sound, key=lambda each: case.score(each[1].hypothesis).scores.mean, default=fits[0]
            )[0]
    return few


def _whose_bias(
    case: Case, whole: Fit, numbers: Sequence[Number], others: Sequence[Number]
) -> list[Number]:
    """The same numbers; instead of the bias of the thin beam that of a cone, where that is plain.

    The two differ by a bias common to both, of which cones and thin beams together tell little:
    both free, one of them must be left by far the larger.
    """
    mine = [n for n in numbers if n.key == "bias_m"]
    if len(mine) != 1 or len(others) != 1 or len(case.thin) != 1:
        return list(numbers)
    both = _only(case, whole, [*numbers, *others], NO_FAULT)
    off, its = (abs(both.value(n)) for n in (mine[0], others[0]))
    if both.failed or its < _FAR_LARGER * off:
        return list(numbers)
    return [others[0] if n == mine[0] else n for n in numbers]


def _starts(
    case: Case, candidates: Sequence[Candidate], start: Hypothesis, advance: Callable[[], None]
) -> list[Hypothesis]:
    """None, and the values that score best of the coarse ones, where they score better."""
    tried = []
    for candidate in candidates:
        for values in itertools.product(*candidate.coarse) if candidate.coarse else ():
            begin = start
            for number, value in zip(candidate.numbers, values, strict=True):
                begin = begin.with_number(number, value)
            tried.append((case.score(begin).scores.mean, begin))
        advance()
    least = case.score(start).scores.mean
    better = [pair for pair in tried if pair[0] > least]
    better.sort(key=lambda pair: -pair[0])
    return [start, *(begin for _, begin in better[:_STARTS])]


def _those_that_count(
    case: Case, whole: Fit, numbers: Sequence[Number], seen: set[Number], start: Hypothesis,
    alike: set[Number],
) -> tuple[Hypothesis, list[Found]]:  # fmt: skip
    """Fitted on their own; the least sure one is left out until all that are left count.

    ``seen`` by the score; only those that come out ``alike`` from all starts are believed without.
    """
    left = list(numbers)
    while left:
        alone = _only(case, whole, left, start)
        if alone.failed:
            return start, []
        judged = case.score(alone.hypothesis)
        together = judged.gain_over(case.score(start))
        found = list[Found]()
        for number in left:
            others = _only(case, alone, [n for n in left if n != number], start)
            gain = judged.gain_over(case.score(others.hypothesis))
            error = _STATED * float(alone.error[left.index(number)])
            if number in seen and not _gains(gain):
                gain = together
                plain = _is_plain(alone, number, _SURE_BESIDE if _gains(gain) else _SURE_BY_WALLS)
                plain = plain and (gain.high > 0.0 or _is_plain(alone, number, _SURE_AGAINST))
                plain = plain and number in alike
            else:
                plain = _is_plain(alone, number, SURE)
            if plain:
                found.append(Found(number, alone.hypothesis, error, gain))
        if len(found) == len(left):
            return alone.hypothesis, found
        doubtful = [n for n in left if n not in {each.number for each in found}]
        left.remove(min(doubtful, key=lambda n: abs(alone.significance(n))))
    return start, []


def _only(case: Case, whole: Fit, numbers: Sequence[Number], start: Hypothesis) -> Fit:
    """The fit of some numbers alone."""
    begin = start
    for number in numbers:
        begin = begin.with_number(number, whole.value(number))
    if not numbers:
        return Fit(begin, (), whole.covariance[:0, :0], whole.points)
    return fit(case.beams(case.thin), numbers, begin, cones=case.wide)


def _gains(gain: Gain) -> bool:
    return gain.low > 0.0 and gain.mean >= LEAST_GAIN


def _is_plain(found: Fit, number: Number, errors: float) -> bool:
    off = abs(found.value(number) - number.neutral)
    believed = number.least <= off < _BELIEVED * number.most
    return believed and abs(found.significance(number)) >= errors


def _by_score_alone(
    case: Case, candidates: Sequence[Candidate], start: Hypothesis, advance: Callable[[], None]
) -> tuple[Hypothesis, list[Found]]:
    """One number after the other, as long as one gains; the one that gains most comes first."""
    current, taken = start, list[Found]()
    alone = [each for each in candidates if each.coarse and len(each.numbers) == 1]
    while len(taken) < MOST_CAUSES:
        known = {found.number for found in taken}
        tried: list[Found] = []
        for each in alone:
            if each.numbers[0] not in known:
                tried += _peaks(case, each, current)
            advance()
        if not tried:
            break
        taken.append(max(tried, key=lambda found: found.gain.mean))
        current = taken[-1].hypothesis
    return current, taken


def _peaks(case: Case, candidate: Candidate, current: Hypothesis) -> Iterator[Found]:
    """One broad peak, in both halves of the session, or nothing.

    A peak of one lucky value, or of one stretch, is no evidence.
    """
    number, base = candidate.numbers[0], case.score(current)
    starts = [current.with_number(number, value) for value in candidate.coarse[0]]
    best = _refined(case, number, max(starts, key=lambda h: case.score(h).scores.mean))
    judged = case.score(best)
    gain = judged.gain_over(base, level=_SCORE_LEVEL)
    value = best.number(number)
    beside = [value - _BESIDE * number.usual, value + _BESIDE * number.usual]
    around = [case.score(best.with_number(number, v)).gain_over(base).mean for v in beside]
    halves = judged.gains_of_halves(base)
    plain = (
        number.least <= abs(value - number.neutral) <= number.usual * 2.0
        and gain.low > 0.0 and gain.mean >= _PLAIN_GAIN
        and min(around) > 0.25 * gain.mean and min(halves) > 0.0
    )  # fmt: skip
    if plain:
        yield Found(number, best, math.nan, gain)


def _refined(case: Case, number: Number, start: Hypothesis) -> Hypothesis:
    """A local search by the score alone, by ever smaller steps."""
    best, top = start, case.score(start).scores.mean
    for share in _SHRINK:
        for sign in (1.0, -1.0):
            step = sign * share * number.usual * 0.3
            tried = best.with_number(number, best.number(number) + step)
            mean = case.score(tried).scores.mean
            if mean > top:
                best, top = tried, mean
                break
    return best
