"""Several models of one sensor, by range: each reading is judged by its own, fast, slow and shown.

The slow twin picks the model itself, and takes each as a sensor of its own.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID, PING

from mapping.artifacts import TempGrid
from mapping.config import load_config, unused_keys, validate
from mapping.layer_map import LayerMap
from mapping.parameters import Sensor
from mapping.placed_session import place_session
from mapping.probing import CellProbe
from mapping.readings import Readings
from mapping.sensor_model import make_temp_grid, stretch_of
from mapping.tracks import Motions
from mapping.update_rules import start
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Pose, Radiation, Range, Scan
from replay.probe_text import touch_text
from replay.rrd.explanation import describe

NEAR_M, MIDDLE_M = 0.4, 0.9
OTHER = {"range_error": 0.25, "behind": 0.02, "before": 0.2, "hit": 2.5, "miss": 0.6, "p_hit": 0.9}


def several(**changes: Any) -> Sensor:
    """A sonar with three models."""
    far = replace(PING, layer="made", no_echo="empties", beam_width_rad=0.4, **changes)
    near = replace(far, **OTHER, up_to_m=NEAR_M)
    return replace(far, nearer=(near, replace(near, hit=1.1, behind=0.4, up_to_m=MIDDLE_M)))


def readings_of(sensors: tuple[Sensor, ...], of: list[int], ranges_m: list[float]) -> Readings:
    draw = np.random.default_rng(1)
    n = len(of)
    at = Motions(draw.uniform(-0.8, 0.8, n), draw.uniform(-0.6, 0.6, n), draw.uniform(-4, 4, n))
    return Readings(
        sensors, 0, np.arange(n), np.array(of), at, at, np.arange(n + 1), np.zeros(n),
        np.array(ranges_m), np.full(n, cases.REACH_M),
    )  # fmt: skip


def model_of(sensor: Sensor, range_m: float) -> int:
    """The twin's choice: the first whose end is not passed."""
    if range_m <= NEAR_M:
        return 0
    return 1 if range_m <= MIDDLE_M else 2


RANGES = [*np.random.default_rng(2).uniform(0.05, 1.4, 150), NEAR_M, MIDDLE_M, math.inf]


@pytest.mark.parametrize(
    ("model", "update", "rasteriser"),
    [
        *itertools.product(["fading", "regions", "peak"], ["bayes", "sum", "pooled"], ["cells"]),
        *(("fading", update, "cells") for update in ("count", "saturating", "himm")),
        ("fading", "bayes", "rays"), ("peak", "count", "arcs"),
    ],
)  # fmt: skip
def test_each_reading_goes_by_the_model_of_its_range(
    model: str, update: str, rasteriser: str
) -> None:
    sensor = several(model=model, update=update, rasteriser=rasteriser)
    apart = tuple(replace(each, nearer=(), up_to_m=math.inf) for each in sensor.models)
    together = LayerMap("made", [sensor], GRID)
    together.merge_many(readings_of((sensor,), [0] * len(RANGES), RANGES))
    twin = LayerMap("made", apart, GRID)
    of = [model_of(sensor, range_m) for range_m in RANGES]
    assert set(of) == {0, 1, 2}
    twin.merge_many(readings_of(apart, of, RANGES))
    one = LayerMap("made", [sensor], GRID)
    readings = readings_of((sensor,), [0] * len(RANGES), RANGES)
    for row in range(len(readings)):
        list(one.merge_one(readings, row))
    for name, cells in together.state.cells.items():
        assert cells.tobytes() == twin.state.cells[name].tobytes()
        assert cells.tobytes() == one.state.cells[name].tobytes()
        assert np.ptp(cells) > 0.0


def test_the_temp_grids_that_are_shown_are_what_the_kernels_add() -> None:
    sensor = several(model="fading", update="bayes")
    readings = readings_of((sensor,), [0] * len(RANGES), RANGES)
    fast, slow = LayerMap("made", [sensor], GRID), start("bayes", GRID)
    fast.merge_many(readings)
    for row, range_m in enumerate(RANGES):
        model = sensor.models[model_of(sensor, range_m)]
        slow.merge(make_temp_grid(readings.beam(row), model, GRID))
    difference = fast.state.cells["log_odds"] - slow.cells["log_odds"]
    assert np.abs(difference).max() < len(RANGES) * 2.0**-22


def test_the_deepest_band_sets_the_size_of_the_grid() -> None:
    assert stretch_of(several(model="fading")) == pytest.approx(1.4)


def run(settings: dict[str, Any]) -> tuple[Sensor, Readings]:
    messages = [
        message
        for k, range_m in enumerate((0.3, 1.2))
        for message in (Pose(k * 10**8, SE2(0.0, 0.0, 0.0)),
                        Range(k * 10**8, "ping", range_m, 0.6, 0.02, 4.0, Radiation.ULTRASOUND))
    ]  # fmt: skip
    placed = place_session(messages, validate({"sensors": {"ping": settings}}))
    return placed.sensors["ping"], Readings.joined(list(placed))


def test_a_configuration_names_them_and_steps_and_probes_show_which_it_was() -> None:
    sensor, readings = run({"ranges": [{"up_to_m": 0.5, "hit": 2.0, "range_error": 0.03}],
                            "update": "bayes"})  # fmt: skip
    (near,) = sensor.nearer
    assert (near.hit, near.range_error, near.behind) == (2.0, 0.03, sensor.behind)
    assert [readings.beam(row).model for row in (0, 1)] == ["up to 0.5 m", "beyond 0.5 m"]
    probe, made = CellProbe((0.25, 0.0)), LayerMap("ping", [sensor], GRID)
    probe.cell, probe.centre_m = (16, 25), (0.25, 0.0)
    for row in (0, 1):
        for artifact in made.merge_one(readings, row):
            probe(artifact)
            if isinstance(artifact, TempGrid):
                assert readings.beam(row).model in describe(artifact)
    assert [touch.model for touch in probe.touches] == ["up to 0.5 m", "beyond 0.5 m"]
    assert "(its model up to 0.5 m)" in touch_text(probe.touches[0])


@pytest.mark.parametrize(
    ("ranges", "reason"),
    [
        ([{"up_to_m": 0.5}, {"up_to_m": 0.5}], "must grow"),
        ([{"hit": 0.5}], "up_to_m"),
        ([{"up_to_m": 0.5, "hitt": 1}], "hitt; the nearest known one is hit"),
        ([{"up_to_m": 0.5, "update": "count"}], "update"),
        ([{"up_to_m": -1.0}], "greater than or equal to 0"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(
    ranges: list[dict[str, Any]], reason: str
) -> None:
    with pytest.raises(BadInput, match=reason) as caught:
        run({"ranges": ranges})
    assert "\n" not in str(caught.value)


def test_scans_and_keys_without_use_are_named() -> None:
    config = load_config([], ["sensors.lidar.ranges=[{up_to_m=1.0, hit=2.0}]"])
    scan = Scan(0, "lidar", np.ones(5), 0.0, 0.1, 0.1, 10.0)
    with pytest.raises(BadInput, match="the beams of a scan share one model"):
        place_session([Pose(0, SE2(0.0, 0.0, 0.0)), scan], config)
    config = load_config([], ["sensors.ping.ranges=[{up_to_m=1.0, p_hit=0.9, hit=2.0}]",
                              "sensors.ping.model=peak", "sensors.ping.update=bayes"])  # fmt: skip
    assert unused_keys(config) == ["sensors.ping.hit"]
