"""Which cells a sensor could have seen between known walls.

Places are in units of cells, relative to the outer corner of cell (0, 0), so that cell (row, col)
covers col .. col + 1 and row .. row + 1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def mark_walls(walls: Flags, ends: Floats) -> None:
    """Mark all cells that straight pieces (K, 4: x0, y0, x1, y1) pass through.

    Each is walked from cell to cell (Amanatides and Woo, 1987), so that no diagonal step leaves a
    gap; what lies outside the grid is left out.
    """
    rows, cols = walls.shape
    for k in range(ends.shape[0]):
        x, y = ends[k, 0], ends[k, 1]
        way_x, way_y = ends[k, 2] - x, ends[k, 3] - y
        col, row = math.floor(x), math.floor(y)
        last_col, last_row = math.floor(ends[k, 2]), math.floor(ends[k, 3])
        step_col, step_row = (1 if way_x > 0.0 else -1), (1 if way_y > 0.0 else -1)
        to_col = ((col + (step_col > 0)) - x) / way_x if way_x != 0.0 else math.inf
        to_row = ((row + (step_row > 0)) - y) / way_y if way_y != 0.0 else math.inf
        for _ in range(abs(last_col - col) + abs(last_row - row) + 1):
            if 0 <= row < rows and 0 <= col < cols:
                walls[row, col] = True
            if to_col <= to_row:
                to_col += abs(1.0 / way_x) if way_x != 0.0 else math.inf
                col += step_col
            else:
                to_row += abs(1.0 / way_y) if way_y != 0.0 else math.inf
                row += step_row


@njit(cache=True, error_model="numpy")
def mark_seen(seen: Flags, walls: Flags, beams: Floats) -> None:
    """Mark the cells that beams reach, the first cell of a wall on each way included.

    ``beams`` (N, 5) hold x, y, heading, half the width (rad) and the reach of each. A beam is a fan
    of rays, less than a cell apart at its reach, each walked from cell to cell.
    """
    rows, cols = walls.shape
    for k in range(beams.shape[0]):
        x, y, heading_rad, half_rad, reach = beams[k]
        count = max(math.ceil(2.0 * half_rad * reach), 1) + 1
        for ray in range(count):
            angle = heading_rad + half_rad * (2.0 * ray / (count - 1) - 1.0)
            c, s = math.cos(angle), math.sin(angle)
            col, row = math.floor(x), math.floor(y)
            step_col, step_row = (1 if c > 0.0 else -1), (1 if s > 0.0 else -1)
            to_col = ((col + (step_col > 0)) - x) / c if c != 0.0 else math.inf
            to_row = ((row + (step_row > 0)) - y) / s if s != 0.0 else math.inf
            per_col = abs(1.0 / c) if c != 0.0 else math.inf
            per_row = abs(1.0 / s) if s != 0.0 else math.inf
            entered = 0.0
            while entered <= reach:
                if 0 <= row < rows and 0 <= col < cols:
                    seen[row, col] = True
                    if walls[row, col]:
                        break
                if to_col <= to_row:
                    entered, to_col, col = to_col, to_col + per_col, col + step_col
                else:
                    entered, to_row, row = to_row, to_row + per_row, row + step_row
