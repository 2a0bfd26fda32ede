"""`saturating` and `pooled` in one go: what one reading after the other gives, in any order."""

from __future__ import annotations

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID
from test_mapping_batch_counts import SEVERAL, random_readings

from mapping.batches import adder_of, adders
from mapping.grid import GridGeometry
from mapping.kernels.batch import threads as shares
from mapping.readings import Readings
from mapping.sensor_model import make_temp_grid
from mapping.tracks import Motions
from mapping.update_rules import start

RULES = ("saturating", "pooled")
WIDE = GridGeometry((-1.0, -0.8), 0.0125, 132, 1200)


def placed(beams, which, order=None):
    """Beams as placed readings, in another order where one is given."""
    order = range(len(beams)) if order is None else order
    beams, which = [beams[k] for k in order], [which[k] for k in order]
    poses = [b.world_from_sensor for b in beams]
    at = Motions(*(np.array([getattr(p, name) for p in poses]) for name in
                   ("x_m", "y_m", "heading_rad")))  # fmt: skip
    n = len(beams)
    return Readings(
        tuple(SEVERAL), 0, np.arange(n), np.array(which), at, at, np.arange(n + 1), np.zeros(n),
        np.array([b.ranges_m[0] for b in beams]), np.array([b.reach_m for b in beams]),
    )  # fmt: skip


def by_kernels(rule, readings, threads=1):
    """A map of all readings, each sensor's in one go."""
    state = start(rule, GRID)
    numbers = list(range(len(SEVERAL)))
    known = adders(state.rule, SEVERAL, numbers)
    for name, adder in known.items():
        mine = [n for n in numbers if adder_of(state.rule, SEVERAL, n) == name]
        rows = np.flatnonzero(np.isin(readings.sensor, mine))
        state.merge_many(
            lambda target, adder=adder, rows=rows: adder.add(target, readings, rows, threads)
        )
    return state


def slowly(rule, beams, which):
    """The same from temp grids, one after the other."""
    state = start(rule, GRID)
    for beam, k in zip(beams, which, strict=True):
        state.merge(make_temp_grid(beam, SEVERAL[k], GRID))
    return state


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("threads", [1, 3])
def test_sums_are_those_of_one_reading_after_the_other(rule, threads, monkeypatch):
    monkeypatch.setattr(shares, "_WORTH", 0.0)
    beams, which, _ = random_readings(3)
    slow, fast = slowly(rule, beams, which), by_kernels(rule, placed(beams, which), threads)
    for name, expected in slow.cells.items():
        assert (expected != slow.rule.start[name]).any(), name
        # A temp grid holds a probability, whose log-odds may round to the next step.
        most = len(beams) * 2.0**-24 if name.startswith("evidence") else 0.0
        assert np.abs(fast.cells[name] - expected).max() <= most, name
    np.testing.assert_array_equal(fast.layer("").observed, slow.layer("").observed)


@pytest.mark.parametrize("rule", RULES)
def test_any_order_and_any_parts_give_the_same_bytes(rule):
    beams, which, _ = random_readings(4)
    order = np.random.default_rng(4).permutation(len(beams)).tolist()
    one, other = (
        by_kernels(rule, placed(beams, which)),
        by_kernels(rule, placed(beams, which, order)),
    )
    for name, array in one.cells.items():
        assert array.tobytes() == other.cells[name].tobytes(), name
    halves = [by_kernels(rule, placed(beams, which, half)) for half in (order[:99], order[99:])]
    for name, array in one.cells.items():
        a, b = (half.cells[name] for half in halves)
        both = np.minimum(a, b) if name.startswith("nearest") else a + b
        assert both.tobytes() == array.tobytes(), name


def test_the_cell_of_an_obstacle_is_the_band_and_nothing_else():
    """A thin beam, whose band holds no cell's centre: what ran through the cell does not count."""
    beam = cases.beam_of(0.026, 0.026, 0.0, 0.52, SEVERAL[1])
    state = by_kernels("pooled", placed([beam], [1]))
    row, col = GRID.cells_of(np.array([[0.546, 0.026]]))[0]
    assert state.cells["hits"][row, col] > 0.0
    assert state.cells["on_arc"][row, col] == 1.0
    assert state.cells["misses"][row, col] == 0.0
    assert np.count_nonzero(state.cells["hits"]) == 1


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("grid", [GRID, WIDE])
def test_readings_in_tiles_are_those_of_one_after_the_other(rule, grid):
    """So many readings that they go to tiles first, and fill them more than once; of a wide grid
    block by block."""
    beams, which, _ = random_readings(5)
    readings = placed(beams, which)
    still = np.zeros(700, np.int64)  # one place: its sums grow past what a tile holds
    rows = np.concatenate([np.arange(len(beams)), still, np.arange(len(beams))])
    few, many = start(rule, grid), start(rule, grid)
    numbers = list(range(len(SEVERAL)))
    for name, adder in adders(few.rule, SEVERAL, numbers).items():
        mine = [n for n in numbers if adder_of(few.rule, SEVERAL, n) == name]
        own = rows[np.isin(readings.sensor[rows], mine)]
        many.merge_many(lambda target, adder=adder, own=own: adder.add(target, readings, own, 1))
        for row in own:  # one reading is added cell by cell
            few.merge_many(
                lambda target, adder=adder, row=row: adder.add(target, readings, np.array([row]), 1)
            )
    for name, array in few.cells.items():
        np.testing.assert_array_equal(many.cells[name], array, err_msg=name)
    np.testing.assert_array_equal(many.layer("").observed, few.layer("").observed)
