"""Thinning a figure to its centre line, one cell thick, by Zhang and Suen (1984)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_ROW_STEP = np.array([1, 1, 0, -1, -1, -1, 0, 1], np.int64)  # north, then clockwise
_COL_STEP = np.array([0, 1, 1, 1, 0, -1, -1, -1], np.int64)


@njit(cache=True)
def _goes(cells: NDArray[np.bool_], row: int, col: int, second: bool) -> bool:
    """Whether a cell may be taken off the edge without cutting the figure or shortening a line."""
    black = changes = 0
    for k in range(8):
        here = cells[row + _ROW_STEP[k], col + _COL_STEP[k]]
        ahead = cells[row + _ROW_STEP[(k + 1) & 7], col + _COL_STEP[(k + 1) & 7]]
        black += here
        changes += (not here) and ahead
    if black < 2 or black > 6 or changes != 1:
        return False
    north, east = cells[row + 1, col], cells[row, col + 1]
    south, west = cells[row - 1, col], cells[row, col - 1]
    if second:
        return not (north and east and west) and not (north and south and west)
    return not (north and east and south) and not (east and south and west)


@njit(cache=True)
def thin(padded: NDArray[np.bool_]) -> None:
    """Thin a figure (rows, cols) in place; its outermost rows and columns must be free.

    Every pass looks only at the cells that were left, so that the whole takes as many steps as the
    figure has cells, times half its thickness.
    """
    left = np.argwhere(padded)
    going = np.empty(len(left), np.int64)
    kept = len(left)
    changed = True
    while changed:
        changed = False
        for second in (False, True):
            n = 0
            for i in range(kept):
                if _goes(padded, left[i, 0], left[i, 1], second):
                    going[n] = i
                    n += 1
            for i in range(n):
                padded[left[going[i], 0], left[going[i], 1]] = False
            if n:
                changed = True
                m = 0
                for i in range(kept):
                    if padded[left[i, 0], left[i, 1]]:
                        left[m, 0], left[m, 1] = left[i, 0], left[i, 1]
                        m += 1
                kept = m
