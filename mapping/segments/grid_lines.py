"""Lines from the borders of a grid.

A border runs through the centres of cells that lie inside what is solid, so every line comes out
half a cell too deep; along a line that runs askew the steps of the border eat a part of that. Lines
are therefore moved towards the free side, the right of the trace, by half a cell times the larger
of the two components of their direction. What the border of a wall shows twice is kept once: pieces
in one line are joined across borders, and the two faces of a thin wall become its centre line.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment
from mapping.config import SegmentsSection
from mapping.grid import GridGeometry
from mapping.segments.chains import joined
from mapping.segments.free_space import cut_where_free, grown
from mapping.segments.joining import merge_collinear, pair_faces
from mapping.segments.least_squares import (
    FittedLine,
    FloatArray,
    segment_of,
    variances_from_residuals,
)
from mapping.segments.methods import line_method
from mapping.segments.runs import meet_at_corners
from mapping.segments.stages import Observer

# A digital straight line stays within a cell of its chord; a ragged one within two.
EPSILON_CELLS = 2.0
PIECE_CELLS = 5.0
# A border that is straight by chance is still known no better than this share of epsilon a cell.
# Neighbouring cells err together, so that covariances of grid lines are on the sure side.
_LEAST_SHARE = 1.0 / 6.0
# Free cells this near count as seen from: a band's edge is ragged.
_SEEN_WITHIN_CELLS = 3.0


def segments_from_borders(
    borders: list[Border],
    config: SegmentsSection,
    *,
    observed: NDArray[np.bool_] | None = None,
    reachable: NDArray[np.bool_] | None = None,
    observe: Observer | None = None,
) -> list[Segment]:
    """Lines along the borders of one layer, each wall once, in the map frame.

    ``observed`` (rows, cols): border cells outside of it make no lines. ``reachable`` (rows, cols),
    of :func:`mapping.segments.free_space.reachable_cells`: nor do border cells without such a free
    cell beside them, which are echoes that seem to lie behind walls. The back of a thin wall,
    though, still shows where its centre is.
    ``border`` of a segment is the number of the border that gave most of it.
    """
    if not borders:
        return []
    geometry = borders[0].geometry
    scaled = scaled_to_cells(config, geometry.resolution_m)
    method = line_method(config.method)
    lines: dict[bool, list[FittedLine]] = {True: [], False: []}  # by whether they count
    owners: list[tuple[FittedLine, int]] = []
    pieces = for_pieces(scaled, geometry.resolution_m)
    supported = _supported_cells(geometry, observed, reachable)
    for border in borders:
        for counts, parts in _parts(border, supported, scaled).items():
            found = method.lines(joined(parts), pieces, observe if counts else None)
            moved = [_towards_free_side(line, geometry.resolution_m) for line in found]
            lines[counts] += moved
            owners += [(line, border.number) for line in moved if counts]
    found = lines[True]
    if config.merge != "none":
        faces = merge_collinear(found, scaled, observe, same_side=True)
        backs = merge_collinear(lines[False], scaled, same_side=True)
        thickness = max(config.wall_m, 2.5 * geometry.resolution_m)
        found = pair_faces(faces, backs, thickness)
        found = merge_collinear(found, scaled, observe)
        found = meet_at_corners(found, scaled, observe)
    if reachable is not None:
        solid = np.zeros(geometry.shape, np.bool_)
        for border in borders:
            solid[border.cells[:, 0], border.cells[:, 1]] = True
        found = cut_where_free(found, solid, reachable, geometry)
    return as_segments(found, borders[0].layer, scaled, owners)


def scaled_to_cells(config: SegmentsSection, resolution_m: float) -> SegmentsSection:
    """The configuration with epsilon no finer than the cells allow."""
    epsilon = max(config.epsilon_m, EPSILON_CELLS * resolution_m)
    return config.model_copy(update={"epsilon_m": epsilon})


def for_pieces(config: SegmentsSection, resolution_m: float) -> SegmentsSection:
    """Short pieces pass for now: together, across gaps and borders, they may become a wall."""
    return config.model_copy(
        update={
            "min_length_m": min(PIECE_CELLS * resolution_m, config.min_length_m),
            "min_points": min(3, config.min_points),
        }
    )


def as_segments(
    lines: list[FittedLine],
    layer: str,
    config: SegmentsSection,
    owners: list[tuple[FittedLine, int]],
) -> list[Segment]:
    """The artifacts, the longest first; a line belongs to the owner that it lies closest to."""
    numbers = np.array([number for _, number in owners])
    middles = np.array([(line.start_m + line.end_m) / 2.0 for line, _ in owners])
    segments = []
    for line in sorted(lines, key=lambda one: -one.length_m):
        if line.length_m < config.min_length_m or len(line.points_m) < config.min_points:
            continue
        border = None
        if len(owners):
            border = int(numbers[np.hypot(*(middles - (line.start_m + line.end_m) / 2).T).argmin()])
        variances = variances_from_residuals(line, _LEAST_SHARE * config.epsilon_m)
        segments.append(
            segment_of(line, layer=layer, source="grid", border=border, variances_m2=variances)
        )
    return segments


def _supported_cells(
    geometry: GridGeometry,
    observed: NDArray[np.bool_] | None,
    reachable: NDArray[np.bool_] | None,
) -> NDArray[np.bool_] | None:
    if observed is None and reachable is None:
        return None
    supported = np.ones(geometry.shape, np.bool_)
    if observed is not None:
        supported &= observed
    if reachable is not None:
        supported &= grown(
            reachable, _SEEN_WITHIN_CELLS * geometry.resolution_m, geometry.resolution_m
        )
    return supported


def _parts(
    border: Border, supported: NDArray[np.bool_] | None, config: SegmentsSection
) -> dict[bool, list[tuple[FloatArray, bool]]]:
    """The whole border as a closed polyline, or the runs of it that count and that do not."""
    points = border.geometry.centres_of(border.cells)
    closed = config.wrap != "off"
    good = np.ones(len(points), np.bool_)
    if supported is not None:
        good = supported[border.cells[:, 0], border.cells[:, 1]]
    if len(points) < 2:
        return {}
    if good.all() or not good.any():
        return {bool(good[0]): [(points, closed)]}
    start = int(np.flatnonzero(good != np.roll(good, 1))[0])  # no run goes over the end
    good, points = np.roll(good, -start), np.roll(points, -start, axis=0)
    cuts = np.flatnonzero(np.diff(good.astype(np.int8))) + 1
    parts: dict[bool, list[tuple[FloatArray, bool]]] = {True: [], False: []}
    for run, counts in zip(np.split(points, cuts), good[[0, *cuts]], strict=True):
        if len(run) > 1:
            parts[bool(counts)].append((run, False))
    return parts


def _towards_free_side(line: FittedLine, resolution_m: float) -> FittedLine:
    """Half a cell to the right of the trace, less where the line runs askew."""
    shift = -line.normal * (0.5 * resolution_m * float(np.abs(line.along).max()))
    return replace(
        line,
        points_m=line.points_m + shift,
        centre_m=line.centre_m + shift,
        start_m=line.start_m + shift,
        end_m=line.end_m + shift,
        corners=(False, False),  # where they meet has moved too
    )
