"""Which numbers of a hypothesis explain a session: coarse to fine, alone and then together.

From afar the score without truth shows the way, over a few values of each number; near it, what
makes walls thinnest is finer by far (:mod:`mapping.diagnosis.patches`), where poses are good enough
to draw walls at all. A candidate counts if its numbers differ from nothing by many standard errors
and by more than is worth a word, and if the score gains by it, with its whole interval. Of
candidates that gain alike the simpler one is taken; of two simple ones the one that is left when
both are fitted together.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from mapping.diagnosis.case import Case
from mapping.diagnosis.hypothesis import Hypothesis, Number
from mapping.diagnosis.patches import NO_FAULT, Fit, fit
from mapping.scoring.held_out import Gain, Judged

MOST_CAUSES = 4
SURE = 5.0  # standard errors
LEAST_GAIN = 0.002  # in log-likelihood a reading: of less nobody sees anything
_PLAIN_GAIN = 0.03  # where only the score speaks
_SCORE_LEVEL = 0.99
_BESIDE = 0.15  # of the usual fault: so far from a peak it must still gain
_STARTS = 2
_SHRINK = (0.5, 0.25, 0.125)  # of the coarse step, in a search by the score alone


@dataclass(frozen=True, slots=True)
class Candidate:
    """One thing that may be wrong: numbers that are free together, and values to start from.

    ``parts``: which cause each number is of, and whose. ``by_score``: the score sees it; else
    (scale, bias) only the walls do, from near and far. ``instead_of`` are numbers that would
    explain the same: candidates of them are left out where this one is tried. ``any_plain``: it is
    enough that one of the numbers differs from nothing.
    """

    parts: tuple[tuple[str, str], ...]
    numbers: tuple[Number, ...]
    coarse: tuple[tuple[float, ...], ...] = ()
    by_score: bool = True
    instead_of: tuple[Number, ...] = ()
    any_plain: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """A candidate that was taken: its hypothesis, and what that gains beyond the one before.

    ``errors`` (one a number) are standard errors; NaN where only the score speaks.
    """

    candidate: Candidate
    hypothesis: Hypothesis
    errors: tuple[float, ...]
    gain: Gain
    judged: Judged

    def value(self, number: Number) -> float:
        """What it has found for a number."""
        return self.hypothesis.number(number)


def search(
    case: Case,
    candidates: Sequence[Candidate],
    start: Hypothesis = NO_FAULT,
    advance: Callable[[], None] = lambda: None,
) -> tuple[Hypothesis, list[Found]]:
    """The hypothesis that the candidates come to, and which of them were taken, in that order."""
    current, taken = start, list[Found]()
    replaced = {number for each in candidates for number in each.instead_of}
    candidates = [each for each in candidates if not replaced & set(each.numbers)]
    for by_score in (True, False):
        while sum(len(found.candidate.numbers) for found in taken) < MOST_CAUSES:
            known = {number for found in taken for number in found.candidate.numbers}
            tried: list[Found] = []
            for each in candidates:
                if each.by_score is by_score and not known & set(each.numbers):
                    tried += _tried(case, each, current, taken)
                    advance()
            if not tried:
                break
            taken.append(_best(case, tried, current, taken))
            current = taken[-1].hypothesis
    return current, taken


def _best(case: Case, tried: Sequence[Found], current: Hypothesis, taken: Sequence[Found]) -> Found:
    top = max(tried, key=_worth)
    as_good = [
        each for each in tried
        if not each.candidate.by_score or top.judged.gain_over(each.judged).low <= 0.0
    ]  # fmt: skip
    fewest = min(len(each.candidate.numbers) for each in as_good)
    simple = sorted((e for e in as_good if len(e.candidate.numbers) == fewest), key=_worth)
    best = simple.pop()
    while simple:
        other = simple.pop()
        if other.candidate.numbers != best.candidate.numbers:
            best = _left_together(case, best, other, current, taken)
    return best


def _worth(found: Found) -> float:
    """By the score, where it sees it; else by how sure the walls are."""
    if found.candidate.by_score:
        return found.gain.mean
    return _sureness(found)


def _sureness(found: Found) -> float:
    pairs = zip(found.candidate.numbers, found.errors, strict=True)
    return max(abs(found.value(n) - n.neutral) / e if e > 0 else 0.0 for n, e in pairs)


def _left_together(
    case: Case, best: Found, other: Found, current: Hypothesis, taken: Sequence[Found]
) -> Found:
    """Of two explanations the one whose number is left when both are free."""
    numbers = [*_numbers(taken), *best.candidate.numbers, *other.candidate.numbers]
    both = fit(case.beams(case.thin), numbers, current)
    if both.failed:
        return best
    sure = [
        max(abs(both.significance(n)) for n in each.candidate.numbers) for each in (best, other)
    ]
    return best if sure[0] >= sure[1] else other


def _numbers(taken: Iterable[Found]) -> list[Number]:
    return [number for found in taken for number in found.candidate.numbers]


def _tried(
    case: Case, candidate: Candidate, current: Hypothesis, taken: Sequence[Found]
) -> Iterator[Found]:
    """The best that a candidate comes to by the walls, or where there are none by the score."""
    base, starts = case.score(current), _starts(case, candidate, current)
    numbers = [*_numbers(taken), *candidate.numbers]
    if case.rough:
        if candidate.coarse and len(candidate.numbers) == 1:
            yield from _by_score(case, candidate, starts[0], current)
        return
    good: list[Found] = []
    for begin in starts:
        by_walls = fit(case.beams(case.thin), numbers, begin)
        plain = [_is_plain(by_walls, each) for each in candidate.numbers]
        if by_walls.failed or not (any(plain) if candidate.any_plain else all(plain)):
            continue
        judged = case.score(by_walls.hypothesis)
        errors = tuple(float(by_walls.error[numbers.index(n)]) for n in candidate.numbers)
        found = Found(candidate, by_walls.hypothesis, errors, judged.gain_over(base), judged)
        if _counts(found):
            good.append(found)
    if good:
        yield max(good, key=_worth)


def _by_score(
    case: Case, candidate: Candidate, start: Hypothesis, current: Hypothesis
) -> Iterator[Found]:
    """Where poses are too bad for walls: one broad peak, in both halves of the session, or nothing.

    A peak of one lucky value, or of one stretch, is no evidence.
    """
    number, base = candidate.numbers[0], case.score(current)
    best = _refined(case, candidate, start)
    judged = case.score(best)
    gain = judged.gain_over(base, level=_SCORE_LEVEL)
    value = best.number(number)
    beside = [value - _BESIDE * number.usual, value + _BESIDE * number.usual]
    around = [_gain(case, best.with_number(number, each), base) for each in beside]
    halves = judged.gains_of_halves(base)
    plain = (
        number.least <= abs(value - number.neutral) <= number.usual * 2.0
        and gain.low > 0.0 and gain.mean >= _PLAIN_GAIN
        and min(around) > 0.25 * gain.mean and min(halves) > 0.0
    )  # fmt: skip
    if plain:
        yield Found(candidate, best, (math.nan,), gain, judged)


def _counts(found: Found) -> bool:
    if found.candidate.by_score:
        return found.gain.low > 0.0 and found.gain.mean >= LEAST_GAIN
    return found.gain.high >= 0.0


def _gain(case: Case, hypothesis: Hypothesis, base: Judged) -> float:
    return case.score(hypothesis).gain_over(base).mean


def _is_plain(found: Fit, number: Number) -> bool:
    off = abs(found.value(number) - number.neutral)
    return off >= number.least and abs(found.significance(number)) >= SURE


def _starts(case: Case, candidate: Candidate, current: Hypothesis) -> list[Hypothesis]:
    """The values that score best of the coarse ones, and none."""
    if not candidate.coarse:
        return [current]
    tried = []
    for values in itertools.product(*candidate.coarse):
        begin = _with(current, candidate.numbers, values)
        tried.append((case.score(begin).scores.mean, begin))
    tried.sort(key=lambda pair: -pair[0])
    best = [begin for mean, begin in tried[:_STARTS] if math.isfinite(mean)]
    return [*best, *([] if current in best else [current])]


def _with(hypothesis: Hypothesis, numbers: Sequence[Number], values: Sequence[float]) -> Hypothesis:
    for number, value in zip(numbers, values, strict=True):
        hypothesis = hypothesis.with_number(number, value)
    return hypothesis


def _refined(case: Case, candidate: Candidate, start: Hypothesis) -> Hypothesis:
    """A local search by the score alone, one number after the other, by ever smaller steps."""
    best, top = start, case.score(start).scores.mean
    for share in _SHRINK:
        for number in candidate.numbers:
            for sign in (1.0, -1.0):
                step = sign * share * number.usual * 0.3
                tried = best.with_number(number, best.number(number) + step)
                mean = case.score(tried).scores.mean
                if mean > top:
                    best, top = tried, mean
                    break
    return best
