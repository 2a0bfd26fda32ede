"""The slow, obvious way to find what a ray meets: one ray and one wall at a time."""

from __future__ import annotations

import math


def nearest_wall(walls, origin, heading_rad):
    """Distance to the nearest wall along one ray and the angle to its normal; (inf, None) if none.

    The wall is turned into the frame of the ray, which looks along +x there: it is met where its
    ends lie on different sides of the x axis.
    """
    best, incidence_rad = math.inf, None
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    for start, end in walls:
        (ax, ay), (bx, by) = [
            (
                c * (p[0] - origin[0]) + s * (p[1] - origin[1]),
                -s * (p[0] - origin[0]) + c * (p[1] - origin[1]),
            )
            for p in (start, end)
        ]
        if ay == by or max(ay, by) < 0 or min(ay, by) > 0:
            continue
        share = ay / (ay - by)
        distance = ax + share * (bx - ax)
        if 0.0 < distance < best:
            best = distance
            slope = math.atan2(by - ay, bx - ax)
            incidence_rad = abs(math.pi / 2 - abs(slope))
    return best, incidence_rad


def point_to_wall(point, wall, steps=20_000):
    """Distance of a point from a wall, by walking along the wall."""
    (ax, ay), (bx, by) = wall
    return min(
        math.hypot(
            ax + (bx - ax) * k / steps - point[0],
            ay + (by - ay) * k / steps - point[1],
        )
        for k in range(steps + 1)
    )
