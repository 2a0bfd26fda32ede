"""What all drawing shares: the current step, the rows that wait, and what must vanish again.

A canvas belongs to one recording, and to one grid once :class:`Started` has told it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from replay.rrd import columns, layout, scene
from replay.rrd.columns import ColumnBuffer, Pack, Stamp
from replay.rrd.layout import Colour, Tiling
from replay.rrd.tiles import LayerTiles


@dataclass(slots=True)
class Canvas:
    """One recording being drawn; ``stamp`` is the step that everything added belongs to."""

    recording: rr.RecordingStream
    geometry: GridGeometry
    rows: ColumnBuffer
    tiling: Tiling
    stamp: Stamp
    layers: dict[str, LayerTiles] = field(default_factory=dict)
    _prepared: set[str] = field(default_factory=set)
    _vanishing: dict[str, tuple[Pack, Any]] = field(default_factory=dict)
    _colours: dict[str, Colour] = field(default_factory=dict)

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
        """Take away what was drawn for now: of one entity, or all of it."""
        for gone in list(self._vanishing) if entity is None else [entity]:
            if gone in self._vanishing:
                pack, nothing = self._vanishing.pop(gone)
                self.add(gone, pack, nothing)

    def prepare(self, entity: str, set_up: scene.SetUp) -> None:
        """Write the unchanging part of an entity, the first time that it is asked for."""
        if entity not in self._prepared:
            self._prepared.add(entity)
            set_up(self.recording, entity)

    def colour(self, sensor: str) -> Colour:
        """One colour for each sensor or layer, in the order in which they come."""
        number = len(self._colours)
        return self._colours.setdefault(sensor, layout.SENSORS[number % len(layout.SENSORS)])

    def layer(self, name: str) -> LayerTiles:
        """The newest state of a layer; a new one is set up, with nothing seen yet."""
        if name not in self.layers:
            self.layers[name] = LayerTiles(self.tiling)
            scene.set_up_layer(self.recording, name, self.colour(name))
            scene.set_up_tiles(
                self.recording, layout.merged(name), self.tiling,
                order=layout.ORDER_TILES, opaque=True,
            )  # fmt: skip
        return self.layers[name]

    def begin(self, name: str, kind: str, rule: str) -> LayerTiles:
        """The same, once the unit of its values and its update rule are known."""
        state = self.layer(name)
        if state.begin(kind):
            self.add(layout.layer_root(name), columns.layer_records, (kind, rule))
        return state

    def draw_layer(self, name: str, *, exact: bool) -> None:
        """Write the tiles of a layer that changed: the picture, and if asked the values."""
        state, root = self.layer(name), layout.merged(name)
        for place, picture in state.take_undrawn():
            entity = layout.tile(root, *place)
            self.add(entity, columns.class_images, picture, picture.nbytes)
        if exact:
            for place, values in state.take_inexact():
                entity = layout.tile(root, *place)
                self.add(entity, columns.float32_values, values, values.nbytes)

    def draw_classes(self, root: str, picture: NDArray[np.uint8], order: float) -> None:
        """Write a whole grid of classes, tile by tile."""

        def set_up(recording: rr.RecordingStream, entity: str) -> None:
            opaque = order == layout.ORDER_CLASSES
            scene.set_up_tiles(recording, entity, self.tiling, order=order, opaque=opaque)

        self.prepare(root, set_up)
        for place in self.tiling:
            part = picture[self.tiling.window(*place).slices].copy()
            self.add(layout.tile(root, *place), columns.class_images, part, part.nbytes)
