"""How the line kernel's settings and results are laid out: plain numbers, without numba."""

from __future__ import annotations

import numpy as np

# How pieces are cut; how they are merged; whether the last of a closed chain meets the first.
SPLIT, INCREMENTAL, GIVEN = 0, 1, 2
NO_MERGE, JOINT_FIT, ANGLE, COLLINEAR, ENDPOINTS = 0, 1, 2, 3, 4
WRAP_OFF, WRAP_ON, WRAP_DROP = 0, 1, 2

# One line: the points of ``chain`` that it took, its normal form, the sum of squares along it, the
# sum of squared distances from it, its two ends, and which of them are corners.
LINE = np.dtype(
    [("chain", np.int64), ("first", np.int64), ("count", np.int64),
     ("normal_x", np.float64), ("normal_y", np.float64), ("centre_x", np.float64),
     ("centre_y", np.float64), ("along", np.float64), ("across", np.float64),
     ("x0", np.float64), ("y0", np.float64), ("x1", np.float64), ("y1", np.float64),
     ("corner0", np.bool_), ("corner1", np.bool_)]
)  # fmt: skip


# What the numbers in ``settings`` are, in turn; lengths in metres, angles in radians.
SETTINGS = (
    "epsilon", "rms", "merge_angle", "min_length", "corner_sine", "corner_reach", "y_on_x", "merge",
    "wrap", "settle", "min_points",
)  # fmt: skip
