"""What a page of pictures is made of, as plain values: cells, marks over them, panels, the page.

Places are x and y in metres in the map frame; pixels are in the grid's order, row 0 at the lowest
y. Who draws them is :mod:`replay.pictures.drawing`, which alone knows the library.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry, Window
from recorder.geometry import SE2
from replay.pictures.style import Colour

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of the map frame, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @classmethod
    def around(cls, points_m: Floats, margin: float = 0.0, least_m: float = 0.0) -> Box:
        """The rectangle that holds points (N, 2), N > 0, and a margin.

        The margin is a share of the longer side; no side is shorter than ``least_m``.
        """
        low, high = points_m.min(axis=0), points_m.max(axis=0)
        air = margin * float((high - low).max())
        missing = np.maximum(least_m - (high - low + 2.0 * air), 0.0) / 2.0
        (x0, y0), (x1, y1) = low - air - missing, high + air + missing
        return cls(float(x0), float(y0), float(x1), float(y1))

    @property
    def width_m(self) -> float:
        """Along x."""
        return self.x1 - self.x0

    @property
    def height_m(self) -> float:
        """Along y."""
        return self.y1 - self.y0

    @property
    def corners_m(self) -> Floats:
        """Lower left and upper right, (2, 2)."""
        return np.array([[self.x0, self.y0], [self.x1, self.y1]])

    def meets(self, other: Box) -> bool:
        """Whether the two have anything in common."""
        apart = self.x1 < other.x0 or other.x1 < self.x0 or self.y1 < other.y0 or other.y1 < self.y0
        return not apart

    def joined(self, other: Box) -> Box:
        """The rectangle that holds both."""
        return Box.around(np.vstack([self.corners_m, other.corners_m]))

    def grown_to(self, width_m: float, height_m: float) -> Box:
        """A rectangle of that size with the same middle."""
        x, y = (self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0
        return Box(x - width_m / 2.0, y - height_m / 2.0, x + width_m / 2.0, y + height_m / 2.0)


@dataclass(frozen=True, slots=True)
class Cells:
    """A grid in colours: ``pixels`` (rows, cols, 3), row 0 at the lowest y."""

    geometry: GridGeometry
    pixels: Pixels

    def within(self, box: Box) -> Cells:
        """The part that a picture of ``box`` shows, so that no more is drawn."""
        low, high = box.corners_m
        window = self.geometry.window_around(low, high)
        if window.empty:
            window = Window(0, 0, 1, 1)
        (x, y), size = self.geometry.origin_m, self.geometry.resolution_m
        corner = (x + window.col0 * size, y + window.row0 * size)
        geometry = GridGeometry(corner, size, window.rows, window.cols)
        return Cells(geometry, self.pixels[window.slices])


@dataclass(frozen=True, slots=True)
class Strokes:
    """Straight lines, (K, 2, 2)."""

    ends_m: Floats
    colour: Colour
    width_pt: float
    label: str = ""


@dataclass(frozen=True, slots=True)
class Trail:
    """A line through points (N, 2), closed or not; ``dashed`` where it is only thought."""

    points_m: Floats
    colour: Colour
    width_pt: float
    label: str = ""
    closed: bool = False
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Dots:
    """Points (N, 2)."""

    points_m: Floats
    colour: Colour
    size_pt: float
    label: str = ""


@dataclass(frozen=True, slots=True)
class Area:
    """The inside of an outline (N, 2), in a clear colour."""

    outline_m: Floats
    colour: Colour
    label: str = ""
    opacity: float = 0.22


@dataclass(frozen=True, slots=True)
class RobotMark:
    """Where the robot stands, and which way it faces."""

    world_from_base: SE2
    colour: Colour
    label: str = "robot"


@dataclass(frozen=True, slots=True)
class Words:
    """A short text at a place, on a plate of its own."""

    at_m: tuple[float, float]
    text: str
    colour: Colour


Mark = Strokes | Trail | Dots | Area | RobotMark | Words


@dataclass(frozen=True, slots=True)
class Swatch:
    """A colour of cells, and what it means."""

    colour: Colour
    label: str


@dataclass(frozen=True, slots=True)
class Panel:
    """One map with what lies over it; what of it is shown is ``frame``.

    One that is not ``in_metres`` is an example, without axes and scale.
    """

    title: str
    frame: Box
    cells: Cells | None = None
    swatches: tuple[Swatch, ...] = ()
    marks: tuple[Mark, ...] = ()
    in_metres: bool = True


@dataclass(frozen=True, slots=True)
class Curve:
    """A line of a plot through points (N, 2)."""

    points: Floats
    colour: Colour
    label: str = ""
    dashed: bool = False
    filled: bool = False  # down to zero


@dataclass(frozen=True, slots=True)
class Bars:
    """Columns of a plot: ``edges`` (N + 1,) along x, ``heights`` (N,); ``named`` writes them."""

    edges: Floats
    heights: Floats
    colour: Colour
    label: str = ""
    named: bool = False


@dataclass(frozen=True, slots=True)
class Chart:
    """A plot of numbers; ``frame`` is its shape on the page."""

    title: str
    x_label: str
    y_label: str
    parts: tuple[Curve | Bars, ...]
    frame: Box = Box(0.0, 0.0, 1.6, 1.0)
    swatches: tuple[Swatch, ...] = ()

    @property
    def marks(self) -> tuple[Strokes, ...]:
        """What the legend names."""
        nowhere = np.zeros((0, 2, 2))
        return tuple(Strokes(nowhere, each.colour, 1.8, each.label) for each in self.parts)


@dataclass(frozen=True, slots=True)
class Page:
    """What becomes one file: panels side by side under a title, and below them a caption.

    ``title`` and ``caption`` also go into the file's own description where its format has one.
    """

    title: str
    panels: tuple[Panel | Chart, ...]
    caption: str = ""
    source: str = ""  # small, beside the title
    columns: int = 3  # at most
    footer: str = ""  # small, below the caption
    drawn_caption: bool = True
    named: str = ""  # the title for the file's description, where another is drawn


def on_one_scale(panels: tuple[Panel, ...]) -> tuple[Panel, ...]:
    """The panels with frames of one size, so that a metre is as long in all of them.

    Maps of one place then show the same part of it; those of several places keep their middles.
    """
    whole = panels[0].frame
    for panel in panels[1:]:
        whole = whole.joined(panel.frame)
    width_m = max(panel.frame.width_m for panel in panels)
    height_m = max(panel.frame.height_m for panel in panels)
    together = whole.width_m * whole.height_m <= 2.5 * width_m * height_m
    frames = [whole if together else p.frame.grown_to(width_m, height_m) for p in panels]
    return tuple(replace(p, frame=frame) for p, frame in zip(panels, frames, strict=True))
