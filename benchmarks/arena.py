"""How rectangular is the map of a rectangular arena? ``python -m benchmarks.arena LAYER.npz``.

Fits the four walls of a rectangle to the occupied cells of an exported layer (the share of cells
within 4 cm of a wall is made largest) and prints its size, that share, and the occupied extent
along the walls with and without the outermost cells.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

NEAR_M = 0.04
OUTER_PERCENTS = (2.0, 1.0)  # cells left out on each side: stray readings that missed a wall


@dataclass(frozen=True, slots=True)
class Arena:
    """A fitted rectangle: size along its own axes, and how well the cells agree with it."""

    size_m: tuple[float, float]
    turned_deg: float
    share_near: float
    extents_m: tuple[tuple[float, float], ...]  # without the outermost 2 and 1 % of each side
    centre_m: tuple[float, float]

    @property
    def walls_m(self) -> NDArray[np.float64]:
        """The four walls, (4, 2, 2), metres, map frame."""
        turn_rad, half = np.radians(self.turned_deg), np.array(self.size_m) / 2.0
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        placed = corners @ np.array([[c, s], [-s, c]]) + np.array(self.centre_m)
        return np.stack([placed, np.roll(placed, -1, axis=0)], axis=1)


def occupied_points(npz: Path, threshold: float) -> NDArray[np.float64]:
    """Centres of the occupied cells, (N, 2), metres."""
    with np.load(npz) as layer:
        rows, cols = np.nonzero(layer["values"] > threshold)
        return (np.column_stack([cols, rows]) + 0.5) * float(layer["resolution_m"]) + layer[
            "origin_m"
        ]


def fit_arena(points_m: NDArray[np.float64], seed: int = 0) -> Arena:
    """The rectangle whose four walls have the largest share of the points within 4 cm."""
    centre = points_m.mean(axis=0)
    extent = _extent(points_m - centre, OUTER_PERCENTS[0])

    def in_frame(turn_rad: float) -> NDArray[np.float64]:
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        return (points_m - centre) @ np.array([[c, -s], [s, c]])

    def share(x: NDArray[np.float64]) -> float:
        p = in_frame(x[0])
        low, high = x[1:3] - x[3:5] / 2, x[1:3] + x[3:5] / 2
        inside = (p > low - NEAR_M) & (p < high + NEAR_M)
        near = (np.abs(p - low) <= NEAR_M) | (np.abs(p - high) <= NEAR_M)
        on_x = near[:, 0] & inside[:, 1]
        on_y = near[:, 1] & inside[:, 0]
        return float((on_x | on_y).mean())

    # Walls close to the outline of what is occupied: boxes inside would draw them otherwise.
    bounds = [(-0.2, 0.2)] + [(-0.3 * v, 0.3 * v) for v in extent]
    bounds += [(0.8 * v, 1.1 * v) for v in extent]
    best = differential_evolution(lambda x: -share(x), bounds, seed=seed, popsize=30, maxiter=300)
    placed = in_frame(best.x[0])
    c, s = np.cos(best.x[0]), np.sin(best.x[0])
    middle = best.x[1:3] @ np.array([[c, s], [-s, c]]) + centre
    extents = [_extent(placed, percent) for percent in OUTER_PERCENTS]
    return Arena(
        (float(best.x[3]), float(best.x[4])), float(np.degrees(best.x[0])), -float(best.fun),
        tuple((float(x), float(y)) for x, y in extents), (float(middle[0]), float(middle[1])),
    )  # fmt: skip


def _extent(points_m: NDArray[np.float64], percent: float) -> NDArray[np.float64]:
    low, high = np.percentile(points_m, [percent, 100 - percent], axis=0)
    return high - low


def main() -> None:
    """Print the fit of one exported layer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("npz", type=Path)
    parser.add_argument("--threshold", type=float, default=0.55)
    arguments = parser.parse_args()
    points = occupied_points(arguments.npz, arguments.threshold)
    arena = fit_arena(points)
    print(f"{len(points)} occupied cells")
    print(f"walls {arena.size_m[0]:.3f} x {arena.size_m[1]:.3f} m, {arena.turned_deg:.1f} degrees")
    print(f"within 4 cm of a wall: {100 * arena.share_near:.1f} %")
    for percent, (width_m, height_m) in zip(OUTER_PERCENTS, arena.extents_m, strict=True):
        print(f"all but the outermost {percent:g} %: {width_m:.3f} x {height_m:.3f} m")


if __name__ == "__main__":
    main()
