"""The newest state of each layer, and which of its tiles the file lacks.

A reading changes a window. The whole grid is kept, so that a tile can be written complete, and so
that readings left out of the recording still count.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from mapping.fusion import FUSED
from mapping.grid import GridGeometry, Window
from mapping.update_rules import UpdateRule, rule_of
from replay.rrd.layout import Place, Tiling
from replay.rrd.pictures import SLACK, UNSEEN

_CODEC = pa.Codec("lz4_raw")  # as the file packs
_TRIED_TILES = 16
_OLDER_TILE, _MOST_OLDER_TILES = 64, 1024
_MOST_TILES = 65_536
T = TypeVar("T", bound=np.generic)


def stored_tilings(geometry: GridGeometry, sides: Sequence[int]) -> tuple[Tiling, Tiling]:
    """How a recording's values and its pictures are cut, by the sides that it states.

    Older ones state none. Raises ValueError for more tiles than there ever are.
    """
    older = Tiling(geometry, _OLDER_TILE)
    while older.count > _MOST_OLDER_TILES:
        older = Tiling(geometry, older.side * 2)
    values, pictures = (Tiling(geometry, max(int(side), 1)) for side in sides or [older.side] * 2)
    if max(values.count, pictures.count) > _MOST_TILES:
        raise ValueError(f"a map in {values.count} tiles")
    return values, pictures


def is_made_whole(layer: str, layers: Sequence[str]) -> bool:
    """Whether a layer of a run comes from other layers, whole, and not from readings."""
    return layer == FUSED and len(layers) > 1


class LayerTiles:
    """One layer: its values, the picture of them, and the tiles that the file does not hold so.

    A tile is *inexact* when its values are not in the file at all, and *stale* when they are there
    only as the tile before and all that readings did to it since.
    """

    def __init__(self, tiling: Tiling) -> None:
        shape = tiling.geometry.shape
        self.tiling = tiling
        self.values: NDArray[np.float32] = np.zeros(shape, np.float32)
        self.picture: NDArray[np.uint8] = np.full(shape, UNSEEN, np.uint8)
        self._drawn = self.picture.copy()
        self.observed: NDArray[np.bool_] = np.zeros(shape, bool)
        self._undrawn, self._inexact, self._stale = (np.zeros(tiling.shape, bool) for _ in range(3))
        self._begun = False
        self._rule: UpdateRule | None = None  # where its pictures need the largest value
        self._largest = 0.0
        self._seen = Window(0, 0, 0, 0)

    def begin(self, kind: str, rule: str = "") -> bool:
        """Give every cell what the rule starts from; False when that was done before."""
        if self._begun:
            return False
        self._begun = True
        known = rule_of(kind, rule)
        if known.against_largest:
            self._rule = known
        if known.start_value != 0.0:
            self.values[:] = known.start_value
        return True

    def see(self, window: Window, touched: NDArray[np.bool_]) -> None:
        """Remember which cells of the window a reading touched."""
        self.observed[window.slices] |= touched
        self._seen = _around(self._seen, window)

    def see_whole(self, observed: NDArray[np.bool_]) -> None:
        """Take over which cells of the grid were seen; the array covers all of it."""
        self.observed[:] = observed
        rows, cols = np.flatnonzero(observed.any(axis=1)), np.flatnonzero(observed.any(axis=0))
        if len(rows):
            low, high = (int(rows[0]), int(cols[0])), (int(rows[-1]) + 1, int(cols[-1]) + 1)
            self._seen = Window(*low, high[0] - low[0], high[1] - low[1])

    def update(
        self, window: Window, values: NDArray[np.float32], probability: NDArray[np.float32]
    ) -> None:
        """Take the window's new values; arrays cover the window."""
        part = window.slices
        new = np.ascontiguousarray(values, np.float32)
        before = self.values[part].max(initial=0.0) if self._rule else 0.0
        # Compared as bits: NaN equals itself, and 0.0 is not -0.0.
        self._take(self.values.view(np.uint32), new.view(np.uint32), window, self._inexact)
        self._shade(probability, window)
        if self._rule is not None:
            self._follow_largest(self._rule, float(new.max(initial=0.0)), float(before))

    def take_undrawn(self, *, whole: bool = False) -> list[tuple[Place, NDArray[np.uint8]]]:
        """Tiles that are drawn too far off: place and a copy of the picture.

        As a ``whole`` map all that are off at all, by so little as none would see.
        """
        marked = self._differing() if whole else self._undrawn
        tiles = [(place, self._cut(self.picture, place)) for place in _emptied(marked)]
        self._undrawn[:] = False
        for place, picture in tiles:
            self._drawn[self.tiling.window(*place).slices] = picture
        return tiles

    def take_inexact(self) -> list[tuple[Place, NDArray[np.float32]]]:
        """Tiles whose values the file lacks: place and a copy of the values."""
        return [(p, self._cut(self.values, p)) for p in _emptied(self._inexact)]

    def take_stale(self) -> list[tuple[Place, NDArray[np.float32]]]:
        """Tiles that the file does not hold whole as they are now: place and a copy."""
        self._inexact |= self._stale
        self._stale[:] = False
        return self.take_inexact()

    def mark_logged(self) -> None:
        """The file holds all values now, though not as whole tiles."""
        self._stale |= self._inexact
        self._inexact[:] = False

    def packed_tiles(self) -> tuple[int, float]:
        """How many tiles hold cells that were seen, and about how many bytes their values take."""
        windows = (self.tiling.window(*place) for place in self.tiling)
        seen = [window for window in windows if self.observed[window.slices].any()]
        tried = seen[:: -(-len(seen) // _TRIED_TILES) or 1]
        sizes = [
            len(_CODEC.compress(self.values[window.slices].tobytes(), asbytes=True))
            for window in tried
        ]
        return len(seen), len(seen) * sum(sizes) / max(len(sizes), 1)

    @property
    def exact(self) -> bool:
        """Whether all values are in the file as they are now."""
        return self._begun and not self._inexact.any()

    def _take(
        self, grid: NDArray[T], new: NDArray[T], window: Window, differing: NDArray[np.bool_]
    ) -> None:
        """Write a window's new numbers into a grid; mark the tiles where one became another."""
        from mapping.kernels.loops import take

        take(grid, new, window.row0, window.col0, self.tiling.side, differing)

    def _shade(self, probability: NDArray[np.float32], window: Window) -> None:
        """Take the window's new shades; mark the tiles that are drawn too far off."""
        from mapping.kernels.recording import shade

        shade(
            np.ascontiguousarray(probability, np.float32), self.observed, self.picture, self._drawn,
            window.row0, window.col0, self.tiling.side, UNSEEN, SLACK, self._undrawn,
        )  # fmt: skip

    def _differing(self) -> NDArray[np.bool_]:
        """The tiles whose picture is not as it was drawn last, in any cell."""
        differing = np.zeros(self.tiling.shape, bool)
        for place in self.tiling:
            part = self.tiling.window(*place).slices
            differing[place] = not np.array_equal(self.picture[part], self._drawn[part])
        return differing

    def _follow_largest(self, rule: UpdateRule, now: float, before: float) -> None:
        """Draw all cells anew when the largest value of the whole map is another one."""
        largest = self._largest
        if now >= largest:
            self._largest = now
        elif before >= largest:
            self._largest = float(self.values.max(initial=0.0))
        if self._largest != largest and not self._seen.empty:
            part = self._seen.slices
            values = self.values[part].astype(np.float64)
            shares = rule.probability_of_values(values, self._largest, {})
            self._shade(shares.astype(np.float32), self._seen)

    def _cut(self, grid: NDArray[T], place: Place) -> NDArray[T]:
        return grid[self.tiling.window(*place).slices].copy()


def _around(one: Window, other: Window) -> Window:
    """The smallest window that holds both."""
    if one.empty or other.empty:
        return other if one.empty else one
    row0, col0 = min(one.row0, other.row0), min(one.col0, other.col0)
    row1 = max(one.row0 + one.rows, other.row0 + other.rows)
    col1 = max(one.col0 + one.cols, other.col0 + other.cols)
    return Window(row0, col0, row1 - row0, col1 - col0)


def _emptied(marked: NDArray[np.bool_]) -> list[Place]:
    """The marked places, row by row; none is marked any more."""
    rows, cols = np.nonzero(marked)
    marked[:] = False
    return list(zip(rows.tolist(), cols.tolist(), strict=True))
