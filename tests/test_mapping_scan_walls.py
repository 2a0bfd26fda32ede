"""The compiled joining of lines to walls beside a slow twin that looks at all points anew."""

from __future__ import annotations

import math

import naive_lines
import numpy as np
import pytest

from mapping.line_kernels.walls import walls_of_lines

LIMITS = (math.cos(0.1), 0.12, 0.3)


def made_up_lines(seed, count=40):
    """Noisy pieces of the four walls of a room, and of one that stands a little apart."""
    draw = np.random.default_rng(seed)
    corners = [((0, 0), (4, 0)), ((4, 0), (4, 3)), ((4, 3), (0, 3)), ((0, 3), (0, 0)),
               ((0.0, 0.3), (4.0, 0.3))]  # fmt: skip
    lines = []
    for _ in range(count):
        a, b = np.array(corners[draw.integers(5)], float)
        low, high = sorted(draw.uniform(0.0, 1.0, 2))
        t = np.linspace(low, high + 0.02, draw.integers(5, 30))[:, None]
        points = a + t * (b - a) + draw.normal(0.0, 0.02, (len(t), 2))
        along = (b - a) / np.hypot(*(b - a)) * (1.0 if draw.uniform() < 0.8 else -1.0)
        lines.append((points, points[0], points[-1], along))
    return lines


def table_of(lines):
    rows = []
    for points, start, end, along in lines:
        mean = points.mean(axis=0)
        x, y = (points - mean).T
        rows.append([*start, *end, *along, len(points), *mean, x @ x, x @ y, y @ y])
    return np.array(rows)


@pytest.mark.parametrize("seed", range(8))
def test_walls_are_those_of_the_slow_twin(seed):
    lines = made_up_lines(seed)
    numbers = walls_of_lines(table_of(lines), *LIMITS)
    assert numbers.tolist() == naive_lines.walls(lines, *LIMITS)
    assert 5 <= len(set(numbers.tolist())) < len(lines) / 2


def test_the_two_faces_of_a_wall_stay_two():
    (line, *_) = made_up_lines(1, 1)
    points, start, end, along = line
    lines = [line, (points + 0.01, start + 0.01, end + 0.01, -along), line]
    assert walls_of_lines(table_of(lines), *LIMITS).tolist() == [0, 1, 0]
