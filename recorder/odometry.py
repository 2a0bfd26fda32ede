"""Dead reckoning: the counts of two wheel encoders → where the robot thinks that it is.

Between two readings of the counters each wheel is taken to turn evenly, so that the robot moves on
an arc of a circle. The arc is exact, not a chord: the size of the steps does not matter as long as
the ratio of the wheels stays the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from recorder.geometry import IDENTITY, SE2, wrap_angle

COUNTER_RANGE = 1 << 16


@dataclass(frozen=True, slots=True)
class WheelGeometry:
    """What turns counts into metres: ticks per metre rolled, and how far apart the wheels are."""

    ticks_per_m: float
    track_m: float

    def __post_init__(self) -> None:
        for name, value in (("ticks_per_m", self.ticks_per_m), ("track_m", self.track_m)):
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be above zero, not {value}")


def count_change(before: int, after: int) -> int:
    """How far a 16-bit counter moved, in [-32768, 32767], also past its end (65535 → 0).

    Only the lowest 16 bits are looked at: signed and wider counters will do.
    """
    half = COUNTER_RANGE // 2
    return (after - before + half) % COUNTER_RANGE - half


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


class DeadReckoning:
    """Adds up arcs. The ``odom`` frame is where the robot stood at the first counts."""

    def __init__(self, geometry: WheelGeometry) -> None:
        self._geometry = geometry
        self._counts: tuple[int, int] | None = None
        self._odom_from_base = IDENTITY

    def update(self, left: int, right: int) -> SE2:
        """New counts, cumulative and 16 bits wide → ``odom_from_base`` now."""
        if self._counts is not None:
            left_m, right_m = (
                count_change(before, after) / self._geometry.ticks_per_m
                for before, after in zip(self._counts, (left, right), strict=True)
            )
            self._odom_from_base @= arc(left_m, right_m, self._geometry.track_m)
        self._counts = (left, right)
        return self._odom_from_base

    def restart(self) -> None:
        """The device started anew and counts from zero: the next counts move nothing."""
        self._counts = None
