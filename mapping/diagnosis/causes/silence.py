"""A sensor that repeats itself, or that is silent for a while.

No echo for a while is usual where there is room. A sensor is stuck there if echoes should have come
(:mod:`mapping.diagnosis.own_walls`), many, and many more than in any other such stretch: in sound
sessions no stretch holds more than five. Of a cone nobody knows where in it a wall was, so there,
and where the places are too far apart, only a stretch counts that is far longer than any other.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from mapping.diagnosis.causes.interface import Cause, Evidence, Suspect
from mapping.diagnosis.own_walls import expected_echoes
from mapping.diagnosis.raw import Channel, channels
from recorder.columns import Floats
from recorder.messages import Radiation
from recorder.numbers import median

if TYPE_CHECKING:
    from mapping.diagnosis.case import Stretch

_LEAST_READINGS = 30
_LEAST_S = 2.0
_MOVED_M, _TURNED_RAD = 0.15, 0.6
_SHARE = 0.02
_NOTHING = -1.0  # no echo, where runs of equal ranges are looked for
_LEAST_BLIND_S = 6.0  # sound sensors miss what they should see for up to that long
_MISSED, _MORE = 10, 2.5  # echoes that should have come in a run, and times those of the next one
_LONG_S, _LONGER = 8.0, 3.0  # or it is so long, and so many times the next one
_DOES = {True: "repeat one range", False: "see nothing"}
_GAPS = 20.0  # times the usual time between readings


class Silence(Cause):
    """Stretches of equal ranges while the robot moves; gaps that the other sensors do not have."""

    name, title = "silence", "a sensor is stuck, or dead"

    def suspects(self, evidence: Evidence) -> Iterator[Suspect]:
        """One for each sensor: how long it is stuck, and how long dead."""
        every = channels(evidence)
        for channel in every:
            stuck = stuck_stretches(evidence, channel)
            count = sum(end - first for first, end in stuck)
            if count > _SHARE * len(channel.t_ns):
                yield _stuck(channel, stuck, count)
            others = [each for each in every if each is not channel]
            if others and (gaps := _gaps(channel, others)):
                yield _dead(channel, gaps)


def stuck_readings(evidence: Evidence) -> list[Stretch]:
    """All stretches in which a sensor is stuck."""
    from mapping.diagnosis.case import Stretch

    return [
        Stretch(channel.sensor, int(channel.t_ns[first]), int(channel.t_ns[end - 1]))
        for channel in channels(evidence)
        for first, end in stuck_stretches(evidence, channel)
    ]


def stuck_stretches(evidence: Evidence, channel: Channel) -> list[tuple[int, int]]:
    """Runs (first, end) of equal readings, too long to be chance, in which the robot moved."""
    if channel.sensor not in evidence.stuck:
        evidence.stuck[channel.sensor] = _stuck_stretches(evidence, channel)
    return evidence.stuck[channel.sensor]


def _stuck_stretches(evidence: Evidence, channel: Channel) -> list[tuple[int, int]]:
    value = np.nan_to_num(channel.range_m, posinf=_NOTHING, neginf=-2.0)
    edges = np.flatnonzero(np.diff(value) != 0) + 1
    bounds = np.concatenate([[0], edges, [len(value)]])
    runs = [
        (first, end)
        for first, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
        if value[first] >= _NOTHING and _is_long(evidence, channel, first, end)
    ]
    found = [run for run in runs if value[run[0]] != _NOTHING]
    nothing = [run for run in runs if value[run[0]] == _NOTHING]
    return sorted(found + _blind(evidence, channel, nothing, found))


def _is_long(evidence: Evidence, channel: Channel, first: int, end: int) -> bool:
    """Whether a run is too long to be chance, and the robot moved in it."""
    lasted_s = (channel.t_ns[end - 1] - channel.t_ns[first]) * 1e-9
    if end - first < _LEAST_READINGS or lasted_s < _LEAST_S:
        return False
    poses, known = evidence.placed.placement.track.at(channel.t_ns[first:end])
    x, y, heading = (np.asarray(v)[known] for v in (poses.x_m, poses.y_m, poses.heading_rad))
    moved = len(x) > 1 and (_span(x, y) > _MOVED_M or np.ptp(np.unwrap(heading)) > _TURNED_RAD)
    return bool(moved)


def _blind(
    evidence: Evidence, channel: Channel, nothing: list[tuple[int, int]],
    stuck: list[tuple[int, int]],
) -> list[tuple[int, int]]:  # fmt: skip
    """Those of the runs without an echo in which echoes should have come.

    Stretches in which the sensor is stuck at a range draw no walls.
    """
    if not nothing:
        return []
    if channel.radiation is Radiation.ULTRASOUND or not np.isfinite(channel.range_m).any():
        return [run for run in nothing if _is_longest(channel, *run)]
    readings = evidence.readings()
    for first, end in stuck:
        low_ns, high_ns = channel.t_ns[first], channel.t_ns[end - 1]
        readings = readings.chosen((readings.t_ns < low_ns) | (readings.t_ns > high_ns))
    expected = expected_echoes(readings, channel.sensor)
    if expected is None:
        return [run for run in nothing if _is_longest(channel, *run)]
    missed = [expected.missed_between(*channel.t_ns[[first, end - 1]]) for first, end in nothing]
    return [
        (first, end) for at, (first, end) in enumerate(nothing)
        if missed[at] >= max(_MISSED, _MORE * max([*missed[:at], *missed[at + 1 :], 0]))
        and channel.t_ns[end - 1] - channel.t_ns[first] > _LEAST_BLIND_S * 1e9
    ]  # fmt: skip


def _is_longest(channel: Channel, first: int, end: int) -> bool:
    """Whether a run without an echo is far longer than all others."""
    nothing = np.concatenate([[False], np.isposinf(channel.range_m), [False]])
    runs = np.flatnonzero(np.diff(nothing.astype(np.int8))).reshape(-1, 2)
    counts = np.diff(runs, axis=1)[:, 0]
    next_one = counts[runs[:, 0] != first].max(initial=_LEAST_READINGS)
    lasted_s = (channel.t_ns[end - 1] - channel.t_ns[first]) * 1e-9
    return bool(lasted_s > _LONG_S and end - first > _LONGER * next_one)


def _span(x: Floats, y: Floats) -> float:
    return float(np.hypot(np.ptp(x), np.ptp(y)))


def _stuck(channel: Channel, stuck: list[tuple[int, int]], count: int) -> Suspect:
    share = count / len(channel.t_ns)
    seconds = tuple((channel.seconds(first), channel.seconds(end - 1)) for first, end in stuck)
    longest = max(stuck, key=lambda run: run[1] - run[0])
    at_m = channel.range_m[longest[0]]
    first_s, last_s = channel.seconds(longest[0]), channel.seconds(longest[1] - 1)
    seen = f"{at_m:.3f} m" if np.isfinite(at_m) else "no echo"
    kinds = {bool(np.isfinite(channel.range_m[first])) for first, _ in stuck}
    return Suspect(
        "silence", channel.sensor,
        f"{channel.sensor} is stuck: {share:.0%} of its readings "
        f"{' or '.join(_DOES[kind] for kind in sorted(kinds))} while the robot moves",
        (f"the longest time {seen} from {first_s:.1f} s to {last_s:.1f} s, "
         f"{longest[1] - longest[0]} readings",),
        2.0 * share, "almost certain" if True in kinds else "likely",
        advice="check the cable and the supply; leave these stretches out",
        value=share, unit="share", seconds=seconds,
    )  # fmt: skip


def _gaps(channel: Channel, others: list[Channel]) -> list[tuple[float, float]]:
    """Stretches in which it is silent and another sensor is not."""
    begin = min(each.t_ns[0] for each in (channel, *others))
    end = max(each.t_ns[-1] for each in (channel, *others))
    times = np.concatenate([[begin], channel.t_ns, [end]])
    gaps = np.diff(times)
    usual = median(gaps)
    found = []
    for at in np.flatnonzero(gaps > max(_GAPS * usual, 2.0 * _LEAST_S * 1e9)).tolist():
        low, high = times[at], times[at + 1]
        if any(((each.t_ns > low) & (each.t_ns < high)).sum() > _GAPS for each in others):
            found.append(((low - channel.start_ns) * 1e-9, (high - channel.start_ns) * 1e-9))
    return found


def _dead(channel: Channel, gaps: list[tuple[float, float]]) -> Suspect:
    total = sum(end - first for first, end in gaps)
    first, end = max(gaps, key=lambda gap: gap[1] - gap[0])
    return Suspect(
        "silence", channel.sensor, f"{channel.sensor} is silent for {total:.0f} s in all",
        (f"the longest time from {first:.1f} s to {end:.1f} s, while others go on",),
        0.3, "almost certain", advice="check the sensor's cable and supply", value=total, unit="s",
        seconds=tuple(gaps),
    )  # fmt: skip
