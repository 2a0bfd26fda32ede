"""How the later stages look: whole maps, thresholds, classes, borders, points and segments.

The way to borders and lines (where a border starts, the tracer's walk, what was cut and joined) is
there for one step only; the borders and lines themselves stay, the newest in its full colour, those
before it pale. The next reading takes all of it away, since the map goes on without it. The end
takes away all but the lines found in the maps, and keeps what it took in a place of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import (
    Artifact,
    Border,
    Classes,
    LineStage,
    RawPoints,
    Segment,
    Snapshot,
    Thresholded,
    TracerStep,
)
from mapping.grid import Window
from replay.colours import pale
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas, Floats
from replay.rrd.layers import Layers
from replay.rrd.layout import Colour

_ARROW_CELLS = 6  # of a border's beginning
_BORDERS = "borders"
_HEAD = 0.35  # of an arrow's length, and half of that to either side


@dataclass(slots=True)
class _Gathered:
    """A layer's strips of one kind, in groups, and how they look: in full, and pale."""

    layer: str
    kind: str  # "borders", or where its segments are from: "grid" or "raw"
    colour: Colour
    pale: Colour
    groups: list[list[tuple[Floats, str]]] = field(default_factory=lambda: [[]])

    @property
    def strips(self) -> list[Floats]:
        """All of them."""
        return [strip for group in self.groups for strip, _ in group]


class Results:
    """Draws results on a canvas; borders and segments gather until their stage starts anew."""

    def __init__(self, canvas: Canvas, layers: Layers) -> None:
        self._canvas, self._layers = canvas, layers
        self._gathered: dict[str, _Gathered] = {}
        self._occupied: dict[str, NDArray[np.uint8]] = {}  # above the threshold, where it is drawn
        self._points: dict[str, Floats] = {}  # raw points, by sensor, where they are drawn
        self._newest = ""  # the root whose newest strip stands out

    def draw(self, artifact: Artifact) -> None:
        """Draw one. Raises TypeError for something else."""
        self._settle(artifact)
        match artifact:
            case Snapshot():
                self._draw_snapshot(artifact)
            case Thresholded():
                self._draw_thresholded(artifact)
            case Classes():
                self._draw_classes(artifact)
            case Border():
                self._draw_border(artifact)
            case TracerStep():
                _draw_tracer_step(self._canvas, artifact)
            case RawPoints():
                self._draw_raw_points(artifact)
            case LineStage():
                _draw_line_stage(self._canvas, artifact)
            case Segment():
                self._draw_segment(artifact)
            case _:
                raise TypeError(f"{type(artifact).__name__} is no artifact")

    def _draw_snapshot(self, snapshot: Snapshot) -> None:
        """A whole layer, with its exact values and its rule's further arrays."""
        layer, canvas = snapshot.layer, self._canvas
        self._layers.draw_whole(snapshot)
        for name, array in layer.extra.items():
            values = np.asarray(array, np.float32)
            entity = layout.extra(layer.name, name)
            canvas.prepare(entity, scene.set_up_extra, name)
            canvas.add(entity, columns.float32_values, values.copy(), values.nbytes)

    def _draw_thresholded(self, thresholded: Thresholded) -> None:
        """The occupied cells over the map; borders and lines of an earlier time go."""
        layer = thresholded.layer
        self._restart(layout.borders(layer))
        self._restart(layout.segments(layer, "grid"))
        picture = thresholded.occupied.astype(np.uint8)
        self._layers.set_up(layer)
        self._occupied[layer] = picture
        threshold = np.array([thresholded.threshold])
        self._canvas.add(layout.thresholded(layer), columns.number_records, threshold)
        self._canvas.draw_classes(layout.thresholded(layer), picture, layout.ORDER_THRESHOLDED)

    def _draw_classes(self, classes: Classes) -> None:
        """The class map, a view of its own."""
        self._canvas.prepare(f"{layout.CLASSES}/names", scene.set_up_classes, classes.names)
        self._canvas.draw_classes(layout.CLASSES, classes.codes, layout.ORDER_CLASSES)

    def _draw_border(self, border: Border) -> None:
        """One more border, closed, through the centres of its cells."""
        root = layout.borders(border.layer)
        centres = border.geometry.centres_of(np.vstack([border.cells, border.cells[:1]]))
        label = f"border {border.number}, {'outer' if border.outer else 'hole'}"
        look = _Gathered(border.layer, _BORDERS, layout.BORDER, layout.PALE_BORDER)
        entity = self._gather(root, centres, label, look)
        record = np.column_stack(
            [np.full(len(border.cells), border.number), np.full(len(border.cells), border.outer),
             border.cells]
        ).astype(np.int64)  # fmt: skip
        self._canvas.add(entity, columns.number_records, record, record.nbytes)
        _draw_border_start(self._canvas, border)

    def _draw_raw_points(self, points: RawPoints) -> None:
        """All obstacle points of a sensor; raw lines of an earlier time go."""
        self._restart(layout.segments(points.layer, "raw"))
        entity, xy = layout.raw_points(points.layer), np.asarray(points.points_m, np.float64)
        self._points[points.layer] = xy
        self._canvas.prepare(entity, scene.set_up_points, self._canvas.colour(points.layer))
        self._canvas.add(entity, columns.points, xy, xy.nbytes)
        self._canvas.add(entity, columns.number_records, xy, xy.nbytes)

    def _draw_segment(self, segment: Segment) -> None:
        """One more straight line."""
        root = layout.segments(segment.layer, segment.source)
        label = f"{segment.length_m:.2f} m, rms {1000 * segment.rms_m:.0f} mm, n {segment.points}"
        ends = np.array([segment.start_m, segment.end_m])
        look = _Gathered(segment.layer, segment.source, *self._look_of_lines(segment))
        entity = self._gather(root, ends, label, look)
        border = np.nan if segment.border is None else segment.border
        record = np.array(
            [*segment.start_m, *segment.end_m, segment.rho_m, segment.alpha_rad,
             *np.asarray(segment.covariance).ravel(), segment.rms_m, segment.points, border],
            np.float64,
        )  # fmt: skip
        self._canvas.add(entity, columns.number_records, record, record.nbytes)

    def _look_of_lines(self, segment: Segment) -> tuple[Colour, Colour]:
        """Lines fitted to raw points have their sensor's colour: they are what it alone saw."""
        if segment.source != "raw":
            return layout.SEGMENT, layout.PALE_SEGMENT
        colour = self._canvas.colour(segment.layer)
        return colour, layout.opaque(pale(colour[:3], 0.6))

    def _gather(self, root: str, strip: Floats, label: str, first: _Gathered) -> str:
        """Add a strip to the newest group below a root, and draw that group; its entity.

        The strip itself is drawn once more, in full, for as long as it is the newest.
        """
        gathered = self._gathered.setdefault(root, first)
        groups = gathered.groups
        if len(groups[-1]) == layout.GROUP:
            groups.append([])
        groups[-1].append((strip, label))
        entity = layout.group(root, len(groups) - 1)
        self._canvas.prepare(entity, _set_up_of(gathered))
        strips, labels = [each[0] for each in groups[-1]], [each[1] for each in groups[-1]]
        self._canvas.add(entity, columns.strips, strips, sum(s.nbytes for s in strips))
        self._canvas.add(entity, columns.labels, labels, sum(len(text) for text in labels))
        if len(strips) == 1:
            self._canvas.add(entity, columns.colours, [gathered.pale])
        newest = layout.newest(root)
        self._canvas.prepare(newest, scene.set_up_newest, gathered.colour)
        self._canvas.add_for_now(newest, columns.strips, [strip], [], strip.nbytes)
        self._newest = root
        return entity

    def _settle(self, artifact: Artifact | None) -> None:
        """What was the newest of its kind is one of all, once something else comes."""
        root = self._newest
        match artifact:
            case Border():
                goes_on = root == layout.borders(artifact.layer)
            case Segment():
                goes_on = root == layout.segments(artifact.layer, artifact.source)
            case _:
                goes_on = False
        if root and not goes_on:
            gathered = self._gathered[root]
            for number, _ in enumerate(gathered.groups):
                self._canvas.add(layout.group(root, number), columns.colours, [gathered.colour])
            self._newest = ""

    def clear(self) -> None:
        """Take all of an earlier stage away: the map goes on without it."""
        for root in list(self._gathered):
            self._restart(root)
        for layer in list(self._occupied):
            self._hide_occupied(layer)
        for sensor in list(self._points):
            self._hide_points(sensor)

    def finish(self, path_m: Floats) -> None:
        """Leave the maps and their lines alone, and keep the rest, and the ``path_m``, aside."""
        canvas = self._canvas
        self._settle(None)
        for layer in list(self._occupied):
            self._keep_occupied(layer, self._occupied[layer])
            self._hide_occupied(layer)
        for sensor, points_m in list(self._points.items()):
            entity = f"{layout.kept(sensor)}/points"
            canvas.prepare(entity, scene.set_up_points, canvas.colour(sensor))
            canvas.add(entity, columns.points, points_m, points_m.nbytes)
            self._hide_points(sensor)
        for root, gathered in list(self._gathered.items()):
            if gathered.kind == "grid":
                continue
            entity, strips = f"{layout.kept(gathered.layer)}/{gathered.kind}", gathered.strips
            canvas.prepare(entity, _set_up_of(gathered))
            canvas.add(entity, columns.strips, strips, sum(strip.nbytes for strip in strips))
            canvas.add(entity, columns.colours, [gathered.colour])
            self._restart(root)
        canvas.prepare(layout.KEPT_PATH, scene.set_up_path)
        canvas.add(layout.KEPT_PATH, columns.points, path_m, path_m.nbytes)

    def _keep_occupied(self, layer: str, picture: NDArray[np.uint8]) -> None:
        canvas, window = self._canvas, Window.around(picture)
        if window.empty:
            return
        entity = f"{layout.kept(layer)}/above_threshold"
        canvas.prepare(entity, scene.set_up_kept_cells)
        corner = layout.corner_m(canvas.geometry, window)
        cells, cell_m = picture[window.slices].copy(), canvas.geometry.resolution_m
        row = columns.PlacedClasses(cells, corner, cell_m, layout.ORDER_THRESHOLDED)
        canvas.add(entity, columns.placed_classes, row, cells.nbytes)

    def _hide_occupied(self, layer: str) -> None:
        nothing = np.zeros_like(self._occupied.pop(layer))
        self._canvas.draw_classes(layout.thresholded(layer), nothing, layout.ORDER_THRESHOLDED)

    def _hide_points(self, sensor: str) -> None:
        del self._points[sensor]
        self._canvas.add(layout.raw_points(sensor), columns.points, np.zeros((0, 2)))

    def _restart(self, root: str) -> None:
        if root == self._newest:
            self._newest = ""
        gathered = self._gathered.pop(root, None)
        for number, _ in enumerate([] if gathered is None else gathered.groups):
            self._canvas.add(layout.group(root, number), columns.strips, [])
            self._canvas.add(layout.group(root, number), columns.labels, [])


def _set_up_of(gathered: _Gathered) -> scene.SetUp:
    return scene.set_up_borders if gathered.kind == _BORDERS else scene.set_up_segments


def _draw_border_start(canvas: Canvas, border: Border) -> None:
    """An arrow along the first cells of a border."""
    centres = border.geometry.centres_of(border.cells[: _ARROW_CELLS + 1])
    strips = [arrow(centres[0], centres[-1])] if len(centres) > 1 else []
    _for_now(canvas, layout.start_of_border(border.layer), strips, layout.STAGE_PLACE)


def _draw_tracer_step(canvas: Canvas, step: TracerStep) -> None:
    """The way so far, the neighbours that were tried, and an arrow to the next cell."""
    path = step.geometry.centres_of(step.cells)
    _for_now(canvas, layout.tracer(step.layer, "path"), [path], layout.STAGE_PIECE)
    tried = step.geometry.centres_of(step.tried)
    _points_for_now(canvas, layout.tracer(step.layer, "tried"), np.vstack([path[-1:], tried]))
    strips = []
    if step.following is not None:
        (following,) = step.geometry.centres_of(np.array([step.following], np.int64))
        strips = [arrow(path[-1], following)]
    _for_now(canvas, layout.tracer(step.layer, "next"), strips, layout.STAGE_PLACE)


def _draw_line_stage(canvas: Canvas, stage: LineStage) -> None:
    """The pieces in blue, and the cuts, joints or crossings as red dots."""
    pieces = layout.line_stage(stage.layer, "pieces")
    _for_now(canvas, pieces, list(stage.pieces_m), layout.STAGE_PIECE)
    _points_for_now(canvas, layout.line_stage(stage.layer, "places"), stage.places_m)


def arrow(start_m: Floats, end_m: Floats) -> Floats:
    """An arrow as one strip (5, 2): the shaft, and both sides of the head."""
    along = (end_m - start_m) * _HEAD
    aside = np.array([-along[1], along[0]]) / 2.0
    left, right = end_m - along + aside, end_m - along - aside
    return np.array([start_m, end_m, left, right, end_m])


def _for_now(canvas: Canvas, entity: str, strips: list[Floats], colour: Colour) -> None:
    canvas.prepare(entity, scene.set_up_strips, colour)
    size = sum(strip.nbytes for strip in strips)
    canvas.add_for_now(entity, columns.strips, strips, [], size)


def _points_for_now(canvas: Canvas, entity: str, points_m: Floats) -> None:
    canvas.prepare(entity, scene.set_up_places)
    canvas.add_for_now(entity, columns.points, points_m, np.zeros((0, 2)), points_m.nbytes)
