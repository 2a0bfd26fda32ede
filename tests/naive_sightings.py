"""The obvious twin of what readings say about a wall: one reading at a time, by angles."""

from __future__ import annotations

import math

from mapping.segments.sightings import Sightings
from mapping.segments.stretch import Stretch


def naive_place(sightings: Sightings, k: int, wall: Stretch) -> tuple[float, float] | None:
    """Where reading ``k`` has the wall; None where it does not face it."""
    x, y = sightings.from_m[k].tolist()
    heading = math.atan2(sightings.towards[k, 1], sightings.towards[k, 0])
    r = float(sightings.range_m[k])
    if not sightings.arc[k]:
        return x + r * math.cos(heading), y + r * math.sin(heading)
    across = _across(wall, x, y)
    if _turn(across - heading) > 0.9 * sightings.half_rad[k]:
        return None
    return x + r * math.cos(across), y + r * math.sin(across)


def naive_explains(sightings: Sightings, k: int, wall: Stretch) -> bool:
    """Whether the wall explains reading ``k``."""
    x, y = sightings.from_m[k].tolist()
    heading = math.atan2(sightings.towards[k, 1], sightings.towards[k, 0])
    r = float(sightings.range_m[k])
    near = max(0.025, 0.03 * r)
    if not sightings.arc[k]:
        t, off = _on(wall, x + r * math.cos(heading), y + r * math.sin(heading))
        return wall.begin_m - 0.03 < t < wall.end_m + 0.03 and abs(off) < near
    t = min(max(_on(wall, x, y)[0], wall.begin_m), wall.end_m)
    to_x, to_y = (wall.place_m + t * wall.along).tolist()
    turn = _turn(math.atan2(to_y - y, to_x - x) - heading)
    return turn <= sightings.half_rad[k] and abs(r - math.hypot(to_x - x, to_y - y)) < near


def naive_against(sightings: Sightings, k: int, wall: Stretch) -> bool:
    """Whether reading ``k`` went past where the wall should have been met."""
    x, y = sightings.from_m[k].tolist()
    heading = math.atan2(sightings.towards[k, 1], sightings.towards[k, 0])
    r = float(sightings.range_m[k])
    past, margin = max(0.03, 0.03 * r), min(0.03, 0.2 * wall.length_m)
    across = _across(wall, x, y)
    turn = _turn(across - heading)
    t, off = _on(wall, x, y)
    inside = wall.begin_m + margin, wall.end_m - margin
    if sightings.arc[k]:
        square = turn <= 0.6 * sightings.half_rad[k] and abs(off) > 0.05
        return square and inside[0] < t < inside[1] and r - abs(off) > 2.0 * past
    if not sightings.narrow[k] or math.cos(turn) <= 0.25:
        return False
    way = abs(off) / math.cos(turn)
    met = _on(wall, x + way * math.cos(heading), y + way * math.sin(heading))[0]
    return inside[0] < met < inside[1] and (r - way) * math.cos(turn) > past + 0.03


def _on(wall: Stretch, x: float, y: float) -> tuple[float, float]:
    dx, dy = x - float(wall.place_m[0]), y - float(wall.place_m[1])
    ax, ay = wall.along.tolist()
    return dx * ax + dy * ay, ax * dy - ay * dx


def _across(wall: Stretch, x: float, y: float) -> float:
    """The direction from a place straight to the line of the wall."""
    left = math.atan2(float(wall.along[1]), float(wall.along[0])) + math.pi / 2
    return left + math.pi if _on(wall, x, y)[1] > 0.0 else left


def _turn(angle: float) -> float:
    return abs((angle + math.pi) % (2.0 * math.pi) - math.pi)
