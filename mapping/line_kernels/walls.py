"""Lines of many scans to walls: which lines continue each other.

A wall is kept as sums (number, mean, scatter of its points), so that joining a line costs the same
however many points there are. Its direction and extent follow from these.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Columns of a line: its ends, its direction with the sensor on the left, and of its points the
# number, the mean, and the sums of xx, xy, yy about it.
START_X, START_Y, END_X, END_Y, ALONG_X, ALONG_Y, COUNT, MEAN_X, MEAN_Y, XX, XY, YY = range(12)
# A wall has the same, but for the ends: from where to where it runs, along it from its mean.
_LOW, _HIGH = START_X, START_Y


@njit(cache=True, error_model="numpy")
def _along_and_across(wall: Floats, x: float, y: float) -> tuple[float, float]:
    """Where a place lies along a wall, from its mean, and how far from it."""
    dx, dy = x - wall[MEAN_X], y - wall[MEAN_Y]
    along = dx * wall[ALONG_X] + dy * wall[ALONG_Y]
    return along, abs(dy * wall[ALONG_X] - dx * wall[ALONG_Y])


@njit(cache=True, error_model="numpy")
def _continued(
    walls: Floats, found: int, line: Floats, cosine: float, across_m: float, gap_m: float
) -> int:
    """The wall that a line continues, the nearest across; -1 where there is none."""
    best, least = -1, np.inf
    for k in range(found):
        wall = walls[k]
        if wall[ALONG_X] * line[ALONG_X] + wall[ALONG_Y] * line[ALONG_Y] <= cosine:
            continue
        t0, off0 = _along_and_across(wall, line[START_X], line[START_Y])
        t1, off1 = _along_and_across(wall, line[END_X], line[END_Y])
        off = max(off0, off1)
        gap = max(min(t0, t1) - wall[_HIGH], wall[_LOW] - max(t0, t1))
        if off <= across_m and gap <= gap_m and off < least:
            best, least = k, off
    return best


@njit(cache=True, error_model="numpy")
def _join(wall: Floats, line: Floats) -> None:
    """Add a line's points to a wall's sums; the wall then runs as all of them together do."""
    n, m = wall[COUNT], line[COUNT]
    low_x = wall[MEAN_X] + wall[_LOW] * wall[ALONG_X]
    low_y = wall[MEAN_Y] + wall[_LOW] * wall[ALONG_Y]
    high_x = wall[MEAN_X] + wall[_HIGH] * wall[ALONG_X]
    high_y = wall[MEAN_Y] + wall[_HIGH] * wall[ALONG_Y]
    dx, dy, share = line[MEAN_X] - wall[MEAN_X], line[MEAN_Y] - wall[MEAN_Y], n * m / (n + m)
    wall[XX] += line[XX] + dx * dx * share
    wall[XY] += line[XY] + dx * dy * share
    wall[YY] += line[YY] + dy * dy * share
    wall[MEAN_X] = (n * wall[MEAN_X] + m * line[MEAN_X]) / (n + m)
    wall[MEAN_Y] = (n * wall[MEAN_Y] + m * line[MEAN_Y]) / (n + m)
    wall[COUNT] = n + m
    angle = 0.5 * math.atan2(2.0 * wall[XY], wall[XX] - wall[YY])
    x, y = math.cos(angle), math.sin(angle)
    turned = 1.0 if x * wall[ALONG_X] + y * wall[ALONG_Y] >= 0.0 else -1.0
    wall[ALONG_X], wall[ALONG_Y] = turned * x, turned * y
    low, high = np.inf, -np.inf
    for px, py in ((low_x, low_y), (high_x, high_y), (line[START_X], line[START_Y]),
                   (line[END_X], line[END_Y])):  # fmt: skip
        t, _ = _along_and_across(wall, px, py)
        low, high = min(low, t), max(high, t)
    wall[_LOW], wall[_HIGH] = low, high


@njit(cache=True, error_model="numpy")
def walls_of_lines(lines: Floats, cosine: float, across_m: float, gap_m: float) -> Ints:
    """The number of the wall that each line is of; a line that continues none begins the next one.

    ``lines`` (N, 12) are taken in their order. A line continues the wall nearest across it that
    runs the same way (the cosine between them is above ``cosine``), lies within ``across_m`` of
    both its ends and is at most ``gap_m`` off along it.
    """
    count = lines.shape[0]
    walls, numbers = np.empty_like(lines), np.empty(count, np.int64)
    found = 0
    for i in range(count):
        line = lines[i]
        k = _continued(walls, found, line, cosine, across_m, gap_m)
        if k >= 0:
            _join(walls[k], line)
        else:
            k = found
            walls[k, :] = line
            t0, _ = _along_and_across(walls[k], line[START_X], line[START_Y])
            t1, _ = _along_and_across(walls[k], line[END_X], line[END_Y])
            walls[k, _LOW], walls[k, _HIGH] = min(t0, t1), max(t0, t1)
            found += 1
        numbers[i] = k
    return numbers
