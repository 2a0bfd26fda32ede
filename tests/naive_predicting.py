"""Slow, obvious twins of the kernels behind a recording: whole arrays, plain numpy."""

from __future__ import annotations

import numpy as np


def covered_cells(
    free: np.ndarray, band: np.ndarray, others: np.ndarray, row0: int, col0: int, grid_cols: int
) -> tuple[np.ndarray, np.ndarray, int, int]:
    """Each mask's cells, one mask after the other."""
    inner = np.concatenate([np.flatnonzero(mask) for mask in (free, band, others)])
    row, col = np.divmod(inner, free.shape[1])
    return (row + row0) * grid_cols + col + col0, inner, int(free.sum()), int(band.sum())


def some_of(free: np.ndarray, most: int) -> np.ndarray:
    marked = np.flatnonzero(free)
    return marked[:: max(1, len(marked) // most)] if most else marked


def distances_m(
    cells: np.ndarray, grid_cols: int, size_m: float, to_x_m: float, to_y_m: float
) -> np.ndarray:
    row, col = np.divmod(cells, grid_cols)
    dx, dy = (col + 0.5) * size_m + to_x_m, (row + 0.5) * size_m + to_y_m
    return np.sqrt(dx * dx + dy * dy)


def odds_of(values: np.ndarray, is_odds: bool) -> np.ndarray:
    return values if is_odds else values / (1.0 - values)


def predict(
    cells: np.ndarray, free: np.ndarray, band: np.ndarray, odds: np.ndarray, values: np.ndarray,
    is_odds: bool, largest: float,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    factors = np.concatenate([free, band, np.ones(len(cells) - len(free) - len(band))])
    known = odds[cells]
    before = np.where(known == 0.0, odds_of(values[cells].astype(np.float64), is_odds), known)
    after = np.clip(before * factors, 1.0 / largest, largest)
    return after, (after if is_odds else after / (1.0 + after)).astype(np.float32)


def changes_of(before: np.ndarray, after: np.ndarray) -> tuple[int, int, int, int, int, int]:
    difference = after - before
    return (
        int((after != before).sum()), int((difference > 0).sum()), int((difference < 0).sum()),
        int(np.argmax(np.abs(difference))), int((after > 0.5).sum()), int((after < 0.5).sum()),
    )  # fmt: skip


def strength_classes(difference: np.ndarray, marked: np.ndarray, edges: np.ndarray) -> np.ndarray:
    level = sum((np.abs(difference) >= edge).astype(np.uint8) for edge in edges)
    level = level + (difference > 0) * np.uint8(len(edges))
    return np.where(marked, level, 0).astype(np.uint8)


def tiles_that_differ(
    old: np.ndarray, new: np.ndarray, row0: int, col0: int, side: int
) -> set[tuple[int, int]]:
    """``old`` and ``new`` cover the same window."""
    return {((r + row0) // side, (c + col0) // side) for r, c in np.argwhere(old != new).tolist()}


def look_up(cubics: np.ndarray, spacing_m: float, distance_m: np.ndarray) -> np.ndarray:
    """Factors at distances (N,) of a table's cubics; 1 beyond its end."""
    # The first cubic starts at knot 1 and serves the distances before it, too.
    at = distance_m / spacing_m - 1.0
    piece = np.maximum(at, 0.0).astype(np.int64)
    inside = piece < len(cubics)
    np.minimum(piece, len(cubics) - 1, out=piece)
    u = at - piece
    c = cubics[piece]
    factor = ((c[:, 3] * u + c[:, 2]) * u + c[:, 1]) * u + c[:, 0]
    if not inside.all():
        factor[~inside] = 1.0
    return factor
