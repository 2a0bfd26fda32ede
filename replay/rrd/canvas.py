"""What all drawing shares: the current step, the rows that wait, and what must vanish again.

A canvas belongs to one grid in one recording, and knows nothing of what is on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from replay.rrd import columns, layout, scene
from replay.rrd.layout import Colour, Place, Tiling
from replay.rrd.sink import Pack, RowBuffer, Sink, Stamp

Floats = NDArray[np.float64]

TRAIL_BASE = 16  # rows of one digit that make one of the next


class Canvas:
    """One grid being drawn; ``stamp`` is the step that everything added belongs to."""

    def __init__(self, sink: Sink, geometry: GridGeometry, stamp: Stamp) -> None:
        self.sink, self.geometry, self.stamp = sink, geometry, stamp
        self.tiling = layout.tiling_for(geometry)
        self.results_tiling = layout.results_tiling_for(geometry)
        self.rows = RowBuffer(sink)
        self._prepared: set[str] = set()
        self._vanishing: dict[str, tuple[Pack, Any]] = {}
        self._trails: dict[str, list[list[Floats]]] = {}
        self._colours: dict[str, Colour] = {}
        self._classes: dict[str, NDArray[np.uint8]] = {}

    def add(self, entity: str, pack: Pack, value: Any, size: int = 64) -> None:
        """Draw something at the current step; it stays until its entity is drawn again."""
        self.rows.add(entity, pack, self.stamp, value, size)

    def add_for_now(
        self, entity: str, pack: Pack, value: Any, nothing: Any, size: int = 64
    ) -> None:
        """Draw something that :meth:`wipe` takes away, by drawing ``nothing`` in its place."""
        self.add(entity, pack, value, size)
        self._vanishing[entity] = (pack, nothing)

    def wipe(self, entity: str | None = None) -> None:
        """Take away what was drawn for now: of one entity and below it, or all of it."""
        for gone in list(self._vanishing):
            if entity is None or gone == entity or gone.startswith(f"{entity}/"):
                pack, nothing = self._vanishing.pop(gone)
                self.add(gone, pack, nothing)

    def leave(self, entity: str, dots_m: Floats, set_up: scene.SetUp, *how: Any) -> None:
        """Add dots (N, 2), metres, to those that were left below an entity before.

        Were each dot a row of its own, the viewer would gather thousands of rows at every step.
        Were all dots so far one row, the file would grow with their square. So they are kept as
        numbers are written: the newest lie in the row of the lowest digit, and whenever that is
        full, all of it moves up a digit. The viewer then looks at one row a digit, and each dot is
        written a few times for each.
        """
        digits = self._trails.setdefault(entity, [])
        number, moved = 0, np.asarray(dots_m, np.float64)
        while True:
            if number == len(digits):
                digits.append([])
            digits[number].append(moved)
            moved = np.concatenate(digits[number])
            is_full = len(digits[number]) == TRAIL_BASE
            drawn = moved[:0] if is_full else moved
            row = layout.digit(entity, number)
            self.prepare(row, set_up, *how)
            self.add(row, columns.points, drawn, drawn.nbytes)
            if not is_full:
                return
            digits[number].clear()
            number += 1

    def prepare(self, entity: str, set_up: scene.SetUp, *how: Any) -> None:
        """Write the unchanging part of an entity, the first time that it is asked for."""
        if entity not in self._prepared:
            self._prepared.add(entity)
            set_up(self.sink, entity, *how)

    def colour(self, sensor: str) -> Colour:
        """One colour for each sensor or layer, in the order in which they come."""
        number = len(self._colours)
        return self._colours.setdefault(sensor, layout.SENSORS[number % len(layout.SENSORS)])

    def draw_classes(self, root: str, picture: NDArray[np.uint8], order: float) -> None:
        """Draw a whole grid of classes: the tiles that are not as they were drawn last."""
        drawn = self._classes.get(root)
        if drawn is None:
            drawn = np.zeros_like(picture)
            if order == layout.ORDER_CLASSES:
                scene.set_up_never_seen(self.sink, root, self.geometry, 0)
        self._classes[root] = picture.copy()
        for place in self.results_tiling:
            part = self.results_tiling.window(*place).slices
            if not np.array_equal(picture[part], drawn[part]):
                self.draw_tile(root, self.results_tiling, place, picture[part].copy(), order)

    def draw_tile(
        self, root: str, tiling: Tiling, place: Place, picture: NDArray[np.uint8], order: float
    ) -> None:
        """Draw one tile of a grid of classes."""
        entity = layout.tile(root, *place)
        self.prepare(entity, scene.set_up_tile, tiling, place, order)
        self.add(entity, columns.class_images, picture, picture.nbytes)

    @property
    def chunks(self) -> int:
        """How many pieces the recording holds by now of what was drawn."""
        return self.rows.chunks + len(self._prepared)
