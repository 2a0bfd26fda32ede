"""What goes by on each channel of a session, counted while it goes by.

Memory does not grow with the session: times between messages and ranges are kept as histograms.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from recorder.clock import NS_PER_S
from recorder.geometry import SE2, wrap_angle
from recorder.messages import (
    Diagnostics,
    Message,
    Odometry,
    Pose,
    Radiation,
    Range,
    Record,
    Scan,
    Transform,
)

_BINS_PER_OCTAVE = 16  # of the times between messages: 4 % apart
_GAP_FACTOR = 5.0
_BIN_M = 0.01
_FARTHEST_BIN = 10_000
_FASTEST_M_PER_S = 3.0  # small robots do not get there; a tracker that mistakes its tag does
_SHORTEST_JUMP_M = 0.25
_FASTEST_TURN_RAD_PER_S = 4.0 * math.pi
_SHORTEST_FLIP_RAD = math.radians(90.0)
_CLOCK_STEP_NS = 1_000_000_000


@dataclass(slots=True)
class Times:
    """When the messages of a channel were measured: rate, gaps, steps back."""

    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    newest_ns: int = 0
    back: int = 0
    longest_ns: int = 0
    longest_at_ns: int = 0
    clock_steps: int = 0  # the clock of the measurements moved against that of the arrivals
    _delay_ns: int = 0
    _steps: Counter[int] = field(default_factory=Counter)

    def take(self, t_ns: int, log_ns: int) -> None:
        """One message, measured at ``t_ns``, arrived at ``log_ns``."""
        if self.count == 0:
            self.first_ns = self.newest_ns = t_ns
        else:
            self._step(t_ns, t_ns - self.last_ns)
            self.clock_steps += abs(log_ns - t_ns - self._delay_ns) > _CLOCK_STEP_NS
        self._delay_ns = log_ns - t_ns
        self.count += 1
        self.last_ns = t_ns
        self.first_ns, self.newest_ns = min(self.first_ns, t_ns), max(self.newest_ns, t_ns)

    def _step(self, t_ns: int, step_ns: int) -> None:
        self.back += step_ns < 0
        if step_ns > self.longest_ns:
            self.longest_ns, self.longest_at_ns = step_ns, t_ns - step_ns
        if step_ns > 0:
            self._steps[round(_BINS_PER_OCTAVE * math.log2(step_ns))] += 1

    @property
    def span_s(self) -> float:
        """From the first to the last measurement."""
        return (self.newest_ns - self.first_ns) / NS_PER_S

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 when they are all of one time."""
        return (self.count - 1) / self.span_s if self.span_s > 0.0 else 0.0

    @property
    def usual_ns(self) -> float:
        """The median time between two messages that are not of one time."""
        wanted = self._steps.total() / 2
        for bin_, count in sorted(self._steps.items()):
            wanted -= count
            if wanted <= 0:
                return float(2.0 ** (bin_ / _BINS_PER_OCTAVE))
        return 0.0

    @property
    def gaps(self) -> int:
        """How often the time between two messages was over five times the usual."""
        least = _BINS_PER_OCTAVE * math.log2(max(_GAP_FACTOR * self.usual_ns, 1.0)) + 0.5
        return sum(count for bin_, count in self._steps.items() if bin_ > least)


@dataclass(slots=True)
class Readings:
    """The readings of one ranger."""

    sensor: str
    radiation: Radiation
    max_range_m: float
    beam_width_rad: float
    count: int = 0
    nothing: int = 0  # saw nothing, or no nearer than its limit
    too_close: int = 0
    unusable: int = 0  # not a number, zero or negative
    beyond: int = 0  # more than its limit, by more than rounding, and yet a number
    least_m: float = math.inf
    most_m: float = -math.inf
    _bins: Counter[int] = field(default_factory=Counter)

    def take(self, range_m: float) -> None:
        """One reading."""
        self.count += 1
        if range_m == -math.inf:
            self.too_close += 1
        elif math.isnan(range_m) or range_m <= 0.0:
            self.unusable += 1
        else:
            self.nothing += range_m >= self.max_range_m * (1.0 - 1e-6)
            if math.isfinite(range_m):
                self._take_finite(range_m)

    def _take_finite(self, range_m: float) -> None:
        self.beyond += range_m > self.max_range_m * (1.0 + 1e-6)
        self.least_m, self.most_m = min(self.least_m, range_m), max(self.most_m, range_m)
        self._bins[min(int(range_m / _BIN_M), _FARTHEST_BIN)] += 1

    @property
    def finite(self) -> int:
        """How many are a range in metres."""
        return self._bins.total()

    def share_at(self, *ranges_m: float) -> float:
        """Share of the finite readings that are one of these ranges, to the centimetre."""
        bins = {round(range_m / _BIN_M) - below for range_m in ranges_m for below in (0, 1)}
        return sum(self._bins[bin_] for bin_ in bins) / max(self.finite, 1)

    def share_beyond(self, range_m: float) -> float:
        """Share of the finite readings that are farther than ``range_m``, to the centimetre."""
        far = sum(n for bin_, n in self._bins.items() if bin_ > round(range_m / _BIN_M))
        return far / max(self.finite, 1)


@dataclass(slots=True)
class Track:
    """The poses of a tracker or of dead reckoning."""

    count: int = 0
    unusable: int = 0  # not finite
    jumps: int = 0
    longest_jump_m: float = 0.0
    longest_jump_ns: int = 0
    flips: int = 0  # the heading turned by over 90 degrees at once
    moved: bool = False
    least_m: tuple[float, float] = (math.inf, math.inf)
    most_m: tuple[float, float] = (-math.inf, -math.inf)
    _last: tuple[int, SE2] | None = None

    def take(self, t_ns: int, pose: SE2) -> None:
        """One pose."""
        self.count += 1
        if not all(map(math.isfinite, (pose.x_m, pose.y_m, pose.heading_rad))):
            self.unusable += 1
            return
        self.least_m = (min(self.least_m[0], pose.x_m), min(self.least_m[1], pose.y_m))
        self.most_m = (max(self.most_m[0], pose.x_m), max(self.most_m[1], pose.y_m))
        if self._last is not None:
            self._step(t_ns, pose, *self._last)
        self._last = t_ns, pose

    def _step(self, t_ns: int, pose: SE2, last_ns: int, last: SE2) -> None:
        self.moved |= pose != last
        seconds = max((t_ns - last_ns) / NS_PER_S, 1e-3)
        jump_m = math.hypot(pose.x_m - last.x_m, pose.y_m - last.y_m)
        if jump_m > max(_SHORTEST_JUMP_M, _FASTEST_M_PER_S * seconds):
            self.jumps += 1
            if jump_m > self.longest_jump_m:
                self.longest_jump_m, self.longest_jump_ns = jump_m, t_ns
        turn_rad = abs(wrap_angle(pose.heading_rad - last.heading_rad))
        self.flips += turn_rad > max(_SHORTEST_FLIP_RAD, _FASTEST_TURN_RAD_PER_S * seconds)


@dataclass(slots=True)
class Sweeps:
    """The scans of one lidar."""

    count: int = 0
    beams: int = 0
    seen: int = 0

    def take(self, scan: Scan) -> None:
        """One scan."""
        self.count += 1
        self.beams += len(scan.ranges_m)
        near = np.isfinite(scan.ranges_m) & (scan.ranges_m > 0) & (scan.ranges_m < scan.max_range_m)
        self.seen += int(near.sum())


@dataclass(slots=True)
class SessionStats:
    """All that was counted of a session."""

    times: dict[str, Times] = field(default_factory=dict)
    readings: dict[str, Readings] = field(default_factory=dict)
    tracks: dict[str, Track] = field(default_factory=dict)
    sweeps: dict[str, Sweeps] = field(default_factory=dict)
    mounts: dict[str, Transform] = field(default_factory=dict)
    moving: set[str] = field(default_factory=set)
    counters: Mapping[str, int | float | str] = field(default_factory=dict)
    understood: int = 0
    arrivals_back: int = 0
    _last_log_ns: int = 0

    def take(self, record: Record) -> None:
        """One record."""
        self.understood += 1
        # two links may overtake each other on their way into the file, but not by much
        self.arrivals_back += record.log_ns < self._last_log_ns - _CLOCK_STEP_NS
        self._last_log_ns = record.log_ns
        message = record.message
        self.times.setdefault(record.topic, Times()).take(message.t_ns, record.log_ns)
        self._look_inside(record.topic, message)

    def _look_inside(self, topic: str, message: Message) -> None:
        match message:
            case Range():
                if topic not in self.readings:
                    self.readings[topic] = Readings(
                        message.sensor, message.radiation, message.max_range_m,
                        message.beam_width_rad,
                    )  # fmt: skip
                self.readings[topic].take(message.range_m)
            case Pose():
                self.tracks.setdefault(topic, Track()).take(message.t_ns, message.world_from_base)
            case Odometry():
                self.tracks.setdefault(topic, Track()).take(message.t_ns, message.odom_from_base)
            case Scan():
                self.sweeps.setdefault(topic, Sweeps()).take(message)
            case Transform() if message.static:
                self.mounts[message.child] = message
            case Transform():
                self.moving.add(message.child)
            case Diagnostics():
                self.counters = message.counters

    def seconds_at(self, t_ns: int) -> float:
        """A time as seconds since the first measurement."""
        first_ns = min((t.first_ns for t in self._measured()), default=t_ns)
        return (t_ns - first_ns) / NS_PER_S

    def _measured(self) -> Iterator[Times]:
        """The times of the channels that measure something."""
        for topic, times in self.times.items():
            if topic in self.readings or topic in self.tracks or topic in self.sweeps:
                yield times
