"""Which cells a beam covers: each cell of a window is looked at once.

Both kernels fill two masks (``free``: passed through, ``band``: the obstacle may be here) and a
list of the cells found, in row order: their flat index, their distance from the sensor, and where
they stand along and across the axis of their beam. A centre on the very edge counts as inside,
whatever the rounding: distances may be 1e-10 m over, angles 1e-10 rad.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

TOLERANCE_M = 1e-10
TOLERANCE_RAD = 1e-10
# Below this sine the cross product cannot tell the sides of an edge apart reliably; the angle can.
_NEAR_EDGE = 1e-7


@njit(cache=True, error_model="numpy")
def _in_beam(
    along: float, across: float, rho: float, sin_half: float, cos_half: float, half_rad: float
) -> bool:
    """Is a place within the beam's half width? Angles only where a product is not sure."""
    # rho * sin(half - |angle|): positive inside, as both angles lie in 0 .. pi.
    inside = along * sin_half - abs(across) * cos_half
    if abs(inside) > _NEAR_EDGE * rho:
        return inside > 0.0
    return math.atan2(abs(across), along) <= half_rad + TOLERANCE_RAD


@njit(cache=True, error_model="numpy")
def wedge(
    column_x: Floats, row_y: Floats, cos_heading: float, sin_heading: float, half_width_rad: float,
    front_end_m: float, band_end_m: float, free: Flags, band: Flags, index: Integers,
    rho_m: Floats, along_m: Floats, across_m: Floats,
) -> tuple[int, int]:  # fmt: skip
    """One axis. ``column_x`` and ``row_y`` are the cells' centres relative to the sensor, metres.

    The front ends at ``front_end_m``, the band at ``band_end_m`` (no band unless that is farther).
    Returns how many cells were found, and how many of them lie in the band.
    """
    sin_half, cos_half = math.sin(half_width_rad), math.cos(half_width_rad)
    has_band = band_end_m > front_end_m
    front_limit = front_end_m - TOLERANCE_M
    limit = band_end_m + TOLERANCE_M if has_band else front_limit
    limit_squared = limit * limit if limit > 0.0 else -1.0
    rows, cols = row_y.size, column_x.size
    found = in_band = 0
    for row in range(rows):
        dy = row_y[row]
        if dy * dy > limit_squared:
            continue
        for col in range(cols):
            dx = column_x[col]
            squared = dx * dx + dy * dy
            if squared > limit_squared:
                continue
            along = dx * cos_heading + dy * sin_heading
            across = dy * cos_heading - dx * sin_heading
            rho = math.sqrt(squared)
            if not _in_beam(along, across, rho, sin_half, cos_half, half_width_rad):
                continue
            if rho >= front_limit:
                if not has_band:
                    continue
                band[row, col] = True
                in_band += 1
            else:
                free[row, col] = True
            index[found] = row * cols + col
            rho_m[found] = rho
            along_m[found] = along
            across_m[found] = across
            found += 1
    return found, in_band


@njit(cache=True, error_model="numpy")
def turn_of(x: float, y: float) -> float:
    """Direction as a number 0 .. 4 that grows with the angle: an angle for comparing, no atan2."""
    if x == 0.0 and y == 0.0:
        return 0.0
    if y >= 0.0:
        return y / (x + y) if x >= 0.0 else 1.0 - x / (y - x)
    return 2.0 + y / (x + y) if x < 0.0 else 3.0 + x / (x - y)


@njit(cache=True, error_model="numpy")
def turns_of(x: Floats, y: Floats) -> Floats:
    """``turn_of`` each direction, (N,)."""
    turns = np.empty(x.size)
    for k in range(x.size):
        turns[k] = turn_of(x[k], y[k])
    return turns


@njit(cache=True, error_model="numpy")
def fan(
    column_x: Floats, row_y: Floats, border_turns: Floats, axis_after: Integers,
    cos_axis: Floats, sin_axis: Floats, half_width_rad: float,
    front_end_m: Floats, band_end_m: Floats, free: Flags, band: Flags, index: Integers,
    rho_m: Floats, along_m: Floats, across_m: Floats, owner: Integers, in_band: Integers,
) -> int:  # fmt: skip
    """Many axes: each cell takes the axis nearest to it.

    ``border_turns`` are the directions half way between neighbouring axes, ascending, as numbers
    of ``turn_of``; ``axis_after[k]`` is the axis between border k and the next. The other arrays of
    axes are in the scan's own order. ``owner`` gets the axis of each cell found, ``in_band`` (zeros
    before) how many cells of its band an axis owns. An axis with negative ends owns its cells and
    is no evidence. Returns how many cells were found.
    """
    sin_half, cos_half = math.sin(half_width_rad), math.cos(half_width_rad)
    farthest = 0.0
    for axis in range(front_end_m.size):
        farthest = max(farthest, front_end_m[axis], band_end_m[axis])
    limit_squared = (farthest + TOLERANCE_M) ** 2
    rows, cols, borders = row_y.size, column_x.size, border_turns.size
    found, last = 0, 0
    for row in range(rows):
        dy = row_y[row]
        if dy * dy > limit_squared:
            continue
        for col in range(cols):
            dx = column_x[col]
            squared = dx * dx + dy * dy
            if squared > limit_squared:
                continue
            turn = turn_of(dx, dy)
            # Most cells lie between the same two borders as the one before.
            above = border_turns[last + 1] if last + 1 < borders else 5.0
            if not border_turns[last] <= turn < above:
                last = (np.searchsorted(border_turns, turn, side="right") - 1) % borders
            axis = axis_after[last]
            front_end, band_end = front_end_m[axis], band_end_m[axis]
            rho = math.sqrt(squared)
            if rho > max(front_end, band_end) + TOLERANCE_M:
                continue
            in_front = rho < front_end - TOLERANCE_M
            if not in_front and not band_end > front_end:
                continue
            along = dx * cos_axis[axis] + dy * sin_axis[axis]
            across = dy * cos_axis[axis] - dx * sin_axis[axis]
            if not _in_beam(along, across, rho, sin_half, cos_half, half_width_rad):
                continue
            if in_front:
                free[row, col] = True
            else:
                band[row, col] = True
                in_band[axis] += 1
            index[found] = row * cols + col
            rho_m[found] = rho
            along_m[found] = along
            across_m[found] = across
            owner[found] = axis
            found += 1
    return found
