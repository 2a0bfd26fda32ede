"""The newest state of each layer, kept by the writer, and which of its tiles the file lacks.

A reading tells only what happened inside its window. The writer keeps the whole grid, so that a
tile can be written complete, and so that readings left out of the recording still count.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapping.grid import Window
from replay.rrd.layout import Tiling
from replay.rrd.pictures import UNSEEN, percent_classes

Place = tuple[int, int]
T = TypeVar("T", bound=np.generic)

# What a cell holds before any reading, by the unit of the layer's values; all others begin at 0.
_STARTS = {"probability": 0.5, "odds": 1.0}


class LayerTiles:
    """One layer: its values, the picture of them, and the tiles not yet written."""

    def __init__(self, tiling: Tiling) -> None:
        shape = tiling.geometry.shape
        self.tiling = tiling
        self.values: NDArray[np.float32] = np.zeros(shape, np.float32)
        self.picture: NDArray[np.uint8] = np.full(shape, UNSEEN, np.uint8)
        self.observed: NDArray[np.bool_] = np.zeros(shape, bool)
        self._undrawn: set[Place] = set(tiling)
        self._inexact: set[Place] = set()
        self._begun = False

    def see(self, window: Window, touched: NDArray[np.bool_]) -> None:
        """Remember which cells of the window a reading touched."""
        self.observed[window.slices] |= touched

    def update(
        self, window: Window, values: NDArray[np.float32], probability: NDArray[np.float32]
    ) -> None:
        """Take the window's new values; arrays cover the window."""
        part = window.slices
        picture = percent_classes(probability, self.observed[part])
        # Compared as bits: NaN equals itself, and 0.0 is not -0.0.
        new = np.ascontiguousarray(values, np.float32)
        changed = new.view(np.uint32) != self.values[part].view(np.uint32)
        self._inexact |= self._tiles_of(changed, window)
        self._undrawn |= self._tiles_of(picture != self.picture[part], window)
        self.values[part] = new
        self.picture[part] = picture

    def take_undrawn(self) -> list[tuple[Place, NDArray[np.uint8]]]:
        """Tiles whose picture changed since last asked: place and a copy of the picture."""
        return [(p, self._cut(self.picture, p)) for p in _emptied(self._undrawn)]

    def take_inexact(self) -> list[tuple[Place, NDArray[np.float32]]]:
        """Tiles whose values changed since last asked: place and a copy of the values."""
        return [(p, self._cut(self.values, p)) for p in _emptied(self._inexact)]

    @property
    def exact(self) -> bool:
        """Whether all values were taken for writing since they last changed."""
        return self._begun and not self._inexact

    def begin(self, kind: str) -> bool:
        """Give every cell what a rule of that kind starts from; False when that was done before."""
        if self._begun:
            return False
        self._begun = True
        self.values[:] = _STARTS.get(kind, 0.0)
        self._inexact = set(self.tiling)
        return True

    def _cut(self, grid: NDArray[T], place: Place) -> NDArray[T]:
        return grid[self.tiling.window(*place).slices].copy()

    def _tiles_of(self, changed: NDArray[np.bool_], window: Window) -> set[Place]:
        if not changed.any():
            return set()
        side = self.tiling.side
        rows, cols = np.nonzero(changed)
        across = self.tiling.shape[1]
        index = (rows + window.row0) // side * across + (cols + window.col0) // side
        return {(int(i) // across, int(i) % across) for i in np.unique(index)}


def _emptied(places: set[Place]) -> list[Place]:
    taken = sorted(places)
    places.clear()
    return taken
