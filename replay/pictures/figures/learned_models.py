"""Sensor models that were learned from the session, beside the ideal one."""

from __future__ import annotations

import math

import numpy as np

from mapping.learning.known_ranges import from_walls
from mapping.learning.sensors import LearnedSensor, learn_sensor
from recorder.errors import BadInput
from replay.pictures import style
from replay.pictures.figures.bench import Bench, Role
from replay.pictures.figures.figure import Drawing, LeftOut
from replay.pictures.figures.shading import percent
from replay.pictures.parts import Bars, Box, Chart, Curve, Floats

_BINS, _SPREADS = 40, 4.0  # of the histograms, and how far they go
_ALIKE = 1.1  # two spreads that differ by less are as good as one
_STDS = 3.0  # the chapter's Gaussian has so many to either side within the error
_FRAME = Box(0.0, 0.0, 1.25, 1.0)
_X = "residual: measured minus true, % of the distance"


def learned_model(bench: Bench) -> Drawing:
    """The residuals of each sensor, the hits that were learned, and the ideal error."""
    charts, texts = [], []
    for role in _rangers(bench):
        learned = _learned(bench, role)
        name, mixture = role.sensor.name, learned.fit.mixture
        at_m = learned.typical_m
        ideal = role.sensor.range_error / _STDS
        mean, std = float(mixture.mean_m(at_m)) / at_m - 1.0, float(mixture.std_m(at_m)) / at_m
        reach = _SPREADS * max(ideal, std)
        x = np.linspace(-reach, reach, 241)
        parts = (
            _histogram(learned, np.ones(len(learned.pairs.true_m), np.bool_), reach),
            Curve(_percent(x, _normal(x, 0.0, ideal)), style.INK, "ideal model", dashed=True),
            Curve(_percent(x, mixture.hit * _normal(x, mean, std)), style.MORE_OCCUPIED,
                  "learned: right readings"),
        )  # fmt: skip
        charts.append(Chart(name, _X, "density", parts, frame=_FRAME))
        texts.append(
            f"{name}: {percent(mixture.hit)} of its readings are right; at {at_m:.2f} m these lie "
            f"{100 * mean:+.1f} % off and spread by {100 * std:.1f} %, where the ideal model has "
            f"{100 * ideal:.1f} %."
        )
    return Drawing(tuple(charts), " ".join(texts), columns=2)


def near_and_far(bench: Bench) -> Drawing:
    """The residuals of the nearer and of the farther half, each with its own spread."""
    role = _rangers(bench)[-1]
    learned = _learned(bench, role)
    true_m, mixture = learned.pairs.true_m, learned.fit.mixture
    middle_m = float(np.median(true_m))
    halves = (("near", true_m <= middle_m), ("far", true_m > middle_m))
    at_m = [float(np.median(true_m[half])) for _, half in halves]
    stds = [float(mixture.std_m(each)) / each for each in at_m]
    reach = _SPREADS * max(stds)
    x = np.linspace(-reach, reach, 241)
    charts = []
    for (title, half), distance_m, std in zip(halves, at_m, stds, strict=True):
        mean = float(mixture.mean_m(distance_m)) / distance_m - 1.0
        parts = (
            _histogram(learned, half, reach),
            Curve(_percent(x, mixture.hit * _normal(x, mean, std)), style.MORE_OCCUPIED,
                  "learned: right readings"),
        )  # fmt: skip
        charts.append(
            Chart(f"{title}: about {distance_m:.2f} m", _X, "density", parts, frame=_FRAME)
        )
    alike = max(stds) < _ALIKE * min(stds)
    caption = (
        f"{role.sensor.name} up to and beyond {middle_m:.2f} m: right readings spread by "
        f"{100 * stds[0]:.1f} % of the distance near, by {100 * stds[1]:.1f} % far. "
        + ("One error for all distances would do." if alike
           else "One error for all distances fits neither as well as its own.")
    )  # fmt: skip
    return Drawing(tuple(charts), caption, columns=2)


def _rangers(bench: Bench) -> tuple[Role, ...]:
    try:
        return bench.both
    except LeftOut:
        return (bench.any_ranger,)


def _learned(bench: Bench, role: Role) -> LearnedSensor:
    if not len(bench.walls_m):
        raise LeftOut("the session does not carry the true walls")
    known = from_walls([bench.readings], role.sensor.name, bench.walls_m)
    try:
        return learn_sensor(known, "true walls")
    except BadInput as error:
        raise LeftOut(str(error)) from None


def _histogram(learned: LearnedSensor, which: np.ndarray, reach: float) -> Bars:
    """The share of those readings at each residual, as a density."""
    pairs = learned.pairs.select(which)
    residual = pairs.range_m / pairs.true_m - 1.0
    edges = np.linspace(-reach, reach, _BINS + 1)
    counts, _ = np.histogram(residual[np.isfinite(residual)], edges)
    density = counts / max(len(residual), 1) / (edges[1] - edges[0]) / 100.0
    return Bars(100.0 * edges, density, style.MORE_FREE, "residuals of the session")


def _normal(x: Floats, mean: float, std: float) -> Floats:
    density: Floats = np.exp(-0.5 * ((x - mean) / std) ** 2) / (std * math.sqrt(2.0 * math.pi))
    return density


def _percent(x: Floats, density: Floats) -> Floats:
    return np.column_stack([100.0 * x, density / 100.0])
