"""Which part of a map is worth looking at: the path and the walls, not the ghosts.

A few readings go far astray (a sonar between two walls, a laser through a window), and the grid
must hold them all. A picture that shows all of it shows the room small.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from mapping.readings import Readings

Floats = NDArray[np.float64]

ASTRAY = 0.03  # of the obstacle points, on each side, that a picture need not show
_ENOUGH = 50_000  # points of each block that are looked at, at most


def frame_of(placed: Iterable[Readings], walls_m: Floats | None = None) -> Floats:
    """The corners (low, high), (2, 2) in metres, around the path and the walls.

    Where the true walls (K, 2, 2) are not known, the obstacle points stand for them, without
    :data:`ASTRAY` of them on each side.
    """
    paths, points = [], []
    for readings in placed:
        base = readings.world_from_base
        path = np.column_stack([base.x_m, base.y_m])
        paths += [path.min(axis=0), path.max(axis=0)] if len(path) else []
        echoes, _ = readings.points_m()
        points.append(echoes[:: len(echoes) // _ENOUGH + 1])
    return frame_around(np.array(paths), np.concatenate([np.zeros((0, 2)), *points]), walls_m)


def frame_around(path_m: Floats, points_m: Floats, walls_m: Floats | None = None) -> Floats:
    """The same from the path (N, 2) and obstacle points (M, 2); (2, 2) zeros from nothing."""
    corners = [path_m] if len(path_m) else []
    if walls_m is not None and len(walls_m):
        corners.append(walls_m.reshape(-1, 2))
    elif len(points_m):
        corners.append(np.quantile(points_m, [ASTRAY, 1.0 - ASTRAY], axis=0))
    if not corners:
        return np.zeros((2, 2))
    every = np.concatenate(corners)
    return np.stack([every.min(axis=0), every.max(axis=0)])
