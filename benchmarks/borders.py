"""Border tracing against OpenCV: is it equal, and how long does it take?

    python -m benchmarks.borders [--seed N] [--size CELLS]

Both trace the same maps in turn; OpenCV gets its image ready made. Needs opencv-python-headless.
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.timing import best_times_s
from mapping.borders import trace_borders


def maps(size: int, seed: int) -> dict[str, NDArray[np.bool_]]:
    """Large grids: smooth figures, a flat with one-cell walls, and cells at random."""
    rng = np.random.default_rng(seed)
    field = gaussian_filter(rng.normal(size=(size, size)), 6.0)
    rooms = np.zeros((size, size), np.bool_)
    for _ in range(size // 5):
        row, col = rng.integers(0, size - 20, 2)
        high, wide = rng.integers(10, max(size // 6, 11), 2)
        bottom, right = min(row + high, size - 1), min(col + wide, size - 1)
        rooms[[row, bottom], col : right + 1] = True
        rooms[row : bottom + 1, [col, right]] = True
    return {
        "blobs": field > np.quantile(field, 0.7),
        "rooms, one-cell walls": rooms,
        "random, 5 % black": rng.random((size, size)) < 0.05,
        "one figure in a corner": _corner_figure(size),
        "empty": np.zeros((size, size), np.bool_),
    }


def _corner_figure(size: int) -> NDArray[np.bool_]:
    grid = np.zeros((size, size), np.bool_)
    grid[: size // 20, : size // 20] = True
    return grid


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", type=int, default=1000)
    options = parser.parse_args()
    print(f"{options.size} x {options.size} cells, OpenCV {cv2.__version__}, best of 15, ms")
    print(f"{'map':<24}{'borders':>9}{'visits':>9}{'OpenCV':>9}{'ours':>9}{'ratio':>8}  equal")
    for name, grid in maps(options.size, options.seed).items():
        screen = np.ascontiguousarray(grid[::-1]).astype(np.uint8)

        def theirs(screen: NDArray[np.uint8] = screen) -> object:
            return cv2.findContours(screen, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)

        def ours(grid: NDArray[np.bool_] = grid) -> object:
            return trace_borders(grid)

        times = best_times_s({"theirs": theirs, "ours": ours})
        borders = trace_borders(grid)
        contours, _ = cv2.findContours(screen, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        visits = sum(len(border.cells) for border in borders)
        same = len(borders) == len(contours) and visits == sum(len(c) for c in contours)
        print(
            f"{name:<24}{len(borders):>9}{visits:>9}{1e3 * times['theirs']:>9.2f}"
            f"{1e3 * times['ours']:>9.2f}{times['ours'] / times['theirs']:>8.2f}  {same}"
        )


if __name__ == "__main__":
    main()
