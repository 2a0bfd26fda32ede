"""A patch of cells as a piece of wall, and where beside it another map has a wall like it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ends = tuple[tuple[float, float], tuple[float, float]]

FARTHEST_MOVE_M = 0.6
"""A wall further away is another wall."""
_FILLED, _FILLED_NEW = 0.5, 0.1
_ONE_SIDED = 2.0  # a wall faces the side that has so many times the free cells of the other


@dataclass(frozen=True, slots=True)
class Patch:
    """A piece of wall: its middle, its direction, how far it reaches along that, one cell."""

    centre_m: Floats
    along: Floats
    low_m: float
    high_m: float
    cell_m: float

    @property
    def length_m(self) -> float:
        """From end to end, metres."""
        return self.high_m - self.low_m

    def span(self, sideways_m: float) -> Ends:
        """The two ends of the patch, moved to its left."""
        middle = self.centre_m + sideways_m * np.array([-self.along[1], self.along[0]])
        (x0, y0), (x1, y1) = (
            (middle + reach * self.along).tolist() for reach in (self.low_m, self.high_m)
        )
        return (x0, y0), (x1, y1)

    def beside(self, points_m: Floats) -> tuple[Floats, Floats]:
        """Of the points (N, 2) beside the patch: how far along it and how far to its left."""
        apart = points_m - self.centre_m
        lengthwise = apart @ self.along
        sideways = self.along[0] * apart[:, 1] - self.along[1] * apart[:, 0]
        inside = (lengthwise >= self.low_m) & (lengthwise <= self.high_m)
        inside &= np.abs(sideways) <= FARTHEST_MOVE_M
        return lengthwise[inside] - self.low_m, sideways[inside]

    def middle_m(self, points_m: Floats, place_m: float) -> float:
        """Where, to the left of the axis, the middle of the wall near ``place_m`` lies."""
        _, sideways = self.beside(points_m)
        near = np.abs(sideways - place_m) <= 2.5 * self.cell_m
        return float(sideways[near].mean()) if near.any() else place_m

    def facing(self, free_m: Floats, place_m: float, reach_m: float) -> int:
        """On which side of a wall near ``place_m`` the free cells (N, 2) lie.

        1: to its left, -1: to its right, 0: on both, or on neither.
        """
        _, sideways = self.beside(free_m)
        away = sideways - place_m
        left = int(np.count_nonzero((away > 0.0) & (away <= reach_m)))
        right = int(np.count_nonzero((away < 0.0) & (away >= -reach_m)))
        return (left > _ONE_SIDED * right) - (right > _ONE_SIDED * left)

    def nearest_wall_m(
        self, occupied_m: Floats, new_m: Floats, fits: Callable[[float], bool]
    ) -> float | None:
        """How far to the left the nearest wall of the other map lies that this one may be now.

        Points (N, 2) of that map: all that are occupied, and those of them far from this map's
        walls. They are counted in strips of three cells along the patch; a strip is such a wall
        when it is filled along half of the patch, and along a tenth of it with new cells, and
        when it ``fits`` at its place.
        """
        share, new = self._filled(occupied_m), self._filled(new_m)
        walls = np.flatnonzero((share >= _FILLED) & (new >= _FILLED_NEW))
        zero = len(share) // 2
        best: int
        for best in walls[np.argsort(np.abs(walls - zero), kind="stable")].tolist():
            outwards = 1 if best > zero else -1
            while 0 < best < len(share) - 1 and share[best + outwards] > share[best]:
                best += outwards
            place_m = (best - zero) * self.cell_m
            if fits(place_m):
                return place_m
        return None

    def _filled(self, points_m: Floats) -> Floats:
        """For strips from far on the right to far on the left: along how much they are filled."""
        lengthwise, sideways = self.beside(points_m)
        zero = math.ceil(FARTHEST_MOVE_M / self.cell_m) + 1
        steps = int(self.length_m / self.cell_m) + 1
        filled = np.zeros((2 * zero + 1, steps), np.bool_)
        place = np.rint(sideways / self.cell_m).astype(np.int64) + zero
        filled[place, np.minimum((lengthwise / self.cell_m).astype(np.int64), steps - 1)] = True
        three = filled | np.roll(filled, 1, axis=0) | np.roll(filled, -1, axis=0)
        share: Floats = three.mean(axis=1)
        return share


def patch_of(points_m: Floats, cell_m: float) -> Patch:
    """The patch that points (N, 2) make."""
    centre = points_m.mean(axis=0)
    _, _, axes = np.linalg.svd(points_m - centre, full_matrices=False)
    reach = (points_m - centre) @ axes[0]
    return Patch(centre, axes[0], float(reach.min()), float(reach.max()), cell_m)
