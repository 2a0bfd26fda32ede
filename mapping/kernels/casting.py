"""How far a beam would get in a map: the nearest occupied cell that it meets.

Places are in units of cells, relative to the outer corner of cell (0, 0), so that cell (row, col)
covers col .. col + 1 and row .. row + 1. Distances are in cells as well, to the centre of the cell
met; +Inf where none is.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]

HALF_DIAGONAL = math.sqrt(0.5) + 1e-9  # of a cell: an axis that touches it passes this close
_TOLERANCE_RAD = 1e-10


@njit(cache=True, error_model="numpy")
def nearest_in_cone(
    occupied: Flags, x: float, y: float, heading_rad: float, half_width_rad: float, reach: float
) -> float:
    """The nearest occupied cell whose centre lies in the cone, up to ``reach``; or +Inf.

    A centre within half a cell's diagonal of the axis counts as well, so that a thin beam slips
    through no wall.
    """
    rows, cols = occupied.shape
    cos_heading, sin_heading = math.cos(heading_rad), math.sin(heading_rad)
    best_squared = reach * reach
    found = False
    first_row, last_row = max(math.floor(y - reach), 0), min(int(y + reach) + 1, rows)
    first_col, last_col = max(math.floor(x - reach), 0), min(int(x + reach) + 1, cols)
    for row in range(first_row, last_row):
        dy = row + 0.5 - y
        if dy * dy > best_squared:
            continue
        for col in range(first_col, last_col):
            if not occupied[row, col]:
                continue
            dx = col + 0.5 - x
            squared = dx * dx + dy * dy
            if squared > best_squared:
                continue
            along = dx * cos_heading + dy * sin_heading
            across = abs(dy * cos_heading - dx * sin_heading)
            beside = along > 0.0 and across <= HALF_DIAGONAL
            if beside or math.atan2(across, along) <= half_width_rad + _TOLERANCE_RAD:
                best_squared = squared
                found = True
    return math.sqrt(best_squared) if found else math.inf


@njit(cache=True, error_model="numpy")
def nearest_on_rays(
    occupied: Flags, x: float, y: float, headings_rad: Floats, reach: float
) -> Floats:
    """The first occupied cell that each ray passes through, (N,), up to ``reach``; or +Inf.

    The rays walk from cell to cell (Amanatides and Woo, 1987). Where one passes exactly through a
    corner it takes the step along x first.
    """
    rows, cols = occupied.shape
    ranges = np.full(headings_rad.size, math.inf)
    for k in range(headings_rad.size):
        c, s = math.cos(headings_rad[k]), math.sin(headings_rad[k])
        col, row = math.floor(x), math.floor(y)
        step_col, step_row = (1 if c > 0.0 else -1), (1 if s > 0.0 else -1)
        # How far along the ray the next cell begins, across a column's edge and across a row's.
        to_col = ((col + (step_col > 0)) - x) / c if c != 0.0 else math.inf
        to_row = ((row + (step_row > 0)) - y) / s if s != 0.0 else math.inf
        per_col = abs(1.0 / c) if c != 0.0 else math.inf
        per_row = abs(1.0 / s) if s != 0.0 else math.inf
        entered = 0.0
        while entered <= reach:
            if 0 <= row < rows and 0 <= col < cols and occupied[row, col]:
                ranges[k] = math.hypot(col + 0.5 - x, row + 0.5 - y)
                break
            if to_col <= to_row:
                entered, to_col, col = to_col, to_col + per_col, col + step_col
            else:
                entered, to_row, row = to_row, to_row + per_row, row + step_row
    return ranges
