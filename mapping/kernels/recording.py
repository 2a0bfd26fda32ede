"""What a recording draws and states of each reading: one pass over its window instead of many."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.uint8]


@njit(cache=True, error_model="numpy", nogil=True)
def take(
    all_cells: NDArray[Any], cells: NDArray[Any], row0: int, col0: int, side: int,
    tile_differs: Flags,
) -> None:  # fmt: skip
    """Write a window's new numbers over those of the grid, whose first cell there is (row0, col0).

    Marks the tiles of ``side`` cells in which one became another.
    """
    rows, cols = cells.shape
    for row in range(rows):
        start = 0
        while start < cols:
            tile = (col0 + start) // side
            end = min(cols, (tile + 1) * side - col0)
            differs = False
            for col in range(start, end):
                new = cells[row, col]
                differs |= all_cells[row0 + row, col0 + col] != new
                all_cells[row0 + row, col0 + col] = new
            if differs:
                tile_differs[(row0 + row) // side, tile] = True
            start = end


@njit(cache=True, error_model="numpy", nogil=True)
def shade(
    probability: Singles, observed: Flags, shades: Bytes, drawn: Bytes, row0: int, col0: int,
    side: int, unseen: int, slack: float, tile_is_off: Flags,
) -> None:  # fmt: skip
    """Write the per cent of a window's cells, to the nearest even one, into the grid's ``shades``.

    ``unseen`` where a cell is not ``observed``. Marks the tiles of ``side`` cells of which one cell
    is ``drawn`` by more than ``slack`` points off its true per cent, or seen where it was not.
    """
    rows, cols = probability.shape
    for row in range(rows):
        tile_row = (row0 + row) // side
        for col in range(cols):
            if not observed[row0 + row, col0 + col]:
                continue
            p = probability[row, col]
            shades[row0 + row, col0 + col] = 2 * np.uint8(np.rint(p * np.float32(50.0)))
            before = drawn[row0 + row, col0 + col]
            if before == unseen or abs(np.float32(100.0) * p - before) > slack:
                tile_is_off[tile_row, (col0 + col) // side] = True


@njit(cache=True, error_model="numpy", nogil=True)
def strength_classes(difference: NDArray[Any], marked: Flags, edges: NDArray[Any]) -> Bytes:
    """How many edges a difference (N,) reaches, as many more where it is positive; else 0.

    The edges are of the same type as the differences.
    """
    classes = np.zeros(difference.size, np.uint8)
    for k in range(difference.size):
        if not marked[k]:
            continue
        level, strength = 0, abs(difference[k])
        for edge in edges:
            level += strength >= edge
        classes[k] = level + (edges.size if difference[k] > 0 else 0)
    return classes


@njit(cache=True, error_model="numpy", nogil=True)
def packed_rows(classes: Bytes, side: int) -> Bytes:
    """Numbers below 16 (rows, cols) as the rows of a PNG of ``side`` cells: two in a byte.

    Each row begins with a 0: it is not coded by the one before. Cells without numbers are 0.
    """
    rows, cols = classes.shape
    packed = np.zeros((side, 1 + (side + 1) // 2), np.uint8)
    for row in range(rows):
        for col in range(0, cols - 1, 2):
            packed[row, 1 + col // 2] = classes[row, col] << 4 | classes[row, col + 1]
        if cols % 2:
            packed[row, 1 + cols // 2] = classes[row, cols - 1] << 4
    return packed


@njit(cache=True, error_model="numpy", nogil=True)
def evidence_of(
    probability: Floats, free: Flags, band: Flags
) -> tuple[int, float, int, float]:  # fmt: skip
    """Cells in the band and the highest probability there; those in front, and the lowest."""
    in_band = in_front = 0
    most, least = 0.0, 1.0
    rows, cols = probability.shape
    for row in range(rows):
        for col in range(cols):
            if band[row, col]:
                in_band += 1
                most = max(most, probability[row, col])
            if free[row, col]:
                in_front += 1
                least = min(least, probability[row, col])
    return in_band, most, in_front, least


@njit(cache=True, error_model="numpy", nogil=True)
def changes_of(before: Singles, after: Singles) -> tuple[int, int, int, int, int, int]:
    """How many cells (N,) changed, became more occupied, more free; which changed most, the first.

    Then how many are above a half now, and below.
    """
    changed = occupied = free = above = below = 0
    most, largest = 0, np.float32(-1.0)
    for k in range(after.size):
        now = after[k]
        above += now > 0.5
        below += now < 0.5
        if now == before[k]:
            continue
        changed += 1
        difference = now - before[k]
        occupied += difference > 0
        free += difference < 0
        if abs(difference) > largest:
            most, largest = k, abs(difference)
    return changed, occupied, free, most, above, below
