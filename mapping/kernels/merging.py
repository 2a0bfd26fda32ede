"""Merging a temp grid into a map kept as log-odds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, error_model="numpy")
def add_log_odds(
    log_odds: NDArray[np.float64], probability: NDArray[np.float64], clamp: float
) -> None:
    """Add ln(p / (1 - p)) to each cell where p is not 0.5; both it and the sum stay clamped."""
    rows, cols = probability.shape
    for row in range(rows):
        for col in range(cols):
            p = probability[row, col]
            if p == 0.5:
                continue
            evidence = math.log(p / (1.0 - p)) if 0.0 < p < 1.0 else math.copysign(clamp, p - 0.5)
            total = log_odds[row, col] + min(max(evidence, -clamp), clamp)
            log_odds[row, col] = min(max(total, -clamp), clamp)
