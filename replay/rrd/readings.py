"""How a reading looks, in its three steps: the beam, its evidence, and what it did to the map."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import MergedGrid, RejectedReading, TempGrid
from mapping.beams import Beam
from mapping.grid import Window
from replay.rrd import columns, layout, scene
from replay.rrd.background import done
from replay.rrd.canvas import Canvas
from replay.rrd.columns import BeamRecord, Patch
from replay.rrd.pictures import beam_outline, change_png, evidence_png, strength_png

_ARROW_SHARE = 0.05  # of the grid's diagonal: long enough to be seen, whatever the grid
_NO_STRIPS: list[NDArray[np.float64]] = []
_SMALLEST_SIDE = 32  # of a patch, in cells
_PACKED = 32  # cells in a byte of a picture, at least
T = TypeVar("T")


def draw_beam(canvas: Canvas, beam: Beam) -> None:
    """The robot, its sensor's beam and obstacle points, and the range in the plot."""
    canvas.wipe()
    _draw_robot(canvas, beam)
    outline = beam_outline(beam)
    entity = layout.of_sensor(layout.beam(beam.layer), beam.layer, beam.sensor)
    canvas.prepare(entity, scene.set_up_beam, canvas.colour(beam.sensor))
    canvas.add_for_now(entity, columns.strips, outline, _NO_STRIPS, sum(s.nbytes for s in outline))
    _draw_points(canvas, beam)
    _draw_range(canvas, beam)
    _record(canvas, beam, layout.ROBOT)


def _draw_robot(canvas: Canvas, beam: Beam) -> None:
    """Where it stands and which way it faces, and one more dot of its path."""
    base = beam.world_from_base
    length = _ARROW_SHARE * float(np.hypot(*canvas.geometry.size_m))
    towards = length * np.array([np.cos(base.heading_rad), np.sin(base.heading_rad)])
    here = np.array([base.x_m, base.y_m])
    # It ends at the robot: in front of it, it would cover the evidence of a near reading.
    canvas.add(layout.ROBOT, columns.arrows, np.stack([here - towards, towards]))
    canvas.leave(layout.PATH, here[None], scene.set_up_path)


def draw_rejected(canvas: Canvas, rejected: RejectedReading) -> None:
    """The robot, and the beam of a reading that a filter left out; nothing of it stays."""
    canvas.wipe()
    beam = rejected.beam
    _draw_robot(canvas, beam)
    outline = beam_outline(beam)
    entity = layout.rejected(beam.layer)
    canvas.prepare(entity, scene.set_up_beam, layout.REJECTED)
    canvas.add_for_now(entity, columns.strips, outline, _NO_STRIPS, sum(s.nbytes for s in outline))
    echo = f"{entity}/echo"
    canvas.prepare(echo, scene.set_up_points, layout.REJECTED)
    canvas.add_for_now(echo, columns.points, beam.points_m, np.zeros((0, 2)))
    _record(canvas, beam, entity)


def draw_temp(canvas: Canvas, temp: TempGrid) -> None:
    """The evidence of the reading, as a patch over the map."""
    if temp.window.empty:
        return
    _draw_patch(canvas, layout.temp(temp.beam.layer), temp.window, evidence_png, temp)


def draw_change(canvas: Canvas, merged: MergedGrid) -> None:
    """The difference that the reading made, as a patch for the views that show it."""
    if merged.window.empty:
        return
    _draw_patch(canvas, layout.change(merged.layer), merged.window, change_png, merged)


def _draw_patch(
    canvas: Canvas, entity: str, window: Window, png: Callable[[T, int], bytes], of: T
) -> None:
    """Draw a picture; of the size that its window needs, which the entity's others have, too."""
    side = _side_for(max(window.rows, window.cols))
    sized = layout.sized(entity, side)
    canvas.prepare(sized, scene.set_up_patches)
    corner = layout.corner_m(canvas.geometry, window)
    picture = canvas.rows.background.do(png, of, side)
    patch = Patch(corner, canvas.geometry.resolution_m, picture)
    canvas.add_for_now(
        sized, columns.patches, patch, _nothing(canvas, side), side * side // _PACKED
    )


def _side_for(cells: int) -> int:
    """The next larger of 32, 48, 64, 96, 128 ...: few sizes, and none far too large."""
    side = _SMALLEST_SIDE
    while side < cells:
        side = side * 3 // 2 if side & (side - 1) == 0 else side * 4 // 3
    return side


def _nothing(canvas: Canvas, side: int) -> Patch:
    """A clear picture, so small that nobody points at it by chance."""
    geometry = canvas.geometry
    return Patch(geometry.origin_m, geometry.resolution_m / 1000.0, done(_clear_png(side)))


@functools.cache
def _clear_png(side: int) -> bytes:
    return strength_png(np.zeros((1, 1), np.uint8), side)


def _draw_points(canvas: Canvas, beam: Beam) -> None:
    """A ranger's echoes gather; the points of a scan are many, so they go with it."""
    entity = layout.of_sensor(layout.points(beam.layer), beam.layer, beam.sensor)
    points_m, colour = beam.points_m, canvas.colour(beam.sensor)
    if len(beam.ranges_m) > 1:
        canvas.prepare(entity, scene.set_up_points, colour)
        canvas.add_for_now(entity, columns.points, points_m, np.zeros((0, 2)), points_m.nbytes)
    elif len(points_m):
        canvas.leave(entity, points_m, scene.set_up_points, colour)


def draw_end(canvas: Canvas) -> NDArray[np.float64]:
    """Take the robot, its path and all points away; the path, (N, 2), metres."""
    canvas.wipe()
    canvas.add(layout.ROBOT, columns.no_arrows, None)
    dots_m = {entity: canvas.lift(entity) for entity in canvas.trails}
    return dots_m.get(layout.PATH, np.zeros((0, 2)))


def _draw_range(canvas: Canvas, beam: Beam) -> None:
    """The nearest range; where nothing was seen, the plot has a gap."""
    colour = canvas.colour(beam.sensor)
    entity = layout.sensor_range(beam.sensor)
    canvas.prepare(entity, scene.set_up_sensor, beam.sensor, colour)
    nearest = float(beam.ranges_m[beam.saw_something].min(initial=np.inf))
    canvas.add(entity, columns.scalars, nearest if np.isfinite(nearest) else np.nan)


def _record(canvas: Canvas, beam: Beam, entity: str) -> None:
    """The same once more for the reader, exactly."""
    base, sensor = beam.world_from_base, beam.world_from_sensor
    numbers = {
        "world_from_base": np.array([base.x_m, base.y_m, base.heading_rad]),
        "world_from_sensor": np.array([sensor.x_m, sensor.y_m, sensor.heading_rad]),
        "bearings_rad": np.asarray(beam.bearings_rad, np.float64),
        "ranges_m": np.asarray(beam.ranges_m, np.float64),
        "width_rad_reach_m": np.append(beam.beam_width_rad, beam.reach_m),
    }
    record = BeamRecord(beam.sensor, beam.layer, numbers)
    size = sum(array.nbytes for array in numbers.values())
    canvas.add(entity, columns.beam_records, record, size)
