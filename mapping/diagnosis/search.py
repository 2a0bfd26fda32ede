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
from typing import Any

from mapping.diagnosis.case import Case
from mapping.diagnosis.fitting import Fit, fit
from mapping.diagnosis.hypothesis import Hypothesis, Number, y_of, yaw_of
from mapping.diagnosis.patches import NO_FAULT
from mapping.diagnosis.pruning import needed, standing_out
from mapping.scoring.held_out import Gain

MOST_CAUSES = 4
SURE = 4.5  # standard errors, where the score gains by a number
_SURE_BESIDE = 6.5  # where it does by all together, or where points fit walls better
_SURE_BY_WALLS = 7.0  # where it may lose or gain
_SURE_AGAINST = 16.0  # where it surely loses: its cells are 2 cm, walls are seen far finer
_SURE_OF_MOUNT = 3.0  # of a turn beside a shift, and the other way round, where one is sure
_STATED = 1.5  # times those: as planted amounts scattered about what was found of them
_AS_MANY = 0.02  # of how well points fit walls: by less, fits hardly differ
_TORN = 0.1  # by so much: walls are torn apart
_COST_OF_WALLS = 0.1  # of how well points fit walls, in log-likelihood a reading: about
_APART = 0.2  # of the usual fault: so far apart fits from other starts may come out
_BELIEVED = 0.95  # of the most that a number may come to: there it was stopped
LEAST_GAIN = 0.002  # in log-likelihood a reading: of less nobody sees anything
_PLAIN_GAIN = 0.03  # where only the score speaks
_SCORE_LEVEL = 0.99
_BESIDE = 0.15  # of the usual fault: so far from a peak it must still gain
_STARTS, _STARTS_BY_WALLS = 2, 1
_COMMON_BIAS_M = 0.004  # what nine sound sessions showed: from -4 to 9 mm, the mean about that
_TOLD_APART = 2.0  # in Wald's statistic: so much more is left by the one than by the other
_OF_A_MOUNT = ("x_m", "y_m", "yaw_rad")
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
    """A number that counts: the whole hypothesis, and what the score gains by it (by all numbers
    of its mount), or where it gains nothing sure by it alone, by all together.

    ``error`` is its standard error; NaN where only the score speaks. ``on_walls`` is how well the
    points of thin beams fit walls without it, and with it. ``beside``: a surer number of the same
    mount has the same gain, which tells nothing of this one.
    """

    number: Number
    hypothesis: Hypothesis
    error: float
    gain: Gain
    on_walls: tuple[float, float] | None = None
    beside: bool = False

    @property
    def cost(self) -> float:
        """What it costs in log-likelihood a reading, by the score or by the walls."""
        before, after = self.on_walls or (0.0, 0.0)
        return max(self.gain.mean, _COST_OF_WALLS * (after - before))


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
    fits = [_fitted_from(case, numbers, each) for each in _starts(case, candidates, start, advance)]
    fits = _that_tear_no_walls(case, [each for each in fits if not each.failed])
    if not fits:
        return start, []
    best = max(fits, key=lambda each: case.score(each.hypothesis).scores.mean)
    seen = {n for each in candidates if each.by_score for n in each.numbers}
    few, nearer = _turned_or_shifted(case, best, needed(best, MOST_CAUSES))
    few = _whose_bias(case, nearer, few, others)
    alike = {n for n in best.numbers if _is_same_from_all(n, fits, best)}
    return _those_that_count(case, nearer, few, seen, start, alike)


def _fitted_from(case: Case, numbers: Sequence[Number], begin: Hypothesis) -> Fit:
    """All numbers fitted; only those that the start is about, where the others lead astray."""
    found = fit(case.beams(case.thin), numbers, begin, cones=case.wide)
    own = [each for each in numbers if begin.number(each) != each.neutral]
    if not own or not (found.failed or _tears(case, found, begin)):
        return found
    return fit(case.beams(case.thin), own, begin, cones=case.wide)


def _tears(case: Case, found: Fit, begin: Hypothesis) -> bool:
    before, after = (case.on_walls(h, found.width).mean for h in (begin, found.hypothesis))
    return after < before - _TORN


def _that_tear_no_walls(case: Case, fits: Sequence[Fit]) -> list[Fit]:
    """Those by which points fit walls about as well as by the best: a fit that began too far from
    the truth ends where it has torn some apart. Those of all numbers, unless all are torn."""
    wide = min((each.width for each in fits), default=1.0)
    judged = [(case.on_walls(each.hypothesis, wide).mean, each) for each in fits]
    sound = _within(judged, _TORN)
    whole = max((len(each.numbers) for _, each in sound), default=0)
    same = [(share, each) for share, each in sound if len(each.numbers) == whole]
    return [each for _, each in _within(same, _AS_MANY)]


def _within(judged: Sequence[tuple[float, Fit]], less: float) -> list[tuple[float, Fit]]:
    most = max((share for share, _ in judged), default=0.0)
    return [(share, each) for share, each in judged if share > most - less]


def _is_same_from_all(number: Number, fits: Sequence[Fit], best: Fit) -> bool:
    """Whether a fit comes to the same value wherever it begins: else each piece of wall fits as
    it stands there, and its small error says nothing."""
    fits = [each for each in fits if number in each.numbers]
    error = max(each.error_of(number) for each in fits)
    slack = max(_APART * number.usual, SURE * error)
    return all(abs(each.value(number) - best.value(number)) <= slack for each in fits)


def _turned_or_shifted(
    case: Case, whole: Fit, numbers: Sequence[Number]
) -> tuple[list[Number], Fit]:
    """The same numbers, of a mount that is among them its turn, its shift, or both; and the fit
    that is nearest to them.

    Fitted together, without all that is not needed, the two are told apart far better than alone,
    where each does nearly as well. Where even so neither stands out, the surer one; where they do
    not differ, the score chooses.
    """
    few, nearest = list(numbers), whole
    for sensor in case.thin:
        pair = (yaw_of(sensor), y_of(sensor))
        if not set(pair) & set(few) or not set(pair) <= set(whole.numbers):
            continue
        others = [each for each in few if each not in pair]
        both = _only(case, nearest, [*others, *pair], NO_FAULT)
        if both.failed:
            continue
        nearest = both
        of_each = [abs(both.significance(each)) for each in pair]
        mine = [each for each, errors in zip(pair, of_each, strict=True) if errors > _SURE_OF_MOUNT]
        if not mine and abs(of_each[0] ** 2 - of_each[1] ** 2) > _TOLD_APART:
            mine = [max(pair, key=lambda n: abs(both.significance(n)))]
        few = [*others, *(mine or [_that_scores_more(case, both, others, pair)])]
    return few, nearest


def _that_scores_more(
    case: Case, whole: Fit, others: Sequence[Number], pair: Sequence[Number]
) -> Number:
    def mean(number: Number) -> float:
        alone = _only(case, whole, [*others, number], NO_FAULT)
        return -math.inf if alone.failed else case.score(alone.hypothesis).scores.mean

    return max(pair, key=mean)


def _whose_bias(
    case: Case, whole: Fit, numbers: Sequence[Number], others: Sequence[Number]
) -> list[Number]:
    """The same numbers; instead of the bias of the thin beam that of a cone, where that is surer.

    The two differ by a bias common to both, of which cones and thin beams together tell little;
    the one that sound sessions feign is taken off both. Only of one thin beam and one cone.
    """
    mine = [n for n in numbers if n.key == "bias_m"]
    if len(mine) != 1 or len(others) != 1 or len(case.thin) != 1:
        return list(numbers)
    both = _only(case, whole, [*numbers, *others], NO_FAULT)
    off, its = (abs(both.value(n) - _COMMON_BIAS_M) / both.error_of(n) for n in (*mine, *others))
    if both.failed or its < off:
        return list(numbers)
    return [others[0] if n == mine[0] else n for n in numbers]


def _starts(
    case: Case, candidates: Sequence[Candidate], start: Hypothesis, advance: Callable[[], None]
) -> list[Hypothesis]:
    """No fault; and of the coarse values those that score best and those by which points fit
    walls best, where they do better."""
    tried = [start]
    for candidate in candidates:
        for values in itertools.product(*candidate.coarse) if candidate.coarse else ():
            begin = start
            for number, value in zip(candidate.numbers, values, strict=True):
                begin = begin.with_number(number, value)
            tried.append(begin)
            case.score(begin)  # remembered, as what follows: to show how far the search is
            case.on_walls(begin, 1.0)
        advance()

    def score(hypothesis: Hypothesis) -> float:
        return case.score(hypothesis).scores.mean

    def walls(hypothesis: Hypothesis) -> float:
        return case.on_walls(hypothesis, 1.0).mean

    by_score, by_walls = (
        [each for each in sorted(tried, key=key, reverse=True) if key(each) > key(start)]
        for key in (score, walls)
    )
    return list(dict.fromkeys([start, *by_score[:_STARTS], *by_walls[:_STARTS_BY_WALLS]]))


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
        found = [
            each
            for fault in _faults(left)
            for each in _counted(case, alone, fault, seen, start, alike)
        ]
        if len(found) == len(left):
            return alone.hypothesis, found
        doubtful = [n for n in left if n not in {each.number for each in found}]
        left.remove(min(doubtful, key=lambda n: abs(alone.significance(n))))
    return start, []


def _faults(numbers: Sequence[Number]) -> list[list[Number]]:
    """Each number alone; those of one mount together."""
    faults = dict[Any, list[Number]]()
    for number in numbers:
        key = ("mount", number.sensor) if number.key in _OF_A_MOUNT else number
        faults.setdefault(key, []).append(number)
    return list(faults.values())


def _counted(
    case: Case, alone: Fit, fault: Sequence[Number], seen: set[Number], start: Hypothesis,
    alike: set[Number],
) -> Iterator[Found]:  # fmt: skip
    """Which numbers of a fault count, and what the score gains by all of them.

    The score hardly tells a turn from a shift of a mount, so both together must stand out as any
    other number must, and each beside the other by walls alone.
    """
    surest = max(fault, key=lambda n: abs(alone.significance(n)))
    judged = case.score(alone.hypothesis)
    others = _only(case, alone, [n for n in alone.numbers if n not in fault], start)
    gain, sure = judged.gain_over(case.score(others.hypothesis)), SURE
    walls = [case.on_walls(each.hypothesis, alone.width) for each in (others, alone)]
    if surest in seen and not _gains(gain):
        gain = judged.gain_over(case.score(start))
        sure = errors_asked(gain, walls[1].gain_over(walls[0]))
        sure = sure if surest in alike else math.inf
    if standing_out(alone, fault) < sure:
        return
    for each in fault:
        errors = abs(alone.significance(each))
        if _is_believed(alone, each) and (each == surest or errors >= _SURE_OF_MOUNT):
            error = _STATED * alone.error_of(each)
            fitting = (walls[0].mean, walls[1].mean)
            yield Found(each, alone.hypothesis, error, gain, fitting, each != surest)


def errors_asked(together: Gain, on_walls: Gain) -> float:
    """How many standard errors, where the score gains nothing sure by a fault alone."""
    if _gains(together) or (on_walls.low > 0.0 and on_walls.mean > _AS_MANY):
        return _SURE_BESIDE
    return _SURE_BY_WALLS if together.high > 0.0 else _SURE_AGAINST


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


def _is_believed(found: Fit, number: Number) -> bool:
    off = abs(found.value(number) - number.neutral)
    return number.least <= off < _BELIEVED * number.most


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
        yield Found(number, best, math.nan, judged.gain_over(base))


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
