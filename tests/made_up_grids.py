"""Grids of rooms with walls that are known exactly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Thresholded
from mapping.grid import GridGeometry

RESOLUTION_M = 0.02


def thresholded_room() -> Thresholded:
    """A room of one-cell walls with a wall standing into it and a solid box, 4 x 3.2 m."""
    occupied = np.zeros((180, 220), np.bool_)
    occupied[[10, 169], 10:210] = True
    occupied[10:170, [10, 209]] = True
    occupied[10:90, 110] = True
    occupied[120:140, 40:70] = True
    return Thresholded("fused", GridGeometry((-0.5, 1.0), RESOLUTION_M, 180, 220), 0.55, occupied)


def solid_rectangle(
    angle_rad: float, *, resolution_m: float = 0.05, size_m: tuple[float, float] = (4.0, 2.5)
) -> tuple[Thresholded, NDArray[np.float64]]:
    """A filled rectangle, turned, and its corners (4, 2) counter-clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    half = np.array(size_m) / 2.0
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half @ np.array([[c, s], [-s, c]])
    side = math.ceil((float(np.hypot(*half)) + 0.3) / resolution_m)
    geometry = GridGeometry((-side * resolution_m,) * 2, resolution_m, 2 * side, 2 * side)
    rows, cols = np.indices(geometry.shape)
    centres = geometry.centres_of(np.stack([rows, cols], axis=-1))
    own = np.abs(centres @ np.array([[c, -s], [s, c]]))
    return Thresholded("x", geometry, 0.55, (own <= half).all(axis=-1)), corners
