"""Walls as straight pieces, and how far things stand from them.

Walls are an array (K, 2, 2): K pieces, each from one end to the other, in metres in the map frame.
They have no thickness; a box is four of them, a round pillar many short ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Walls = NDArray[np.float64]


def path(points: Sequence[tuple[float, float]], *, closed: bool = False) -> Walls:
    """The pieces (K, 2, 2) between neighbouring points; ``closed`` adds the one back to the start.

    Pieces without length are left out.
    """
    corners = np.asarray([*points, points[0]] if closed else points, dtype=np.float64)
    pieces = np.stack([corners[:-1], corners[1:]], axis=1)
    return pieces[np.any(pieces[:, 0] != pieces[:, 1], axis=1)]


def rectangle(
    centre: tuple[float, float], width_m: float, height_m: float, angle_rad: float = 0.0
) -> Walls:
    """The four sides of a rectangle, ``width_m`` along the direction ``angle_rad``."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    x, y = width_m / 2.0, height_m / 2.0
    corners = [
        (centre[0] + c * right - s * up, centre[1] + s * right + c * up)
        for right, up in ((-x, -y), (x, -y), (x, y), (-x, y))
    ]
    return path(corners, closed=True)


def disc(centre: tuple[float, float], radius_m: float, sides: int = 24) -> Walls:
    """A round pillar as a regular polygon whose corners lie on the circle."""
    turns = [2.0 * math.pi * i / sides for i in range(sides)]
    return path(
        [(centre[0] + radius_m * math.cos(t), centre[1] + radius_m * math.sin(t)) for t in turns],
        closed=True,
    )


def join(*groups: Walls) -> Walls:
    """Several groups of walls as one read-only array."""
    walls = np.concatenate(groups)
    walls.setflags(write=False)
    return walls


def point_clearance(points_m: Points, walls: Walls) -> NDArray[np.float64]:
    """Distance of points (..., 2) from walls (..., 2, 2), the leading axes broadcast."""
    start, along = walls[..., 0, :], walls[..., 1, :] - walls[..., 0, :]
    length_sq = np.maximum(np.square(along).sum(axis=-1), np.finfo(np.float64).tiny)
    share = np.clip(((points_m - start) * along).sum(axis=-1) / length_sq, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points_m - start - share[..., None] * along, axis=-1))


def leg_clearance(start: Points, end: Points, walls: Walls) -> float:
    """Least distance between a straight leg and any wall, 0 where they cross; inf without walls."""
    if len(walls) == 0:
        return math.inf
    leg = np.stack([start, end])
    if np.any(_crosses(leg, walls)):
        return 0.0
    from_wall_ends = float(point_clearance(walls.reshape(-1, 2), leg).min())
    from_leg_ends = float(point_clearance(leg[:, None], walls).min())
    return min(from_wall_ends, from_leg_ends)


def _crosses(leg: Points, walls: Walls) -> NDArray[np.bool_]:
    """Which walls (K, 2, 2) the leg (2, 2) meets between their ends and its own."""

    def side(a: Points, b: Points, p: Points) -> NDArray[np.float64]:
        ab, ap = b - a, p - a
        return np.asarray(ab[..., 0] * ap[..., 1] - ab[..., 1] * ap[..., 0])

    a, b = walls[:, 0], walls[:, 1]
    across_wall = side(a, b, leg[0]) * side(a, b, leg[1]) < 0.0
    across_leg = side(leg[0], leg[1], a) * side(leg[0], leg[1], b) < 0.0
    return np.asarray(across_wall & across_leg)
