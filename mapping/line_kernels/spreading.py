"""From some cells of a grid to all others: how far they lie, and which of them hang together."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Cells = NDArray[np.bool_]


@njit(cache=True, error_model="numpy")
def distances(cells: Cells) -> NDArray[np.float64]:
    """Of each cell (rows, cols) to the nearest of ``cells``, in cells; inf where there are none.

    Exact, in two passes: along the columns, then along each row over the lower envelope of the
    parabolas that the first pass left there. Meijster, Roerdink and Hesselink (2000).
    """
    rows, cols = cells.shape
    none = rows + cols  # further than anything can be
    down = np.empty((rows, cols), np.int64)
    for row in range(rows):
        for col in range(cols):
            above = down[row - 1, col] + 1 if row > 0 else none
            down[row, col] = 0 if cells[row, col] else min(above, none)
    for row in range(rows - 2, -1, -1):
        for col in range(cols):
            down[row, col] = min(down[row, col], down[row + 1, col] + 1)
    nearest = np.empty((rows, cols))
    at, begins, own = np.empty(cols, np.int64), np.empty(cols, np.int64), np.empty(cols, np.int64)
    for row in range(rows):
        top = -1  # of the parabolas on the envelope: where they stand, and from where on they lead
        for col in range(cols):
            own[col] = down[row, col] * down[row, col]
            begin = 0
            while top >= 0:
                k = at[top]
                # From where on the new one is lower: rounded up, as a tie leaves the old one.
                begin = (col * col - k * k + own[col] - own[k]) // (2 * (col - k)) + 1
                if begin > begins[top]:
                    break
                top -= 1
                begin = 0
            if begin < cols:
                top += 1
                at[top], begins[top] = col, begin
        for col in range(cols - 1, -1, -1):
            while begins[top] > col:
                top -= 1
            found = (col - at[top]) ** 2 + own[at[top]]
            nearest[row, col] = np.sqrt(found) if found < none * none else np.inf
    return nearest


@njit(cache=True, error_model="numpy")
def spread(cells: Cells, first: Cells) -> Cells:
    """Those of ``cells`` (rows, cols) that hang together, also by corners, with one in ``first``.

    ``first`` are some of ``cells``.
    """
    rows, cols = cells.shape
    reached = first & cells
    waiting = np.empty(rows * cols, np.int64)
    count = 0
    for row in range(rows):
        for col in range(cols):
            if reached[row, col]:
                waiting[count] = row * cols + col
                count += 1
    while count > 0:
        count -= 1
        row, col = waiting[count] // cols, waiting[count] % cols
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(col - 1, 0), min(col + 2, cols)):
                if cells[r, c] and not reached[r, c]:
                    reached[r, c] = True
                    waiting[count] = r * cols + c
                    count += 1
    return reached
