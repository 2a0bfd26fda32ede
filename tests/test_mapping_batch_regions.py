"""`regions` and `peak` in one go: the rasteriser's cells, the models' values, the same bytes."""

from __future__ import annotations

from dataclasses import replace

import batch_cases as cases
import numpy as np
import pytest
from batch_cases import GRID, PING
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_sensor_model import naive_temp_grid

from mapping.kernels import merging
from mapping.kernels.batch import regions, steps
from mapping.kernels.batch.region_tables import peak_sensor, regions_sensor, tables_of
from mapping.sensor_model import regions_table

MODELS = st.sampled_from(["regions", "peak"])


def tables_for(sensors):
    out = []
    for s in sensors:
        angle = regions_table(s.regions) if s.gaussian in ("both", "angle") else np.ones(1)
        distance = regions_table(s.regions) if s.gaussian in ("both", "distance") else np.ones(1)
        if s.model == "peak":
            out.append(
                peak_sensor(s.beam_width_rad, s.emptiness, angle, distance, s.p_hit, s.p_miss)
            )
        else:
            out.append(regions_sensor(s.beam_width_rad, s.emptiness, angle, distance))
    return tables_of(out)


def map_of(readings, sensors, grid=GRID, parts=1):
    cells, observed = cases.blank(grid)
    for band in cases.bands(grid, parts):
        regions.add_regions(
            cells, observed, cases.place(grid), readings, *tables_for(sensors), *band
        )
    assert not cells[:, grid.cols :].any()
    return cells[:, : grid.cols], observed


def expected_steps(probability):
    with np.errstate(divide="ignore"):
        log_odds = np.log(probability) - np.log1p(-probability)
    return np.clip(log_odds, -13.8, 13.8) * steps.ONE


@given(st.data(), MODELS.flatmap(lambda model: cases.sensors(model=model)))
@settings(max_examples=500, deadline=None)
def test_a_reading_is_the_evidence_of_the_model(data, sensor):
    beam = data.draw(cases.beams(sensor))
    _temp, front, band = cases.parts_of(beam, sensor, GRID)
    cells, observed = map_of(cases.columns_of([beam], [sensor]), [sensor])
    says = sensor.emptiness != "none" and (sensor.model == "regions" or sensor.p_miss != 0.5)
    np.testing.assert_array_equal(observed, band | (front & says))
    assert not cells[~(front | band)].any()
    twin = naive_temp_grid(beam, sensor, GRID)
    expected = expected_steps(twin.probability)
    # Near certainty log-odds are steep: there 1e-9 of probability are many steps.
    near = (
        3.0
        + 4e-7 * np.abs(expected)
        + 1e-9 * steps.ONE / (twin.probability * (1 - twin.probability) + 1e-12)
    )
    # The sensor's own cell has any direction where the sensor stands on its centre.
    centres = GRID.centres_of(np.argwhere(np.ones(GRID.shape))).reshape(*GRID.shape, 2)
    pose = beam.world_from_sensor
    sure = ~twin.unsure & (np.hypot(*(centres - (pose.x_m, pose.y_m)).T).T > 1e-9)
    assert (np.abs(cells - expected) <= near)[sure].all()


SEVERAL = [
    replace(PING, model="regions"),
    replace(
        PING, model="regions", no_echo="empties", regions=60, gaussian="angle", beam_width_rad=1.5
    ),
    replace(
        PING, model="peak", gaussian="distance", emptiness="linear", range_error=0.02, p_miss=0.2
    ),
    replace(PING, model="regions", gaussian="none", emptiness="constant", beam_width_rad=4.0),
]


def random_readings(draw, count):
    which = [int(k) for k in draw.integers(0, len(SEVERAL), count)]
    beams = [
        cases.beam_of(
            *draw.uniform(-1, 1, 2), draw.uniform(-7, 7), cases.maybe_range(draw), SEVERAL[k]
        )
        for k in which
    ]
    return beams, cases.columns_of(beams, SEVERAL, which)


@pytest.mark.parametrize("parts", [2, 5])
def test_bands_of_rows_give_the_same_bytes(parts):
    _, readings = random_readings(np.random.default_rng(2), 200)
    whole, seen = map_of(readings, SEVERAL)
    in_parts, seen_in_parts = map_of(readings, SEVERAL, parts=parts)
    np.testing.assert_array_equal(in_parts, whole)
    np.testing.assert_array_equal(seen_in_parts, seen)


def test_one_reading_at_a_time_on_a_blank_window_gives_the_same_bytes():
    beams, readings = random_readings(np.random.default_rng(3), 200)
    whole, seen = map_of(readings, SEVERAL)
    cells, observed = np.zeros(GRID.shape, np.int32), np.zeros(GRID.shape, np.bool_)
    for i, beam in enumerate(beams):
        window = cases.parts_of(beam, SEVERAL[readings.sensor[i]], GRID)[0].window
        if window.empty:
            continue
        said, here = steps.blank(window.rows, window.cols), observed[window.slices].copy()
        regions.add_regions(
            said,
            here,
            cases.window_place(GRID, window),
            cases.one(readings, i),
            *tables_for(SEVERAL),
            0,
            window.rows,
        )
        merging.add_steps(cells[window.slices], said[:, : window.cols])
        observed[window.slices] |= here
    np.testing.assert_array_equal(cells, whole)
    np.testing.assert_array_equal(observed, seen)


def test_a_wide_beam_across_the_row_of_its_sensor():
    sensor = replace(PING, model="regions", beam_width_rad=3.0, emptiness="constant")
    for heading in np.arange(0.0, 6.4, 0.2):
        beam = cases.beam_of(0.013, 0.007, heading, 0.7, sensor)
        temp, _, _ = cases.parts_of(beam, sensor, GRID)
        cells, _ = map_of(cases.columns_of([beam], [sensor]), [sensor])
        expected = expected_steps(temp.probability)
        assert (np.abs(cells[temp.window.slices] - expected) <= 3.0 + 4e-7 * np.abs(expected)).all()


@pytest.mark.parametrize("heading_rad", [-2.3e-308, -1e-300, -1e-299, 1e-300, 2.3e-308])
def test_a_border_that_is_level_but_for_rounding_is_level(heading_rad):
    sensor = replace(PING, model="regions", regions=6, beam_width_rad=1.0)
    level, nearly = (
        map_of(cases.columns_of([cases.beam_of(0.0, 0.0, h, 1.2, sensor)], [sensor]), [sensor])
        for h in (0.0, heading_rad)
    )
    np.testing.assert_array_equal(level[0], nearly[0])
    np.testing.assert_array_equal(level[1], nearly[1])
