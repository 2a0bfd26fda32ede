"""From a grid to closed borders: threshold, then follow the edge of everything that is occupied.

Occupied cells hang together over their eight neighbours, free ones over four, and what lies outside
the grid is free. So a grid has one border for each occupied component and one for each hole in
one. In the map frame (y up) outer borders run counter-clockwise and those of holes clockwise: what
is free lies on the right. A border may pass a cell more than once, where a wall is one cell thick.

The following is the chapter's: search counter-clockwise around the cell, starting behind the way
one came. Its two rules of when to start and when to stop miss parts of one-cell walls and of
figures that touch themselves; ``tracer="chapter"`` keeps them to be looked at. The default stops
when the first *move* comes again, and starts at every border crack that no border holds yet.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Thresholded, TracerStep
from mapping.config import BordersSection
from mapping.grid import Layer, read_only

Tracer = Literal["closed", "chapter"]

# Row and column steps of the directions 0 .. 7: counter-clockwise from east, rows grow upwards.
DIRECTIONS = ((0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1))


@dataclass(frozen=True, slots=True)
class TracedBorder:
    """``cells`` (N, 2) as row, col in trace order, the first not repeated at the end."""

    outer: bool
    cells: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class WalkStep:
    """One step of the tracer: at ``cell``, the directions tried in turn, and where it goes.

    ``tried`` ends with the direction taken, unless the cell is single (then ``following`` is None).
    """

    cell: tuple[int, int]
    tried: tuple[int, ...]
    following: tuple[int, int] | None


def threshold_layer(layer: Layer, threshold: float) -> Thresholded:
    """Which cells of a layer are occupied: seen, and their probability above the threshold.

    A cell that no reading ever touched is never occupied, whatever stands for the unknown. The
    threshold is as the layer's own float32 sees it, so that 0.55 is not above 0.55.
    """
    occupied = layer.observed & (layer.probability > np.float32(threshold))  # NaN is not above
    read_only(occupied)
    return Thresholded(layer.name, layer.geometry, threshold, occupied)


def trace_borders(occupied: NDArray[np.bool_], *, tracer: Tracer = "closed") -> list[TracedBorder]:
    """All borders of a grid (rows, cols), row 0 lowest, in the order of a scan from the top left.

    Each starts at the first of its cells that the scan meets with a free cell to the west.
    """
    from mapping.kernels.loops import chapter_borders, closed_borders

    kernel = closed_borders if tracer == "closed" else chapter_borders
    grid = np.ascontiguousarray(occupied, np.bool_)
    if grid.ndim != 2:
        raise ValueError(f"a grid has two dimensions, not {grid.ndim}")
    filled = grid.any(axis=1)
    if not filled.any():
        return []
    cells, ends, outer = kernel(grid.view(np.uint8), filled.view(np.uint8))
    read_only(cells)
    starts = [0, *ends][: len(ends)]
    return [
        TracedBorder(is_outer, cells[start:end])
        for start, end, is_outer in zip(starts, ends, outer, strict=True)
    ]


def find_borders(thresholded: Thresholded, config: BordersSection) -> list[Border]:
    """The borders of a thresholded layer, numbered from 0 in scan order."""
    traced = trace_borders(thresholded.occupied, tracer=config.tracer)
    return [
        Border(thresholded.layer, number, border.outer, thresholded.geometry, border.cells)
        for number, border in enumerate(traced)
    ]


def walk_border(occupied: NDArray[np.bool_], border: TracedBorder) -> Iterator[WalkStep]:
    """The tracer's walk along one border, search by search, to be shown as steps.

    One step for each cell of ``border.cells``, and the same cells in the same order.
    """
    search = 5  # the first cell was met from its free west: as if entered in direction 7
    for row, col in border.cells.tolist():
        tried: list[int] = []
        following = None
        for turn in range(8):
            direction = (search + turn) % 8
            tried.append(direction)
            there = (row + DIRECTIONS[direction][0], col + DIRECTIONS[direction][1])
            if _is_occupied(occupied, there):
                following = there
                break
        yield WalkStep((row, col), tuple(tried), following)
        search = (tried[-1] + (7 if tried[-1] % 2 == 0 else 6)) % 8


def tracer_steps(
    thresholded: Thresholded, borders: list[Border], most: int
) -> Iterator[TracerStep]:
    """The walk along the longest border, up to ``most`` steps, to be shown."""
    if not borders or most <= 0:
        return
    border = max(borders, key=lambda one: len(one.cells))
    walk = walk_border(thresholded.occupied, TracedBorder(border.outer, border.cells))
    for number, step in enumerate(itertools.islice(walk, most), 1):
        tried = np.array([DIRECTIONS[direction] for direction in step.tried], np.int64)
        tried += np.array(step.cell, np.int64)
        yield TracerStep(
            border.layer, border.number, border.geometry, border.cells[:number], tried,
            step.following,
        )  # fmt: skip


def _is_occupied(occupied: NDArray[np.bool_], cell: tuple[int, int]) -> bool:
    row, col = cell
    inside = 0 <= row < occupied.shape[0] and 0 <= col < occupied.shape[1]
    return inside and bool(occupied[row, col])
