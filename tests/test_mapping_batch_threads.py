"""How a batch is shared out: bands with as much to do, every row once, nothing lost on the way."""

from __future__ import annotations

import math
import threading
from itertools import pairwise
from pathlib import Path

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import PING
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.batches import worth_threads
from mapping.config import MappingConfig
from mapping.grid import GridGeometry
from mapping.kernels.batch import fading, threads
from mapping.kernels.batch.readings import place_of
from mapping.placed_session import place_session
from mapping.readings import Readings
from recorder.session.columns import open_session

LOGS = Path(__file__).resolve().parent.parent / "logs"
FINE = GridGeometry((-1.0, -0.8), 0.01, 165, 205)
HALF = np.array([PING.beam_width_rad / 2.0])


def readings_of(seed, count, y_m=(-0.4, 0.4)):
    draw = np.random.default_rng(seed)
    beams = [
        cases.beam_of(draw.uniform(-0.5, 0.5), draw.uniform(*y_m), draw.uniform(-9, 9), d, PING)
        for d in draw.uniform(0.1, 0.6, count)
    ]
    return cases.columns_of(beams, [PING])


def cells_by_row(readings, grid):
    """How many cells each row of the grid has to add, counted one by one."""
    y, x = np.indices(grid.shape)
    x = grid.origin_m[0] + (x + 0.5) * grid.resolution_m
    y = grid.origin_m[1] + (y + 0.5) * grid.resolution_m
    rows = np.zeros(grid.rows)
    for k in range(len(readings.x_m)):
        dx, dy = x - readings.x_m[k], y - readings.y_m[k]
        off = (np.arctan2(dy, dx) - readings.heading_rad[k] + math.pi) % (2 * math.pi) - math.pi
        inside = (np.abs(off) <= HALF[0]) & (np.hypot(dx, dy) <= readings.band_end_m[k])
        rows += inside.sum(axis=1)
    return rows


@pytest.mark.parametrize("y_m", [(-0.4, 0.4), (0.3, 0.5)])
def test_each_band_has_about_as_much_to_do(y_m, monkeypatch):
    monkeypatch.setattr(threads, "_WORTH", 0.0)
    readings = readings_of(1, 300, y_m)
    edges = threads.band_edges(readings, HALF, cases.place(FINE), FINE.rows, 2)
    assert (edges[0], edges[-1], len(edges)) == (0, FINE.rows, 3)
    cells = cells_by_row(readings, FINE)
    assert 0.4 < cells[: edges[1]].sum() / cells.sum() < 0.6


def test_where_little_is_to_do_nothing_is_cut():
    few, place = readings_of(2, 20), cases.place(FINE)
    assert threads.band_edges(few, HALF, place, FINE.rows, 2) == [0, FINE.rows]
    many = readings_of(2, 9000)
    assert len(threads.band_edges(many, HALF, place, FINE.rows, 2)) == 3
    assert threads.band_edges(many, HALF, place, FINE.rows, 1) == [0, FINE.rows]
    none = cases.first(many, 0)
    assert threads.band_edges(none, HALF, place, FINE.rows, 2) == [0, FINE.rows]


@given(
    cuts=st.lists(st.integers(0, cases.GRID.rows), max_size=3).map(sorted),
    sensor=cases.sensors(model="fading"), data=st.data(),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_wherever_the_cuts_lie_the_bytes_are_the_same(cuts, sensor, data):
    """Above all where the band of a thin beam has its only cells beyond the cut."""
    grid = cases.GRID
    beams = data.draw(st.lists(cases.beams(sensor), min_size=1, max_size=3))
    half = sensor.beam_width_rad / 2.0
    table = np.array([[half, sensor.hit, sensor.miss, sensor.near, sensor.fade_m]])
    maps = []
    for edges in ([0, grid.rows], [0, *cuts, grid.rows]):
        cells, observed = cases.blank(grid)
        job = (cells, observed, cases.place(grid), cases.columns_of(beams, [sensor]), table)
        for band in pairwise(edges):
            fading.add_fading(*job, *band)
        maps.append((cells.tobytes(), observed.tobytes()))
    assert maps[0] == maps[1]


def test_every_share_is_done_and_what_fails_is_raised():
    done, here = [], threading.get_ident()

    def kernel(what, first, end):
        done.append((what, first, end, threading.get_ident() == here))
        if first == 4:
            raise ValueError(what)

    with pytest.raises(ValueError, match="rows"):
        threads.in_bands(kernel, "rows", edges=[0, 4, 9])
    assert sorted(done) == [("rows", 0, 4, True), ("rows", 4, 9, False)]
    done.clear()
    threads.in_parts(kernel, "all")
    assert done == [("all", 0, 1, True)]


@pytest.mark.parametrize(("resolution_m", "expected"), [(0.003, 2), (0.04, 1)])
def test_a_thread_is_taken_where_it_has_cells_to_do(resolution_m, expected):
    placed = place_session(open_session(LOGS / "room.mcap"), MappingConfig())
    readings = Readings.joined(list(placed))
    rows = np.flatnonzero(readings.sensor == [s.name for s in readings.sensors].index("ping"))
    assert worth_threads(readings, rows, resolution_m, 2) == expected
    assert worth_threads(readings, rows[:0], resolution_m, 2) == 1


def test_a_place_beyond_the_map_is_cut_to_it(monkeypatch):
    monkeypatch.setattr(threads, "_WORTH", 0.0)
    far = place_of((50.0, 60.0), 0.01)
    edges = threads.band_edges(readings_of(3, 50), HALF, far, 40, 3)
    assert edges[0] == 0
    assert edges[-1] == 40
    assert edges == sorted(edges)
