"""Grids to trace: four classes drawn at random, and small figures known by heart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter


def random_grid(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Every cell for itself."""
    shape = rng.integers(1, 24, 2)
    return rng.random(shape) < rng.uniform(0.05, 0.95)


def blobs(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Smooth figures with smooth holes."""
    field = gaussian_filter(rng.normal(size=tuple(rng.integers(12, 40, 2))), rng.uniform(0.8, 2.5))
    return field > np.quantile(field, rng.uniform(0.3, 0.9))


def thin_rooms(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Rectangles of walls one cell thick, over each other, with some cells missing."""
    grid = np.zeros(tuple(rng.integers(12, 40, 2)), np.bool_)
    for _ in range(rng.integers(1, 7)):
        r = np.sort(rng.integers(0, grid.shape[0], 2))
        c = np.sort(rng.integers(0, grid.shape[1], 2))
        grid[r, c[0] : c[1] + 1] = True
        grid[r[0] : r[1] + 1, c] = True
    return grid & (rng.random(grid.shape) >= rng.choice([0.0, 0.0, 0.02, 0.1]))


def thin_lines(rng: np.random.Generator) -> NDArray[np.bool_]:
    """Lines one cell thick, in any direction, crossing each other."""
    grid = np.zeros(tuple(rng.integers(8, 36, 2)), np.bool_)
    for _ in range(rng.integers(1, 8)):
        a, b = rng.uniform(0, np.array(grid.shape) - 1, (2, 2))
        steps = int(np.abs(b - a).max()) + 1
        cells = np.round(np.linspace(a, b, steps + 1)).astype(int)
        grid[cells[:, 0], cells[:, 1]] = True
    return grid


CLASSES = {"random": random_grid, "blobs": blobs, "rooms": thin_rooms, "lines": thin_lines}

# Drawn as seen, y up: the first line is the highest row. Then for each border whether it is outer,
# how many cells it has and how many it visits.
FIGURES: dict[str, tuple[str, list[tuple[bool, int, int]]]] = {
    "single": ("#", [(True, 1, 1)]),
    "pair": ("##", [(True, 2, 2)]),
    "line5": ("#####", [(True, 5, 8)]),
    "diagonal3": ("..#/.#./#..", [(True, 3, 4)]),
    "square3": ("###/###/###", [(True, 8, 8)]),
    "ring3": ("###/#.#/###", [(True, 8, 8), (False, 4, 4)]),
    "diamond": (".#./#.#/.#.", [(True, 4, 4), (False, 4, 4)]),
    "ring_thick_right": ("####/#.##/####", [(True, 10, 10), (False, 4, 4)]),
    "two_rings_sharing_a_cell": (
        "###../#.#../#####/..#.#/..###",
        [(True, 14, 14), (False, 4, 4), (False, 4, 4)],
    ),
    "V": ("#.#/.#.", [(True, 3, 4)]),
    "T_up": ("###/.#.", [(True, 4, 4)]),
    "plus": (".#./###/.#.", [(True, 4, 4)]),
    "inverted_V": (".#./#.#", [(True, 3, 4)]),
    "inverted_V_long": ("..#../.#.#./#...#", [(True, 5, 8)]),
    "corner_of_three": (".##/#..", [(True, 3, 4)]),
    "two_rooms": (
        "#######/#..#..#/#..#..#/#######",
        [(True, 18, 18), (False, 8, 8), (False, 8, 8)],
    ),
    "nested": (
        "#######/#.....#/#.###.#/#.#.#.#/#.###.#/#.....#/#######",
        [(True, 24, 24), (False, 20, 20), (True, 8, 8), (False, 4, 4)],
    ),
    "whole_frame": ("####/#..#/#..#/####", [(True, 12, 12), (False, 8, 8)]),
}


def drawn(picture: str) -> NDArray[np.bool_]:
    """A picture, highest row first, as a grid with row 0 lowest."""
    rows = [[cell == "#" for cell in line] for line in picture.split("/")]
    return np.array(rows[::-1], np.bool_)
