"""The score of a hypothesis: maps of the readings as it has them, each reading by those of others.

The maps are the default ones, whatever is configured: it is the session that is on trial. Log-odds
add up, so that the map without a fold is the whole less the fold's own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapping.config_sections import GridSection
from mapping.grid import GridGeometry
from mapping.layer_map import empty_maps
from mapping.readings import Readings
from mapping.scoring.held_out import FOLDS, Judged, as_occupied, judge
from recorder.columns import Ints


def score(
    readings: Readings,
    block: Ints,
    blocks: int,
    geometry: GridGeometry,
    *,
    together: bool,
    threads: int = 1,
) -> Judged:
    """Each reading by the map of the others; by that of all sensors ``together``, or of its own."""
    occupied = occupied_by_others(
        readings, block, blocks, geometry, together=together, threads=threads
    )
    return judge(readings, block, blocks, geometry, occupied)


def occupied_by_others(
    readings: Readings,
    block: Ints,
    blocks: int,
    geometry: GridGeometry,
    *,
    together: bool = False,
    threads: int = 1,
) -> dict[str, NDArray[np.float32]]:
    """By layer, (F, rows, cols): the maps without the blocks of fold f, as :func:`judge` takes
    them."""
    folds = min(FOLDS, blocks)
    fold = block % folds
    stacks: dict[str, NDArray[np.float32]] = {}
    for k in range(folds):
        maps = empty_maps(readings.sensors, geometry, GridSection(), threads=threads)
        some = readings.chosen(fold == k)
        for name, each in maps.items():
            each.merge_many(some)
            odds = each.state.cells["log_odds"].astype(np.float32)
            stacks.setdefault(name, np.empty((folds, *odds.shape), np.float32))[k] = odds
    if together:
        whole = sum(stacks.values())
        stacks = dict.fromkeys(stacks, np.asarray(whole))
    occupied = {}
    for name, odds in stacks.items():
        others = odds.sum(axis=0) - odds
        occupied[name] = as_occupied(1.0 / (1.0 + np.exp(-others)), geometry.resolution_m)
    return occupied
