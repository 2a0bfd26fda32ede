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
from mapping.segments.windows import window_cuts

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
    return _finish(chains, config, observe, layout.GIVEN, window_cuts(chains, config), SETTLE_GROWN)


def _finish(
    chains: Chains,
    config: SegmentsSection,
    observe: Observer | None,
    method: int,
    cuts: NDArray[np.int64],
    settle: int,
) -> list[FittedLine]:
    from mapping.line_kernels.lines import lines_of_chains

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
        _tell_splits(chains, log[0, : counts[1]], observe)
        _tell_merges(chains, log[1, : counts[2]], observe)
        _tell_lines(lines, observe)
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


def _tell_splits(chains: Chains, splits: FloatArray, observe: Observer) -> None:
    points = chains.points_m
    for low, high, cut, distance in splits:
        start, end, at = (place_of(points[int(i)]) for i in (low, high, cut))
        observe(Split(start, end, at, float(distance)))


def _tell_merges(chains: Chains, merges: FloatArray, observe: Observer) -> None:
    for first, count, joint, cost in merges:
        chain = int(np.searchsorted(chains.offsets, first, side="right")) - 1
        last = chains.points_of(chain, int(first), int(count))[-1]
        points = chains.points_m
        start, at, end = (place_of(p) for p in (points[int(first)], points[int(joint)], last))
        observe(Merge(start, at, end, float(cost)))


def _tell_lines(lines: list[FittedLine], observe: Observer) -> None:
    for line in lines:
        t = (line.points_m[[0, -1]] - line.centre_m) @ line.along
        start, end = (place_of(line.centre_m + at * line.along) for at in t)
        observe(Fit(start, end, len(line.points_m), line.rms_m))
    for line in lines:
        if line.corners[1]:
            observe(Corner(place_of(line.end_m)))
