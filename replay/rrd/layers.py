"""The layers of one run as its readings change them: pictures on a canvas, exact values in the log.

Readings that are not shown still change them; the next shown one draws what they did.
"""

from __future__ import annotations

from collections.abc import Sequence

from mapping.artifacts import MergedGrid, Snapshot, TempGrid
from mapping.update_rules import rule_of
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas
from replay.rrd.pictures import UNSEEN
from replay.rrd.tiles import LayerTiles, is_made_whole
from replay.rrd.value_log.log import ValueLog

# Each tile of a map is written some 5 times at the end: what never changes of it, its values, its
# picture, cells above the threshold, classes.
_WRITTEN = 5
_INDEX_COST = 1600  # bytes of the file's own index at its end for each chunk, roughly
_CHUNK_COST = 1200  # bytes of a chunk without what it holds
_PICTURES_SHARE = 0.15  # of a map's values, for what is drawn of it: bytes, where these are floats
_END_COST = 100_000  # bytes of what else comes at the end


class Layers:
    """The newest state of every layer of a run, and which of it the recording holds."""

    def __init__(self, canvas: Canvas, layers: Sequence[str]) -> None:
        self._canvas, self._layers = canvas, layers
        self._log = ValueLog(canvas.rows, canvas.tiling)
        self._tiles: dict[str, LayerTiles] = {}
        self._newest_temp: TempGrid | None = None

    def set_up(self, name: str) -> LayerTiles:
        """The newest state of a layer; a new one is set up, with nothing seen yet."""
        if name not in self._tiles:
            canvas = self._canvas
            made_whole = is_made_whole(name, self._layers)
            tiling = canvas.results_tiling if made_whole else canvas.tiling
            self._tiles[name] = LayerTiles(tiling)
            scene.set_up_layer(canvas.sink, name, canvas.colour(name))
            scene.set_up_never_seen(canvas.sink, layout.merged(name), canvas.geometry, UNSEEN)
        return self._tiles[name]

    def see(self, temp: TempGrid) -> None:
        """Take which cells a reading touches, and its evidence for them."""
        self.set_up(temp.beam.layer).see(temp.window, temp.band | temp.free)
        self._newest_temp = temp

    def merge(self, merged: MergedGrid, *, shown: bool, exact: bool) -> None:
        """Take what a reading did to its layer; if ``shown``, draw it; if ``exact``, log it.

        Logged is what the reading did, where the recording holds all before it, or else whole
        tiles. What a reading did that is not shown comes with the layer's next one that is.
        """
        name, stamp = merged.layer, self._canvas.stamp
        tiles = self._begin(name, merged.kind, merged.rule)
        was_exact = tiles.exact
        tiles.update(merged.window, merged.values, merged.probability)
        if exact and was_exact:
            self._log.append(merged, self._newest_temp, stamp, shown=shown)
            tiles.mark_logged()
        if shown:
            self.draw(name)
            if exact:
                self._log.replace(name, tiles.take_inexact(), stamp)

    def draw(self, name: str, *, whole: bool = False) -> None:
        """Draw the tiles of a layer that are drawn too far off; of a ``whole`` map, off at all."""
        tiles = self._tiles[name]
        root, order = layout.merged(name), layout.ORDER_TILES
        for place, picture in tiles.take_undrawn(whole=whole):
            self._canvas.draw_tile(root, tiles.tiling, place, picture, order)

    def draw_whole(self, snapshot: Snapshot) -> None:
        """Draw a whole map, and write all its values that the recording does not hold whole."""
        layer, stamp = snapshot.layer, self._canvas.stamp
        tiles = self._begin(layer.name, layer.kind, snapshot.rule)
        tiles.see_whole(layer.observed)
        tiles.update(layer.geometry.whole, layer.values, layer.probability)
        self.draw(layer.name, whole=True)
        self._log.replace(layer.name, tiles.take_stale(), stamp)
        self._log.restart(layer.name, stamp)

    @property
    def exact(self) -> tuple[str, ...]:
        """The layers whose values the recording holds, exactly, as they are at this step."""
        return tuple(
            name for name, tiles in self._tiles.items()
            if tiles.exact and self._log.is_complete(name)
        )  # fmt: skip

    def reserved_bytes(self) -> int:
        """What the exact values of all layers will take at the end, and the file's own index."""
        layers = [tiles.packed_tiles() for tiles in self._tiles.values()]
        counts, sizes = [count for count, _ in layers], [size for _, size in layers]
        # Fused, there is about one layer more.
        count = sum(counts) + max(counts, default=0)
        values = sum(sizes) + max(sizes, default=0.0)
        chunks = self._canvas.chunks + 10 * (1 + len(layers))
        index = _INDEX_COST * (chunks + _WRITTEN * count) + _CHUNK_COST * _WRITTEN * count
        return int((1.0 + _PICTURES_SHARE) * values) + index + _END_COST

    def _begin(self, name: str, kind: str, rule: str) -> LayerTiles:
        """The state of a layer of which the unit of its values and its update rule are known."""
        tiles = self.set_up(name)
        if tiles.begin(kind, rule):
            record = columns.LayerRecord(kind, rule, rule_of(kind, rule).start_value)
            self._canvas.add(layout.layer_root(name), columns.layer_records, record)
        return tiles
