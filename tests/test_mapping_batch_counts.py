"""Counts, sums, masses and axes in one go: what one reading after the other gives."""

from __future__ import annotations

import math
from dataclasses import replace

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID, PING

from mapping.kernels.batch import axis, cellwise, counts
from mapping.kernels.batch.cell_tables import MASSES, SUM, CellSensor, tables_of
from mapping.kernels.batch.readings import BINARY, COUNT, NOTHING
from mapping.sensor_model import make_temp_grid, regions_table
from mapping.update_rules import start

SEVERAL = [
    replace(PING, model="regions"),
    replace(
        PING,
        model="regions",
        no_echo="empties",
        regions=18,
        gaussian="angle",
        beam_width_rad=0.05,
        range_error=0.0,
    ),
    replace(
        PING, model="peak", gaussian="distance", emptiness="linear", range_error=0.02, p_miss=0.2
    ),
    replace(PING, model="regions", gaussian="none", emptiness="none", beam_width_rad=4.0),
    replace(PING, model="fading", no_echo="empties"),
]


def random_readings(seed, count=250):
    draw = np.random.default_rng(seed)
    which = [int(k) for k in draw.integers(0, len(SEVERAL), count)]
    beams = []
    for n, k in enumerate(which):
        x, y = draw.uniform(-1, 1, 2)
        heading = draw.uniform(-7, 7)
        if n % 4 == 0:  # on the lattice, straight or diagonal
            x, y, heading = round(x * 20) / 20, round(y * 20) / 20, round(heading) * math.pi / 4
        d = cases.maybe_range(draw)
        beams.append(cases.beam_of(x, y, heading, d, SEVERAL[k]))
    return beams, which, cases.columns_of(beams, SEVERAL, which)


def one_by_one(rule, beams, which):
    state = start(rule, GRID)
    for beam, k in zip(beams, which, strict=True):
        state.merge(make_temp_grid(beam, SEVERAL[k], GRID))
    return state.cells, state.layer("made").observed


def band_table():
    says = [s.emptiness != "none" or s.model == "fading" for s in SEVERAL]
    return np.array([[s.beam_width_rad / 2, says[k]] for k, s in enumerate(SEVERAL)], float)


def cell_tables():
    return tables_of(
        [
            CellSensor(
                s.beam_width_rad,
                s.model,
                s.emptiness,
                s.hit,
                s.miss,
                s.near,
                s.fade_m,
                s.p_hit,
                s.p_miss,
                regions_table(s.regions) if s.gaussian in ("both", "angle") else np.ones(1),
                regions_table(s.regions) if s.gaussian in ("both", "distance") else np.ones(1),
            )
            for s in SEVERAL
        ]
    )


@pytest.mark.parametrize(("rule", "what"), [("count", COUNT), ("binary", BINARY)])
@pytest.mark.parametrize("parts", [1, 3])
def test_counts_are_those_of_one_reading_after_the_other(rule, what, parts):
    beams, which, readings = random_readings(1)
    expected, seen = one_by_one(rule, beams, which)
    values, observed = np.zeros(GRID.shape), np.zeros(GRID.shape, np.bool_)
    for band in cases.bands(GRID, parts):
        counts.add_bands(values, observed, cases.place(GRID), readings, band_table(), what, *band)
    (expected,) = expected.values()
    assert expected.any()
    np.testing.assert_array_equal(values, expected)
    np.testing.assert_array_equal(observed, seen)


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("rule", ["sum", "dempster-shafer"])
def test_sums_and_masses_are_those_of_one_reading_after_the_other(rule, parts):
    beams, which, readings = random_readings(2)
    expected, seen = one_by_one(rule, beams, which)
    is_sum = rule == "sum"
    cells = np.zeros((1 if is_sum else 4, *GRID.shape))
    if not is_sum:
        cells[2] = 1.0
    observed = np.zeros(GRID.shape, np.bool_)
    for band in cases.bands(GRID, parts):
        cellwise.add_cellwise(
            cells,
            observed,
            cases.place(GRID),
            readings,
            *cell_tables(),
            SUM if is_sum else MASSES,
            *band,
        )
    for got, array in zip(cells, expected.values(), strict=True):
        np.testing.assert_allclose(got, array, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(observed, seen)


def test_a_sum_of_regions_is_the_same_to_the_bit():
    beams, which, _ = random_readings(3)
    kept = [(b, k) for b, k in zip(beams, which, strict=True) if SEVERAL[k].model != "fading"]
    beams, which = [b for b, _ in kept], [k for _, k in kept]
    expected, _ = one_by_one("sum", beams, which)
    cells, observed = np.zeros((1, *GRID.shape)), np.zeros(GRID.shape, np.bool_)
    cellwise.add_cellwise(
        cells,
        observed,
        cases.place(GRID),
        cases.columns_of(beams, SEVERAL, which),
        *cell_tables(),
        SUM,
        0,
        GRID.rows,
    )
    np.testing.assert_array_equal(cells[0], expected["sum"])


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_himm_is_that_of_one_reading_after_the_other(seed):
    beams, which, readings = random_readings(seed)
    expected, seen = one_by_one("himm", beams, which)
    values, observed = np.zeros(GRID.shape), np.zeros(GRID.shape, np.bool_)
    place = cases.place(GRID)
    counts.add_bands(values, observed, place, readings, band_table(), NOTHING, 0, GRID.rows)
    widths = np.array([s.beam_width_rad / 2 for s in SEVERAL])
    axis.add_axes(values, observed, place, readings, widths, 3.0, 1.0, 15.0)
    np.testing.assert_array_equal(values, expected["certainty"])
    np.testing.assert_array_equal(observed, seen)
