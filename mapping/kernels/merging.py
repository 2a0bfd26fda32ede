"""Merging a temp grid, or the steps of one reading, into a map kept as steps of log-odds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapping.kernels.batch.steps import CLAMP, HIGHEST, LOWEST, ONE

Steps = NDArray[np.int32]


@njit(cache=True, error_model="numpy")
def add_log_odds(
    cells: NDArray[np.int32], row0: int, col0: int, probability: NDArray[np.float64]
) -> None:
    """Add ln(p / (1 - p)), in steps, to each cell of a window where p is not 0.5.

    (row0, col0) is the window's first cell. Both what is added and the sum stay clamped.
    """
    rows, cols = probability.shape
    for row in range(rows):
        for col in range(cols):
            p = probability[row, col]
            if p == 0.5:
                continue
            evidence = math.copysign(CLAMP, p - 0.5)
            if 0.0 < p < 1.0:
                evidence = min(max(math.log(p / (1.0 - p)) * ONE, -CLAMP), CLAMP)
            total = float(cells[row0 + row, col0 + col] + np.rint(evidence))
            cells[row0 + row, col0 + col] = np.int32(min(max(total, -CLAMP), CLAMP))


@njit(cache=True, error_model="numpy", nogil=True)
def add_steps(cells: Steps, added: Steps) -> None:
    """Add the steps of one reading, (rows, cols), to a window of the map; sums are clamped."""
    rows, cols = added.shape
    for row in range(rows):
        for col in range(cols):
            total = np.int32(cells[row, col] + added[row, col])
            total = total if total < HIGHEST else HIGHEST
            cells[row, col] = total if total > LOWEST else LOWEST
