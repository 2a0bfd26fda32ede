"""The methods that use the order of the points: split-and-merge, incremental, line regression."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.config import SegmentsSection
from mapping.line_kernels import layout
from mapping.segments.chains import Chains
from mapping.segments.least_squares import FittedLine, FloatArray
from mapping.segments.stages import Corner, Fit, Merge, Observer, Split, place_of

_MERGE_RULES = {
    "none": layout.NO_MERGE,
    "joint-fit": layout.JOINT_FIT,
    "angle": layout.ANGLE,
    "collinear": layout.COLLINEAR,
    "endpoints": layout.ENDPOINTS,
}
_WRAPS = {"off": layout.WRAP_OFF, "on": layout.WRAP_ON, "drop": layout.WRAP_DROP}
_NO_CUTS = np.empty(0, np.int64)
# How many points a joint may move to where both lines fit best. A growing set takes in a good part
# of the next wall before its rms shows it; a chord's farthest point is off by a point or two.
SETTLE_SPLIT, SETTLE_GROWN = 2, 12
WINDOW = 9  # points, of line regression
# Two windows a step apart share all but one point at either end, so that along a wall their lines
# differ by far less than each is uncertain; beyond this they belong to two walls.
_MOST = 3.0


def split_and_merge(
    chains: Chains, config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Cut at the farthest point from the chord until all are near; merge, fit and intersect."""
    return _finish(chains, config, observe, layout.SPLIT, _NO_CUTS, SETTLE_SPLIT)


def incremental(
    chains: Chains, config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Take point after point while the fit's rms stays in its bound; then start a new line."""
    return _finish(chains, config, observe, layout.INCREMENTAL, _NO_CUTS, SETTLE_GROWN)


def line_regression(
    chains: Chains, config: SegmentsSection, observe: Observer | None = None
) -> list[FittedLine]:
    """Fit a window of points at every place; cut where the lines of neighbouring windows differ."""
    return _finish(
        chains, config, observe, layout.GIVEN, _window_cuts(chains, config), SETTLE_GROWN
    )


def _window_cuts(chains: Chains, config: SegmentsSection) -> NDArray[np.int64]:
    """Indices (K,) of the points where a piece starts, the chains' own starts among them.

    Arras and Siegwart (1997): the sum of squared Mahalanobis distances, in (rho, alpha), between a
    window's line and those of its two neighbours is small along a wall and large at a corner.
    """
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


def _finish(
    chains: Chains,
    config: SegmentsSection,
    observe: Observer | None,
    method: int,
    cuts: NDArray[np.int64],
    settle: int,
) -> list[FittedLine]:
    from mapping.kernels.loops import lines_of_chains

    n = len(chains.points_m)
    log = np.empty((2, n, 4))
    found = np.empty((n // config.min_points + 1, len(layout.LINE)))
    counts = lines_of_chains(
        chains.points_m,
        chains.offsets,
        chains.closed,
        method,
        cuts,
        kernel_settings(config, settle),
        log,
        found,
    )
    lines = [_line(chains, row) for row in found[: counts[0]]]
    if observe is not None:
        _report_splits(chains, log[0, : counts[1]], observe)
        _report_merges(chains, log[1, : counts[2]], observe)
        _report_lines(lines, observe)
    return lines


def kernel_settings(config: SegmentsSection, settle: int) -> FloatArray:
    """The configuration as the numbers that the kernel takes."""
    values = {
        "epsilon": config.epsilon_m,
        "rms": config.largest_rms_m,
        "merge_angle": math.radians(config.merge_angle_deg),
        "min_length": config.min_length_m,
        "corner_sine": math.sin(math.radians(config.corner_angle_deg)),
        "corner_reach": config.corner_reach_m,
        "y_on_x": float(config.fit == "y-on-x"),
        "merge": _MERGE_RULES[config.merge],
        "wrap": _WRAPS[config.wrap],
        "settle": settle,
        "min_points": config.min_points,
    }
    return np.array([values[name] for name in layout.SETTINGS], np.float64)


def _line(chains: Chains, row: FloatArray) -> FittedLine:
    chain, first, count = (int(row[k]) for k in (layout.CHAIN, layout.FIRST, layout.COUNT))
    return FittedLine(
        chains.points_of(chain, first, count),
        row[[layout.CENTRE_X, layout.CENTRE_Y]],
        np.array([row[layout.NORMAL_Y], -row[layout.NORMAL_X]]),
        row[[layout.X0, layout.Y0]],
        row[[layout.X1, layout.Y1]],
        (bool(row[layout.CORNER0]), bool(row[layout.CORNER1])),
    )


def _report_splits(chains: Chains, splits: FloatArray, observe: Observer) -> None:
    points = chains.points_m
    for low, high, cut, distance in splits:
        start, end, at = (place_of(points[int(i)]) for i in (low, high, cut))
        observe(Split(start, end, at, float(distance)))


def _report_merges(chains: Chains, merges: FloatArray, observe: Observer) -> None:
    for first, count, joint, cost in merges:
        chain = int(np.searchsorted(chains.offsets, first, side="right")) - 1
        last = chains.points_of(chain, int(first), int(count))[-1]
        points = chains.points_m
        start, at, end = (place_of(p) for p in (points[int(first)], points[int(joint)], last))
        observe(Merge(start, at, end, float(cost)))


def _report_lines(lines: list[FittedLine], observe: Observer) -> None:
    for line in lines:
        t = (line.points_m[[0, -1]] - line.centre_m) @ line.along
        start, end = (place_of(line.centre_m + at * line.along) for at in t)
        observe(Fit(start, end, len(line.points_m), line.rms_m))
    for line in lines:
        if line.corners[1]:
            observe(Corner(place_of(line.end_m)))
