"""How a robot with two wheels drives a closed route: straight legs, and turns on the spot.

Both at a steady pace, so that pose and wheels at any time follow from a formula: nothing is added
up, and no step has to be chosen. But for slight bends the robot turns the long way round: its
sensors look ahead only, and so they get to see nearly everything from each waypoint.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.geometry import SE2, wrap_angle

SPEED_MPS = 0.18
TURN_RADPS = 1.2
BEND_RAD = math.radians(20.0)


@dataclass(frozen=True, slots=True)
class Leg:
    """A stretch of the route: straight ahead, or a turn on the spot."""

    start: SE2
    forward_m: float
    turn_rad: float

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return self.forward_m / SPEED_MPS + abs(self.turn_rad) / TURN_RADPS

    def wheels_m(self, track_m: float) -> tuple[float, float]:
        """How far the left and the right wheel roll."""
        turn_m = self.turn_rad * track_m / 2.0
        return self.forward_m - turn_m, self.forward_m + turn_m


@dataclass(frozen=True, slots=True)
class DriveState:
    """Where the robot truly is, and how far its wheels have rolled since the start."""

    world_from_base: SE2
    left_m: float
    right_m: float


class Drive:
    """A closed route (N, 2), in metres, driven lap after lap from its first waypoint.

    The robot starts looking at the second waypoint. A route without length is turned on the spot.
    """

    def __init__(self, route_m: NDArray[np.float64], track_m: float) -> None:
        self._legs = _legs(route_m)
        self._track_m = track_m
        self._ends_s: list[float] = []
        self._wheels_m = [(0.0, 0.0)]
        for leg in self._legs:
            left_m, right_m = leg.wheels_m(track_m)
            before_m = self._wheels_m[-1]
            self._ends_s.append((self._ends_s or [0.0])[-1] + leg.duration_s)
            self._wheels_m.append((before_m[0] + left_m, before_m[1] + right_m))

    @property
    def lap_s(self) -> float:
        """How long one lap takes."""
        return self._ends_s[-1]

    def at(self, t_s: float) -> DriveState:
        """The state at ``t_s`` seconds (0 or later) after the start."""
        laps, lap_t_s = divmod(t_s, self.lap_s)
        index = min(bisect.bisect_right(self._ends_s, lap_t_s), len(self._legs) - 1)
        leg = self._legs[index]
        share = 1.0 - (self._ends_s[index] - lap_t_s) / leg.duration_s
        left_m, right_m = leg.wheels_m(self._track_m)
        before_m, lap_m = self._wheels_m[index], self._wheels_m[-1]
        return DriveState(
            leg.start @ SE2(share * leg.forward_m, 0.0, share * leg.turn_rad),
            laps * lap_m[0] + before_m[0] + share * left_m,
            laps * lap_m[1] + before_m[1] + share * right_m,
        )


def _legs(route_m: NDArray[np.float64]) -> list[Leg]:
    """Straight legs and turns of one lap, none without a duration."""
    steps_m = np.roll(route_m, -1, axis=0) - route_m
    moves = [k for k in range(len(route_m)) if math.hypot(*steps_m[k]) > 1e-9]
    if not moves:
        return [Leg(SE2(float(route_m[0, 0]), float(route_m[0, 1]), 0.0), 0.0, 2.0 * math.pi)]
    headings_rad = [math.atan2(steps_m[k, 1], steps_m[k, 0]) for k in moves]
    legs = []
    for k, heading_rad, next_rad in zip(
        moves, headings_rad, [*headings_rad[1:], headings_rad[0]], strict=True
    ):
        length_m = math.hypot(*steps_m[k])
        start = SE2(float(route_m[k, 0]), float(route_m[k, 1]), heading_rad)
        legs.append(Leg(start, length_m, 0.0))
        turn_rad = wrap_angle(next_rad - heading_rad)
        if abs(turn_rad) > BEND_RAD:
            turn_rad -= math.copysign(2.0 * math.pi, turn_rad)
        if abs(turn_rad) > 1e-9:
            legs.append(Leg(start @ SE2(length_m, 0.0, 0.0), 0.0, turn_rad))
    return legs
