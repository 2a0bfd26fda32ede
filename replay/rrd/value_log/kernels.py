"""What a reading does to the cells that it covers, as a recording predicts it.

The sums are those of a twin in plain numpy, in the same order, and nothing is fused or reordered:
the same bits come out on every machine, and of a file that was written without these kernels.
Cells are flat indices into the whole grid, ``inner`` ones into a reading's window, both in row
order: first those in front, then those of the band, then others that changed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


@njit(cache=True, error_model="numpy", nogil=True)
def covered_cells(
    free: Flags, band: Flags, others: Flags, row0: int, col0: int, grid_cols: int
) -> tuple[Integers, Integers, int, int]:
    """The cells marked in a window whose first cell is (row0, col0): in the grid, in the window.

    Also how many of them lie in front and how many in the band.
    """
    rows, cols = free.shape
    in_front = in_band = in_others = 0
    for row in range(rows):
        for col in range(cols):
            in_front += free[row, col]
            in_band += band[row, col]
            in_others += others[row, col]
    cells = np.empty(in_front + in_band + in_others, np.int64)
    inner = np.empty(cells.size, np.int64)
    next_front, next_band, next_other = 0, in_front, in_front + in_band
    for row in range(rows):
        first = (row + row0) * grid_cols + col0
        for col in range(cols):
            if free[row, col]:
                cells[next_front], inner[next_front] = first + col, row * cols + col
                next_front += 1
            if band[row, col]:
                cells[next_band], inner[next_band] = first + col, row * cols + col
                next_band += 1
            if others[row, col]:
                cells[next_other], inner[next_other] = first + col, row * cols + col
                next_other += 1
    return cells, inner, in_front, in_band


@njit(cache=True, error_model="numpy", nogil=True)
def other_changes(
    new: NDArray[np.uint32], all_old: NDArray[np.uint32], free: Flags, band: Flags, row0: int,
    col0: int,
) -> Flags:  # fmt: skip
    """The cells of a window, marked neither ``free`` nor ``band``, whose bits became others.

    ``new`` covers the window, whose first cell is (row0, col0), ``all_old`` the grid.
    """
    rows, cols = new.shape
    others = np.zeros((rows, cols), np.bool_)
    for row in range(rows):
        for col in range(cols):
            if new[row, col] != all_old[row0 + row, col0 + col]:
                others[row, col] = not (free[row, col] or band[row, col])
    return others


@njit(cache=True, error_model="numpy", nogil=True)
def some_of(free: Flags, most: int) -> Integers:
    """About ``most`` of the cells marked in a window, evenly, as flat indices into it; 0: all."""
    marked = free.ravel()
    count = 0
    for k in range(marked.size):
        count += marked[k]
    every = max(1, count // most) if most > 0 else 1
    chosen = np.empty(-(-count // every), np.int64)
    seen = found = 0
    for k in range(marked.size):
        if marked[k]:
            if seen % every == 0:
                chosen[found] = k
                found += 1
            seen += 1
    return chosen


@njit(cache=True, error_model="numpy", nogil=True)
def distances_m(
    cells: Integers, grid_cols: int, size_m: float, to_x_m: float, to_y_m: float
) -> Floats:
    """From a sensor to the centres of cells (N,) in ascending order.

    ``to_x_m`` and ``to_y_m`` lead from the sensor to the grid's origin.
    """
    distances = np.empty(cells.size)
    row = cells[0] // grid_cols if cells.size else 0
    for k in range(cells.size):
        col = cells[k] - row * grid_cols
        while col >= grid_cols:  # a division for each cell would take longer than all the rest
            col, row = col - grid_cols, row + 1
        dx = (col + 0.5) * size_m + to_x_m
        dy = (row + 0.5) * size_m + to_y_m
        distances[k] = math.sqrt(dx * dx + dy * dy)
    return distances


@njit(cache=True, error_model="numpy", nogil=True)
def factor_at(cubics: Floats, spacing_m: float, distance: float) -> float:
    """A table's factor, of its cubics (K, 4), at a distance; 1 beyond its end."""
    at = distance / spacing_m - 1.0
    piece = int(max(at, 0.0))
    if piece >= cubics.shape[0]:
        return 1.0
    u, c = at - piece, cubics[piece]
    factor: float = ((c[3] * u + c[2]) * u + c[1]) * u + c[0]
    return factor


@njit(cache=True, error_model="numpy", nogil=True)
def share_fitting(
    cubics: Floats, spacing_m: float, distances: Floats, factors: Floats, tolerance: float
) -> float:
    """The share of samples (N,) that a table gives back, up to a relative tolerance."""
    fitting = 0
    for k in range(distances.size):
        off = abs(factor_at(cubics, spacing_m, distances[k]) - factors[k])
        fitting += off <= tolerance * factors[k]
    return fitting / distances.size


@njit(cache=True, error_model="numpy", nogil=True)
def odds_of(value: float, is_odds: bool) -> float:
    """The odds that a layer's value stands for."""
    return value if is_odds else value / (1.0 - value)


@njit(cache=True, error_model="numpy", nogil=True)
def front_factors(cubics: Floats, spacing_m: float, distances: Floats) -> Floats:
    """A table's factors at distances (N,)."""
    factors = np.empty(distances.size)
    for k in range(distances.size):
        factors[k] = factor_at(cubics, spacing_m, distances[k])
    return factors


@njit(cache=True, error_model="numpy", nogil=True)
def predict(
    cells: Integers, front_factors: Floats, band_factors: Floats, odds: Floats, values: Singles,
    is_odds: bool, largest: float,
) -> tuple[Floats, Singles]:  # fmt: skip
    """Odds and values of the cells after a reading, from those of all cells before it.

    ``odds`` of 0 are known but from the value. Cells beyond those with factors keep their odds.
    """
    lowest, in_front = 1.0 / largest, front_factors.size
    after, predicted = np.empty(cells.size), np.empty(cells.size, np.float32)
    for k in range(cells.size):
        factor = 1.0
        if k < in_front:
            factor = front_factors[k]
        elif k - in_front < band_factors.size:
            factor = band_factors[k - in_front]
        now = odds[cells[k]]
        if now == 0.0:
            now = odds_of(np.float64(values[cells[k]]), is_odds)
        now *= factor
        if now < lowest:
            now = lowest
        elif now > largest:
            now = largest
        after[k] = now
        predicted[k] = np.float32(now if is_odds else now / (1.0 + now))
    return after, predicted


@njit(cache=True, error_model="numpy", nogil=True)
def settle(
    cells: Integers, after: Floats, predicted: Singles, missed: Integers, true: Singles,
    distance_bits: Integers, odds: Floats, values: Singles, is_odds: bool,
) -> None:  # fmt: skip
    """Write what was predicted into all odds and values; ``missed`` cells get ``true`` instead.

    ``distance_bits`` is how many bit patterns lie between the two: of one, the odds were at the
    border between both values, nearly; else they are not known. ``after`` and ``predicted`` become
    what was written.
    """
    for n in range(missed.size):
        k = missed[n]
        between = (np.float64(predicted[k]) + np.float64(true[n])) / 2.0
        after[k] = odds_of(between, is_odds) if distance_bits[n] <= 1 else 0.0
        predicted[k] = true[n]
    for k in range(cells.size):
        odds[cells[k]] = after[k]
        values[cells[k]] = predicted[k]


@njit(cache=True, error_model="numpy", nogil=True)
def follow_sums(
    cells: Integers, in_front: int, distances: Floats, sums: Floats, reading: Floats,
    formula: Floats,
) -> None:  # fmt: skip
    """Let the sums of cells grow by a reading; see :mod:`replay.rrd.value_log.sums`.

    ``distances`` (N,) are those of the cells from its sensor, ``sums`` (M, 8) those of all cells.
    """
    fade_m, near_m, middle_m = formula[10], formula[11], formula[12]
    share, arc_end_m, last_m, range_m = reading
    for k in range(cells.size):
        rho, cell = distances[k], cells[k]
        if k < in_front:
            faded = rho / fade_m
            sums[cell, 1] += np.rint(16777216.0 / (1.0 + faded * faded)) / 16777216.0
            sums[cell, 3] += rho > last_m
            sums[cell, 4] += rho < near_m
            sums[cell, 5] += near_m <= rho < middle_m
            sums[cell, 6] = min(sums[cell, 6], rho)
        else:
            sums[cell, 0] += share
            sums[cell, 2] += rho <= arc_end_m
            sums[cell, 7] = min(sums[cell, 7], range_m)


@njit(cache=True, error_model="numpy", nogil=True)
def ln_of_one_plus(x: float, logarithms: Floats) -> float:
    """ln(1 + x) of a sum, which is not below 0."""
    if x == 0.0:
        return 0.0
    m, power = math.frexp(1.0 + x)
    place = int((m - 0.5) * 1024.0 + 0.5)
    r = m * logarithms[place, 1] - 1.0
    rest = r * (1.0 - r * (0.5 - r * (1.0 / 3.0 - r * (0.25 - r * 0.2))))
    total: float = power * 0.6931471805599453 + (logarithms[place, 0] + rest)
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def values_of_sums(
    cells: Integers, sums: Floats, formula: Floats, logarithms: Floats, curve: Floats
) -> Singles:
    """What the sums (M, 8) of all cells stand for in some of them, (N,).

    The third to the sixth of the sums are counts; the curve's cubics reach from totals -64 to 64.
    """
    values, pieces = np.empty(cells.size, np.float32), curve.shape[0]
    most_unpassed, least = formula[9], formula[13]
    of_counts = np.empty(256)  # most cells have no more of any kind
    for many in range(of_counts.size):
        of_counts[many] = ln_of_one_plus(float(many), logarithms)
    for k in range(cells.size):
        cell, total = cells[k], formula[8]
        total += formula[0] * ln_of_one_plus(sums[cell, 0], logarithms)
        total += formula[1] * ln_of_one_plus(sums[cell, 1], logarithms)
        for n in range(2, 6):
            many = int(sums[cell, n])
            if many < of_counts.size:
                total += formula[n] * of_counts[many]
            else:
                total += formula[n] * ln_of_one_plus(sums[cell, n], logarithms)
        total += formula[6] * sums[cell, 6]
        total += formula[7] * sums[cell, 7]
        total *= min((sums[cell, 0] + sums[cell, 1]) / least, 1.0)
        if sums[cell, 0] == 0.0:
            total = min(total, 0.0)
        if sums[cell, 1] == 0.0:
            total = min(max(total, 0.0), most_unpassed)
        at = min(max((total + 64.0) * (pieces / 128.0), 0.0), pieces)
        piece = min(int(at), pieces - 1)
        u, c = at - piece, curve[piece]
        values[k] = np.float32(((c[3] * u + c[2]) * u + c[1]) * u + c[0])
    return values
