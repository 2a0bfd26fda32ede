"""The slow, obvious twin of the kernel that judges ranges by a map."""

from __future__ import annotations

import itertools
import math

import numpy as np


def chances_of_the_end(
    occupied: np.ndarray, x: float, y: float, headings: list[float], reach: float
) -> list[float]:
    """That a beam ends k steps away, for each k, and last that it gets through.

    A beam of several rays gets as far as the one of them that is stopped first.
    """
    rows, cols = occupied.shape

    def probability(along: float, heading: float) -> float:
        row = math.floor(y + along * math.sin(heading))
        col = math.floor(x + along * math.cos(heading))
        return float(occupied[row, col]) if 0 <= row < rows and 0 <= col < cols else 0.0

    left = [1.0]
    for k in range(1, math.ceil(reach) + 1):
        rays = [
            math.prod(1.0 - probability(i + 0.5, heading) for i in range(k)) for heading in headings
        ]
        left.append(min(rays))
    return [a - b for a, b in itertools.pairwise(left)] + [left[-1]]


def likelihood(
    ends: list[float], range_m: float, reach_m: float, step_m: float, shares: np.ndarray,
    error_m: float, error: float,
) -> float:  # fmt: skip
    """Of a range, as a density; of no echo (+Inf), as a probability."""
    hit, short, none, random = shares
    *ends, through = ends
    if math.isinf(range_m):
        return hit * through + none
    at = [(k + 0.5) * step_m for k in range(len(ends))]
    total = random / reach_m + short * through / reach_m
    for p, r in zip(ends, at, strict=True):
        sigma = error_m + error * r
        bell = math.exp(-0.5 * ((range_m - r) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi))
        total += p * hit * bell
        total += p * short / r if range_m < r else 0.0
    return total
