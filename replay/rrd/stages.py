"""How the way to borders and lines looks: where a border starts, the tracer's walk, the stages.

All of it is there for one step only; the borders and lines themselves stay.
"""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from mapping.artifacts import Border, LineStage, TracerStep
from mapping.grid import GridGeometry
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas
from replay.rrd.layout import Colour

_ARROW_CELLS = 6  # of a border's beginning
_HEAD = 0.35  # of an arrow's length, and half of that to either side

Floats = NDArray[np.float64]


def draw_border_start(canvas: Canvas, border: Border) -> None:
    """An arrow along the first cells of a border."""
    centres = border.geometry.centres_of(border.cells[: _ARROW_CELLS + 1])
    strips = [arrow(centres[0], centres[-1])] if len(centres) > 1 else []
    _for_now(canvas, layout.start_of_border(border.layer), strips, layout.STAGE_PLACE)


def draw_tracer_step(canvas: Canvas, step: TracerStep) -> None:
    """The way so far, the neighbours that were tried, and an arrow to the next cell."""
    path = step.geometry.centres_of(step.cells)
    _for_now(canvas, layout.tracer(step.layer, "path"), [path], layout.STAGE_PIECE)
    tried = step.geometry.centres_of(step.tried)
    _points_for_now(canvas, layout.tracer(step.layer, "tried"), np.vstack([path[-1:], tried]))
    strips = []
    if step.following is not None:
        strips = [arrow(path[-1], _centre(step.geometry, step.following))]
    _for_now(canvas, layout.tracer(step.layer, "next"), strips, layout.STAGE_PLACE)


def draw_line_stage(canvas: Canvas, stage: LineStage) -> None:
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


def _centre(geometry: GridGeometry, cell: tuple[int, int]) -> Floats:
    centre: Floats = geometry.centres_of(np.array([cell], np.int64))[0]
    return centre


def _for_now(canvas: Canvas, entity: str, strips: list[Floats], colour: Colour) -> None:
    def set_up(recording: rr.RecordingStream, entity: str) -> None:
        scene.set_up_strips(recording, entity, colour)

    canvas.prepare(entity, set_up)
    size = sum(strip.nbytes for strip in strips)
    canvas.add_for_now(entity, columns.strips, strips, [], size)


def _points_for_now(canvas: Canvas, entity: str, points_m: Floats) -> None:
    canvas.prepare(entity, scene.set_up_places)
    canvas.add_for_now(entity, columns.points, points_m, np.zeros((0, 2)), points_m.nbytes)
