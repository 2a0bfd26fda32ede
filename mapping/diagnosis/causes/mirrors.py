"""Far echoes of a sonar that spoil its map: over a mirror, past the wall, or placed wrong.

A smooth wall that is met at a slant mirrors sound, and what comes back has gone a longer way. Every
sonar has such echoes, and the usual model of a cone believes far ones little, so they are named
only where its map without them is plainly better by two judges: the thin beams, whose readings it
predicts, and the sonar's own nearer ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.cross_talk import talking
from mapping.diagnosis.causes.interface import Cause, Plot, Suspect, how_sure
from mapping.diagnosis.evaluation import occupied_by_others
from mapping.diagnosis.facing import Overshoot, overshoot, walls_of
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.readings import Readings
from mapping.scoring.held_out import BlockScores, Gain, Judged, judge
from recorder.columns import Ints
from recorder.messages import Radiation

Mask = NDArray[np.bool_]
_CAPS_M = (0.5, 0.8, 1.2, 1.8, 2.5)
_FEWEST, _SHARE = 100, 0.03
_LEVEL, _LEAST_LOW = 0.99, 0.05
_ALIKE = 0.25  # of the gain: what the next reach gains at least
_NEARLY = 0.7  # of the best gain: then the longer reach is taken
_COST = 0.1  # of the gain: a way round, so that what is truly wrong stands before it
_SQUARE_RAD = math.radians(15.0)
_PLAIN_SHARE = 0.05
_SHOWN = 200


@dataclass(frozen=True, slots=True)
class Cap:
    """What a reach of a sonar gains: by the thin beams, and by its own readings within it."""

    reach_m: float
    gain: Gain
    own: Gain


class Mirrors(Cause):
    """Each sonar, judged by the thin beams."""

    name, title = "far-echoes", "far echoes of a sonar spoil its map"

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """One for each sonar."""
        left = talking(case, hypothesis)
        for sensor in case.wide:
            sound = case.placed.sensors[sensor].radiation is Radiation.ULTRASOUND
            if not sound or sensor in left:
                continue
            every = list(caps_of(case, hypothesis, sensor))
            caps = [each for at, each in enumerate(every) if _helps(each) and _is_broad(every, at)]
            if caps:
                best = max(each.gain.mean for each in caps)
                cap = max(
                    (each for each in caps if each.gain.mean >= _NEARLY * best),
                    key=lambda each: each.reach_m,
                )
                yield _suspect(case, hypothesis, sensor, cap)


def _helps(cap: Cap) -> bool:
    return cap.gain.low > _LEAST_LOW and cap.own.mean > 0.0


def _is_broad(caps: Sequence[Cap], at: int) -> bool:
    """Whether the next shorter or longer reach gains as well: one lucky value is no evidence."""
    beside = [*caps[max(at - 1, 0) : at], *caps[at + 1 : at + 2]]
    return any(each.gain.mean > _ALIKE * caps[at].gain.mean for each in beside)


def caps_of(case: Case, hypothesis: Hypothesis, sensor: str) -> Iterator[Cap]:
    """Every reach that leaves enough echoes on either side."""
    readings = case.session.under(hypothesis)
    own, thin = _of(case, (sensor,)), _of(case, case.thin)
    first_m = readings.ranges_m[readings.begins[:-1]]
    least = max(_FEWEST, _SHARE * own.sum())
    if thin.sum() < _FEWEST:
        return
    before = _judged(case, readings, own, (thin, own))
    for reach_m in _CAPS_M:
        near = own & (first_m < reach_m)
        if min(near.sum(), (own & ~near & np.isfinite(first_m)).sum()) < least:
            continue
        after = _judged(case, readings, near, (thin, own))
        by_thin = after[0].gain_over(before[0], level=_LEVEL)
        within = (_within(each[1], near[own]) for each in (after, before))
        yield Cap(reach_m, by_thin, next(within).gain_over(next(within), level=_LEVEL))


def _of(case: Case, sensors: tuple[str, ...]) -> Mask:
    names = np.array([each.name in sensors for each in case.readings.sensors])
    mine: Mask = names[case.readings.sensor]
    return mine


def _judged(case: Case, readings: Readings, of_map: Mask, of_each: Sequence[Mask]) -> list[Judged]:
    """Several lots of readings, each by the map of one sonar's that the others of it draw."""
    maps = occupied_by_others(
        readings.chosen(of_map), case.block[of_map], case.blocks, case.geometry,
        threads=case.threads,
    )  # fmt: skip
    layer = readings.sensors[readings.sensor[of_map][0]].layer
    as_one = tuple(replace(each, layer=layer) for each in readings.sensors)
    return [
        judge(replace(readings.chosen(some), sensors=as_one), case.block[some], case.blocks,
              case.geometry, maps)
        for some in of_each
    ]  # fmt: skip


def _within(judged: Judged, near: Mask) -> BlockScores:
    """The score of the nearer readings alone: those that both maps hold."""
    block = judged.block[near]
    return BlockScores.of(judged.log_likelihood[near], block, judged.blocks)


def _suspect(case: Case, hypothesis: Hypothesis, sensor: str, cap: Cap) -> Suspect:
    seen = overshoot(case, hypothesis, sensor, walls_of(case, hypothesis))
    rows = case.rows_of(sensor)
    far = rows[_far(case, rows, cap.reach_m)]
    thin = " and ".join(case.thin)
    return Suspect(
        "far-echoes", sensor,
        f"echoes of {sensor} from beyond {cap.reach_m:g} m make its map worse",
        (f"{len(far) / len(rows):.0%} of its readings; without them its map predicts the readings "
         f"of {thin} better, and its own nearer ones by {cap.own.mean:+.3f}",
         *(_angles(sensor, seen) if seen is not None else ())),
        _COST * max(cap.gain.mean, 0.0), how_sure(cap.gain, math.nan),
        settings={"sensors": {sensor: {"max_range_m": cap.reach_m}}},
        value=cap.reach_m, unit="m", gain=cap.gain,
        seconds=tuple(
            (t - 0.05, t + 0.05) for t in map(case.seconds, far[:_SHOWN].tolist())
        ),
        plots=() if seen is None else (_plot(sensor, seen),),
    )  # fmt: skip


def _far(case: Case, rows: Ints, reach_m: float) -> Mask:
    range_m = case.readings.ranges_m[case.readings.begins[rows]]
    return np.isfinite(range_m) & (range_m >= reach_m)


def _angles(sensor: str, seen: Overshoot) -> Iterator[str]:
    """How often it measures past a wall of the thin beams, met squarely and at a slant."""
    square = seen.angle_rad <= _SQUARE_RAD
    shares = [float(seen.past[some].mean()) for some in (square, ~square) if some.any()]
    if len(shares) < 2:
        return
    why = (
        "a mirror does not explain the former: the poses or its mount may be off as well"
        if shares[0] > _PLAIN_SHARE
        else "as a mirror does"
    )
    yield (
        f"{sensor} measures past a wall that it meets within {math.degrees(_SQUARE_RAD):.0f} "
        f"degrees of square in {shares[0]:.0%}, past one at a slant in {shares[1]:.0%} of the "
        f"pings: {why}"
    )


def _plot(sensor: str, seen: Overshoot) -> Plot:
    return Plot(
        f"how far {sensor} measures past the wall ahead", "angle of incidence (degrees)",
        "measured less expected (m)",
        points=np.column_stack([np.degrees(seen.angle_rad), seen.beyond_m]),
    )  # fmt: skip
