"""One map as it is to be looked at, wherever it comes from, and the panel that shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapping.beams import Beam
from mapping.grid import GridGeometry, Window
from replay import colours
from replay.pictures import style
from replay.pictures.parts import (
    Area,
    Box,
    Cells,
    Dots,
    Floats,
    Mark,
    Panel,
    RobotMark,
    Strokes,
    Swatch,
    Trail,
)
from replay.rrd.pictures import beam_outline

CLASSES = "classes"  # the view of them
_AIR = 0.06  # around path and walls, of their longer side
_LEAST_M = 0.5
_OUTSIDE = 0.02  # of all lines or points: so much may lie outside the frame on each side
_FEW_LINES = 40  # more are drawn thin, or they hide the map
GREY_SWATCHES = (
    Swatch(style.FREE, "free"), Swatch(style.OCCUPIED, "occupied"),
    Swatch(style.NEVER_SEEN, "never seen"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Overlaid:
    """What lies over a map: ``found_m`` the lines found in it and ``walls_m`` the true ones,
    (K, 2, 2), ``path_m`` (N, 2) where the robot was until then, ``beam`` the reading shown.

    ``around_m`` (M, 2) are the points that a picture of any moment shows, where they are known;
    ``sensors`` are all of the session, for their colours.
    """

    found_m: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))
    walls_m: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))
    path_m: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    beam: Beam | None = None
    around_m: Floats | None = None
    sensors: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Counted:
    """How many cells were seen, how many of these are rather occupied, where the free ones lie."""

    seen: int
    occupied: int
    free_m: Box | None


@dataclass(frozen=True, slots=True)
class MapView:
    """A map at one moment, and what lies over it.

    ``file`` and ``layer`` are what it is of, ``when`` the moment in words, ``rule`` how it came
    about (empty: not known).
    """

    file: str
    layer: str
    when: str
    rule: str
    cells: Cells
    swatches: tuple[Swatch, ...]
    over: Overlaid
    counted: Counted | None = None

    @property
    def placed_frame(self) -> Box | None:
        """The frame around path and walls; None where it has neither."""
        over = self.over
        if over.around_m is not None:
            return frame_around(over.around_m, over.walls_m, over.found_m[:0])
        return frame_around(over.path_m, over.walls_m, over.found_m)

    @property
    def frame(self) -> Box:
        """What a picture shows of it: path and walls, not what lies behind them.

        Where it has neither: what was found free, or all cells.
        """
        placed = self.placed_frame
        if placed is not None:
            return placed
        if self.counted is None or self.counted.free_m is None:
            return whole_of(self.cells.geometry)
        return Box.around(self.counted.free_m.corners_m, _AIR, _LEAST_M)


def view_of_grid(
    geometry: GridGeometry, probability: NDArray[np.floating], seen: NDArray[np.bool_],
    over: Overlaid, *, file: str, layer: str, when: str, rule: str = "",
) -> MapView:  # fmt: skip
    """Probabilities of being occupied, (rows, cols), in grey."""
    occupied, free = seen & (probability > 0.5), Window.around(seen & (probability < 0.5))
    free_m = None if free.empty else box_of(geometry, free)
    counted = Counted(int(seen.sum()), int(occupied.sum()), free_m)
    cells = Cells(geometry, grey_pixels(probability, seen))
    return MapView(file, layer, when, rule, cells, GREY_SWATCHES, over, counted)


def view_of_classes(
    geometry: GridGeometry, names: Sequence[str], codes: NDArray[np.uint8], over: Overlaid, *,
    file: str, when: str,
) -> MapView:  # fmt: skip
    """Where sensors agree and where they do not; of the classes only those that are there."""
    table = class_colours(names)
    there = np.unique(codes).tolist()
    swatches = tuple(Swatch(tuple(table[k] / 255.0), names[k]) for k in there)
    cells = Cells(geometry, table[codes])
    return MapView(file, CLASSES, when, "", cells, swatches, over)


def class_colours(names: Sequence[str]) -> NDArray[np.uint8]:
    """A colour for each class, (classes, 3): a sensor alone has its own, pale where empty."""
    alone = {name: name.partition(" alone ")[::2] for name in names if " alone " in name}
    of_sensor = colours.sensor_colours(sensor for sensor, _ in alone.values())
    table = {
        "agree occupied": colours.OCCUPIED, "agree empty": colours.FREE,
        "contradict": colours.CONTRADICTION,
    }  # fmt: skip
    for name, (sensor, state) in alone.items():
        full = of_sensor[sensor]
        table[name] = colours.pale(full) if state == "empty" else full
    return np.array([table.get(name, colours.NEVER_SEEN) for name in names], np.uint8)


def frame_around(path_m: Floats, walls_m: Floats, found_m: Floats) -> Box | None:
    """The rectangle of where the robot was and what is around it there; None without anything.

    True walls count where they are known. Of found ones a fiftieth of their length may stick out
    on each side: a ghost far behind a wall then makes no picture small.
    """
    parts = [path_m, walls_m.reshape(-1, 2)]
    if not len(walls_m) and len(found_m):
        parts.append(_most_of(found_m))
    points = np.concatenate(parts)
    return Box.around(points, _AIR, _LEAST_M) if len(points) else None


def whole_of(geometry: GridGeometry) -> Box:
    """The frame of all cells."""
    return box_of(geometry, geometry.whole)


def box_of(geometry: GridGeometry, window: Window) -> Box:
    """Where some cells lie."""
    (x, y), size = geometry.origin_m, geometry.resolution_m
    x0, y0 = x + window.col0 * size, y + window.row0 * size
    return Box(x0, y0, x0 + window.cols * size, y0 + window.rows * size)


def around_session(path_m: Floats, points_m: Floats, walls_m: Floats) -> Floats:
    """What of a session a picture of any of its moments shows, (N, 2), metres.

    The whole path, and where the true walls are not known nearly all obstacle points.
    """
    if len(walls_m) or not len(points_m):
        return path_m
    corners = np.quantile(points_m, [_OUTSIDE, 1.0 - _OUTSIDE], axis=0)
    return np.vstack([path_m, corners])


def _most_of(lines_m: Floats) -> Floats:
    """The corners of a box that holds nearly all of the length of some lines."""
    lengths = np.hypot(*(lines_m[:, 1] - lines_m[:, 0]).T)
    shares = np.linspace(0.0, 1.0, 11)[None, :, None]
    points = (lines_m[:, :1] * (1.0 - shares) + lines_m[:, 1:] * shares).reshape(-1, 2)
    weights = np.repeat(lengths, 11)
    corners = np.empty((2, 2))
    for axis in range(2):
        order = np.argsort(points[:, axis], kind="stable")
        sums = np.cumsum(weights[order])
        low, high = np.searchsorted(sums, sums[-1] * np.array([_OUTSIDE, 1.0 - _OUTSIDE]))
        corners[:, axis] = points[order[low], axis], points[order[high], axis]
    return corners


def grey_pixels(probability: NDArray[np.floating], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """White free, black occupied, blue-grey never seen; (rows, cols) → (rows, cols, 3)."""
    shade = np.clip(np.nan_to_num(probability, nan=0.5), 0.0, 1.0)
    pixels = np.repeat(np.round(255.0 * (1.0 - shade)).astype(np.uint8)[..., None], 3, axis=2)
    pixels[~seen] = np.round(255.0 * np.array(style.NEVER_SEEN)).astype(np.uint8)
    return pixels


def panel_of(view: MapView, title: str = "", frame: Box | None = None) -> Panel:
    """The map in grey, and over it path, walls, beam and robot."""
    over = view.over
    marks: list[Mark] = []
    if len(over.path_m) > 1:
        marks.append(Trail(over.path_m, style.PATH, 1.1, "path"))
    marks += beam_marks(over.beam, over.sensors)
    if len(over.found_m):
        width_pt = 2.4 if len(over.found_m) <= _FEW_LINES else 1.4
        marks.append(Strokes(over.found_m, style.FOUND_WALL, width_pt, "walls found"))
    if len(over.walls_m):
        marks.append(Strokes(over.walls_m, style.TRUE_WALL, 1.0, "true walls"))
    if over.beam is not None:
        marks.append(RobotMark(over.beam.world_from_base, style.ROBOT))
    return Panel(title, frame or view.frame, view.cells, view.swatches, tuple(marks))


def beam_marks(beam: Beam | None, sensors: Sequence[str]) -> list[Mark]:
    """The part of the map that a reading is evidence for, and its obstacle points."""
    if beam is None:
        return []
    colour = style.sensor_colour(beam.sensor, sensors)
    outline, *axis = beam_outline(beam)
    marks: list[Mark] = [Area(outline, colour, f"beam of {beam.sensor}")]
    marks += [Trail(each, colour, 0.8) for each in axis]
    points = beam.points_m
    if len(points):
        one = len(beam.ranges_m) == 1
        marks.append(Dots(points, colour, 5.0 if one else 2.2, "point measured"))
    return marks
