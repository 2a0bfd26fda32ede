"""Lines along the centre of what is occupied: a band of any thickness gives one line.

The figure is thinned to one cell, and the borders of that are followed as any others: both sides of
a line one cell thick run through the same cells and become one line. Where a band ends or bends,
thinning grows whiskers towards its corners; a line no longer than its band is thick is one of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment, Thresholded
from mapping.borders import trace_borders
from mapping.config import SegmentsSection
from mapping.grid import GridGeometry
from mapping.segments.chains import joined
from mapping.segments.free_space import cut_where_free
from mapping.segments.grid_lines import (
    as_segments,
    for_pieces,
    scaled_to_cells,
    segments_from_borders,
)
from mapping.segments.joining import merge_collinear
from mapping.segments.least_squares import FittedLine, FloatArray
from mapping.segments.methods import line_method
from mapping.segments.runs import meet_at_corners
from mapping.segments.stages import Observer

Cells = NDArray[np.bool_]
# The centre of a band that borders on what the robot saw lies half of its thickness away from it;
# so much more, and two cells, is forgiven where the band is uneven.
_UNEVEN = 1.25
_UNEVEN_CELLS = 2.0
_SEEN_SHARE = 0.5


def segments_from_ridge(
    thresholded: Thresholded,
    config: SegmentsSection,
    *,
    observed: Cells | None = None,
    reachable: Cells | None = None,
    observe: Observer | None = None,
) -> list[Segment]:
    """Lines along the centre lines of a layer's occupied bands, in the map frame.

    ``observed`` (rows, cols): only what is occupied inside of it counts. ``reachable`` (rows,
    cols), of :func:`mapping.segments.free_space.reachable_cells`: only bands beside those.
    """
    geometry = thresholded.geometry
    occupied = thresholded.occupied.copy()
    if observed is not None:
        occupied &= observed
    depth = _depth_cells(occupied)
    ridge = thinned(occupied)
    scaled = scaled_to_cells(config, geometry.resolution_m)
    method = line_method(config.method)
    lines: list[FittedLine] = []
    for border in trace_borders(ridge):
        if len(border.cells) > 1:
            points = geometry.centres_of(border.cells)
            chains = joined([(points, config.wrap != "off")])
            lines += method.lines(chains, for_pieces(scaled, geometry.resolution_m), observe)
    if config.merge != "none":
        # Up one side of the line and down the other: the same cells twice.
        lines = merge_collinear(lines, scaled, observe)
    lines = _without_whiskers(lines, geometry, depth)
    if reachable is not None:
        lines = _beside(reachable, lines, geometry, depth)
    lines = meet_at_corners(lines, scaled, observe)
    if reachable is not None:
        lines = cut_where_free(lines, occupied, reachable, geometry)
    return as_segments(lines, thresholded.layer, scaled, [])


def segments_from_grid(
    thresholded: Thresholded,
    borders: list[Border],
    config: SegmentsSection,
    *,
    lidar: bool = False,
    observed: Cells | None = None,
    reachable: Cells | None = None,
    observe: Observer | None = None,
) -> list[Segment]:
    """Lines of one layer by the source that the configuration names: its borders or its ridges.

    ``auto`` is the one that scores better on rooms with known walls: a lidar's band begins before
    the wall by its range error, so that in a hall of 14 x 9 m at 5 cm, with 1 cm of noise, its
    borders run 8 cm from the wall and its ridges 2.5 cm (medians). Of a ``lidar``, all readings of
    the layer are a laser's.
    """
    if config.source == "ridge" or (config.source == "auto" and lidar):
        return segments_from_ridge(
            thresholded, config, observed=observed, reachable=reachable, observe=observe
        )
    return segments_from_borders(
        borders, config, observed=observed, reachable=reachable, observe=observe
    )


def thinned(occupied: Cells) -> Cells:
    """The figure (rows, cols) thinned to lines one cell thick."""
    from mapping.kernels.loops import thin

    padded = np.pad(occupied, 1)
    thin(padded)
    inner: Cells = padded[1:-1, 1:-1].copy()
    return inner


def _depth_cells(occupied: Cells) -> FloatArray:
    """How far each cell (rows, cols) lies from the nearest free one; beyond the grid is free."""
    from mapping.kernels.loops import distances

    depth: FloatArray = distances(~np.pad(occupied, 1))[1:-1, 1:-1]
    return depth


def _without_whiskers(
    lines: list[FittedLine], geometry: GridGeometry, depth: FloatArray
) -> list[FittedLine]:
    """Leave out lines no longer than the thickness of the band that they run in."""

    def thickness_cells(line: FittedLine) -> float:
        rows, cols = _cells_along(line, geometry)
        return 2.0 * float(depth[rows, cols].mean()) if len(rows) else 0.0

    size = geometry.resolution_m
    return [line for line in lines if line.length_m > thickness_cells(line) * size]


def _beside(
    reachable: Cells, lines: list[FittedLine], geometry: GridGeometry, depth: FloatArray
) -> list[FittedLine]:
    """Lines most of whose band borders on what the robot saw."""
    from mapping.kernels.loops import distances

    if not reachable.any():
        return []
    near = distances(reachable) <= _UNEVEN * depth + _UNEVEN_CELLS
    places = [(line, _cells_along(line, geometry)) for line in lines]
    return [line for line, at in places if len(at[0]) and near[at].mean() >= _SEEN_SHARE]


def _cells_along(
    line: FittedLine, geometry: GridGeometry
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the cells that hold a line's points."""
    cells = geometry.cells_of(line.points_m)
    rows, cols = cells[geometry.contains(cells)].T
    return rows, cols
