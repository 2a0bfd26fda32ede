"""How the line kernel's settings and results are laid out: plain numbers, without numba."""

from __future__ import annotations

# How pieces are cut; how they are merged; whether the last of a closed chain meets the first.
SPLIT, INCREMENTAL, GIVEN = 0, 1, 2
NO_MERGE, JOINT_FIT, ANGLE, COLLINEAR, ENDPOINTS = 0, 1, 2, 3, 4
WRAP_OFF, WRAP_ON, WRAP_DROP = 0, 1, 2

# One line, a row of float64 (records cost the call from Python half a microsecond each): the points
# of the chain that it took, its normal form, the sum of squares along it, the sum of squared
# distances from it, its two ends, and which of them are corners.
LINE = (
    "chain", "first", "count", "normal_x", "normal_y", "centre_x", "centre_y", "along", "across",
    "x0", "y0", "x1", "y1", "corner0", "corner1",
)  # fmt: skip
(
    CHAIN, FIRST, COUNT, NORMAL_X, NORMAL_Y, CENTRE_X, CENTRE_Y, ALONG, ACROSS,
    X0, Y0, X1, Y1, CORNER0, CORNER1,
) = range(len(LINE))  # fmt: skip


# What the numbers in ``settings`` are, in turn; lengths in metres, angles in radians.
SETTINGS = (
    "epsilon", "rms", "merge_angle", "min_length", "corner_sine", "corner_reach", "y_on_x", "merge",
    "wrap", "settle", "min_points",
)  # fmt: skip
