"""How a recording goes: its counters and latest values, and these as text for a screen or a log."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from recorder.messages import Pose, Range
from recorder.translation import RecordingCounters

_STEPS_KEPT = 15
_STEPS_NEEDED = 5
_LATE = 0.6  # of a step, before a reading counts as missing


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """How a recording goes, as often as was asked for: for the screen."""

    t_ns: int
    elapsed_s: float
    link_up: bool
    counters: RecordingCounters
    latest: Mapping[str, Range]  # the last reading of each sensor
    rate_hz: Mapping[str, float]  # readings a second of each sensor, of the last whole second
    pose: Pose | None
    missing: Mapping[str, int]  # of each sensor, by its usual pace: an estimate
    paused: bool


class Cadence:
    """How many readings of one sensor did not come, by the pace of those that did.

    Lost lines are counted for the whole link, by their sequence numbers; of which sensor they were
    is not known. A pause of three usual steps misses two readings. ``missing`` is an estimate, and
    0 until the pace is known.
    """

    def __init__(self) -> None:
        self.missing = 0
        self._steps_ns: deque[int] = deque(maxlen=_STEPS_KEPT)
        self._last_ns: int | None = None

    def reading(self, t_ns: int) -> None:
        """One came, measured at ``t_ns``."""
        last_ns, self._last_ns = self._last_ns, t_ns
        if last_ns is None:
            return
        step_ns = t_ns - last_ns
        if len(self._steps_ns) >= _STEPS_NEEDED:
            usual_ns = statistics.median(self._steps_ns)
            if usual_ns > 0:
                self.missing += max(int(step_ns / usual_ns + 1.0 - _LATE) - 1, 0)
        self._steps_ns.append(step_ns)


def damaged_lines(counters: RecordingCounters) -> int:
    """Lines that came and could not be used."""
    return counters.bad_checksum + counters.malformed + counters.cut + counters.overlong


def lost_anything(counters: RecordingCounters) -> bool:
    """Whether something that the device sent is not in the session as it was measured."""
    lines = damaged_lines(counters) + counters.gaps
    return lines > 0 or bool(counters.failure) or nothing_understood(counters)


def nothing_understood(counters: RecordingCounters) -> bool:
    """Whether bytes came, and not one line of them was sound."""
    came = damaged_lines(counters) + counters.noise + counters.unknown_kind
    return counters.received == 0 and came > 0


def range_text(reading: Range) -> str:
    """A range for people."""
    if math.isinf(reading.range_m):
        return "nothing" if reading.range_m > 0.0 else "too close"
    return f"{reading.range_m:.2f} m"


def pose_text(pose: Pose | None) -> str:
    """A pose for people."""
    if pose is None:
        return "no pose yet"
    at = pose.world_from_base
    return f"x {at.x_m:.2f} m, y {at.y_m:.2f} m, {math.degrees(at.heading_rad):.0f} deg"


def status_line(status: RecordingStatus) -> str:
    """All in one line, for where no bars can be drawn."""
    counters = status.counters
    parts = [f"{status.elapsed_s:5.0f} s"]
    if status.paused:
        parts.append("PAUSED")
    if not status.link_up:
        parts.append("no link")
    for name, reading in sorted(status.latest.items()):
        parts.append(f"{name} {range_text(reading)} {status.rate_hz.get(name, 0.0):.0f}/s")
    parts.append(f"bad {damaged_lines(counters)}")
    parts.append(f"missing {counters.gaps}")
    parts.append(f"poses {counters.poses}")
    return "  ".join(parts)
