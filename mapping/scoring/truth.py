"""What a map is held against: true walls as straight pieces, or a map that is taken for true."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry

Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]


class Truth(Protocol):
    """Walls as pieces (K, 2, 2) in metres, and which cells of any grid they are.

    ``directed``: the pieces run as the walls do, and are not the sides of cells.
    """

    @property
    def walls_m(self) -> Floats:
        """Straight pieces (K, 2, 2), metres, map frame."""

    @property
    def directed(self) -> bool:
        """Whether lines can be held against the directions of the pieces."""

    def wall_cells(self, geometry: GridGeometry) -> Flags:
        """The cells (rows, cols) that a wall passes through."""

    def open_cells(self, geometry: GridGeometry) -> Flags:
        """The cells (rows, cols) known to be free: within the walls, or free in the true map."""


@dataclass(frozen=True, slots=True)
class TrueWalls:
    """Walls that are known exactly."""

    walls_m: Floats
    directed: bool = True

    def wall_cells(self, geometry: GridGeometry) -> Flags:
        from mapping.kernels.visibility import mark_walls

        cells = np.zeros(geometry.shape, np.bool_)
        ends = (self.walls_m - np.array(geometry.origin_m)) / geometry.resolution_m
        mark_walls(cells, np.ascontiguousarray(ends.reshape(-1, 4)))
        return cells

    def open_cells(self, geometry: GridGeometry) -> Flags:
        from recorder.simulator.routes import inside

        every = np.argwhere(np.ones(geometry.shape, np.bool_))
        within = inside(geometry.centres_of(every), self.walls_m).reshape(geometry.shape)
        return np.asarray(within & ~self.wall_cells(geometry))


@dataclass(frozen=True, slots=True)
class TrueMap:
    """A map whose occupied and free cells (rows, cols) are taken for true; others are unknown."""

    geometry: GridGeometry
    occupied: Flags
    free: Flags
    directed: bool = False

    @property
    def walls_m(self) -> Floats:
        """The sides of occupied cells towards others, neighbours in a row as one piece."""
        solid = np.pad(self.occupied, 1)  # cell (r, c) is its (r + 1, c + 1)
        flat, upright = solid[1:, :] != solid[:-1, :], solid[:, 1:] != solid[:, :-1]
        ends = [(x0 - 1, y, x1 - 1, y) for y, x0, x1 in _runs(flat)]
        ends += [(x, y0 - 1, x, y1 - 1) for x, y0, y1 in _runs(upright.T)]
        cells = np.array(ends, np.float64).reshape(-1, 2, 2)
        return np.asarray(cells * self.geometry.resolution_m + np.array(self.geometry.origin_m))

    def wall_cells(self, geometry: GridGeometry) -> Flags:
        cells = self._looked_up(self.occupied, geometry)
        own = geometry.cells_of(self.geometry.centres_of(np.argwhere(self.occupied)))
        own = own[geometry.contains(own)]
        cells[own[:, 0], own[:, 1]] = True  # thin walls of a finer map
        return cells

    def open_cells(self, geometry: GridGeometry) -> Flags:
        return np.asarray(self._looked_up(self.free, geometry) & ~self.wall_cells(geometry))

    def _looked_up(self, flags: Flags, geometry: GridGeometry) -> Flags:
        every = np.argwhere(np.ones(geometry.shape, np.bool_))
        own = self.geometry.cells_of(geometry.centres_of(every))
        there = self.geometry.contains(own)
        found = np.zeros(len(every), np.bool_)
        found[there] = flags[own[there, 0], own[there, 1]]
        return found.reshape(geometry.shape)


def _runs(flags: Flags) -> list[tuple[int, int, int]]:
    """Stretches of an array (lines, places): line, first place, place behind the last."""
    edges = np.diff(np.pad(flags, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    line, first = np.nonzero(edges == 1)
    _, end = np.nonzero(edges == -1)
    return list(zip(line.tolist(), first.tolist(), end.tolist(), strict=True))
