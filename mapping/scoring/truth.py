"""What a map is held against: true walls as straight pieces, or a map that is taken for true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry

Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]


class Truth(Protocol):
    """Walls as pieces (K, 2, 2) in metres, and which cells of any grid they are.

    ``directed``: the pieces run as the walls do, and are not the sides of cells. ``glass_m`` are
    those of them that light passes, (G, 2, 2): no light comes back from there.
    """

    @property
    def walls_m(self) -> Floats:
        """Straight pieces (K, 2, 2), metres, map frame."""

    @property
    def directed(self) -> bool:
        """Whether lines can be held against the directions of the pieces."""

    @property
    def glass_m(self) -> Floats:
        """The pieces (G, 2, 2) of glass, metres, map frame."""

    def wall_cells(self, geometry: GridGeometry, *, to_light: bool = False) -> Flags:
        """The cells (rows, cols) that a wall passes through; ``to_light``: one that stops light."""

    def open_cells(self, geometry: GridGeometry) -> Flags:
        """The cells (rows, cols) known to be free: within the walls, or free in the true map."""


@dataclass(frozen=True, slots=True)
class TrueWalls:
    """Walls that are known exactly; ``is_glass`` (K,) says which light passes, None: no wall."""

    walls_m: Floats
    directed: bool = True
    is_glass: Flags | None = None

    @classmethod
    def of(cls, walls_m: Floats, surfaces: Sequence[str]) -> TrueWalls:
        """Walls (K, 2, 2), of which it is known what each is made of (or of none, where empty).

        Raises BadInput for a surface that there is not.
        """
        from recorder.simulator.surfaces import wall_surfaces

        made_of = wall_surfaces(surfaces)
        return cls(walls_m, is_glass=None if made_of is None else ~made_of.opaque)

    @property
    def glass_m(self) -> Floats:
        return np.zeros((0, 2, 2)) if self.is_glass is None else self.walls_m[self.is_glass]

    def wall_cells(self, geometry: GridGeometry, *, to_light: bool = False) -> Flags:
        from mapping.kernels.visibility import mark_walls

        cells = np.zeros(geometry.shape, np.bool_)
        walls_m = self.walls_m
        if to_light and self.is_glass is not None:
            walls_m = walls_m[~self.is_glass]
        ends = (walls_m - np.array(geometry.origin_m)) / geometry.resolution_m
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

    @property
    def glass_m(self) -> Floats:
        return np.zeros((0, 2, 2))

    def wall_cells(self, geometry: GridGeometry, *, to_light: bool = False) -> Flags:
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
