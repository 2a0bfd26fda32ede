"""The cells that the axis of a beam runs through, for rules that treat a beam as a thin line."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


def axis_cells(temp: TempGrid) -> tuple[Flags, Flags]:
    """Cells of the window that an axis passed through, and those that hold an obstacle point.

    Both have the window's shape, and no cell is in both: a hit stays a hit. An axis that saw
    nothing passes as far as the sensor reaches, if the sensor model lets it empty its beam.
    """
    beam, window = temp.beam, temp.window
    passed = np.zeros((window.rows, window.cols), np.bool_)
    hit = np.zeros_like(passed)
    ends_m = beam.far_m
    axes = zip(beam.headings_rad, beam.ranges_m, ends_m, beam.marks.tolist(), strict=True)
    for heading, range_m, end_m, seen in axes:
        if math.isnan(range_m):
            continue
        row, col = line_cells(temp, float(heading), float(end_m))
        inside = (row >= 0) & (row < window.rows) & (col >= 0) & (col < window.cols)
        if seen:
            if inside[-1]:
                hit[row[-1], col[-1]] = True
        elif not temp.free[row[inside], col[inside]].any():
            continue
        passed[row[inside], col[inside]] = True
    return passed & ~hit, hit


def line_cells(temp: TempGrid, heading_rad: float, length_m: float) -> tuple[Integers, Integers]:
    """Rows and columns, in the window, of the cells from the sensor along a line, in order.

    The line is cut where it crosses the borders between cells; each piece lies in one cell. The
    last cell is the one that holds the line's end.
    """
    origin, geometry = temp.beam.world_from_sensor, temp.geometry
    direction = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    start = (np.array([origin.x_m, origin.y_m]) - geometry.origin_m) / geometry.resolution_m
    end = start + direction * (length_m / geometry.resolution_m)
    cuts = [np.array([0.0, 1.0])]
    for a, b in zip(start, end, strict=True):
        between = np.arange(math.floor(min(a, b)) + 1, math.ceil(max(a, b)))
        if between.size:
            cuts.append((between - a) / (b - a))
    at = np.unique(np.clip(np.concatenate(cuts), 0.0, 1.0))
    middle = (at[:-1] + at[1:]) / 2.0
    points = start + middle[:, None] * (end - start)
    cells = np.floor(np.vstack([points, end])).astype(np.int64)
    return cells[:, 1] - temp.window.row0, cells[:, 0] - temp.window.col0
