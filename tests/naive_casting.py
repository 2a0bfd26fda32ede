"""Slow, obvious twins of the kernels that cast beams into a map."""

from __future__ import annotations

import math

import numpy as np


def nearest_in_cone(
    occupied: np.ndarray, x: float, y: float, heading: float, half_width: float, reach: float
) -> float:
    """Every occupied cell, one by one: in the cone, or on the axis; the nearest."""
    found = [math.inf]
    for row, col in np.argwhere(occupied):
        away = complex(col + 0.5 - x, row + 0.5 - y)
        turned = away * complex(math.cos(heading), -math.sin(heading))
        in_cone = abs(math.atan2(turned.imag, turned.real)) <= half_width + 1e-10
        on_axis = turned.real > 0 and abs(turned.imag) <= math.sqrt(0.5) + 1e-9
        if (in_cone or on_axis) and abs(away) <= reach:
            found.append(abs(away))
    return min(found)


def nearest_on_ray(
    occupied: np.ndarray, x: float, y: float, heading: float, reach: float
) -> tuple[float, bool]:
    """Clip the ray to the box of every occupied cell; the one that it enters first.

    Also whether that was close: the ray grazes a corner, or enters near its reach, so that
    rounding decides.
    """
    c, s = math.cos(heading), math.sin(heading)
    first, answer, close = math.inf, math.inf, False
    for row, col in np.argwhere(occupied):
        enter, leave = 0.0, math.inf
        for place, low, way in ((x, float(col), c), (y, float(row), s)):
            if way == 0.0:
                if not low <= place < low + 1:
                    leave = -math.inf
                continue
            ends = sorted(((low - place) / way, (low + 1 - place) / way))
            enter, leave = max(enter, ends[0]), min(leave, ends[1])
        close |= abs(leave - enter) < 1e-6 or abs(enter - reach) < 1e-6
        if enter < leave and enter <= reach and enter < first:
            first, answer = enter, math.hypot(col + 0.5 - x, row + 0.5 - y)
    return answer, close
