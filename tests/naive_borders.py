"""The obvious twin of the border tracer: walk along the cracks between black and white.

A crack is one side of one black cell whose other side is white. Going with black on the left, each
crack leads to exactly one other; the borders are the cycles of that map. Nothing here looks like
the tracer: no search around a cell, no marks, no rule of when to stop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Sides of a cell: the step to the neighbour across it. Walking with black on the left, one goes
# east along the south side, north along the east side, west along the north side, south along the
# west side: the side follows the walk.
SOUTH, EAST, NORTH, WEST = range(4)
_ACROSS = {SOUTH: (-1, 0), EAST: (0, 1), NORTH: (1, 0), WEST: (0, -1)}
_ALONG = {SOUTH: (0, 1), EAST: (1, 0), NORTH: (0, -1), WEST: (-1, 0)}

Cell = tuple[int, int]
Crack = tuple[Cell, int]


def naive_borders(occupied: NDArray[np.bool_]) -> list[list[Cell]]:
    """The cells of each border in the order of the walk, the first not repeated."""
    black = {(int(r), int(c)) for r, c in np.argwhere(occupied)}
    cracks = {
        ((r, c), side)
        for r, c in black
        for side, (dr, dc) in _ACROSS.items()
        if (r + dr, c + dc) not in black
    }
    borders = []
    while cracks:
        first = min(cracks)
        crack, walk = first, []
        while True:
            cracks.discard(crack)
            walk.append(crack[0])
            crack = _next(crack, black)
            if crack == first:
                break
        borders.append(_without_repeats(walk))
    return borders


def _next(crack: Crack, black: set[Cell]) -> Crack:
    (r, c), side = crack
    dr, dc = _ALONG[side]
    ar, ac = _ACROSS[side]
    # Black cells touch over corners too, so the one diagonally ahead on the white side comes first.
    if (r + dr + ar, c + dc + ac) in black:
        return (r + dr + ar, c + dc + ac), (side - 1) % 4
    if (r + dr, c + dc) in black:
        return (r + dr, c + dc), side
    return (r, c), (side + 1) % 4


def _without_repeats(walk: list[Cell]) -> list[Cell]:
    """Several cracks of one cell in a row are one visit, round the end too."""
    cells = [cell for k, cell in enumerate(walk) if cell != walk[k - 1]]
    return cells or walk[:1]


def started_at_least(cells: list[Cell]) -> tuple[Cell, ...]:
    """A closed sequence, started so that two sequences that differ only there become equal."""
    n = len(cells)
    starts = [k for k in range(n) if cells[k] == min(cells)]
    return min(tuple(cells[k:] + cells[:k]) for k in starts)
