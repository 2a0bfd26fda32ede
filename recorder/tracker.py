"""The overhead tracker: poses as JSON lines over TCP or UDP.

A line is ``{"t_s": ..., "x": ..., "y": ..., "heading_deg": ...}``, in metres, or in pixels with the
origin at the bottom left; other keys are ignored. ``t_s`` (UNIX seconds, when the picture was
taken) is used while it agrees with the host's clock; without it the pose is dated by its arrival.
"""

from __future__ import annotations

import json
import math
import threading
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from recorder.clock import NS_PER_S, Clock
from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.link import ByteSource, Link, LinkEvent
from recorder.messages import Pose

MAX_LINE_BYTES = 1024
FARTHEST_M = 1e5  # nobody tracks a robot from farther away
CLOCK_TOLERANCE_S = 2.0

_MAX_HEADING_DEG = 1e6


@dataclass(frozen=True, slots=True)
class TrackedPose:
    """A pose, when it arrived, and whether it was dated by its arrival for want of a good time."""

    pose: Pose
    arrival_ns: int
    dated_by_arrival: bool


@dataclass(frozen=True, slots=True)
class BadTrackerLine:
    """A line that holds no pose, and why."""

    reason: str


TrackerEvent = TrackedPose | BadTrackerLine | LinkEvent


class PoseSource(typing.Protocol):
    """Where poses come from, as a :class:`recorder.link.ByteSource` is where bytes do."""

    def events(self, stop: threading.Event) -> Iterator[TrackerEvent]:
        """Poses, bad lines and changes of state in order of arrival, until ``stop`` is set."""


class Tracker:
    """The poses that a source of bytes brings, in metres."""

    def __init__(self, source: ByteSource, *, px_per_m: float | None = None) -> None:
        self._source = source
        if px_per_m is not None and not (math.isfinite(px_per_m) and px_per_m > 0.0):
            raise BadInput(f"a tracker of {px_per_m} pixels per metre makes no sense")
        self._units_per_m = 1.0 if px_per_m is None else px_per_m

    def events(self, stop: threading.Event) -> Iterator[TrackerEvent]:
        """Poses, bad lines and changes of the link, in order of arrival, until ``stop`` is set.

        Raises LinkError when the first connection fails and is not waited for.
        """
        lines = _Lines()
        for event in self._source.events(stop):
            if isinstance(event, LinkEvent):
                lines = _Lines()  # half a line of an old connection is no start of a new one
                yield event
                continue
            for line in lines.feed(event.data):
                yield read_pose(line, event.arrival_ns, self._units_per_m)


def open_tracker(url: str, *, clock: Clock, px_per_m: float | None = None) -> Tracker:
    """A tracker at ``tcp://HOST:PORT`` (we connect) or ``udp://HOST:PORT`` (we listen).

    ``px_per_m``: it sends pixels, so many a metre. It is connected at once, LinkError if that
    fails; BadInput on an address or a scale that cannot be.
    """
    if not url.startswith(("tcp://", "udp://")):
        raise BadInput(f"{url}: a tracker is tcp://HOST:PORT or udp://HOST:PORT")
    link = Link(url, clock=clock)
    tracker = Tracker(link, px_per_m=px_per_m)
    link.open()
    return tracker


def read_pose(
    line: bytes, arrival_ns: int, units_per_m: float = 1.0
) -> TrackedPose | BadTrackerLine:
    """One line of a tracker; never raises.

    A time more than 2 s off the arrival is not believed, and no pose is later than its arrival.
    """
    if len(line) > MAX_LINE_BYTES:
        return BadTrackerLine("the line is too long")
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return BadTrackerLine("it is not JSON")
    if not isinstance(fields, dict):
        return BadTrackerLine("it is not a JSON object")
    x, y = _number(fields, "x"), _number(fields, "y")
    heading_deg = _number(fields, "heading_deg")
    if x is None or y is None or heading_deg is None:
        return BadTrackerLine("x, y and heading_deg are needed, as numbers")
    pose = SE2(x / units_per_m, y / units_per_m, wrap_angle(math.radians(heading_deg)))
    if max(abs(pose.x_m), abs(pose.y_m)) > FARTHEST_M or abs(heading_deg) > _MAX_HEADING_DEG:
        return BadTrackerLine("no robot stands there")
    t_ns = _measured_ns(_number(fields, "t_s"), arrival_ns)
    if t_ns is None:
        return TrackedPose(Pose(arrival_ns, pose), arrival_ns, dated_by_arrival=True)
    return TrackedPose(Pose(t_ns, pose), arrival_ns, dated_by_arrival=False)


def _measured_ns(t_s: float | None, arrival_ns: int) -> int | None:
    """The tracker's time if the host's clock bears it out."""
    if t_s is None or abs(t_s - arrival_ns / NS_PER_S) > CLOCK_TOLERANCE_S:
        return None
    whole_s = math.floor(t_s)  # apart, as the product would lose some 100 ns
    return min(whole_s * NS_PER_S + round((t_s - whole_s) * NS_PER_S), arrival_ns)


def _number(fields: dict[str, Any], name: str) -> float | None:
    """The finite number under ``name``, if there is one (JSON's true is none)."""
    value = fields.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return None
    return number if math.isfinite(number) else None


class _Lines:
    """Cuts bytes into lines without their ends; what is too long is handed out in pieces."""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> list[bytes]:
        *lines, self._pending = (self._pending + data).split(b"\n")
        if len(self._pending) > MAX_LINE_BYTES:
            lines.append(self._pending)
            self._pending = b""
        return [line for line in lines if line.strip()]
