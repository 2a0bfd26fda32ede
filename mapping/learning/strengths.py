"""How strong the evidence of a sensor should be, from sessions in rooms whose walls are known.

What is fitted depends on the rule in force. `pooled` has weights of its sums, found by a logistic
regression; other rules take what their sensor model says, whose strengths (`hit`, `miss` and
`fade_m` of `fading`; `p_hit` and `p_miss` of `peak`) are searched for with the map's own log-loss.
Either way all readings of a session count, and every sixth alone: what suits many must suit few.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.config_sections import GridSection
from mapping.grid import GridGeometry
from mapping.layer_map import LayerMap, empty_maps
from mapping.learning.pooling import Sample, fit_weights, sample_of
from mapping.numbers import expit
from mapping.parameters import Sensor, Table
from mapping.readings import Readings
from mapping.scoring.cells import log_loss_of
from mapping.scoring.observable import observable_cells
from mapping.scoring.truth import Truth
from mapping.update_rules.pooled_weights import as_table, given_weights, weights_of
from mapping.update_rules.rules import Pooled
from recorder.errors import BadInput

Flags = NDArray[np.bool_]
Settings = dict[str, Any]

THINNED = (1, 6)  # every reading, every sixth
PULL = 0.01  # towards the weights in force
_ENDLESS_M = 1e3  # a `fade_m` beyond is none
_TRIES = 80
_WIDE = 0.5  # of a first step, in the logarithm of a strength


@dataclass(frozen=True, slots=True)
class Case:
    """One layer of a session in a room whose walls are known.

    ``readings`` are the layer's, ``looking`` the same with those that saw nothing; ``room`` tells
    rooms apart. ``name`` is what people know it by.
    """

    name: str
    room: bytes
    layer: str
    readings: Readings
    looking: Readings
    geometry: GridGeometry
    truth: Truth

    @property
    def sensor(self) -> Sensor:
        """The one whose rule the layer goes by: its last."""
        return [each for each in self.readings.sensors if each.layer == self.layer][-1]

    def half(self, second: bool) -> Case:
        """The first or the second half of its time."""
        t_ns = self.looking.t_ns
        middle_ns = int(t_ns[len(t_ns) // 2])
        parts = [r.chosen((r.t_ns >= middle_ns) == second) for r in (self.readings, self.looking)]
        name = f"the {'second' if second else 'first'} half of {self.name}"
        return replace(self, name=name, readings=parts[0], looking=parts[1])

    def thinned(self, nth: int) -> Case:
        """Every so many of each sensor's readings."""
        parts = [_thinned(each, nth) for each in (self.readings, self.looking)]
        return replace(self, readings=parts[0], looking=parts[1])

    def map(self, settings: Mapping[str, Any]) -> LayerMap:
        """Its map, with some keys of its sensors changed."""
        sensors = tuple(_with(each, settings) for each in self.readings.sensors)
        made = empty_maps(sensors, self.geometry, GridSection())[self.layer]
        made.merge_many(replace(self.readings, sensors=sensors))
        return made

    def seen(self) -> Flags:
        """The cells (rows, cols) that could be observed."""
        return observable_cells([self.looking], self.truth, self.geometry)[self.layer]


@dataclass(frozen=True, slots=True)
class KeptOut:
    """A case judged by settings that were learned without it: log-loss, and that without them."""

    name: str
    before: float
    learned: float


@dataclass(frozen=True, slots=True)
class LearnedStrengths:
    """The keys of a layer's sensors, and what they were worth where they were not learned from.

    ``same_room``: what was kept out was another time in the same room, which says less.
    """

    layer: str
    sensors: tuple[str, ...]
    rule: str
    settings: Settings
    kept_out: tuple[KeptOut, ...]
    same_room: bool

    @property
    def before(self) -> float:
        """The mean log-loss of what was kept out, as it was."""
        return float(np.mean([each.before for each in self.kept_out]))

    @property
    def learned(self) -> float:
        """The same with what was learned of the rest."""
        return float(np.mean([each.learned for each in self.kept_out]))

    @property
    def is_better(self) -> bool:
        """Whether what was learned is worth it where it was not learned."""
        return self.learned < self.before


def learn_strengths(cases: Sequence[Case]) -> LearnedStrengths:
    """Fit a layer of several sessions; and to all but one room in turn, to judge that one by.

    Of one room, to all but one session; of one session, to each of its halves. Raises BadInput
    where the rule in force has no strength to fit.
    """
    sensor = cases[0].sensor
    settings = fit(cases)
    rooms = list(dict.fromkeys(each.room for each in cases))
    if len(rooms) > 1:
        groups = [[each for each in cases if each.room == room] for room in rooms]
    elif len(cases) > 1:
        groups = [[each] for each in cases]
    else:
        groups = [[cases[0].half(second)] for second in (False, True)]
    kept_out = []
    for k, group in enumerate(groups):
        others = fit([each for n, other in enumerate(groups) if n != k for each in other])
        kept_out += [KeptOut(c.name, log_loss(c, {}), log_loss(c, others)) for c in group]
    names = dict.fromkeys(s.name for case in cases for s in case.readings.sensors
                          if s.layer == case.layer)  # fmt: skip
    return LearnedStrengths(
        cases[0].layer, tuple(names), sensor.update, settings, tuple(kept_out), len(rooms) == 1
    )


def fit(cases: Sequence[Case]) -> Settings:
    """The keys that suit some cases best."""
    sensor = cases[0].sensor
    if sensor.update == Pooled.name:
        like = _weights(sensor)
        samples = [_sample(each.thinned(nth)) for each in cases for nth in THINNED]
        return {"weights": Table(as_table(fit_weights(samples, like, pull=PULL)))}
    return _searched(cases, _strengths_of(sensor))


def log_loss(case: Case, settings: Mapping[str, Any]) -> float:
    """Of its map with some keys changed: the mean of all readings and every sixth."""
    found = []
    for nth in THINNED:
        thinned = case.thinned(nth)
        walls = thinned.truth.wall_cells(thinned.geometry)
        probability = thinned.map(settings).layer().probability.astype(np.float64)
        found.append(log_loss_of(probability, walls, thinned.seen()))
    return float(np.mean(found))


def _sample(case: Case) -> Sample:
    return sample_of(case.map({}).state, case.seen(), case.truth)


def _weights(sensor: Sensor) -> Any:
    given = sensor.own.get("weights") or "sonar"
    return weights_of(given) if isinstance(given, str) else given_weights(given)


def _strengths_of(sensor: Sensor) -> list[str]:
    """The keys of its model that say how strong its evidence is. BadInput where it has none."""
    if sensor.model == "fading":
        return ["hit", "miss", *(["fade_m"] if sensor.fade_m < _ENDLESS_M else [])]
    if sensor.model == "peak":
        return ["p_hit", "p_miss"]
    raise BadInput(
        f"{sensor.name}: the model {sensor.model!r} with the rule {sensor.update!r} has no "
        "strength to learn; pooled, fading and peak have"
    )


def _searched(cases: Sequence[Case], names: Sequence[str]) -> Settings:
    """Those with the least mean log-loss, by the simplex of Nelder and Mead (1965)."""
    from scipy.optimize import minimize

    thinned = [each.thinned(nth) for each in cases for nth in THINNED]
    known = [(each, each.truth.wall_cells(each.geometry), each.seen()) for each in thinned]
    start = np.array([_free(name, float(getattr(cases[0].sensor, name))) for name in names])

    def loss(values: NDArray[np.float64]) -> float:
        settings = {name: _bound(name, v) for name, v in zip(names, values.tolist(), strict=True)}
        losses = [
            log_loss_of(each.map(settings).layer().probability.astype(np.float64), walls, seen)
            for each, walls, seen in known
        ]
        return float(np.mean(losses))

    simplex = np.vstack([start, start + _WIDE * np.eye(len(start))])
    options = {"maxfev": _TRIES, "initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-4}
    best = minimize(loss, start, method="Nelder-Mead", options=options).x.tolist()
    return {name: float(f"{_bound(name, v):.4g}") for name, v in zip(names, best, strict=True)}


def _free(name: str, value: float) -> float:
    """A strength as a number without bounds: its logarithm, of a probability its log-odds."""
    if name == "p_miss":
        value = 1.0 - value
    held = min(max(value, 1e-3), 1.0 - 1e-3) if name.startswith("p_") else max(value, 1e-3)
    return math.log(held / (1.0 - held)) if name.startswith("p_") else math.log(held)


def _bound(name: str, value: float) -> float:
    if not name.startswith("p_"):
        return math.exp(min(value, 10.0))
    p = float(expit(np.array(value)))
    return 1.0 - p if name == "p_miss" else p


def _thinned(readings: Readings, nth: int) -> Readings:
    if nth == 1:
        return readings
    place = np.zeros(len(readings), np.int64)
    for number in range(len(readings.sensors)):
        mine = readings.sensor == number
        place[mine] = np.arange(int(mine.sum()))
    return readings.chosen(place % nth == 0)


def _with(sensor: Sensor, settings: Mapping[str, Any]) -> Sensor:
    if not settings:
        return sensor
    own = {key: value for key, value in settings.items() if key == "weights"}
    fields = {key: value for key, value in settings.items() if key != "weights"}
    nearer = tuple(_with(each, settings) for each in sensor.nearer)
    return replace(sensor, own={**sensor.own, **own}, nearer=nearer, **fields)
