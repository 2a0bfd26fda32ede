"""Single wrong echoes, and the reading filter that the map gains by, where one does.

Every sonar has some: over a mirror, past a corner. In sound simulated rooms a median of three
rejects 6 to 14 % of its readings, so only more is a fault. What cross-talk explains is left to it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.config import Sensor
from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.cross_talk import talking
from mapping.diagnosis.causes.interface import Cause, Suspect, how_sure
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.filters import FILTERS, OFF, PREDICTED
from mapping.placer import Placer
from mapping.scoring.held_out import Gain
from recorder.columns import Ints

LEAST_GAIN = 0.005  # in log-likelihood a reading
LEAST_SHARE = 0.18  # of a sensor's readings
_COST = 0.2  # of a share, at least, in log-likelihood a reading: more than far echoes cost by them
_MOST_REJECTED = 0.5  # of a sensor's readings: a filter that leaves out more is no filter
_SHOWN = 20
_MOST_PREDICTED = 10_000  # readings of a sensor: more take seconds by this filter
_TRIED: tuple[tuple[str, int], ...] = (("median", 3), ("median", 5), ("agree", 2), ("predicted", 3))
_NAMED = {
    "median": "a median of {of}", "agree": "{of} in a row that agree",
    "predicted": "to hold them against the map so far",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Tried:
    """A filter, which readings it rejects, and what the map of the others gains by it."""

    filter: str
    of: int
    rejected: NDArray[np.bool_]
    gain: Gain


class WrongEchoes(Cause):
    """Each sensor of single ranges with each filter: named where the score gains by one."""

    name, title = "wrong-echoes", "single readings are wrong alone"
    needs_walls = False

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """The filter by which a sensor's map predicts its kept readings best."""
        left = talking(case, hypothesis)
        for name in (*case.thin, *case.wide):
            known = case.placed.sensors[name]
            if known.filter != OFF or name in left or case.is_scan(name):
                continue
            alone = _rejected(case, replace(known, filter="median", filter_of=3))
            share = alone.sum() / len(case.rows_of(name))
            if share < LEAST_SHARE:
                continue
            tried = _tries(case, hypothesis, known)
            best = max(tried, key=lambda each: each.gain.mean, default=None)
            if best is not None:
                yield _suspect(case, known, best, float(share))
            else:
                yield _no_filter_helps(case, name, np.flatnonzero(alone), float(share))


def _tries(case: Case, hypothesis: Hypothesis, sensor: Sensor) -> Iterator[_Tried]:
    """The filters that count: both scores are of the readings that are kept."""
    readings = case.session.under(hypothesis)
    before = case.score(hypothesis, [sensor.name])
    count = len(case.rows_of(sensor.name))
    for name, of in _TRIED:
        if name == PREDICTED and count > _MOST_PREDICTED:
            continue
        rejected = _rejected(case, replace(sensor, filter=name, filter_of=of))
        if not 0 < rejected.sum() <= _MOST_REJECTED * count:
            continue
        after = case.judged(readings, [sensor.name], ~rejected)
        gain = after.gain_over(before)
        if gain.mean >= LEAST_GAIN:
            yield _Tried(name, of, rejected, gain)


def _rejected(case: Case, sensor: Sensor) -> NDArray[np.bool_]:
    """Which readings (N,) a sensor's filter rejects."""
    placement = case.placed.placement
    sensors = tuple(sensor if s.name == sensor.name else s for s in placement.sensors)
    placer = Placer(case.config, replace(placement, sensors=sensors))
    for block in case.placed.columns():
        placer.take(block)
    reason = FILTERS[sensor.filter].reason
    found = [each.t_ns for each in placer.dropped_at if each.reason == reason]
    mine = np.zeros(len(case.readings), np.bool_)
    mine[case.rows_of(sensor.name)] = True
    return mine & np.isin(case.readings.t_ns, np.concatenate([np.zeros(0, np.int64), *found]))


def _suspect(case: Case, sensor: Sensor, best: _Tried, share: float) -> Suspect:
    how = _NAMED[best.filter].format(of=best.of)
    return Suspect(
        WrongEchoes.name, sensor.name, f"{_alone(sensor.name, share)}: {how} leaves them out",
        ("the map of the other readings predicts those that are kept better without them",),
        max(best.gain.mean, _COST * share), how_sure(best.gain, math.nan),
        settings={"sensors": {sensor.name: {"filter": best.filter, **_of(best)}}},
        value=share, unit="share", gain=best.gain,
        seconds=_seconds(case, np.flatnonzero(best.rejected)),
    )  # fmt: skip


def _no_filter_helps(case: Case, sensor: str, rows: Ints, share: float) -> Suspect:
    return Suspect(
        WrongEchoes.name, sensor, _alone(sensor, share),
        ("they lie far from the reading before and the one after; no filter makes the map of the "
         "others predict the kept ones better",),
        _COST * share, "likely", advice=f"look at what {sensor} hears: its wiring, other sonars",
        value=share, unit="share", seconds=_seconds(case, rows),
    )  # fmt: skip


def _alone(sensor: str, share: float) -> str:
    return f"{share:.0%} of the readings of {sensor} are wrong alone"


def _seconds(case: Case, rows: Ints) -> tuple[tuple[float, float], ...]:
    return tuple((case.seconds(row), case.seconds(row)) for row in rows[:_SHOWN].tolist())


def _of(best: _Tried) -> dict[str, int]:
    return {} if best.of == FILTERS[best.filter].of else {"filter_of": best.of}
