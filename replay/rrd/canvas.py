"""What all drawing shares: the current step, the rows that wait, and what must vanish again.

A canvas belongs to one recording, and to one grid once :class:`Started` has told it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mapping.artifacts import MergedGrid, TempGrid
from mapping.grid import GridGeometry
from mapping.update_rules import rule_of
from replay.rrd import columns, layout, scene
from replay.rrd.columns import ColumnBuffer, LayerRecord, Pack, Stamp
from replay.rrd.history_writer import HistoryWriter
from replay.rrd.layout import Colour, Tiling
from replay.rrd.pictures import UNSEEN
from replay.rrd.tiles import LayerTiles, Place
from replay.rrd.trail import Trail


@dataclass(slots=True)
class _Ticket:
    """The step at which the file tells what a reading did; not known yet where it is not shown."""

    stamp: Stamp | None


@dataclass(slots=True)
class Canvas:
    """One recording being drawn; ``stamp`` is the step that everything added belongs to."""

    recording: rr.RecordingStream
    geometry: GridGeometry
    rows: ColumnBuffer
    tiling: Tiling
    stamp: Stamp
    layers: dict[str, LayerTiles] = field(default_factory=dict)
    newest_temp: TempGrid | None = None
    _prepared: set[str] = field(default_factory=set)
    _vanishing: dict[str, tuple[Pack, Any]] = field(default_factory=dict)
    _trails: dict[str, Trail] = field(default_factory=dict)
    _colours: dict[str, Colour] = field(default_factory=dict)
    _histories: dict[str, HistoryWriter[_Ticket]] = field(default_factory=dict)
    _told: dict[str, list[tuple[_Ticket, bytes]]] = field(default_factory=dict)
    _hidden: dict[str, list[_Ticket]] = field(default_factory=dict)
    _drawn: dict[str, NDArray[np.uint8]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rows.before_sending(self._drain)

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

    def leave(self, entity: str, dots_m: NDArray[np.float64], set_up: scene.SetUp) -> None:
        """Add dots (N, 2), metres, to those that were left below an entity before."""
        if entity not in self._trails:

            def draw(number: int, dots: NDArray[np.float64]) -> None:
                row = layout.digit(entity, number)
                self.prepare(row, set_up)
                self.add(row, columns.points, dots, dots.nbytes)

            self._trails[entity] = Trail(draw)
        self._trails[entity].add(dots_m)

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
            scene.set_up_never_seen(self.recording, layout.merged(name), self.geometry, UNSEEN)
        return self.layers[name]

    def begin(self, name: str, kind: str, rule: str) -> LayerTiles:
        """The same, once the unit of its values and its update rule are known."""
        state = self.layer(name)
        if state.begin(kind, rule):
            record = LayerRecord(kind, rule, rule_of(kind, rule).start_value)
            self.add(layout.layer_root(name), columns.layer_records, record)
        return state

    def merge(self, merged: MergedGrid, *, shown: bool, exact: bool) -> None:
        """Take what a reading did to its layer; if ``shown``, draw it, and if ``exact``, tell it.

        Told is what the reading did, where the file holds all before it, or else whole tiles. What
        a reading did that is not shown is told with the layer's next reading that is.
        """
        state = self.begin(merged.layer, merged.kind, merged.rule)
        all_told = state.exact
        state.update(merged.window, merged.values, merged.probability)
        if exact and all_told:
            self._tell(merged, _Ticket(self.stamp if shown else None))
            state.told()
        if shown:
            self.draw_layer(merged.layer, exact=exact)

    @property
    def chunks(self) -> int:
        """How many pieces the file holds by now, each of which its index names; roughly."""
        return self.rows.chunks + len(self._prepared) + 10 * (1 + len(self.layers))

    @property
    def exact_layers(self) -> tuple[str, ...]:
        """The layers whose values are in the file, exactly, as they are at the current step."""
        return tuple(
            name for name, state in self.layers.items()
            if state.exact and not self._hidden.get(name)
        )  # fmt: skip

    def draw_layer(self, name: str, *, exact: bool) -> None:
        """Write the tiles of a layer that changed: the picture, and if asked the values."""
        state = self.layer(name)
        for place, picture in state.take_undrawn():
            self._add_tile(layout.merged(name), place, picture, layout.ORDER_TILES)
        if exact:
            self._add_values(name, state.take_inexact())

    def draw_whole(self, name: str) -> None:
        """The same for a whole map: all tiles that changed since they were written as such.

        The history of the layer begins anew after it.
        """
        self.draw_layer(name, exact=False)
        self._add_values(name, self.layer(name).take_stale())
        if name in self._histories:
            self._unhide(name)
            self._drain()
            self._histories[name].restart()

    def draw_classes(self, root: str, picture: NDArray[np.uint8], order: float) -> None:
        """Write a grid of classes: the tiles that are not as they were drawn last."""
        drawn = self._drawn.get(root)
        if drawn is None:
            drawn = np.zeros_like(picture)
            if order == layout.ORDER_CLASSES:
                scene.set_up_never_seen(self.recording, root, self.geometry, 0)
        self._drawn[root] = picture.copy()
        for place in self.tiling:
            part = self.tiling.window(*place).slices
            if not np.array_equal(picture[part], drawn[part]):
                self._add_tile(root, place, picture[part].copy(), order)

    def _tell(self, merged: MergedGrid, ticket: _Ticket) -> None:
        """Add a reading to the history of its layer."""
        name, temp = merged.layer, self.newest_temp
        if name not in self._histories:
            rule = rule_of(merged.kind, merged.rule)
            self._histories[name] = HistoryWriter(
                self.geometry, merged.kind, rule.start_value, predicts=rule.multiplies_odds
            )
            self._told[name] = []
        if ticket.stamp is None:
            self._hidden.setdefault(name, []).append(ticket)
        else:
            self._unhide(name)
        if temp is not None and temp.beam is not merged.beam:
            temp = None
        self._told[name] += self._histories[name].add(merged.window, merged.values, temp, ticket)
        self._add_told(name)

    def _unhide(self, name: str) -> None:
        """The current step tells what the readings of a layer did that were not shown."""
        for ticket in self._hidden.pop(name, []):
            ticket.stamp = self.stamp

    def _drain(self) -> None:
        """Write what histories hold back."""
        for name, history in self._histories.items():
            self._told[name] += history.drain()
            self._add_told(name)

    def _add_told(self, name: str) -> None:
        """Add the records of a layer whose step is known; those after one that is not wait."""
        told = self._told[name]
        while told and (stamp := told[0][0].stamp) is not None:
            _, record = told.pop(0)
            self.rows.add(layout.history(name), columns.history_records, stamp, record, len(record))
            self.rows.exact_bytes += len(record)

    def _add_values(self, name: str, tiles: list[tuple[Place, NDArray[np.float32]]]) -> None:
        """Whole tiles of values; readings after them are told from there."""
        history = self._histories.get(name)
        if history is not None and tiles:
            self._unhide(name)
            self._drain()
        for place, values in tiles:
            entity = layout.tile(layout.merged(name), *place)
            self.add(entity, columns.float32_values, values, values.nbytes)
            self.rows.exact_bytes += values.nbytes
            if history is not None:
                history.replace(self.tiling.window(*place), values)

    def _add_tile(self, root: str, place: Place, picture: NDArray[np.uint8], order: float) -> None:
        entity = layout.tile(root, *place)

        def set_up(recording: rr.RecordingStream, entity: str) -> None:
            opaque = order in (layout.ORDER_CLASSES, layout.ORDER_TILES)
            scene.set_up_tile(recording, entity, self.tiling, place, order=order, opaque=opaque)

        self.prepare(entity, set_up)
        self.add(entity, columns.class_images, picture, picture.nbytes)
