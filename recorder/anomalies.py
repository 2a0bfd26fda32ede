"""What is odd about a session although every byte of it is right: one line for each finding.

Swapped channels, sensors that say always the same, poses that jump, clocks that step. Nothing here
is certain; each line says what was seen, so that people can judge.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from recorder.messages import Radiation
from recorder.session.stats import Readings, SessionStats, Times, Track

INFRARED_LIMIT_M = 0.8  # the infrared rangers of such robots never measure farther
_ENOUGH = 20  # readings, before anything is said of a channel
_SHARE = 0.02  # of readings that a few glitches may have
_TROUBLE = (
    "bad_checksum", "malformed", "cut", "overlong", "noise", "unchecked", "gaps", "duplicates",
    "reconnects", "device_restarts", "unknown_sensors", "tracker_bad_lines", "tracker_reconnects",
)  # fmt: skip


def anomalies(session_stats: SessionStats, metadata: Mapping[str, object]) -> Iterator[str]:
    """What people should look at, one line each."""
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
    yield from _of_the_whole(session_stats)
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
        share = readings.share_beyond(INFRARED_LIMIT_M)
        if share > _SHARE:
            yield (
                f"{topic}: {share:.0%} of its ranges lie beyond {INFRARED_LIMIT_M:g} m, which "
                f"infrared does not reach{_near(session_stats)}: are the channels swapped?"
            )
        elif readings.most_m > INFRARED_LIMIT_M + 0.005:
            yield f"{topic}: infrared beyond {INFRARED_LIMIT_M:g} m ({readings.most_m:.2f} m)"


def _columns(session_stats: SessionStats, metadata: Mapping[str, object]) -> Iterator[str]:
    """An importer that had to drop what only swapped columns explain."""
    dropped = metadata.get("dropped")
    far = dropped.get("infrared above 80 cm", 0) if isinstance(dropped, Mapping) else 0
    kept = sum(
        r.count for r in session_stats.readings.values() if r.radiation is Radiation.INFRARED
    )
    if isinstance(far, int) and far > _SHARE * (kept + far) and far >= _ENOUGH:
        yield (
            f"{far / (kept + far):.0%} of the infrared readings were dropped at the import, for "
            f"they lay above 80 cm{_near(session_stats)}: are the columns swapped?"
        )


def _near(session_stats: SessionStats) -> str:
    """A sonar that never sees farther than an infrared ranger does."""
    for topic, readings in session_stats.readings.items():
        sonar = readings.radiation is Radiation.ULTRASOUND and readings.finite >= _ENOUGH
        if sonar and readings.share_beyond(INFRARED_LIMIT_M) <= _SHARE:
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


def _of_the_whole(session_stats: SessionStats) -> Iterator[str]:
    """What a map needs and the session lacks."""
    ranging = [
        session_stats.times[topic] for topic in (*session_stats.readings, *session_stats.sweeps)
    ]
    if not ranging:
        yield "no ranges: there is nothing to map"
    if not session_stats.tracks:
        yield "no poses: nothing can be put into a map"
    elif ranging:
        posed = [session_stats.times[topic] for topic in session_stats.tracks]
        if min(t.first_ns for t in posed) > max(t.newest_ns for t in ranging) or max(
            t.newest_ns for t in posed
        ) < min(t.first_ns for t in ranging):
            yield "the poses and the ranges are of different times"
    sensors = {r.sensor for r in session_stats.readings.values()}
    if sensors and not session_stats.mounts:
        yield f"nothing says where {', '.join(sorted(sensors))} sit on the robot (/tf_static)"


def _counted(session_stats: SessionStats) -> Iterator[str]:
    """What the recorder counted while it recorded."""
    counts = {name: _number(session_stats.counters.get(name, 0)) for name in _TROUBLE}
    trouble = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    if trouble:
        yield f"the recorder counted: {trouble}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _number(value: object) -> int:
    try:
        return int(str(value))
    except ValueError:
        return 0
