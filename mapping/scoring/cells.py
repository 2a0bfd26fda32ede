"""How right the cells of a map are, where their truth is known and could be observed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from mapping.scoring.truth import Floats, Truth

Flags = NDArray[np.bool_]

HELD = 0.001  # probabilities are held this far from 0 and 1: no cell decides alone
OCCUPIED = 0.6  # above it, a cell is taken as a wall where walls are looked for
NEAR_M = 0.04
WALL_STEP_M = 0.01
_FINE_M = 0.002
_MOST_SAMPLES = 2_000_000
_BIN_EDGES = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0])


@dataclass(frozen=True, slots=True)
class CalibrationBin:
    """Cells of about one probability: how many, their mean, and how many of them are walls.

    ``occupied`` is the share of walls when all walls weigh as much as all that is free, as the
    map's own prior of one half has it.
    """

    cells: int
    probability: float
    occupied: float


@dataclass(frozen=True, slots=True)
class CellScore:
    """How right a layer is. NaN where there is nothing to judge.

    Log-loss (natural logarithm) and Brier score are the means of those of the free and of the wall
    cells, so that both weigh as much; lower is better, undecided everywhere is 0.693 and 0.25.
    ``wall_distance_*`` is how far cells taken as walls lie from the nearest wall; ``wall_found``
    the share of the seen wall with such a cell within 4 cm; ``ghost_m2`` how much is taken as a
    wall where nothing could be seen. ``glass_m`` is how much glass, by length, light went through:
    it gives no echo and is not judged.
    """

    free_cells: int
    wall_cells: int
    log_loss: float
    log_loss_free: float
    log_loss_walls: float
    brier: float
    auc: float
    iou: float
    calibration_error: float
    calibration: tuple[CalibrationBin, ...]
    wall_distance_median_m: float
    wall_distance_p95_m: float
    wall_found: float
    ghost_m2: float
    glass_m: float = 0.0


def score_cells(
    probability: NDArray[np.floating], geometry: GridGeometry, truth: Truth, seen: Flags
) -> CellScore:
    """Judge a layer (rows, cols) over the cells that could be ``seen`` (rows, cols)."""
    p = np.clip(np.nan_to_num(np.asarray(probability, np.float64), nan=0.5), 0.0, 1.0)
    walls = truth.wall_cells(geometry)
    free_p, wall_p = p[seen & ~walls], p[seen & walls]
    loss_free, loss_walls = _log_loss(1.0 - free_p), _log_loss(wall_p)
    taken = p > OCCUPIED
    union = int((seen & (walls | taken)).sum())
    bins, error = calibration(free_p, wall_p)
    median_m, p95_m = _distances(taken, geometry, truth)
    return CellScore(
        free_cells=len(free_p),
        wall_cells=len(wall_p),
        log_loss=(loss_free + loss_walls) / 2.0,
        log_loss_free=loss_free,
        log_loss_walls=loss_walls,
        brier=(_mean(free_p**2) + _mean((1.0 - wall_p) ** 2)) / 2.0,
        auc=area_under_curve(free_p, wall_p),
        iou=int((seen & walls & taken).sum()) / union if union else math.nan,
        calibration_error=error,
        calibration=bins,
        wall_distance_median_m=median_m,
        wall_distance_p95_m=p95_m,
        wall_found=_found(taken, geometry, truth, seen & walls),
        ghost_m2=float((taken & ~seen & ~walls).sum()) * geometry.resolution_m**2,
        glass_m=_glass(geometry, truth, seen),
    )


def log_loss_of(probability: Floats, walls: Flags, seen: Flags) -> float:
    """The log-loss alone, of a layer (rows, cols) over the cells that could be seen."""
    return (_log_loss(1.0 - probability[seen & ~walls]) + _log_loss(probability[seen & walls])) / 2


def area_under_curve(free_p: Floats, wall_p: Floats) -> float:
    """The chance that a wall cell has the higher probability of two, ties half (Mann-Whitney)."""
    if not len(free_p) or not len(wall_p):
        return math.nan
    ordered = np.sort(free_p)
    below = np.searchsorted(ordered, wall_p, "left")
    up_to = np.searchsorted(ordered, wall_p, "right")
    return float((below + up_to).mean()) / (2.0 * len(free_p))


def calibration(free_p: Floats, wall_p: Floats) -> tuple[tuple[CalibrationBin, ...], float]:
    """Cells by their probability, and the mean gap between it and the share of walls (ECE)."""
    if not len(free_p) or not len(wall_p):
        return (), math.nan
    p = np.concatenate([free_p, wall_p])
    weight = np.repeat([0.5 / len(free_p), 0.5 / len(wall_p)], [len(free_p), len(wall_p)])
    of = np.minimum(np.searchsorted(_BIN_EDGES, p, "right") - 1, len(_BIN_EDGES) - 2)
    count = np.bincount(of, minlength=len(_BIN_EDGES) - 1)
    total = np.bincount(of, weight)
    walls = np.bincount(of, np.where(np.arange(len(p)) < len(free_p), 0.0, weight))
    mean = np.bincount(of, weight * p)
    there = np.flatnonzero(count)
    bins = tuple(
        CalibrationBin(int(count[k]), float(mean[k] / total[k]), float(walls[k] / total[k]))
        for k in there
    )
    return bins, float(np.abs(mean[there] - walls[there]).sum())


def _log_loss(right: Floats) -> float:
    return _mean(-np.log(np.clip(right, HELD, 1.0 - HELD)))


def _mean(values: Floats) -> float:
    return float(values.mean()) if len(values) else math.nan


def _distances(taken: Flags, geometry: GridGeometry, truth: Truth) -> tuple[float, float]:
    """Median and 95th percentile of how far occupied cells' centres are from the nearest wall."""
    from scipy.spatial import cKDTree

    if not taken.any() or not len(truth.walls_m):
        return math.nan, math.nan
    length_m = float(np.linalg.norm(np.diff(truth.walls_m, axis=1), axis=-1).sum())
    step_m = max(_FINE_M, length_m / _MOST_SAMPLES)
    walls = cKDTree(along(truth.walls_m, step_m)[0])
    away_m, _ = walls.query(geometry.centres_of(np.argwhere(taken)))
    median_m, p95_m = np.percentile(away_m, [50.0, 95.0])
    return float(median_m), float(p95_m)


def _found(taken: Flags, geometry: GridGeometry, truth: Truth, seen_walls: Flags) -> float:
    """The share of the seen wall that has an occupied cell near by."""
    from scipy.spatial import cKDTree

    places_m = along(truth.walls_m, WALL_STEP_M)[0]
    places_m = places_m[lies_on(places_m, seen_walls, geometry)]
    if not len(places_m):
        return math.nan
    if not taken.any():
        return 0.0
    cells = cKDTree(geometry.centres_of(np.argwhere(taken)))
    return float((cells.query(places_m)[0] <= NEAR_M + 1e-9).mean())


def _glass(geometry: GridGeometry, truth: Truth, seen: Flags) -> float:
    """The length of the glass that was not seen itself, though what lies on both its sides was."""
    places_m, along_rad, _ = along(truth.glass_m, WALL_STEP_M)
    normal = np.column_stack([-np.sin(along_rad), np.cos(along_rad)])
    beside_m = 1.5 * geometry.resolution_m * normal
    itself, left, right = (
        looked_up(seen, places_m + off_m, geometry) for off_m in (0.0, beside_m, -beside_m)
    )
    return float((left & right & ~itself).sum()) * WALL_STEP_M


def looked_up(cells: Flags, places_m: Floats, geometry: GridGeometry) -> Flags:
    """What cells (rows, cols) hold at places (N, 2) in metres; nothing outside the grid."""
    at = geometry.cells_of(places_m)
    inside = geometry.contains(at)
    found = np.zeros(len(at), np.bool_)
    found[inside] = cells[at[inside, 0], at[inside, 1]]
    return found


def along(pieces_m: Floats, step_m: float) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Places along pieces (K, 2, 2) about ``step_m`` apart: where, in which direction, of which.

    (N, 2) metres, (N,) radians, (N,) numbers of pieces. The ends are half a step off.
    """
    way = pieces_m[:, 1] - pieces_m[:, 0]
    counts = np.maximum(np.rint(np.hypot(way[:, 0], way[:, 1]) / step_m).astype(np.int64), 1)
    of = np.repeat(np.arange(len(pieces_m)), counts)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])[of] if len(counts) else of
    share = (np.arange(len(of)) - first + 0.5) / counts[of]
    places_m = pieces_m[of, 0] + share[:, None] * way[of]
    return places_m, np.arctan2(way[of, 1], way[of, 0]), of


def lies_on(places_m: Floats, cells: Flags, geometry: GridGeometry) -> Flags:
    """Which places (N, 2) lie in one of the cells (rows, cols) or beside it."""
    from scipy.ndimage import binary_dilation

    near: Flags = binary_dilation(cells, np.ones((3, 3), np.bool_))
    return looked_up(near, places_m, geometry)
