"""How likely a range is in a map.

Places are in units of cells, relative to the outer corner of cell (0, 0); a ray is looked at in
steps of one cell's side, half a cell first. What lies outside the grid is free.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Singles = NDArray[np.float32]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_CERTAIN = 1e-4  # so little is left of a ray's chance to get further: it ends here
_FAR = 5.0  # standard deviations from the range that is looked for


@njit(cache=True, error_model="numpy")
def log_likelihoods(
    occupied: Singles, fold: Ints, x: Floats, y: Floats, heading_rad: Floats, fan_rad: Floats,
    ranges: Floats, reach: Floats, resolution_m: float, shares: Floats, error_m: float,
    error: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The log-likelihood of each range in the map without its own fold, and the range expected.

    ``occupied`` (F, rows, cols): probability that a cell is occupied, where fold f was kept out.
    The others are (N,): which fold a reading is of, where its beam starts, its heading, its range
    and its reach in cells (+Inf: no echo). ``fan_rad`` (J,): directions across the beam, which
    ends where the first of them does. ``shares``: of hits, short, none, random. A hit lies about
    the cell that ends the beam with a spread of ``error_m + error * range``, a short one evenly
    before it. Densities are those of metres. The expected range (metres) is the median of where the
    beam ends; +Inf: past its reach.
    """
    count, rows, cols, rays = x.size, occupied.shape[1], occupied.shape[2], fan_rad.size
    found, expected_m = np.empty(count), np.full(count, math.inf)
    c, s, left = np.empty(rays), np.empty(rays), np.empty(rays)
    for i in range(count):
        for j in range(rays):
            angle = heading_rad[i] + fan_rad[j]
            c[j], s[j], left[j] = math.cos(angle), math.sin(angle), 1.0
        z_m, reach_m = ranges[i] * resolution_m, reach[i] * resolution_m
        hit = short = 0.0
        before = 1.0
        for k in range(math.ceil(reach[i])):
            along = k + 0.5
            for j in range(rays):
                col = math.floor(x[i] + along * c[j])
                row = math.floor(y[i] + along * s[j])
                if 0 <= row < rows and 0 <= col < cols:
                    left[j] *= 1.0 - occupied[fold[i], row, col]
            after = left.min()
            ends, r_m = before - after, along * resolution_m
            if after < 0.5 <= before:
                expected_m[i] = r_m
            if ends > 0.0 and z_m < math.inf:
                sigma_m = error_m + error * r_m
                away = (z_m - r_m) / sigma_m
                if abs(away) < _FAR:
                    hit += ends * math.exp(-0.5 * away * away) / sigma_m
                if z_m < r_m:
                    short += ends / r_m
            before = after
            if before < _CERTAIN:
                break
        if z_m < math.inf:
            density = shares[0] * hit / math.sqrt(2.0 * math.pi)
            density += shares[1] * (short + before / reach_m) + shares[3] / reach_m
            found[i] = math.log(density)
        else:
            found[i] = math.log(shares[0] * before + shares[2])
    return found, expected_m
