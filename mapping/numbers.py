"""Functions that NumPy lacks, and for which SciPy takes a fifth of a second to load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def expit(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log-odds → probability: 1 / (1 + exp(-x))."""
    with np.errstate(over="ignore"):  # exp(-x) = +Inf: a probability of 0
        probability: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-x))
    return probability
