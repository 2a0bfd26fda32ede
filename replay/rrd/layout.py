"""Entity names, drawing order and colours of a recording: the one place where they are written.

Reader, writer and blueprints all take them from here. A layer's things lie below its own name, so
that a view of ``/map/ping`` shows one sensor and nothing of another. Grids are cut into tiles, each
an entity of its own: the viewer then finds the newest version of every tile at any step, and a
reading writes only the tiles that it changed.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mapping.grid import GridGeometry, Window
from replay import colours

MAP = "/map"
GRID = f"{MAP}/grid"
WALLS = f"{MAP}/walls"
ROBOT = f"{MAP}/robot"
PATH = f"{MAP}/path"
KEPT_PATH = f"{MAP}/kept_path"
AXES = f"{MAP}/axes"
CLASSES = f"{MAP}/classes"
RANGES = "/ranges"
PLOT = "/range_plot"
PLOT_CURSOR = f"{PLOT}/now"
EXPLANATION = "/explanation"
CONFIG = "/config"
LEGEND, CLASSES_LEGEND, MANUAL = "/legend", "/legend_of_classes", "/manual"
STEPS = "/steps"
NOTICE = "/notice"
MATTERS = "/readings_that_matter"
VALUE_LOG = "/histories"
MAPS = "/maps"  # the names of several maps in one recording
PROBES = "/probes"
# Named to come after the layers: of pictures, the viewer lays the later name over the earlier.
DISPLAY, TOGETHER = f"{MAP}/pictures", f"{MAP}/pictures_of_several"
THRESHOLDS = f"{MAP}/thresholds"
PROBE_MARKS = f"{MAP}/probes"

STEP, READING, TIME = "step", "reading", "time"
# Tabs that texts name.
CLASSES_TITLE = "classes: where the sensors agree"
KEPT_TITLE = "With borders and points"

# What is drawn over what, from below. Up to the patch they are grids, each in a plane of its own.
ORDER_NEVER_SEEN, ORDER_TILES, ORDER_CLASSES, ORDER_THRESHOLDED = -1.0, 0.0, 1.0, 2.0
ORDER_DISPLAY, ORDER_PATCH = 3.0, 4.0
ORDER_WALLS, ORDER_BORDERS, ORDER_PATH, ORDER_POINTS = 5.0, 6.0, 7.0, 8.0
ORDER_SEGMENTS, ORDER_BEAM, ORDER_ROBOT, ORDER_PROBE = 9.0, 10.0, 11.0, 12.0
ORDER_STAGES, ORDER_AXES = 9.5, 13.0

# Grids whose planes are closer than a millimetre lie in one plane, for the viewer. Pictures of one
# kind that touch in a plane count as transparent, however opaque they are; and among transparent
# pictures of several kinds, the one farther from the middle of the view is drawn first, whatever
# the order. So grids lie a millimetre apart, and the tiles of one a hair.
_PLANE_M = 0.001
TILE_SHRINKAGE = 3e-5

Colour = tuple[int, int, int, int]
Place = tuple[int, int]  # of a tile among the tiles: row and column, counted from the lower left


def opaque(colour: colours.Colour) -> Colour:
    """A colour that nothing shines through."""
    return (*colour, 255)


NEVER_SEEN: Colour = opaque(colours.NEVER_SEEN)
MORE_OCCUPIED: Colour = opaque(colours.MORE_OCCUPIED)
MORE_FREE: Colour = opaque(colours.MORE_FREE)
WALL: Colour = (*colours.TRUE_WALL, 200)
BORDER: Colour = opaque(colours.BORDER)
SEGMENT: Colour = opaque(colours.LINE)
PALE_SEGMENT: Colour = opaque(colours.pale(colours.LINE, 0.6))
PALE_BORDER: Colour = opaque(colours.pale(colours.BORDER, 0.6))
OCCUPIED: Colour = (*colours.ABOVE_THRESHOLD, 150)
ROBOT_COLOUR: Colour = opaque(colours.ROBOT)
PATH_COLOUR: Colour = (*colours.ROBOT, 150)
REJECTED: Colour = opaque(colours.REJECTED)
PROBE: Colour = (255, 0, 255, 255)
PAPER: Colour = (245, 245, 240, 255)
INK: Colour = (70, 75, 90, 255)
STAGE_PIECE: Colour = (0, 150, 255, 255)
STAGE_PLACE: Colour = (220, 0, 0, 255)
# Of the class map; what one sensor alone saw has the colour of its layer.
_CLASS_COLOURS: dict[str, tuple[Colour, str]] = {
    "unknown": (NEVER_SEEN, "blue-grey"), "agree occupied": ((0, 0, 0, 255), "black"),
    "agree empty": ((255, 255, 255, 255), "white"),
    "contradict": (opaque(colours.CONTRADICTION), "red"),
}  # fmt: skip
_ALONE = " alone "

GROUP = 32  # borders or segments that share an entity

# Small tiles hold little that a reading did not change, large ones are few: each is an entity. Of
# 200 x 200 cells or fewer, the file's compression still finds a tile's version before.
_TILE, _MOST_TILES = 80, 1024
_RESULTS_TILE = 1024  # what the smallest graphics cards take as one picture


def class_colours(names: Sequence[str]) -> dict[str, tuple[Colour, str]]:
    """The colour of each class, and the same in words.

    ``... alone empty`` is pale, ``... alone occupied`` the layer's full colour.
    """
    layers = [name.partition(_ALONE)[0] for name in names if _ALONE in name]
    found, words = colours.sensor_colours(layers), colours.sensor_colour_names(layers)
    each = {}
    for name in names:
        layer, alone, state = name.partition(_ALONE)
        if not alone:
            each[name] = _CLASS_COLOURS.get(name, _CLASS_COLOURS["unknown"])
        elif state == "empty":
            each[name] = (opaque(colours.pale(found[layer])), f"pale {words[layer]}")
        else:
            each[name] = (opaque(found[layer]), words[layer])
    return each


def plane_m(order: float) -> float:
    """How far behind the patch, which is behind nothing, a grid of this drawing order lies."""
    return _PLANE_M * (ORDER_PATCH - order)


def layer_root(layer: str) -> str:
    """Where all of a layer lies; characters that mean something in a path are escaped."""
    return f"{MAP}/layers/{part(layer)}"


def _below(name: str) -> Callable[[str], str]:
    """From a layer to what lies below it by that name."""
    return lambda layer: f"{layer_root(layer)}/{name}"


merged = _below("merged")  # the root of its tiles
rejected = _below("rejected")  # the newest reading that a filter left out
temp = _below("temp")  # the evidence of the newest reading, over the map
change = _below("what_changed")  # what the newest reading changed, over the map
beam = _below("beam")  # the outline of the newest one
points = _below("points")  # obstacle points, one reading at a time
kept = _below("kept")  # what the end takes off the map: switched on, it lies there again
raw_points = _below("raw_points")  # all of them together, at the end
thresholded = _below("thresholded")  # the root of tiles: the occupied cells, over the map
borders = _below("borders")  # the root of numbered groups
start_of_border = _below("border_start")  # where the newest one starts, and which way it goes


def tile(root: str, row: int, col: int) -> str:
    """One tile below a root, by its place among the tiles, counted from the lower left."""
    return f"{root}/t{row:02d}_{col:02d}"


def never_seen(root: str) -> str:
    """What lies below all tiles of a root: cells that no reading ever touched."""
    return f"{root}/never_seen"


def of_sensor(root: str, layer: str, sensor: str) -> str:
    """What a sensor has below a root of its layer: each of several has a place of its own."""
    return root if sensor == layer else f"{root}/{part(sensor)}"


def root_of(name: str) -> str:
    """Where all of one of several maps lies; empty of the only one."""
    return f"/{part(name)}" if name else ""


def value_log(layer: str) -> str:
    """Every value of a layer at every reading, for the reader alone."""
    return f"{VALUE_LOG}/{part(layer)}"


def extra(layer: str, name: str) -> str:
    """A further array of a layer, whole, at its snapshots."""
    return f"{layer_root(layer)}/extra/{part(name)}"


def sized(patches: str, side: int) -> str:
    """Patches of one size; the viewer complains of compressed pictures that change theirs."""
    return f"{patches}/p{side}"


def digit(trail: str, number: int) -> str:
    """One row of those that make up a trail of dots."""
    return f"{trail}/d{number}"


def compared(layer: str, threshold: float) -> str:
    """A layer at one of several thresholds that are shown side by side."""
    return f"{THRESHOLDS}/{part(layer)}/{part(f'{threshold:g}')}"


def tracer(layer: str, what: str) -> str:
    """The tracer on its way: its ``path``, the cells ``tried`` and the ``next`` one."""
    return f"{layer_root(layer)}/tracer/{what}"


def line_stage(layer: str, what: str) -> str:
    """What was done on the way to lines: the ``pieces`` and the ``places``."""
    return f"{layer_root(layer)}/line_stage/{what}"


def segments(layer: str, source: str) -> str:
    """The root of a layer's segments from ``source``; numbered groups lie below."""
    return f"{layer_root(layer)}/segments/{part(source)}"


def group(root: str, number: int) -> str:
    """One group of ``GROUP`` borders or segments below a root."""
    return f"{root}/g{number:03d}"


def newest(root: str) -> str:
    """The border or segment of a root that the step is about."""
    return f"{root}/newest"


def sensor_range(sensor: str) -> str:
    """The plot of one sensor's ranges."""
    return f"{RANGES}/{part(sensor)}"


def predicted_range(sensor: str) -> str:
    """The plot of what the map so far predicts for one sensor."""
    return f"{RANGES}/{part(sensor)}/predicted"


def display(layer: str, name: str) -> str:
    """A layer drawn in another way; several layers drawn into one picture have no layer."""
    return f"{DISPLAY}/{part(layer)}/{part(name)}" if layer else f"{TOGETHER}/{part(name)}"


def probe(number: int) -> str:
    """Where all about a watched cell lies."""
    return f"{PROBES}/{number}"


def probe_belief(number: int, layer: str) -> str:
    """The plot of a layer's belief in a watched cell."""
    return f"{probe(number)}/belief/{part(layer)}"


def probe_log(number: int) -> str:
    """The list of the readings that reached a watched cell."""
    return f"{probe(number)}/readings"


def probe_story(number: int) -> str:
    """What moved a watched cell most, as text."""
    return f"{probe(number)}/story"


def probe_mark(number: int) -> str:
    """The mark of a watched cell on the map."""
    return f"{PROBE_MARKS}/{number}"


@functools.lru_cache(maxsize=256)
def part(name: str) -> str:
    """A name as one part of an entity's path."""
    return re.sub(r"([^\w.-])", r"\\\1", name)


@dataclass(frozen=True, slots=True)
class Tiling:
    """How a grid is cut: square tiles of ``side`` cells from cell (0, 0); the last are cut off."""

    geometry: GridGeometry
    side: int

    @property
    def shape(self) -> tuple[int, int]:
        """How many tiles lie above each other, and beside each other."""
        return -(-self.geometry.rows // self.side), -(-self.geometry.cols // self.side)

    @property
    def count(self) -> int:
        """How many tiles there are."""
        rows, cols = self.shape
        return rows * cols

    def window(self, row: int, col: int) -> Window:
        """The cells of the tile at ``row``, ``col``."""
        row0, col0 = row * self.side, col * self.side
        rows = min(self.side, self.geometry.rows - row0)
        return Window(row0, col0, rows, min(self.side, self.geometry.cols - col0))

    def __iter__(self) -> Iterator[tuple[int, int]]:
        rows, cols = self.shape
        return ((row, col) for row in range(rows) for col in range(cols))


def tiling_for(geometry: GridGeometry) -> Tiling:
    """Tiles for what readings change: of 80 cells, doubled until they are few; of even sizes."""
    side, longest = _TILE, max(geometry.shape)
    while True:
        tiling = Tiling(geometry, -(-longest // -(-longest // side)))
        if tiling.count <= _MOST_TILES:
            return tiling
        side *= 2


def results_tiling_for(geometry: GridGeometry) -> Tiling:
    """Tiles for what is drawn whole, at whole maps: one, if the grid is not very large."""
    return Tiling(geometry, min(_RESULTS_TILE, max(geometry.shape)))


TILINGS = (tiling_for, results_tiling_for)  # whose sides a recording states, in this order


def corner_m(geometry: GridGeometry, window: Window) -> tuple[float, float]:
    """The outer corner of a window's first cell, metres, map frame."""
    x, y = geometry.origin_m
    return x + window.col0 * geometry.resolution_m, y + window.row0 * geometry.resolution_m
