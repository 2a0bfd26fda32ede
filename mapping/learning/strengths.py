"""How strong the evidence of a sensor should be, from sessions in rooms whose walls are known.

What is fitted depends on the rule in force. `pooled` has weights of its sums, found by a logistic
regression; other rules take what their sensor model says, whose strengths (`hit`, `miss` and
`fade_m` of `fading`; `p_hit` and `p_miss` of `peak`) are searched for with the map's own log-loss.
Either way all readings of a session count, and every sixth alone: what suits many must suit few.

Where no walls are known, the readings that are kept out judge (the score without truth): the same
strengths are searched for, and of `pooled` one factor for all its weights.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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
from mapping.scoring.held_out import FOLDS, as_occupied, blocks_of, judge
from mapping.scoring.observable import observable_cells
from mapping.scoring.truth import Truth
from mapping.update_rules.pooled_weights import Weights, as_table, given_weights, weights_of
from mapping.update_rules.rules import Pooled
from recorder.errors import BadInput

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
    rooms apart. ``name`` is what people know it by. Without a ``truth`` the readings judge.
    """

    name: str
    room: bytes
    layer: str
    readings: Readings
    looking: Readings
    geometry: GridGeometry
    truth: Truth | None

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

    def judge(self) -> Callable[[Mapping[str, Any]], float]:
        """What tells how bad its map is with some keys changed; what does not change is found once.

        The log-loss against the walls; without them minus the log-likelihood of a reading by the
        map of the others.
        """
        if self.truth is None:
            return self._by_readings
        walls = self.truth.wall_cells(self.geometry)
        seen = observable_cells([self.looking], self.truth, self.geometry)[self.layer]

        def loss(settings: Mapping[str, Any]) -> float:
            probability = self.map(settings).layer().probability.astype(np.float64)
            return log_loss_of(probability, walls, seen)

        return loss

    def _by_readings(self, settings: Mapping[str, Any]) -> float:
        block, blocks = blocks_of(len(self.readings))
        folds = min(FOLDS, blocks)
        maps = [
            replace(self, readings=self.readings.chosen(block % folds != fold)).map(settings)
            for fold in range(folds)
        ]
        occupied = np.stack([
            as_occupied(each.layer().probability, self.geometry.resolution_m) for each in maps
        ])  # fmt: skip
        judged = judge(self.readings, block, blocks, self.geometry, {self.layer: occupied})
        return -judged.scores.mean


@dataclass(frozen=True, slots=True)
class KeptOut:
    """A case judged by settings that were learned without it, and as it was: lower is better."""

    name: str
    before: float
    learned: float


@dataclass(frozen=True, slots=True)
class LearnedStrengths:
    """The keys of a layer's sensors, and what they were worth where they were not learned from.

    ``same_room``: what was kept out was another time in the same room, which says less.
    ``by_walls``: judged by log-loss; else by minus the log-likelihood of readings kept out.
    """

    layer: str
    sensors: tuple[str, ...]
    rule: str
    settings: Settings
    kept_out: tuple[KeptOut, ...]
    same_room: bool
    by_walls: bool

    @property
    def before(self) -> float:
        """The mean loss of what was kept out, as it was."""
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
    by_walls = cases[0].truth is not None
    rooms = list(dict.fromkeys(each.room for each in cases))
    if len(rooms) > 1 and by_walls:
        groups = [[each for each in cases if each.room == room] for room in rooms]
    elif len(cases) > 1:
        groups = [[each] for each in cases]
    else:
        groups = [[cases[0].half(second)] for second in (False, True)]
    kept_out = []
    for k, group in enumerate(groups):
        others = fit([each for n, other in enumerate(groups) if n != k for each in other])
        kept_out += [KeptOut(c.name, loss_of(c, {}), loss_of(c, others)) for c in group]
    names = dict.fromkeys(s.name for case in cases for s in case.readings.sensors
                          if s.layer == case.layer)  # fmt: skip
    return LearnedStrengths(
        cases[0].layer, tuple(names), sensor.update, settings, tuple(kept_out),
        by_walls and len(rooms) == 1, by_walls,
    )  # fmt: skip


def fit(cases: Sequence[Case]) -> Settings:
    """The keys that suit some cases best."""
    sensor = cases[0].sensor
    like = _weights(sensor)
    if sensor.update == Pooled.name and cases[0].truth is None:
        return _searched(cases, ["factor"], lambda values: {
            "weights": Table(as_table(_times(like, values["factor"])))
        })  # fmt: skip
    if sensor.update == Pooled.name:
        samples = [_sample(each.thinned(nth)) for each in cases for nth in THINNED]
        return {"weights": Table(as_table(fit_weights(samples, like, pull=PULL)))}
    return _searched(cases, _strengths_of(sensor), dict)


def loss_of(case: Case, settings: Mapping[str, Any]) -> float:
    """Of its map with some keys changed: the mean of all readings and every sixth."""
    return float(np.mean([each.judge()(settings) for each in _parts(case)]))


def _parts(case: Case) -> list[Case]:
    """All its readings, and every sixth; where these judge themselves, all alone."""
    return [case.thinned(nth) for nth in THINNED] if case.truth is not None else [case]


def _sample(case: Case) -> Sample:
    assert case.truth is not None
    seen = observable_cells([case.looking], case.truth, case.geometry)[case.layer]
    return sample_of(case.map({}).state, seen, case.truth)


def _times(weights: Weights, factor: float) -> Weights:
    of = {name: factor * value for name, value in weights.of.items()}
    return replace(weights, bias=factor * weights.bias, of=of)


def _weights(sensor: Sensor) -> Weights:
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


def _searched(
    cases: Sequence[Case], names: Sequence[str], keys_of: Callable[[dict[str, float]], Settings]
) -> Settings:
    """Those with the least mean loss, by the simplex of Nelder and Mead (1965)."""
    from scipy.optimize import minimize

    judges = [part.judge() for each in cases for part in _parts(each)]
    sensor = cases[0].sensor
    start = np.array([_free(name, float(getattr(sensor, name, 1.0))) for name in names])

    def settings_of(values: NDArray[np.float64]) -> Settings:
        pairs = zip(names, values.tolist(), strict=True)
        return keys_of({name: float(f"{_bound(name, value):.4g}") for name, value in pairs})

    def loss(values: NDArray[np.float64]) -> float:
        settings = settings_of(values)
        return float(np.mean([of_part(settings) for of_part in judges]))

    simplex = np.vstack([start, start + _WIDE * np.eye(len(start))])
    options = {"maxfev": _TRIES, "initial_simplex": simplex, "xatol": 0.02, "fatol": 1e-4}
    return settings_of(minimize(loss, start, method="Nelder-Mead", options=options).x)


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
