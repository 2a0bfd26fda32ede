"""The maps of several sensors → one: weighted or by Bayes, and where the sensors agree.

The chapter weighs each map by how far its sensor can be trusted, with weights that add up to 1.
Bayes adds the log-odds, as if all readings had gone into one map.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Classes
from mapping.config import FusionSection, Sensor
from mapping.grid import Layer, read_only
from mapping.names import choose
from mapping.numbers import expit
from mapping.update_rules import log_odds
from recorder.errors import BadInput

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

FUSED = "fused"


def fuse(layers: Sequence[Layer], sensors: Iterable[Sensor], section: FusionSection) -> Layer:
    """One layer, named ``fused``, from the layers of several sensors on the same grid.

    ``sensors`` are those whose readings went into the layers; a layer is trusted as they are.
    Raises BadInput for no layers, layers on different grids, and weights that cannot be used.
    """
    if not layers:
        raise BadInput("there is no layer to fuse")
    if any(layer.geometry != layers[0].geometry for layer in layers):
        raise BadInput("layers can be fused only on one grid")
    if section.rule == "bayes":
        probability = added_log_odds(layers)
    else:
        probability = weighted(layers, weights_of(layers, sensors, section.weights))
    values = probability.astype(np.float32)
    observed = np.logical_or.reduce([layer.observed for layer in layers])
    read_only(values)
    read_only(observed)
    return Layer(FUSED, "probability", layers[0].geometry, values, values, observed, {})


def weighted(layers: Sequence[Layer], weights: Sequence[float]) -> Floats:
    """Σ w p, (rows, cols): between the least and the greatest of the layers in each cell."""
    total = np.zeros(layers[0].geometry.shape)
    for layer, weight in zip(layers, weights, strict=True):
        total += weight * layer.probability.astype(np.float64)
    return total


def added_log_odds(layers: Sequence[Layer]) -> Floats:
    """The layers' log-odds added, as a probability, (rows, cols).

    A layer adds nothing where none of its readings ever was, whatever its rule holds there (a
    count of 0 would mean surely empty).
    """
    total = np.zeros(layers[0].geometry.shape)
    for layer in layers:
        total += np.where(layer.observed, log_odds(layer.probability.astype(np.float64)), 0.0)
    probability: Floats = expit(total)
    return probability


def _angular_trust(sensor: Sensor) -> float:
    return 1.0 / sensor.beam_width_rad


def _range_trust(sensor: Sensor) -> float:
    # A sensor configured without any error is trusted as one of a hundredth of a percent.
    return 1.0 / max(sensor.range_error, 1e-4)


TRUST: dict[str, Callable[[Sensor], float]] = {
    "angular": _angular_trust,
    "range": _range_trust,
    "equal": lambda sensor: 1.0,
}


def weights_of(
    layers: Sequence[Layer], sensors: Iterable[Sensor], weights: str | dict[str, float]
) -> list[float]:
    """Weight of each layer; they add up to 1.

    By name of a trust: in inverse proportion to the beam's width (19 and 3 degrees to each side:
    0.14 and 0.86) or to the range error (10 and 5 %: 1/3 and 2/3), or equal; the trust of a layer
    is the mean of its sensors'. Or given: a number for each layer by name.
    """
    if isinstance(weights, dict):
        raw = _given(layers, weights)
    else:
        trust = choose(TRUST, weights, "kind of fusion weight")
        of_layer: dict[str, list[float]] = {}
        for sensor in sensors:
            of_layer.setdefault(sensor.layer or sensor.name, []).append(trust(sensor))
        unknown = [layer.name for layer in layers if layer.name not in of_layer]
        if unknown and weights != "equal":
            raise BadInput(f"no sensor is known for layer {unknown[0]}, so it has no weight")
        raw = [float(np.mean(of_layer.get(layer.name, [1.0]))) for layer in layers]
    total = sum(raw)
    if total <= 0.0:
        raise BadInput("the fusion weights of these layers add up to 0")
    return [weight / total for weight in raw]


def _given(layers: Sequence[Layer], weights: dict[str, float]) -> list[float]:
    names = [layer.name for layer in layers]
    missing = [name for name in names if name not in weights]
    if missing:
        raise BadInput(f"fusion.weights has no weight for layer {missing[0]}")
    for name in weights:
        choose(dict.fromkeys(names), name, "layer in fusion.weights")
    return [weights[name] for name in names]


def classify(layers: Sequence[Layer]) -> Classes:
    """Where the layers agree, where one alone has evidence, where they contradict each other.

    A layer has evidence for a cell that one of its readings touched and that it does not hold at
    exactly 0.5. ``unknown`` is code 0; then come agreement on occupied and on empty, contradiction,
    and for each layer what it holds alone.
    """
    if not layers:
        raise BadInput("there is no layer to classify")
    names = ["unknown", "agree occupied", "agree empty", "contradict"]
    occupied = [layer.observed & (layer.probability > 0.5) for layer in layers]
    empty = [layer.observed & (layer.probability < 0.5) for layer in layers]
    occupied_in = np.sum(occupied, axis=0)
    empty_in = np.sum(empty, axis=0)
    codes = np.zeros(layers[0].geometry.shape, np.uint8)
    codes[(occupied_in >= 2) & (empty_in == 0)] = 1
    codes[(empty_in >= 2) & (occupied_in == 0)] = 2
    codes[(occupied_in > 0) & (empty_in > 0)] = 3
    alone = occupied_in + empty_in == 1
    for layer, is_occupied, is_empty in zip(layers, occupied, empty, strict=True):
        for mask, state in ((is_occupied, "occupied"), (is_empty, "empty")):
            codes[alone & mask] = len(names)
            names.append(f"{layer.name} alone {state}")
    read_only(codes)
    return Classes(layers[0].geometry, codes, tuple(names))
