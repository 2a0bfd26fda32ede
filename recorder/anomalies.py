"""Anomalies of a session although every byte of it is right: one line for each finding.

Swapped channels, sensors that never change, poses that jump, clocks that step. Nothing here
is certain; each line gives what was seen, so that people can judge.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from recorder.messages import Radiation
from recorder.sensors import kind_of, kind_of_radiation
from recorder.sensors.kinds import BEYOND
from recorder.session.stats import Readings, SessionStats, Times, Track

_ENOUGH = 20  # readings, before a channel is judged
_SHARE = 0.02  # of readings that a few glitches may have
_TROUBLE = (
    "bad_checksum", "malformed", "cut", "overlong", "noise", "unchecked", "gaps", "duplicates",
    "reconnects", "device_restarts", "unknown_sensors", "wheel_leaps", "bad_not_kept",
    "tracker_bad_lines", "tracker_reconnects",
)  # fmt: skip

_CLOCK_NOTES = {
    "dated_by_arrival": "the device's clock is coarser than the arrivals: {} lines are dated by "
    "their arrival",
    "ahead_of_arrival": "the times of {} lines run ahead of their arrival (all sent at once?): "
    "the device's own times are taken",
}


def anomalies(
    session_stats: SessionStats, metadata: Mapping[str, object], *, posed_by_tf: bool = False
) -> Iterator[str]:
    """What people should look at, one line each; ``posed_by_tf``: transforms hold the poses."""
    for topic, readings in session_stats.readings.items():
        for finding in _of_readings(readings):
            yield f"{topic}: {finding}"
    yield from _swapped(session_stats)
    yield from _columns(session_stats, metadata)
    for topic, sweeps in session_stats.sweeps.items():
        if sweeps.count >= _ENOUGH and sweeps.seen == 0:
            yield f"{topic}: not one beam saw anything"
    for topic, track in session_stats.tracks.items():
        for finding in _of_track(track, session_stats):
            yield f"{topic}: {finding}"
    for topic, times in session_stats.times.items():
        for finding in _of_times(times):
            yield f"{topic}: {finding}"
    if session_stats.arrivals_back:
        yield f"the clock of the arrivals steps back {_times(session_stats.arrivals_back)}"
    yield from _of_the_whole(session_stats, posed_by_tf)
    yield from _counted(session_stats)


def _of_readings(readings: Readings) -> Iterator[str]:
    if readings.unusable:
        yield f"{readings.unusable} readings are zero, negative or not a number"
    if readings.max_range_m <= 0.0 or not math.isfinite(readings.max_range_m):
        yield "its messages name no largest range: give sensors.NAME.max_range_m"
    if readings.beam_width_rad <= 0.0 or not math.isfinite(readings.beam_width_rad):
        yield "its messages name no width of the beam: give sensors.NAME.beam_width_deg"
    if readings.count < _ENOUGH:
        return
    if readings.nothing == readings.count:
        yield "saw nothing all the time, or always its largest range: is it plugged in?"
    elif readings.too_close == readings.count:
        yield "everything is too close all the time: is something before it?"
    elif readings.finite == readings.count and readings.least_m == readings.most_m:
        yield f"says {readings.least_m:.3f} m all the time: is it stuck?"


def _swapped(session_stats: SessionStats) -> Iterator[str]:
    """An infrared channel with ranges that only a sonar reaches."""
    for topic, readings in session_stats.readings.items():
        if readings.radiation is not Radiation.INFRARED or readings.finite < _ENOUGH:
            continue
        limit_m = _limit_m(readings)
        kind = kind_of(readings.sensor, readings.radiation)
        invalid = readings.share_at(*kind.invalid_m)
        share = readings.share_beyond(limit_m) - invalid
        if share > _SHARE:
            yield (
                f"{topic}: {share:.0%} of its ranges lie beyond {limit_m:g} m, which it does not "
                f"reach{_near(session_stats, limit_m)}: are the channels swapped?"
            )
        elif invalid > _SHARE:
            yield f"{topic}: {invalid:.0%} of its ranges are what a {kind.title} reports for none"
        elif readings.most_m > limit_m + 0.005:
            yield f"{topic}: infrared beyond {limit_m:g} m ({readings.most_m:.2f} m)"


def _limit_m(readings: Readings) -> float:
    """The farthest that a sensor measures: by its own messages, else by the catalogue."""
    if 0.0 < readings.max_range_m < math.inf:
        return readings.max_range_m
    return kind_of(readings.sensor, readings.radiation).max_range_m


def _columns(session_stats: SessionStats, metadata: Mapping[str, object]) -> Iterator[str]:
    """An importer that had to drop what only swapped columns explain."""
    dropped = metadata.get("dropped")
    infrared = [r for r in session_stats.readings.values() if r.radiation is Radiation.INFRARED]
    usual_m = kind_of_radiation(Radiation.INFRARED).max_range_m
    limit_m = min((_limit_m(readings) for readings in infrared), default=usual_m)
    for reason, far in dropped.items() if isinstance(dropped, Mapping) else ():
        if not isinstance(far, int) or not reason.startswith(BEYOND):
            continue
        total = far + sum(readings.count for readings in infrared)
        if far > _SHARE * total and far >= _ENOUGH:
            yield (
                f"{far / total:.0%} of the infrared readings were dropped at the import, for they "
                f"lay above {reason.removeprefix(BEYOND)}{_near(session_stats, limit_m)}: are the "
                "columns swapped?"
            )


def _near(session_stats: SessionStats, limit_m: float) -> str:
    """A sonar that never sees farther than an infrared ranger's limit."""
    for topic, readings in session_stats.readings.items():
        sonar = readings.radiation is Radiation.ULTRASOUND and readings.finite >= _ENOUGH
        if sonar and readings.share_beyond(limit_m) <= _SHARE:
            return f", and {topic} never gets there"
    return ""


def _of_track(track: Track, session_stats: SessionStats) -> Iterator[str]:
    if track.unusable:
        yield f"{track.unusable} poses are not finite"
    if track.jumps:
        at_s = session_stats.seconds_at(track.longest_jump_ns)
        yield f"jumps {_times(track.jumps)}, at most {track.longest_jump_m:.2f} m, at {at_s:.1f} s"
    if track.flips:
        yield f"the heading turns by over 90 degrees at a stroke, {_times(track.flips)}"
    if track.count >= _ENOUGH and not track.moved:
        yield "never changes"


def _of_times(times: Times) -> Iterator[str]:
    if times.back:
        yield f"its clock steps back {_times(times.back)}"
    if times.clock_steps:
        yield f"its clock steps against that of the arrivals {_times(times.clock_steps)}"
    if times.count >= _ENOUGH and times.span_s == 0.0:
        yield "its clock stands still"


def _of_the_whole(session_stats: SessionStats, posed_by_tf: bool) -> Iterator[str]:
    """What a map needs and the session lacks."""
    ranging = [
        session_stats.times[topic] for topic in (*session_stats.readings, *session_stats.sweeps)
    ]
    if not ranging:
        yield "no ranges: there is nothing to map"
    if not session_stats.tracks:
        if not posed_by_tf:
            yield "no poses: nothing can be put into a map"
    elif ranging:
        posed = [session_stats.times[topic] for topic in session_stats.tracks]
        if min(t.first_ns for t in posed) > max(t.newest_ns for t in ranging) or max(
            t.newest_ns for t in posed
        ) < min(t.first_ns for t in ranging):
            yield "the poses and the ranges are of different times"
    sensors = {r.sensor for r in session_stats.readings.values()}
    if sensors and not session_stats.mounts and not session_stats.moving:
        yield f"no transform mounts {', '.join(sorted(sensors))} on the robot (/tf_static)"


def _counted(session_stats: SessionStats) -> Iterator[str]:
    """What the recorder counted while it recorded."""
    counts = {name: _number(session_stats.counters.get(name, 0)) for name in _TROUBLE}
    trouble = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    if trouble:
        yield f"the recorder counted: {trouble}"
    for name, text in _CLOCK_NOTES.items():
        count = _number(session_stats.counters.get(name, 0))
        if count:
            yield text.format(count)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _number(value: object) -> int:
    try:
        return int(str(value))
    except ValueError:
        return 0
