"""Log-odds as whole numbers: steps of 2^-24 in int32, clamped at 13.8, and rows of whole groups.

Sums of integers are the same in any order and any number of parts, as long as no cell reached its
clamp on the way. This file does not load numba.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Steps = NDArray[np.int32]
Floats = NDArray[np.float64]

ONE = 1 << 24  # steps in log-odds of 1
CLAMP = round(13.8 * ONE)
LANES = 16  # a row of a blank grid holds a multiple of so many cells
HIGHEST: Any = np.int32(CLAMP)
LOWEST: Any = np.int32(-CLAMP)


def blank(rows: int, cols: int) -> Steps:
    """A grid of zeros (rows, cols rounded up to whole groups); the cells past ``cols`` stay 0.

    A group begins at a multiple of its size, so that it lies in one line of the cache.
    """
    stride, size = -(-cols // LANES) * LANES, 4 * LANES
    room = np.zeros(rows * stride + LANES, np.int32)
    first = -(room.ctypes.data % size) % size // 4
    return room[first : first + rows * stride].reshape(rows, stride)


def log_odds_of(cells: Steps, cols: int) -> Floats:
    """Steps → log-odds, (rows, cols)."""
    log_odds: Floats = cells[:, :cols] / ONE
    return log_odds
