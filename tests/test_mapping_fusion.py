"""Several sensors' maps → one, and where they agree."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.config import FusionSection, MappingConfig, ReportedSensor, resolve_sensor
from mapping.fusion import classify, fuse, weights_of
from mapping.grid import GridGeometry, Layer
from recorder.errors import BadInput
from recorder.messages import Radiation

ROW = GridGeometry((0.0, 0.0), 0.1, 1, 6)


def sensor_of(name, radiation, **changes):
    sensor = resolve_sensor(ReportedSensor(name, radiation), MappingConfig(), mounted=False)
    return replace(sensor, layer=name, **changes)


SONAR = sensor_of("ping", Radiation.ULTRASOUND)
SHARP = sensor_of("dirrs", Radiation.INFRARED)
SENSORS = [SONAR, SHARP]


def layer_of(name, probability, observed=None):
    values = np.atleast_2d(np.array(probability, np.float32))
    seen = values != 0.5 if observed is None else np.atleast_2d(np.array(observed, bool))
    geometry = GridGeometry((0.0, 0.0), 0.1, *values.shape)
    return Layer(name, "probability", geometry, values, values, seen, {})


PAIR = [layer_of("ping", [0.9, 0.2, 0.5, 0.5]), layer_of("dirrs", [0.6, 0.1, 0.8, 0.5])]


def test_weights_by_angular_resolution_are_the_chapters():
    weights = weights_of(PAIR, SENSORS, "angular")
    assert [round(w, 2) for w in weights] == [0.14, 0.86]
    assert weights[0] == pytest.approx(3 / 22)


def test_weights_by_range_error_are_a_third_and_two_thirds():
    np.testing.assert_allclose(weights_of(PAIR, SENSORS, "range"), [1 / 3, 2 / 3])


def test_equal_and_given_weights():
    assert weights_of(PAIR, SENSORS, "equal") == [0.5, 0.5]
    assert weights_of(PAIR, SENSORS, {"ping": 1.0, "dirrs": 3.0}) == [0.25, 0.75]


def test_sensors_of_one_layer_count_as_one():
    left, right = replace(SONAR, name="left"), replace(SONAR, name="right")
    np.testing.assert_allclose(
        weights_of(PAIR, [left, right, SHARP], "angular"), weights_of(PAIR, SENSORS, "angular")
    )


def test_a_sensor_without_error_gets_all_but_nothing_breaks():
    weights = weights_of(PAIR, [SONAR, replace(SHARP, range_error=0.0)], "range")
    assert sum(weights) == pytest.approx(1.0)
    assert weights[1] > 0.99


@pytest.mark.parametrize(
    ("weights", "words"),
    [
        ({"ping": 1.0}, "has no weight for layer dirrs"),
        ({"ping": 1.0, "dirrs": 1.0, "pong": 1.0}, "'pong'; the nearest known one is ping"),
        ({"ping": 0.0, "dirrs": 0.0}, "add up to 0"),
        ("angles", "unknown kind of fusion weight 'angles'"),
    ],
)
def test_weights_that_cannot_be_used(weights, words):
    with pytest.raises(BadInput, match=words):
        weights_of(PAIR, SENSORS, weights)


def test_a_layer_of_an_unknown_sensor_has_no_weight():
    with pytest.raises(BadInput, match="no sensor is known for layer dirrs"):
        weights_of(PAIR, [SONAR], "angular")


def test_the_weighted_map():
    fused = fuse(PAIR, SENSORS, FusionSection(rule="weights", weights="angular"))
    w = 3 / 22
    expected = [w * 0.9 + (1 - w) * 0.6, w * 0.2 + (1 - w) * 0.1, w * 0.5 + (1 - w) * 0.8, 0.5]
    np.testing.assert_allclose(fused.probability[0], expected, atol=1e-6)
    assert (fused.name, fused.kind) == ("fused", "probability")
    np.testing.assert_array_equal(fused.observed[0], [True, True, True, False])
    assert not fused.values.flags.writeable


def test_the_bayes_map_adds_log_odds():
    fused = fuse(PAIR, SENSORS, FusionSection(rule="bayes"))
    t, f = 0.9, 0.6
    assert fused.probability[0, 0] == pytest.approx(t * f / (t * f + (1 - t) * (1 - f)), abs=1e-6)
    assert fused.probability[0, 2] == pytest.approx(0.8, abs=1e-6)
    assert fused.probability[0, 3] == 0.5


def test_what_a_sensor_never_saw_is_no_evidence_to_bayes():
    count = layer_of("ping", [0.0, 1.0], observed=[False, True])
    fused = fuse([count, layer_of("dirrs", [0.8, 0.8])], SENSORS, FusionSection(rule="bayes"))
    assert fused.probability[0, 0] == pytest.approx(0.8, abs=1e-6)
    assert fused.probability[0, 1] > 0.999


PROBABILITIES = st.lists(st.floats(0, 1), min_size=6, max_size=6)


@settings(deadline=None, max_examples=100)
@given(st.lists(PROBABILITIES, min_size=1, max_size=4), st.data())
def test_weighted_fusion_stays_within_its_inputs(rows, data):
    layers = [layer_of(f"s{k}", row) for k, row in enumerate(rows)]
    weights = {layer.name: data.draw(st.floats(0.01, 10)) for layer in layers}
    fused = fuse(layers, [], FusionSection(rule="weights", weights=weights))
    stack = np.array([layer.probability for layer in layers])
    assert (fused.probability >= stack.min(axis=0) - 1e-6).all()
    assert (fused.probability <= stack.max(axis=0) + 1e-6).all()


@settings(deadline=None, max_examples=100)
@given(st.lists(PROBABILITIES, min_size=1, max_size=4))
def test_bayes_fusion_is_the_sum_of_log_odds_in_any_order(rows):
    layers = [layer_of(f"s{k}", row) for k, row in enumerate(rows)]
    one = fuse(layers, [], FusionSection(rule="bayes"))
    other = fuse(layers[::-1], [], FusionSection(rule="bayes"))
    np.testing.assert_allclose(one.probability, other.probability, atol=1e-6)
    for col in range(6):
        total = 0.0
        for layer in layers:
            p = float(layer.probability[0, col])
            clamped = 13.8 * (1 if p else -1) if p in (0.0, 1.0) else math.log(p / (1 - p))
            total += min(max(clamped, -13.8), 13.8)
        expected = 1 / (1 + math.exp(-total))
        assert one.probability[0, col] == pytest.approx(expected, abs=1e-5)


def test_layers_on_different_grids_and_none_at_all_are_refused():
    other = layer_of("dirrs", [0.5] * 3)
    with pytest.raises(BadInput, match="one grid"):
        fuse([PAIR[0], other], SENSORS, FusionSection())
    with pytest.raises(BadInput, match="no layer"):
        fuse([], SENSORS, FusionSection())
    with pytest.raises(BadInput, match="no layer"):
        classify([])


def test_the_class_map_names_every_case():
    ping = layer_of("ping", [0.9, 0.1, 0.9, 0.9, 0.1, 0.5, 0.5, 0.5])
    dirrs = layer_of("dirrs", [0.8, 0.2, 0.2, 0.5, 0.5, 0.7, 0.3, 0.5])
    found = classify([ping, dirrs])
    assert [found.names[code] for code in found.codes[0]] == [
        "agree occupied", "agree empty", "contradict", "ping alone occupied", "ping alone empty",
        "dirrs alone occupied", "dirrs alone empty", "unknown",
    ]  # fmt: skip
    assert found.names[0] == "unknown"
    assert not found.codes.flags.writeable


def test_a_cell_never_seen_is_not_empty_whatever_its_count():
    ping = layer_of("ping", [0.0, 1.0], observed=[False, True])
    found = classify([ping])
    assert [found.names[c] for c in found.codes[0]] == ["unknown", "ping alone occupied"]


@settings(deadline=None, max_examples=100)
@given(st.lists(st.lists(st.sampled_from([0.2, 0.5, 0.8]), min_size=4, max_size=4),
                min_size=1, max_size=4))  # fmt: skip
def test_classes_of_any_number_of_sensors(rows):
    layers = [layer_of(f"s{k}", row) for k, row in enumerate(rows)]
    found = classify(layers)
    for col in range(4):
        values = [row[col] for row in rows]
        ups, downs = values.count(0.8), values.count(0.2)
        if ups and downs:
            expected = "contradict"
        elif ups + downs == 0:
            expected = "unknown"
        elif ups + downs == 1:
            alone = next(k for k, p in enumerate(values) if p != 0.5)
            expected = f"s{alone} alone {'occupied' if ups else 'empty'}"
        else:
            expected = "agree occupied" if ups else "agree empty"
        assert found.names[found.codes[0, col]] == expected
