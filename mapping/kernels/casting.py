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
def _box_of_cone(heading_rad: float, half_width_rad: float) -> tuple[float, float, float, float]:
    """Lowest and highest x, lowest and highest y of a cone of length 1 with its tip at (0, 0)."""
    quarter, high = math.pi / 2.0, heading_rad + half_width_rad
    angle = heading_rad - half_width_rad
    axis = math.ceil(angle / quarter)
    left = right = down = up = 0.0
    while True:  # one edge, each axis direction that lies between, the other edge
        left, right = min(left, math.cos(angle)), max(right, math.cos(angle))
        down, up = min(down, math.sin(angle)), max(up, math.sin(angle))
        if angle >= high:
            return left, right, down, up
        angle = min(axis * quarter, high)
        axis += 1


@njit(cache=True, error_model="numpy")
def nearest_in_cone(
    occupied: Flags, x: float, y: float, heading_rad: float, half_width_rad: float, reach: float
) -> float:
    """The nearest occupied cell whose centre lies in the cone, up to ``reach``; or +Inf.

    A centre within half a cell's diagonal of the axis counts as well, so that a thin beam slips
    through no wall. Rows are searched from the sensor outwards, and only as far as what was found.
    """
    cos_heading, sin_heading = math.cos(heading_rad), math.sin(heading_rad)
    best_squared, found = reach * reach, False
    left, right, down, up = _box_of_cone(heading_rad, half_width_rad)
    first_row = max(math.floor(y + reach * down) - 2, 0)
    last_row = min(math.floor(y + reach * up) + 3, occupied.shape[0])
    first_col = max(math.floor(x + reach * left) - 2, 0)
    last_col = min(math.floor(x + reach * right) + 3, occupied.shape[1])
    above = min(max(math.floor(y), first_row), last_row)
    below = above - 1
    while above < last_row or below >= first_row:
        is_above = above < last_row and (below < first_row or above + 0.5 - y <= y - below - 0.5)
        row = above if is_above else below
        above, below = above + is_above, below - (not is_above)
        dy = row + 0.5 - y
        if dy * dy > best_squared:
            break  # all other rows are farther away
        width = math.sqrt(best_squared - dy * dy) + 2.0
        for col in range(
            max(first_col, math.floor(x - width)), min(last_col, math.floor(x + width) + 1)
        ):
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
                best_squared, found = squared, True
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
