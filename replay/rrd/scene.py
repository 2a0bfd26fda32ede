"""What never changes in a recording: frames, styles, colour tables, names, the true walls.

Logged once, without a time, when the grid and the layers are known. The viewer's plane has y down;
one mirrored frame at the root of the map turns it up, so that everything below it is in metres of
the map frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import rerun as rr

from mapping.artifacts import Started
from mapping.grid import GridGeometry
from replay.rrd import layout
from replay.rrd.axes import frame_of, set_up_axes, whole_frame
from replay.rrd.columns import image_format
from replay.rrd.explanation import MANUAL
from replay.rrd.layout import Colour, Place, Tiling
from replay.rrd.pictures import Named, percent_names
from replay.rrd.sink import Sink

_MARKDOWN = "text/markdown"

SetUp = Callable[..., None]  # of a sink, an entity, and how it looks


def set_up(sink: Sink, started: Started, config_text: str) -> None:
    """Everything that all layers share."""
    set_up_plane(sink)
    geometry = started.geometry
    frames = {frame.name: frame for frame in (frame_of(started), whole_frame(geometry))}
    for frame in frames.values():
        set_up_axes(sink, frame)
    where = np.array([*geometry.origin_m, geometry.resolution_m], np.float64)
    sink.log(layout.GRID, rr.AnyValues(
        where_m=where, shape=np.array(geometry.shape, np.int64), layers=list(started.layers),
        walls_m=started.walls_m.astype(np.float64).ravel(),
        tile_cells=np.array([tiling_for(geometry).side for tiling_for in layout.TILINGS], np.int64),
    ))  # fmt: skip
    if len(started.walls_m):
        walls = rr.LineStrips2D(
            started.walls_m, colors=[layout.WALL], radii=-1.5, draw_order=layout.ORDER_WALLS
        )
        sink.log(layout.WALLS, walls)
    sink.log(layout.ROBOT, rr.Arrows2D.from_fields(
        colors=[layout.ROBOT_COLOUR], radii=[-3.0], draw_order=layout.ORDER_ROBOT
    ))  # fmt: skip
    set_up_texts(sink, config_text)


def set_up_plane(sink: Sink) -> None:
    """The frame of the map, with y up."""
    sink.log(layout.MAP, rr.Transform3D(mat3x3=[[1, 0, 0], [0, -1, 0], [0, 0, 1]]))


def set_up_texts(sink: Sink, config_text: str) -> None:
    """What stands beside the maps: the explanations to come, the legend, the configuration."""
    set_up_markdown(sink, layout.EXPLANATION)
    sink.log(layout.MANUAL, rr.TextDocument(MANUAL, media_type=_MARKDOWN))
    sink.log(layout.CONFIG, rr.TextDocument(config_text, media_type="text/plain"))


def set_up_markdown(sink: Sink, entity: str) -> None:
    """That the texts of an entity are markdown."""
    sink.log(entity, rr.TextDocument.from_fields(media_type=_MARKDOWN))


def set_up_layer(sink: Sink, layer: str) -> None:
    """The styles of one layer's cells."""
    set_up_opaque(sink, layout.merged(layer), percent_names())
    set_up_above_threshold(sink, layout.thresholded(layer))


def set_up_above_threshold(sink: Sink, entity: str) -> None:
    """The style of the cells above the threshold, over the map."""
    occupied = [(0, "", (0, 0, 0, 0)), (1, "above the threshold", layout.OCCUPIED)]
    _colour_table(sink, entity, occupied)


def set_up_beam(sink: Sink, entity: str, colour: Colour) -> None:
    """The style of the outline of a beam."""
    _lines(sink, entity, colour, -1.5, layout.ORDER_BEAM)


def set_up_patches(sink: Sink, entity: str) -> None:
    """The style of pictures of the evidence of a reading, or what it changed."""
    look = rr.EncodedImage.from_fields(
        media_type="image/png", opacity=0.999, draw_order=layout.ORDER_PATCH
    )
    sink.log(entity, look)


def set_up_points(sink: Sink, entity: str, colour: Colour) -> None:
    """The style of obstacle points."""
    _dots(sink, entity, colour, -1.75, layout.ORDER_POINTS)


def set_up_path(sink: Sink, entity: str) -> None:
    """The style of where the robot was."""
    _dots(sink, entity, layout.PATH_COLOUR, -1.5, layout.ORDER_PATH)


def set_up_tile(sink: Sink, entity: str, tiling: Tiling, place: Place, order: float) -> None:
    """Place and size of one tile, so that its rows hold nothing but cells."""
    geometry, window = tiling.geometry, tiling.window(*place)
    corner = [*layout.corner_m(geometry, window), layout.plane_m(order)]
    scale = geometry.resolution_m * (1.0 - layout.TILE_SHRINKAGE)
    look = rr.SegmentationImage.from_fields(
        format=image_format((window.rows, window.cols)),
        opacity=1.0 if order in (layout.ORDER_CLASSES, layout.ORDER_TILES) else 0.999,
        draw_order=order,
    )
    where = rr.Transform3D(translation=corner, scale=scale)
    sink.log(entity, where, look)


def set_up_never_seen(sink: Sink, root: str, geometry: GridGeometry, number: int) -> None:
    """One large cell of class ``number`` below all tiles: tiles exist only where there is more."""
    entity = layout.never_seen(root)
    corner = [*geometry.origin_m, layout.plane_m(layout.ORDER_NEVER_SEEN)]
    where = rr.Transform3D(translation=corner, scale=[*geometry.size_m, 1.0])
    image = rr.SegmentationImage(
        np.full((1, 1), number, np.uint8), opacity=1.0, draw_order=layout.ORDER_NEVER_SEEN
    )
    sink.log(entity, where, image)


def set_up_borders(sink: Sink, entity: str) -> None:
    """The style of borders whose colour is logged with them; labels show where one points."""
    _labelled_lines(sink, entity, -1.0, layout.ORDER_BORDERS)


def set_up_segments(sink: Sink, entity: str) -> None:
    """The style of segments whose colour is logged with them."""
    _labelled_lines(sink, entity, -2.5, layout.ORDER_SEGMENTS)


def _labelled_lines(sink: Sink, entity: str, radius: float, order: float) -> None:
    style = rr.LineStrips2D.from_fields(radii=[radius], draw_order=order, show_labels=False)
    sink.log(entity, style)


def set_up_newest(sink: Sink, entity: str, colour: Colour) -> None:
    """The style of the border or segment that a step is about."""
    _lines(sink, entity, colour, -2.5, layout.ORDER_STAGES)


def set_up_kept_cells(sink: Sink, entity: str) -> None:
    """The style of a picture of the cells above the threshold that lie apart from the map."""
    set_up_above_threshold(sink, entity)
    look = rr.SegmentationImage.from_fields(opacity=0.999, draw_order=layout.ORDER_THRESHOLDED)
    sink.log(entity, look)


def set_up_two_classes(sink: Sink, root: str, first: str, second: str) -> None:
    """Names of the cells of a black and white picture: the first are light, the second dark."""
    set_up_opaque(sink, root, [(0, first, layout.PAPER), (1, second, layout.INK)])


def set_up_strips(sink: Sink, entity: str, colour: Colour) -> None:
    """The style of what is shown on the way to borders and lines."""
    _lines(sink, entity, colour, -2.0, layout.ORDER_STAGES)


def set_up_places(sink: Sink, entity: str) -> None:
    """The style of the places of note among it."""
    _dots(sink, entity, layout.STAGE_PLACE, -3.0, layout.ORDER_STAGES + 0.5)


def set_up_extra(sink: Sink, entity: str, name: str) -> None:
    """The name of a further array, as it was given."""
    sink.log(entity, rr.AnyValues(name=name))


def set_up_sensor(sink: Sink, entity: str, name: str, colour: Colour) -> None:
    """The name and colour of one sensor's line in the plot of ranges."""
    sink.log(entity, rr.SeriesLines(names=[name], colors=[colour], widths=[1.5]))
    sink.log(entity, rr.SeriesPoints(names=[name], colors=[colour], marker_sizes=[3]))


def set_up_classes(sink: Sink, _: str, names: Sequence[str]) -> None:
    """Names and colours of the class map."""
    colours = layout.class_colours(names)
    named = [(number, name, colours[name][0]) for number, name in enumerate(names)]
    set_up_opaque(sink, layout.CLASSES, named)
    sink.log(layout.CLASSES, rr.AnyValues(names=list(names)))


def set_up_opaque(sink: Sink, entity: str, named: Sequence[Named]) -> None:
    """Names and colours of a grid's numbers, all opaque.

    One colour that is not, even of a number that no cell has, and the viewer draws it all as
    transparent (see :mod:`replay.rrd.layout`); so each byte gets one.
    """
    known = {number for number, _, _ in named}
    others = [(number, "", layout.NEVER_SEEN) for number in range(256) if number not in known]
    _colour_table(sink, entity, [*named, *others])


def _colour_table(sink: Sink, entity: str, named: Sequence[Named]) -> None:
    sink.log(entity, _annotations(tuple(named)))


@lru_cache(maxsize=64)
def _annotations(named: tuple[Named, ...]) -> rr.AnnotationContext:
    """Layers share their tables, and one takes milliseconds to put together."""
    return rr.AnnotationContext([_annotation(*each) for each in named])


@lru_cache(maxsize=4096)
def _annotation(number: int, name: str, colour: Colour) -> rr.AnnotationInfo:
    return rr.AnnotationInfo(number, name, colour)


def _dots(sink: Sink, entity: str, colour: Colour, radius: float, order: float) -> None:
    """A style of points; a negative radius is in points of the screen."""
    sink.log(entity, rr.Points2D.from_fields(colors=[colour], radii=[radius], draw_order=order))


def _lines(sink: Sink, entity: str, colour: Colour, radius: float, order: float) -> None:
    """A style of line strips; a negative radius is in points of the screen."""
    style = rr.LineStrips2D.from_fields(colors=[colour], radii=[radius], draw_order=order)
    sink.log(entity, style)
