"""Cross-talk: a sonar takes the echo of another one's ping for its own.

Such a reading is too short against what the map of its sensor's other readings predicts, and it is
what the other sonar measures at that moment, but for a steady difference: half the way between the
two, and half the way that sound goes between their pings. Sonars whose cones overlap are left
alone: they see the same walls at the same moment, so that nobody could tell. How many would match
by chance follows from the same readings against those that the other sonar took at other times.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.interface import Cause, Plot, Suspect, how_sure
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.scoring.held_out import Gain
from recorder.columns import Floats, Ints
from recorder.geometry import wrap_angle

_SHORT_M, _SHORT = 0.1, 0.05  # so much before what is predicted, and of the range besides
_NEAR_M, _NEAR = 0.02, 0.015  # how near two sonars measure the same echo: twice their own noise
_MOST_M = 1.0  # difference: pings further apart than six milliseconds meet in no common reading
_STEP_M = 0.02
_APART_S = 0.1  # readings further apart were not taken at the same moment
_SHIFTS, _LEAST_SHIFT_S = 60, 4.0
_FEWEST, _FEWEST_SHORT, _SHARE, _SURE = 100, 15, 0.01, 6.0
_BESIDE_RAD = math.radians(5.0)  # between two cones: nearer ones may see the same
_SOUND_MPS = 343.0
_SHOWN = 200


@dataclass(frozen=True, slots=True)
class Talk:
    """What one sonar took over from another.

    ``rows`` (M,) are readings of ``receiver`` that are too short and match; ``chance`` of them
    would anyway, give or take ``spread``. ``short_m`` (S, 2): all that are too short, and what the
    other one measured then. ``offset_m``: what the former are longer.
    """

    receiver: str
    sender: str
    rows: Ints
    short_m: Floats
    offset_m: float
    chance: float
    spread: float
    readings: int

    @property
    def excess(self) -> float:
        """How many readings more than by chance."""
        return len(self.rows) - self.chance

    @property
    def errors(self) -> float:
        """By how many standard deviations that is more."""
        return self.excess / max(self.spread, 1.0)

    @property
    def counts(self) -> bool:
        """Whether it is beyond chance, and worth a word."""
        return self.errors >= _SURE and self.excess >= max(_FEWEST_SHORT, _SHARE * self.readings)


class CrossTalk(Cause):
    """Each pair of sonars that measure at the same moments."""

    name, title = "cross-talk", "two sonars receive each other's echoes"

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """One for each pair."""
        for found in talks(case, hypothesis):
            yield _suspect(case, hypothesis, found)


def talks(case: Case, hypothesis: Hypothesis) -> list[list[Talk]]:
    """Of each pair of sonars that do: what either one took over from the other."""
    if hypothesis not in case.talks:
        case.talks[hypothesis] = list(_talks(case, hypothesis))
    found: list[list[Talk]] = case.talks[hypothesis]
    return found


def _talks(case: Case, hypothesis: Hypothesis) -> Iterator[list[Talk]]:
    sonars = [name for name in case.wide if len(case.rows_of(name)) >= _FEWEST]
    for first, second in itertools.combinations(sonars, 2):
        if _overlap(case, first, second):
            continue
        both = (talk(case, hypothesis, first, second), talk(case, hypothesis, second, first))
        found = [each for each in both if each is not None and each.counts]
        if found:
            yield found


def talking(case: Case, hypothesis: Hypothesis) -> frozenset[str]:
    """The sonars in such pairs: what else is wrong with their echoes nobody can tell."""
    found = itertools.chain.from_iterable(talks(case, hypothesis))
    return frozenset(name for each in found for name in (each.receiver, each.sender))


def _overlap(case: Case, first: str, second: str) -> bool:
    """Whether two cones look the same way, as the session has them mounted."""
    yaws = [case.session.mount(name).heading_rad for name in (first, second)]
    width_rad = sum(case.placed.sensors[name].beam_width_rad for name in (first, second))
    return abs(wrap_angle(yaws[0] - yaws[1])) < 0.5 * width_rad + _BESIDE_RAD


def talk(case: Case, hypothesis: Hypothesis, receiver: str, sender: str) -> Talk | None:
    """What ``receiver`` took over from ``sender``; None where they do not measure together."""
    judged = case.score(hypothesis, [receiver])  # by its own map: mounts of others may be wrong
    ranges_m = case.session.under(hypothesis).ranges_m[case.readings.begins[:-1]]
    mine, its = (_in_time(case, name, ranges_m) for name in (receiver, sender))
    if min(len(mine), len(its)) < _FEWEST:
        return None
    # `judged` holds this sensor's readings alone, in the order of the case's.
    expected_m = np.full(len(case.readings), np.inf)
    expected_m[case.rows_of(receiver)] = judged.expected_m
    nearest, apart_s = _nearest(case.readings.t_ns[mine], case.readings.t_ns[its])
    ahead_m = expected_m[mine] - ranges_m[mine]
    short = (apart_s < _APART_S) & (ahead_m > _SHORT_M + _SHORT * ranges_m[mine])
    short &= np.isfinite(expected_m[mine])
    if short.sum() < _FEWEST_SHORT:
        return None
    rows, at, other_m = mine[short], nearest[short], ranges_m[its]
    offset_m, near = _match(ranges_m[rows], other_m[at])
    rate = (len(its) - 1) / max(np.ptp(case.readings.t_ns[its]) * 1e-9, 1e-9)
    least = min(round(_LEAST_SHIFT_S * rate), len(its) // 4)
    shifts = np.linspace(least, len(its) - least, _SHIFTS).astype(np.int64)
    by_chance = [
        int(_match(ranges_m[rows], other_m[(at + shift) % len(its)])[1].sum()) for shift in shifts
    ]
    return Talk(
        receiver, sender, rows[near], np.column_stack([ranges_m[rows], other_m[at]]), offset_m,
        float(np.mean(by_chance)), float(np.std(by_chance)), len(mine),
    )  # fmt: skip


def _in_time(case: Case, name: str, ranges_m: Floats) -> Ints:
    """The echoes of a sensor, by their times."""
    rows = case.rows_of(name)
    rows = rows[np.isfinite(ranges_m[rows])]
    return rows[np.argsort(case.readings.t_ns[rows], kind="stable")]


def _nearest(t_ns: Ints, others_ns: Ints) -> tuple[Ints, Floats]:
    """Of each time (N,) the nearest of others in order, and how far apart in seconds."""
    after = np.clip(np.searchsorted(others_ns, t_ns), 1, len(others_ns) - 1)
    earlier = (t_ns - others_ns[after - 1]) < (others_ns[after] - t_ns)
    nearest = after - earlier
    return nearest, np.abs(others_ns[nearest] - t_ns) * 1e-9


def _match(mine_m: Floats, other_m: Floats) -> tuple[float, NDArray[np.bool_]]:
    """The difference that most readings have, and which of them (S,)."""
    apart_m = mine_m - other_m
    steps = np.arange(-_MOST_M, _MOST_M + _STEP_M / 2, _STEP_M)
    near = np.abs(apart_m[:, None] - steps) < (_NEAR_M + _NEAR * mine_m)[:, None]
    best = int(np.argmax(near.sum(axis=0)))
    return float(steps[best]), near[:, best]


def _suspect(case: Case, hypothesis: Hypothesis, found: list[Talk]) -> Suspect:
    rows = np.unique(np.concatenate([each.rows for each in found]))
    share = sum(each.excess for each in found) / sum(each.readings for each in found)
    gain = _gain(case, hypothesis, [found[0].receiver, found[0].sender], rows)
    most = max(found, key=lambda each: each.errors)
    reach_m = max(
        each.max_range_m for each in case.placed.sensors.values()
        if each.name in (most.receiver, most.sender)
    )  # fmt: skip
    return Suspect(
        "cross-talk", most.receiver,
        f"{most.receiver} and {most.sender} receive each other's echoes" if len(found) > 1
        else f"{most.receiver} receives the echoes of {most.sender}",
        tuple(map(_evidence, found)), max(gain.mean, 0.5 * share), how_sure(gain, most.errors),
        advice=f"let them ping in turn, {2e3 * reach_m / _SOUND_MPS:.0f} ms or more apart, or turn "
        "them away from each other",
        value=share, unit="share", gain=gain,
        seconds=tuple((t - 0.05, t + 0.05) for t in map(case.seconds, rows[:_SHOWN].tolist())),
        plots=tuple(map(_plot, found)),
    )  # fmt: skip


def _evidence(found: Talk) -> str:
    return (
        f"{len(found.short_m)} of {found.readings} ranges of {found.receiver} are too short for "
        f"the map of its others; {len(found.rows)} of these are what {found.sender} measures at "
        f"that moment (difference {100 * found.offset_m:+.0f} cm), where chance would make it "
        f"{found.chance:.0f} +- {found.spread:.0f}"
    )


def _plot(found: Talk) -> Plot:
    longest_m = float(found.short_m.max())
    ends_m = np.array([max(found.offset_m, 0.0), longest_m])
    return Plot(
        f"ranges of {found.receiver} that are too short; the line: as {found.sender} measures",
        f"range of {found.receiver} (m)", f"range of {found.sender} at that moment (m)",
        points=found.short_m, line=np.column_stack([ends_m, ends_m - found.offset_m]),
    )  # fmt: skip


def _gain(case: Case, hypothesis: Hypothesis, names: list[str], rows: Ints) -> Gain:
    """How much better the other readings of both are predicted without those."""
    readings = case.session.under(hypothesis)
    kept = np.ones(len(readings), np.bool_)
    kept[rows] = False
    return case.judged(readings, names, kept).gain_over(case.score(hypothesis, names))
