"""How a recording goes, in words: what a terminal and a log file both need."""

from __future__ import annotations

import math

from recorder.messages import Pose, Range
from recorder.recording.loop import RecordingStatus
from recorder.recording.translation import RecordingCounters


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
