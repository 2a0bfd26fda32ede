"""Planar geometry: rigid motions, angles and interpolation between two poses.

Names chain as in ``world_from_sensor = world_from_base @ base_from_sensor``: the frame on the right
of one factor is the frame on the left of the next. x points right or forward, y up or left, angles
run counter-clockwise (ROS REP 103).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class SE2:
    """A rigid motion of the plane, or a pose: where frame B stands in frame A (``a_from_b``)."""

    x_m: float
    y_m: float
    heading_rad: float

    def __matmul__(self, other: SE2) -> SE2:
        """``a_from_b @ b_from_c == a_from_c``."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return SE2(
            self.x_m + c * other.x_m - s * other.y_m,
            self.y_m + s * other.x_m + c * other.y_m,
            wrap_angle(self.heading_rad + other.heading_rad),
        )

    def inverse(self) -> SE2:
        """``a_from_b.inverse() == b_from_a``."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return SE2(
            -c * self.x_m - s * self.y_m,
            s * self.x_m - c * self.y_m,
            wrap_angle(-self.heading_rad),
        )

    def transform(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points ``(N, 2)`` in frame B, metres → the same points in frame A."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        turned_m = points_m @ np.array([[c, s], [-s, c]])
        moved_m: NDArray[np.float64] = turned_m + np.array([self.x_m, self.y_m])
        return moved_m


IDENTITY = SE2(0.0, 0.0, 0.0)


def wrap_angle(angle_rad: float) -> float:
    """The same direction in [-π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def interpolate(a: SE2, b: SE2, fraction: float) -> SE2:
    """Between two poses: position along the straight line, heading along the shorter arc."""
    turn_rad = wrap_angle(b.heading_rad - a.heading_rad)
    return SE2(
        a.x_m + fraction * (b.x_m - a.x_m),
        a.y_m + fraction * (b.y_m - a.y_m),
        wrap_angle(a.heading_rad + fraction * turn_rad),
    )
