"""The maps drawn in other ways, as layers that can be switched on: depth of colour, merges, odds.

They are pictures, made whenever a whole map is at hand: at each snapshot and at the end. They may
take a small share of the recording's budget; what does not fit is left out, and the text
of the step names it.

A cell takes one byte: the shade of each map in it, in levels. The colour and the name of each
combination are written once, so that the viewer shows them where one points at a cell.
"""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mapping.artifacts import Artifact, Snapshot, Started
from mapping.display import GREEN, against_largest, at_depth, grey, inked
from mapping.fusion import FUSED
from mapping.grid import Layer, Window
from mapping.update_rules import rule_of
from replay.colours import in_place, sensor_colour_names, sensor_colours
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas
from replay.rrd.pictures import Named
from replay.rrd.sink import Sink

OF_ONE = ("grey", "reduced", "odds")
OF_SEVERAL = ("two-colours", "three-colours")
TITLES = {
    "grey": "full colour depth",
    "reduced": "reduced colour depth",
    "odds": "odds against the largest (white: far less)",
    "two-colours": "two sensors, each in its ink",
    "three-colours": "each in its ink, and green where both",
}
_MOST = {"two-colours": 2, "three-colours": 3}  # maps in a picture
_BUDGET_SHARE = 0.04  # inside of what the thinning keeps for the unforeseen
_PACKING = 2.0  # the file packs less tightly than zlib
_MOST_CELLS = 16_000_000  # in a picture; a larger one takes seconds to make
# Levels of each map in a picture of so many: all combinations, and none, fit into a byte.
LEVELS = {1: 255, 2: 15, 3: 6}

Floats = NDArray[np.float64]
Codes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Picture:
    """One way to draw: ``name``, the layer it is of (empty: of several), and its cells.

    ``codes`` (rows, cols) are 0 where nothing was seen, else 1 more than the levels of all ``of``
    maps, written as a number with ``levels`` digits.
    """

    layer: str
    name: str
    of: tuple[str, ...]
    levels: int
    codes: Codes


class DisplayOverlay:
    """Draws the layers named by ``names`` (:data:`OF_ONE`, :data:`OF_SEVERAL`)."""

    def __init__(self, names: Sequence[str], *, levels: int, budget_mb: float) -> None:
        self._names, self._levels = tuple(names), levels
        self._left_bytes = _BUDGET_SHARE * budget_mb * 1e6
        self._newest: dict[str, Layer] = {}
        self._layers: tuple[str, ...] = ()

    def start(self, canvas: Canvas, started: Started) -> None:
        """Know which layers there will be."""
        self._layers = started.layers

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """Pictures of one whole layer, and after the last layer those of several."""
        if not isinstance(artifact, Snapshot):
            return ""
        self._newest[artifact.layer.name] = artifact.layer
        # Half of the room is kept for the end.
        room = self._left_bytes if artifact.final else self._left_bytes / 2
        left_out = []
        for picture in self._pictures(artifact.layer):
            window = Window.around(picture.codes)
            cells = picture.codes[window.slices].copy()
            size = round(_PACKING * len(zlib.compress(cells.tobytes(), 1)))
            if size > room or cells.size > _MOST_CELLS:
                left_out.append(TITLES[picture.name])
                continue
            room -= size
            self._left_bytes -= size
            entity = layout.display(picture.layer, picture.name)
            canvas.prepare(entity, _set_up, picture)
            corner = layout.corner_m(canvas.geometry, window)
            cell_m = canvas.geometry.resolution_m
            row = columns.PlacedClasses(cells, corner, cell_m, layout.ORDER_DISPLAY)
            canvas.add(entity, columns.placed_classes, row, cells.nbytes)
        if not left_out:
            return ""
        return f"Too large for this file's budget, so left out: {', '.join(left_out)}."

    def _pictures(self, layer: Layer) -> Iterator[Picture]:
        """All that this snapshot completes."""
        if layer.observed.any():
            for name in OF_ONE:
                if name in self._names:
                    yield one(name, layer, self._levels)
        if layer.name != self._layers[-1]:
            return
        together = [self._newest[n] for n in self._layers if n != FUSED and n in self._newest]
        if len(together) > 1 and any(each.observed.any() for each in together):
            for name in OF_SEVERAL:
                if name in self._names:
                    yield several(name, together)


def one(name: str, layer: Layer, levels: int) -> Picture:
    """One layer, drawn as ``name`` says; ``levels`` are those of the reduced depth."""
    shade = against_largest(_odds(layer)) if name == "odds" else layer.probability
    depth = min(levels, LEVELS[1]) if name == "reduced" else LEVELS[1]
    return Picture(layer.name, name, (layer.name,), depth, encode([shade], depth, layer.observed))


def several(name: str, layers: Sequence[Layer]) -> Picture:
    """The first two layers in one picture, or with ``three-colours`` the third as well."""
    places = in_place(each.name for each in layers)
    used = sorted(layers, key=lambda each: places.index(each.name))[: _MOST[name]]
    depth = LEVELS[len(used)]
    seen = np.logical_or.reduce([each.observed for each in used])
    codes = encode([each.probability for each in used], depth, seen)
    return Picture("", name, tuple(each.name for each in used), depth, codes)


def encode(
    shades: Sequence[NDArray[np.floating]], levels: int, observed: NDArray[np.bool_]
) -> Codes:
    """The shades (0 .. 1) of each cell as one byte; see :class:`Picture`."""
    number = np.zeros(observed.shape, np.int64)
    for shade in shades:
        number = number * levels + np.rint(at_depth(shade, levels) * (levels - 1)).astype(np.int64)
    return np.where(observed, number + 1, 0).astype(np.uint8)


def colours(name: str, of: Sequence[str], levels: int) -> NDArray[np.uint8]:
    """The colour of each code from 1 on, (levels ** count, 3).

    One map is grey. Of several each has the ink of its sensor, printed over each other on white;
    with ``three-colours`` two maps are printed in green where both hold a cell occupied.
    """
    steps = np.array(list(itertools.product(range(levels), repeat=len(of))), np.float64).T
    shades = [row[None] / (levels - 1) for row in steps]
    if len(of) == 1:
        table: NDArray[np.uint8] = grey(shades[0])[0]
        return table
    inks_of = [sensor_colours(of)[each] for each in of]
    if name == "three-colours" and len(of) == 2:
        both = np.minimum(*shades)
        shades = [shades[0] - both, shades[1] - both, both]
        inks_of.append(GREEN)
    table = inked(shades, inks_of)[0]
    return table


def inks(name: str, sensors: Sequence[str]) -> str:
    """What the colours of a picture of several mean: which sensor is printed in which ink."""
    used = in_place(sensors)[: _MOST[name]]
    named = sensor_colour_names(used)
    texts = [f"{sensor} {named[sensor]}" for sensor in used]
    if name == "three-colours" and len(used) == 2:
        texts.append("both green")
    elif name == "two-colours":
        texts.append("both dark")
    return ", ".join(texts)


def _odds(layer: Layer) -> Floats:
    """The layer's odds p / (1 - p); counts and sums are already what is held against the largest.

    A cell held as surely occupied counts as the surest that a float32 can tell from it.
    """
    if rule_of(layer.kind).shown_as_odds:
        return np.where(layer.observed, layer.values, 0.0).astype(np.float64)
    surest = float(np.nextafter(np.float32(1), np.float32(0)))
    p = np.minimum(layer.probability.astype(np.float64), surest)
    odds: Floats = np.where(layer.observed, p / (1.0 - p), 0.0)
    return odds


def _set_up(sink: Sink, entity: str, picture: Picture) -> None:
    """The colour and the name of each code, and how the picture is laid over the cells."""
    table = colours(picture.name, picture.of, picture.levels)
    named: list[Named] = [(0, "never seen", layout.NEVER_SEEN)]
    each = itertools.product(range(picture.levels), repeat=len(picture.of))
    for code, (digits, (r, g, b)) in enumerate(zip(each, table.tolist(), strict=True), start=1):
        shares = [f"{of} {100 * d / (picture.levels - 1):.0f} %"
                  for of, d in zip(picture.of, digits, strict=True)]  # fmt: skip
        named.append((code, ", ".join(shares), (r, g, b, 255)))
    scene.set_up_opaque(sink, entity, named)
    look = rr.SegmentationImage.from_fields(opacity=1.0, draw_order=layout.ORDER_DISPLAY)
    sink.log(entity, look)
