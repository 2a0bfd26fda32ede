"""The obvious twins of the line kernels: recursion, singular values, one comparison at a time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def naive_splits(points: Floats, epsilon: float) -> list[int]:
    """Indices at which a polyline is cut, by the recursive definition, in rising order."""

    def cuts(low: int, high: int) -> list[int]:
        if high - low < 2:
            return []
        away = [chord_distance(points[i], points[low], points[high]) for i in range(low + 1, high)]
        at = low + 1 + int(np.argmax(away))
        if max(away) <= epsilon:
            return []
        return [*cuts(low, at), at, *cuts(at, high)]

    return cuts(0, len(points) - 1)


def chord_distance(p: Floats, a: Floats, b: Floats) -> float:
    """Distance of p from the line through a and b, or from a where the two coincide."""
    length = math.dist(a, b)
    if length == 0.0:
        return math.dist(p, a)
    return abs((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])) / length


def naive_line(points: Floats) -> tuple[Floats, Floats, float]:
    """Centre, direction and rms of the total least squares line, by singular values."""
    centre = points.mean(axis=0)
    _, values, axes = np.linalg.svd(points - centre, full_matrices=False)
    return centre, axes[0], float(values[-1] / math.sqrt(len(points)))


def naive_growth(points: Floats, rms: float) -> list[int]:
    """Indices at which the incremental method starts a new line."""
    starts, first = [], 0
    for i in range(len(points)):
        if i - first >= 2 and naive_line(points[first : i + 1])[2] > rms:
            first = i - 1
            starts.append(first)
    return starts


def naive_scan_breaks(
    ranges: Floats, bearings: Floats, sigma_m: float, lambda_rad: float
) -> list[bool]:
    """For every return of a scan, whether the adaptive breakpoint rule parts it from the last."""
    seen = [k for k in range(len(ranges)) if math.isfinite(ranges[k]) and ranges[k] > 0]
    breaks = []
    for before, k in zip([*seen[-1:], *seen[:-1]], seen, strict=True):
        turn = abs((bearings[k] - bearings[before] + math.pi) % (2 * math.pi) - math.pi)
        if before == k or turn >= lambda_rad:
            breaks.append(True)
            continue
        a, b = (ranges[i] * np.array([math.cos(bearings[i]), math.sin(bearings[i])])
                for i in (before, k))  # fmt: skip
        nearer = min(ranges[before], ranges[k])
        reach = nearer * math.sin(turn) / math.sin(lambda_rad - turn) + 3 * sigma_m
        breaks.append(math.dist(a, b) > reach)
    return breaks


def naive_thinning(occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Zhang and Suen's passes, cell by cell over the whole grid until nothing changes."""
    cells = np.pad(occupied, 1).astype(int)
    while True:
        before = cells.copy()
        for second in (False, True):
            going = []
            for r, c in np.argwhere(cells):
                n, ne, e, se = (
                    cells[r + 1, c],
                    cells[r + 1, c + 1],
                    cells[r, c + 1],
                    cells[r - 1, c + 1],
                )
                s, sw, w, nw = (
                    cells[r - 1, c],
                    cells[r - 1, c - 1],
                    cells[r, c - 1],
                    cells[r + 1, c - 1],
                )
                ring = [n, ne, e, se, s, sw, w, nw]
                changes = sum(a == 0 and b == 1 for a, b in zip(ring, [*ring[1:], n], strict=True))
                keeps = (n * e * w, n * s * w) if second else (n * e * s, e * s * w)
                if 2 <= sum(ring) <= 6 and changes == 1 and keeps == (0, 0):
                    going.append((r, c))
            for r, c in going:
                cells[r, c] = 0
        if (cells == before).all():
            return cells[1:-1, 1:-1].astype(bool)


def walls(lines, cosine, across_m, gap_m):
    """The wall of each line (points, start, end, along), all points of a wall looked at anew."""
    found, numbers = [], []  # of a wall: its points, its direction, its two ends
    for points, start, end, along in lines:
        best = None
        for k, (of_wall, direction, ends) in enumerate(found):
            middle = np.concatenate(of_wall).mean(axis=0)
            normal = np.array([-direction[1], direction[0]])
            off = max(abs((place - middle) @ normal) for place in (start, end))
            t, own = (
                [float((p - middle) @ direction) for p in two] for two in ((start, end), ends)
            )
            gap = max(min(t) - max(own), min(own) - max(t))
            fits = direction @ along > cosine and off <= across_m and gap <= gap_m
            if fits and (best is None or off < best[0]):
                best = off, k
        if best is None:
            numbers.append(len(found))
            found.append([[points], along, (start, end)])
            continue
        numbers.append(best[1])
        wall = found[best[1]]
        wall[0].append(points)
        every = np.concatenate(wall[0])
        _, _, (direction, _) = np.linalg.svd(every - every.mean(axis=0), full_matrices=False)
        old_ends = wall[2]
        wall[1] = direction if direction @ wall[1] >= 0.0 else -direction
        t = [float((p - every.mean(axis=0)) @ wall[1]) for p in (*old_ends, start, end)]
        wall[2] = tuple(every.mean(axis=0) + at * wall[1] for at in (min(t), max(t)))
    return numbers
