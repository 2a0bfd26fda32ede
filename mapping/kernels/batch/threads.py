"""A batch on several threads: each owns rows of the map, so no bit changes. Does not load numba.

Readings of rangers are shared out by bands of neighbouring rows: what a reading needs besides its
cells is then done once, but for those on a border between two bands. Scans reach over half the map
and are shared out by every so-many-th row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from recorder.columns import Floats

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

    from mapping.kernels.batch.readings import Place, Readings

_LOOKED_AT = 1000  # readings, to see how much there is to do in which rows
_CELLS_A_ROW = 16.0  # what beginning a row costs, in cells
_CELLS_A_READING = 1000.0
_WORTH = 1.2e7  # cells, three milliseconds: with less another thread may cost more than it brings


def in_parts(kernel: Callable[..., None], *arguments: Any, threads: int = 1) -> None:
    """Run a kernel that takes ``part`` and ``parts`` last; the same bytes on any number of threads.

    The kernels let go of Python's lock, so the threads run side by side.
    """
    _side_by_side(kernel, arguments, [(part, threads) for part in range(threads)])


def in_bands(kernel: Callable[..., None], *arguments: Any, edges: Sequence[int]) -> None:
    """Run a kernel that takes the first row and the one after the last, a thread a band of rows.

    ``edges`` are those of :func:`band_edges`.
    """
    _side_by_side(kernel, arguments, list(pairwise(edges)))


def band_edges(
    beams: Readings, half_rad: Floats, place: Place, rows: int, threads: int
) -> list[int]:
    """Where to cut ``rows`` of a map so that each thread has as much to do: 0, ..., rows.

    ``half_rad`` (S,) is half the width of each sensor's beam. No cut where there is little to do.
    """
    every = -(-len(beams.x_m) // _LOOKED_AT)
    if threads <= 1 or not every:
        return [0, rows]
    half = half_rad[beams.sensor[::every]]
    reach = np.maximum(beams.front_end_m[::every], beams.band_end_m[::every]).clip(0.0)
    long = reach / place.size_m
    work = half * np.square(long) + _CELLS_A_ROW * long + _CELLS_A_READING
    if work.sum() * every < _WORTH:
        return [0, rows]
    heading = beams.heading_rad[::every]
    sines = np.sin(heading + np.stack([-half, 0.0 * half, half])) * long
    up, down = sines.max(0).clip(0.0), sines.min(0).clip(None, 0.0)
    middle = (beams.y_m[::every] - place.origin_y_m) / place.size_m - place.row0
    low, high = (middle + np.stack([down, up])).clip(0, rows).astype(np.int64)
    tall = np.maximum(high - low, 1)
    density = work / tall
    begun = np.bincount(low, density, rows + 2) - np.bincount(low + tall, density, rows + 2)
    done = np.cumsum(np.cumsum(begun))[:rows]
    cuts = np.searchsorted(done, done[-1] * np.arange(1, threads) / threads)
    return [0, *cuts.tolist(), rows]


def _side_by_side(
    kernel: Callable[..., None], arguments: Sequence[Any], shares: Sequence[tuple[int, int]]
) -> None:
    """One share here, the others beside it."""
    if len(shares) == 1:
        kernel(*arguments, *shares[0])
        return
    from concurrent.futures import wait

    others = [_pool(len(shares) - 1).submit(kernel, *arguments, *share) for share in shares[1:]]
    try:
        kernel(*arguments, *shares[0])
    finally:
        wait(others)
    for each in others:
        each.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Kept for the next stretch."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(threads, "echogrid-map")
