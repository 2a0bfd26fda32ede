"""Swatches with names: what the colours on the maps mean, of just those that are there now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from mapping.artifacts import (
    Artifact,
    Classes,
    Finished,
    MergedGrid,
    RejectedReading,
    Started,
    TempGrid,
)
from mapping.beams import Beam
from mapping.fusion import FUSED
from replay import colours
from replay.rrd import columns, layout
from replay.rrd.canvas import Canvas
from replay.rrd.layout import Colour
from replay.rrd.sink import Columns, Sink

Floats = NDArray[np.float64]

_COLUMNS, _ROW = 3, 0.42  # how many stand in a row; its height, where a column is 1 wide
_LENGTH, _BELOW = 0.22, 0.11
_CELLS, _LINE, _THIN = 0.055, 0.016, 0.008  # half the thickness of a swatch
_EDGE, _EDGE_COLOUR = 0.006, (120, 125, 135, 255)
_MOST_SENSORS = 6
_TEXT: Colour = (225, 228, 235, 255)
BACKGROUND = (20, 21, 24)


@dataclass(frozen=True, slots=True)
class Swatch:
    """A colour, how thick it is drawn, and what it means."""

    name: str
    colour: Colour
    thickness: float = _CELLS


class LegendOverlay:
    """Draws the legend anew whenever other things come on the maps."""

    def __init__(self) -> None:
        self._sensors: list[Swatch] = []
        self._walls: list[Swatch] = []
        self._shown: tuple[Swatch, ...] = ()

    def start(self, canvas: Canvas, started: Started) -> None:
        """The empty maps, and the sensors that will fill them."""
        canvas.prepare(layout.LEGEND, _set_up)
        self._sensors = sensor_swatches(started)
        if len(started.walls_m):
            self._walls = [Swatch("true wall", layout.WALL, _THIN)]
        self._draw(canvas, [_UNSEEN, *self._sensors, *self._walls])

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """See what comes onto the maps."""
        match artifact:
            case Started():
                pass
            case Classes():
                self._draw(canvas, [*_GREYS, *_RESULTS, *self._sensors, *self._walls])
                self._draw_classes(canvas, artifact)
            case Finished():
                self._draw(canvas, [*_GREYS, _LINES, *self._walls])
            case Beam() | TempGrid() | MergedGrid():
                if shown:
                    self._draw(canvas, [*_GREYS, *_EVIDENCE, _ROBOT, *self._sensors, *self._walls])
            case RejectedReading():
                if shown:
                    self._draw(canvas, [*_GREYS, _REJECTED, _ROBOT, *self._sensors, *self._walls])
            case _:
                self._draw(canvas, [*_GREYS, *_RESULTS, *self._sensors, *self._walls])
        return ""

    def _draw(self, canvas: Canvas, swatches: Sequence[Swatch]) -> None:
        chosen = tuple(swatches)
        if chosen != self._shown:
            self._shown = chosen
            _add(canvas, layout.LEGEND, chosen)

    def _draw_classes(self, canvas: Canvas, classes: Classes) -> None:
        """The classes that there are, in the tab of their map."""
        found = layout.class_colours(classes.names)
        used = np.bincount(classes.codes.ravel(), minlength=len(classes.names))
        chosen = tuple(
            Swatch(name, found[name][0])
            for name, count in zip(classes.names, used, strict=False) if count
        )  # fmt: skip
        canvas.prepare(layout.CLASSES_LEGEND, _set_up)
        _add(canvas, layout.CLASSES_LEGEND, chosen)


def _add(canvas: Canvas, entity: str, swatches: tuple[Swatch, ...]) -> None:
    canvas.add(f"{entity}/swatches", _packed_swatches, swatches)
    canvas.add(f"{entity}/names", _packed_names, swatches)


_GREYS = (
    Swatch("free", layout.opaque(colours.FREE)),
    Swatch("occupied", layout.opaque(colours.OCCUPIED)),
    Swatch("never seen", layout.NEVER_SEEN),
)
_UNSEEN = _GREYS[-1]
_EVIDENCE = (
    Swatch("obstacle may be here", layout.MORE_OCCUPIED),
    Swatch("beam passed through", layout.MORE_FREE),
)
_REJECTED = Swatch("left out by a filter", layout.REJECTED, _LINE)
_ROBOT = Swatch("robot and path", layout.ROBOT_COLOUR, _LINE)
_LINES = Swatch("wall that was found", layout.SEGMENT, _LINE)
_RESULTS = (
    Swatch("above the threshold", layout.opaque(colours.ABOVE_THRESHOLD)),
    Swatch("border", layout.BORDER, _THIN),
    _LINES,
)


def sensor_swatches(started: Started) -> list[Swatch]:
    """One for each sensor, in its place and colour; of very many, for each layer."""
    layer_of = {sensor.name: sensor.layer for sensor in started.sensors}
    names = layer_of or {layer: layer for layer in started.layers if layer != FUSED}
    if len(names) > _MOST_SENSORS:
        names = {layer: layer for layer in names.values()}
    found = colours.sensor_colours([*started.layers, *names], layer_of)
    return [
        Swatch(f"{name}: beam, echoes", layout.opaque(found[name]), _LINE)
        for name in colours.in_place(names)[: 2 * _MOST_SENSORS]
    ]


def legend_view(started: Started, name: str) -> rrb.Spatial2DView:
    """The view of it, as large as the longest legend needs."""
    sensors = len(sensor_swatches(started))
    return _view(layout.LEGEND, name, len(_GREYS) + len(_EVIDENCE) + 1 + sensors + 1)


def classes_legend_view(started: Started) -> rrb.Spatial2DView:
    """The same for the class map: four classes of all sensors, two of each layer."""
    layers = [layer for layer in started.layers if layer != FUSED]
    return _view(layout.CLASSES_LEGEND, "What these colours mean", 4 + 2 * len(layers))


def _view(entity: str, name: str, most: int) -> rrb.Spatial2DView:
    height = -(-most // _COLUMNS) * _ROW
    return rrb.Spatial2DView(
        origin=entity, name=name, background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[0, _COLUMNS], y_range=[0, height]),
    )  # fmt: skip


def _set_up(sink: Sink, entity: str) -> None:
    names = rr.Points2D.from_fields(radii=[-0.1], colors=[_TEXT], show_labels=True)
    sink.log(f"{entity}/names", names)


def _places(count: int) -> Floats:
    """The middle of each swatch, (count, 2)."""
    rows, cols = np.divmod(np.arange(count), _COLUMNS)
    return np.column_stack([cols + 0.5, rows * _ROW + _BELOW])


def _packed_swatches(rows: Sequence[tuple[Swatch, ...]]) -> Columns:
    """Each as a thick line upon a thicker grey one, so that black and dark ones have an edge."""
    strips: list[list[Floats]] = []
    looks: list[list[Colour]] = []
    radii: list[list[float]] = []
    for row in rows:
        half = np.array([_LENGTH, 0.0])
        lines = [np.stack([at - half, at + half]) for at in _places(len(row))]
        strips.append([*lines, *lines])
        looks.append([_EDGE_COLOUR] * len(row) + [swatch.colour for swatch in row])
        thick = [swatch.thickness for swatch in row]
        radii.append([t + _EDGE if t == _CELLS else t / 2 for t in thick] + thick)
    lengths = [len(each) for each in radii]
    flat = [radius for each in radii for radius in each]
    return [
        *columns.strips(strips),
        *columns.colours(looks),
        *rr.LineStrips2D.columns(radii=flat).partition(lengths),
    ]


def _packed_names(rows: Sequence[tuple[Swatch, ...]]) -> Columns:
    places = [_places(len(row)) for row in rows]
    labels = [swatch.name for row in rows for swatch in row]
    lengths = [len(row) for row in rows]
    below = [place + np.array([0.0, _CELLS]) for place in places]
    return [
        *columns.points(below),
        *rr.Points2D.columns(labels=labels).partition(lengths),
    ]
