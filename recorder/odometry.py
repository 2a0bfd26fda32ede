"""Dead reckoning: the counts of two wheel encoders → where the robot thinks that it is.

Between two readings of the counters each wheel is taken to turn evenly, so that the robot moves on
an arc of a circle. The arc is exact, not a chord: the size of the steps does not matter as long as
the ratio of the wheels stays the same.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from recorder.geometry import IDENTITY, SE2, wrap_angle

COUNTER_RANGE = 1 << 16  # unless it is known or found out
LARGEST_RANGE = 1 << 32
_WIDTHS = (16, 32, 15, 31, 24, 8, 10, 12, 14)  # of counters, in bits, the likeliest first
_SURE_RANGES = (1 << 16, 1 << 32)  # no other range is so near that it would be taken for these
_FASTEST_M_S = 10.0
_ALWAYS_POSSIBLE_M = 1.0  # however short the time seems to be
_STEPS_KEPT = 6
_STEPS_NEEDED = 3
_LEAP = 8.0  # times the longest step, back, is no step but the counter's end
_LEAST_RANGE = 64  # of a counter, to be found out


@dataclass(frozen=True, slots=True)
class WheelGeometry:
    """What turns counts into metres: ticks per metre rolled, and how far apart the wheels are.

    ``counter_range`` is after how many counts the counters begin again; None: found out.
    """

    ticks_per_m: float
    track_m: float
    counter_range: int | None = None

    def __post_init__(self) -> None:
        for name, value in (("ticks_per_m", self.ticks_per_m), ("track_m", self.track_m)):
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be above zero, not {value}")
        if self.counter_range is not None and not 2 <= self.counter_range <= LARGEST_RANGE:
            raise ValueError(f"counter_range must be from 2 to 2**32, not {self.counter_range}")


def count_change(before: int, after: int, counter_range: int = COUNTER_RANGE) -> int:
    """How far a counter moved, at most half its range, also past its end (65535 → 0).

    Only the remainder by its range is looked at: signed and wider counters will do.
    """
    half = counter_range // 2
    return (after - before + half) % counter_range - half


def arc(left_m: float, right_m: float, track_m: float) -> SE2:
    """``before_from_after`` when the wheels roll ``left_m`` and ``right_m`` evenly.

    The middle of the axle moves ``s = (right + left) / 2`` along an arc of ``(right - left) /
    track`` radians, thus along a chord of ``s · sin(turn/2) / (turn/2)`` at half the turn.
    """
    turn_rad = (right_m - left_m) / track_m
    half_rad = turn_rad / 2.0
    # math.sin(h) / h is 1 to the last digit long before h is 0.
    shortening = math.sin(half_rad) / half_rad if abs(half_rad) > 1e-9 else 1.0
    chord_m = (left_m + right_m) / 2.0 * shortening
    return SE2(chord_m * math.cos(half_rad), chord_m * math.sin(half_rad), wrap_angle(turn_rad))


class WheelCounter:
    """One wheel's counter: what it shows → how far it moved, past its end too.

    Without a ``counter_range`` the end is found out: a step back that is about as long as all that
    the counter ever showed, while the wheel was going forwards, is the counter's end and no step.
    """

    def __init__(self, counter_range: int | None = None) -> None:
        self.counter_range = counter_range
        self._is_given = counter_range is not None
        self._before: int | None = None
        self._lowest = self._highest = 0
        self._steps: deque[int] = deque(maxlen=_STEPS_KEPT)
        self._longest = 0

    def change(self, count: int, most: float) -> int | None:
        """How far it moved; None where no wheel moves so far (``most`` counts) at once."""
        before, self._before = self._before, count
        if before is None:
            self._lowest = self._highest = count
            return 0
        self._lowest, self._highest = min(self._lowest, count), max(self._highest, count)
        step = self._step(before, count, max(most, 4.0 * self._usual))
        if step is not None:
            self._steps.append(step)
            self._longest = max(self._longest, abs(step))
        return step

    def restart(self) -> None:
        """It begins anew."""
        self._before = None
        self._steps.clear()

    @property
    def _usual(self) -> int:
        """The longest of the last steps, 0 while they are few."""
        return max(map(abs, self._steps)) if len(self._steps) >= _STEPS_NEEDED else 0

    def _step(self, before: int, after: int, most: float) -> int | None:
        change = after - before
        if self._is_given and self.counter_range is not None:
            wrapped = count_change(0, change, self.counter_range)
            return wrapped if abs(wrapped) <= most else None
        if abs(change) <= most and not self._is_leap(change):
            return change
        guesses = [(count_change(0, change, each), each) for each in self._guesses(before, after)]
        usual = min(2.0 * self._usual + 2.0, most)
        for bound in (usual, most):  # what is usual is likelier
            for wrapped, counter_range in guesses:
                surely = most if counter_range in (self.counter_range, *_SURE_RANGES) else bound
                if abs(wrapped) <= surely and abs(wrapped) < abs(change) / 4.0:
                    self.counter_range = counter_range
                    return wrapped
        return change if abs(change) <= most else None

    def _is_leap(self, change: int) -> bool:
        """Whether it turned so far, or back so far, that its end is likelier."""
        if abs(change) >= COUNTER_RANGE // 2:
            return True
        is_long = self._usual > 0 and abs(change) > _LEAP * self._longest
        return is_long and change * self._steps[-1] < 0

    def _guesses(self, before: int, after: int) -> list[int]:
        """Ranges that would explain a leap: none is smaller than what the counter has shown.

        The one that explained the last leap; the widths that counters have; else, for a leap from
        or to about zero or its own negative, the roundest number near it and a usual step.
        """
        unsigned = self._lowest >= 0
        least = self._highest + 1 if unsigned else max(-2 * self._lowest, 2 * self._highest + 1)
        known = [] if self.counter_range is None else [self.counter_range]
        found = [each for each in (*known, *(1 << bits for bits in _WIDTHS)) if each >= least]
        change, usual = after - before, self._usual
        near_zero = after if change < 0 else before
        at_its_end = 0 <= near_zero < 2 * usual or abs(before + after) < 2 * usual
        if usual > 0 and change * self._steps[-1] < 0 and at_its_end:
            nearest = abs(change) + abs(self._steps[-1])
            lowest, highest = max(least, nearest - usual), nearest + usual
            if _LEAST_RANGE <= lowest <= highest:
                found.append(_roundest(lowest, highest, nearest))
        return found


def _roundest(lowest: int, highest: int, nearest: int) -> int:
    """The whole number from ``lowest`` to ``highest`` with the most zeros at its end."""
    for power in range(9, 0, -1):
        unit = int(10**power)
        rounded = min(max(round(nearest / unit), -(-lowest // unit)), highest // unit) * unit
        if lowest <= rounded <= highest:
            return rounded
    return min(max(nearest, lowest), highest)


class DeadReckoning:
    """Adds up arcs. The ``odom`` frame is where the robot stood at the first counts."""

    def __init__(self, geometry: WheelGeometry) -> None:
        self._geometry = geometry
        self._wheels = tuple(WheelCounter(geometry.counter_range) for _ in range(2))
        self._t_ns: int | None = None
        self._odom_from_base = IDENTITY
        self.leaps = 0  # steps that no wheel can make: they moved nothing

    @property
    def counter_range(self) -> int | None:
        """After how many counts the counters begin again, where that is known."""
        return max((wheel.counter_range or 0 for wheel in self._wheels), default=0) or None

    def update(self, left: int, right: int, t_ns: int | None = None) -> SE2:
        """New counts, cumulative, of the time ``t_ns`` → ``odom_from_base`` now."""
        most = self._most_counts(t_ns)
        left_moved, right_moved = (
            wheel.change(count, most)
            for wheel, count in zip(self._wheels, (left, right), strict=True)
        )
        if left_moved is None or right_moved is None:
            self.leaps += 1
        else:
            per_m = self._geometry.ticks_per_m
            moved = arc(left_moved / per_m, right_moved / per_m, self._geometry.track_m)
            self._odom_from_base @= moved
        self._t_ns = t_ns
        return self._odom_from_base

    def _most_counts(self, t_ns: int | None) -> float:
        """How far a wheel can have turned since the last counts."""
        if t_ns is None or self._t_ns is None:
            return COUNTER_RANGE / 2 - 1
        most_m = max(_FASTEST_M_S * (t_ns - self._t_ns) / 1e9, _ALWAYS_POSSIBLE_M)
        return most_m * self._geometry.ticks_per_m

    def restart(self) -> None:
        """The device started anew and counts from zero: the next counts move nothing."""
        for wheel in self._wheels:
            wheel.restart()
