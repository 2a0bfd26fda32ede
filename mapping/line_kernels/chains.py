"""Where an ordered run of points is broken: by distance, or by the breakpoint rule of a scan."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True)
def break_at_gaps(xy: Floats, gap_m: float) -> NDArray[np.int64]:
    """Chains of points (N, 2) where neighbours lie further apart than ``gap_m``: offsets (C + 1,).

    A point that is not a number is not a point: the caller has left those out.
    """
    offsets = np.empty(xy.shape[0] + 2, np.int64)
    offsets[0] = 0
    chains = 1
    for i in range(1, xy.shape[0]):
        if math.hypot(xy[i, 0] - xy[i - 1, 0], xy[i, 1] - xy[i - 1, 1]) > gap_m:
            offsets[chains] = i
            chains += 1
    offsets[chains] = xy.shape[0]
    return offsets[: chains + 1]


@njit(cache=True)
def scan_chains(
    ranges: Floats, bearings: Floats, sine_lambda: float, cosine_lambda: float, sigma_m: float
) -> tuple[Floats, NDArray[np.int64], bool]:
    """The returns of a scan (N,) as points (M, 2), where its chains start, and whether it closes.

    The adaptive breakpoint of Borges and Aldon (2004): two returns belong together when they lie no
    further apart than a wall could that is seen at ``lambda``, plus three standard deviations. The
    comparison runs round the circle, and the points start behind a break. Beams without a return
    are left out; what lies between two of them is a wider step in bearing.
    """
    n = 0
    r, u = np.empty(ranges.size), np.empty((ranges.size, 2))
    for i in range(ranges.size):
        if math.isfinite(ranges[i]) and ranges[i] > 0.0 and math.isfinite(bearings[i]):
            r[n], u[n, 0], u[n, 1] = ranges[i], math.cos(bearings[i]), math.sin(bearings[i])
            n += 1
    starts, breaks, offset = np.zeros(n, np.bool_), 0, 0
    before = n - 1
    for k in range(n):
        sine = u[before, 0] * u[k, 1] - u[before, 1] * u[k, 0]
        cosine = u[before, 0] * u[k, 0] + u[before, 1] * u[k, 1]
        # sin(lambda - step); a step as wide as lambda, or half a circle, cannot be bridged.
        slant = sine_lambda * cosine - cosine_lambda * abs(sine)
        apart = r[before] ** 2 + r[k] ** 2 - 2.0 * r[before] * r[k] * cosine
        reach = 3.0 * sigma_m
        if slant > 0.0:
            reach += min(r[before], r[k]) * abs(sine) / slant
        if n == 1 or slant <= 0.0 or apart > reach * reach:
            starts[k] = True
            if breaks == 0:
                offset = k
            breaks += 1
        before = k
    xy, offsets = np.empty((n, 2)), np.empty(max(breaks, 1) + 1, np.int64)
    offsets[0] = 0
    chain = 0
    for k in range(n):
        i = k + offset if k + offset < n else k + offset - n
        xy[k, 0], xy[k, 1] = r[i] * u[i, 0], r[i] * u[i, 1]
        if starts[i] and k > 0:
            chain += 1
            offsets[chain] = k
    offsets[chain + 1] = n
    return xy, offsets, breaks == 0
