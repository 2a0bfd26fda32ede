"""Line regression: where the lines of a sliding window change from place to place.

After Arras and Siegwart (1997): a line is fitted to every window of points; the sum of squared
Mahalanobis distances, in (rho, alpha), between a window's line and those of its two neighbours is
small along a wall and large at a corner.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping.config import SegmentsSection
from mapping.segments.chains import Chains
from mapping.segments.least_squares import FloatArray

WINDOW = 9
# Two windows a step apart share all but one point at either end, so that along a wall their lines
# differ by far less than each is uncertain; beyond this they belong to two walls.
_MOST = 3.0


def window_cuts(chains: Chains, config: SegmentsSection) -> NDArray[np.int64]:
    """Indices (K,) of the points where a piece starts, the chains' own starts among them."""
    cuts: list[NDArray[np.int64]] = []
    for begin, end in zip(chains.offsets[:-1], chains.offsets[1:], strict=True):
        inner = _cuts_of(chains.points_m[begin:end], config.epsilon_m / 4.0)
        if end - begin >= 2:
            cuts.append(begin + np.concatenate([[0], inner]))
    return np.concatenate(cuts).astype(np.int64) if cuts else np.empty(0, np.int64)


def _cuts_of(points: FloatArray, sigma_m: float) -> NDArray[np.int64]:
    """Between two straight runs of windows, the cut lies in the middle of the bent ones."""
    if len(points) < WINDOW + 2:
        return np.empty(0, np.int64)
    bent = _change(points, sigma_m) > _MOST
    edges = np.flatnonzero(np.diff(bent.astype(np.int8)))
    starts = edges[bent[edges + 1]] + 1
    ends = edges[bent[edges]] + 1
    if bent[0]:
        starts = np.concatenate([[0], starts])
    if bent[-1]:
        ends = np.append(ends, len(bent))
    middles = (starts + ends - 1) // 2 + 1 + WINDOW // 2
    return middles[(middles > 0) & (middles < len(points))]


def _change(points: FloatArray, sigma_m: float) -> FloatArray:
    """(W - 2,): how far the line of each inner window is from those of its two neighbours."""
    p = points - points[0]
    columns = np.column_stack([p, p[:, 0] ** 2, p[:, 0] * p[:, 1], p[:, 1] ** 2])
    sums = np.concatenate([np.zeros((1, 5)), np.cumsum(columns, axis=0)])
    x, y, xx, xy, yy = ((sums[WINDOW:] - sums[:-WINDOW]) / WINDOW).T
    xx, xy, yy = xx - x * x, xy - x * y, yy - y * y
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    along = np.maximum(0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy), 1e-12)
    # How the next line differs from this one: its offset at this window's centre, and its angle.
    turn = (np.diff(angle) + np.pi / 2) % np.pi - np.pi / 2
    offset = -np.sin(angle[:-1]) * np.diff(x) + np.cos(angle[:-1]) * np.diff(y)
    squared = WINDOW / sigma_m**2 * (offset**2 + along[:-1] * turn**2)
    return np.asarray(squared[:-1] + squared[1:])
