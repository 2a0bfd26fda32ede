"""How well a map predicts readings that it was not made of: a score without true walls.

Readings are cut into blocks of neighbours in time; each block is judged by the map of the readings
of other blocks. A range is judged by a mixture: about the first obstacle of its beam (hit), evenly
before it (short), nothing seen though something is there (none), anywhere (random), so that one
wrong echo does not decide. The score is the mean log-likelihood of a reading, natural logarithm of
a density in metres: higher is better, and a difference of 0.1 means that a reading is predicted
10 % better. Its interval comes of drawing whole blocks anew, for neighbours err together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.config import MappingConfig
from mapping.grid import GridGeometry
from mapping.layer_map import empty_maps
from mapping.parameters import Sensor
from mapping.placed_session import PlacedSession
from mapping.readings import Readings
from recorder.columns import Floats, Ints
from recorder.errors import BadInput
from recorder.sensors import CATALOGUE

FOLDS = 4
BLOCK = 200  # readings; shorter sessions have shorter blocks
_LEAST_BLOCK, _FEWEST_BLOCKS = 10, 20
_DRAWS = 1000
_RAY_SPACING_RAD = math.radians(5.0)
_MIXTURE_ERROR_M, _MIXTURE_ERROR = 0.01, 0.75  # the latter: of the kind's relative range error
FREE_PATH_M = 1.5  # how far a beam gets on the average, in a place of which nothing is known
_LEAST = 0.01  # no map is surer of a cell than this: one wrong cell must not rule a range out


@dataclass(frozen=True, slots=True)
class Mixture:
    """How a kind of sensor errs: shares that sum to 1, and the spread of a hit."""

    error_m: float = _MIXTURE_ERROR_M
    error: float = 0.04
    hit: float = 0.80
    short: float = 0.05
    none: float = 0.05
    random: float = 0.10

    @property
    def shares(self) -> Floats:
        """Hit, short, none, random."""
        return np.array([self.hit, self.short, self.none, self.random])

    @classmethod
    def of(cls, sensor: Sensor) -> Mixture:
        """That of its kind: a setting of the sensor's must not change who judges it."""
        known = CATALOGUE.get(sensor.kind)
        return cls(error=_MIXTURE_ERROR * (known.range_error if known else sensor.range_error))


@dataclass(frozen=True, slots=True)
class BlockScores:
    """Log-likelihoods added up by blocks: ``total`` and ``count`` are (B,)."""

    total: Floats
    count: Ints

    @classmethod
    def of(cls, values: Floats, block: Ints, blocks: int) -> BlockScores:
        """Those of readings (N,), each of a block."""
        return cls(_sums(block, values, blocks), np.bincount(block, minlength=blocks))

    @classmethod
    def joined(cls, parts: Sequence[BlockScores]) -> BlockScores:
        """Those of several sessions together."""
        return cls(
            np.concatenate([each.total for each in parts]),
            np.concatenate([each.count for each in parts]),
        )

    @property
    def mean(self) -> float:
        """The score: of all readings alike."""
        count = int(self.count.sum())
        return float(self.total.sum()) / count if count else math.nan

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Between which values the score lies with that probability; NaN of under two blocks."""
        return _interval(self.total, self.count, level)

    def gain_over(self, other: BlockScores, level: float = 0.95) -> Gain:
        """By how much it is better than another score of the same readings, with interval."""
        if not np.array_equal(self.count, other.count):
            raise ValueError("scores of different readings cannot be compared")
        low, high = _interval(self.total - other.total, self.count, level)
        return Gain(self.mean - other.mean, low, high)


@dataclass(frozen=True, slots=True)
class Gain:
    """A difference of two scores, and between which values it lies with 95 % probability."""

    mean: float
    low: float
    high: float


def _sums(group: Ints, values: Floats, groups: int) -> Floats:
    """Values (N,) added up by group, (groups,)."""
    return np.asarray(np.bincount(group, weights=values, minlength=groups), np.float64)


def _interval(total: Floats, count: Ints, level: float) -> tuple[float, float]:
    """The percentile bootstrap of ``total.sum() / count.sum()`` over blocks (B,).

    Efron and Tibshirani, An Introduction to the Bootstrap, 1993. Always the same draws.
    """
    there = np.flatnonzero(count)
    if len(there) < 2:
        return math.nan, math.nan
    drawn = np.random.default_rng(0).choice(there, (_DRAWS, len(there)))
    means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)


def blocks_of(count: int, block: int = BLOCK) -> tuple[Ints, int]:
    """The block of each of ``count`` readings in their order, (N,), and how many blocks there are.

    All blocks are of nearly one size; a short session has at least twenty, if they hold ten
    readings each.
    """
    size = max(_LEAST_BLOCK, min(block, count // _FEWEST_BLOCKS))
    blocks = max(1, round(count / size))
    return np.arange(count) * blocks // max(count, 1), blocks


@dataclass(frozen=True, slots=True)
class Judged:
    """What became of N readings: ``axes_row`` (K,) is the reading of each axis.

    ``log_likelihood`` and ``expected_m`` (the range that the map of the others predicts; +Inf:
    nothing is met) are (K,). ``block`` is (N,).
    """

    readings: Readings
    block: Ints
    blocks: int
    axes_row: Ints
    log_likelihood: Floats
    expected_m: Floats

    @property
    def scores(self) -> BlockScores:
        """The score of all sensors together."""
        return BlockScores.of(self.log_likelihood, self.block[self.axes_row], self.blocks)

    def of_sensors(self, names: Sequence[str]) -> BlockScores:
        """The score of some sensors alone."""
        mine = self._of(names)[self.axes_row]
        return BlockScores.of(
            self.log_likelihood[mine], self.block[self.axes_row[mine]], self.blocks
        )

    def gain_over(
        self, other: Judged, names: Sequence[str] | None = None, level: float = 0.95
    ) -> Gain:
        """By how much it is better, over the readings that both judged; of some sensors alone.

        A reading is the same where its time and its sensor are, and its number of axes. Raises
        BadInput where the two have none in common.
        """
        before, after = self.paired(other, names)
        return after.gain_over(before, level)

    def gains_of_halves(self, other: Judged) -> tuple[float, float]:
        """By how much it is better in the first half of the blocks, and in the second."""
        before, after = self.paired(other, None)
        gain = after.total - before.total
        half, count = self.blocks // 2, np.maximum(after.count, 0)
        parts = (slice(0, half), slice(half, None))
        first, last = (float(gain[p].sum()) / max(int(count[p].sum()), 1) for p in parts)
        return first, last

    def paired(self, other: Judged, names: Sequence[str] | None) -> tuple[BlockScores, BlockScores]:
        """The other's scores and its own, over the readings that both judged.

        Raises BadInput where the two have none in common.
        """
        first_ns = min(int(each.readings.t_ns.min()) for each in (self, other))
        mine, its = np.intersect1d(self._keys(first_ns), other._keys(first_ns), True, True)[1:]
        axes, same = np.diff(self.readings.begins), np.diff(other.readings.begins)
        kept = axes[mine] == same[its]
        if names is not None:
            kept &= self._of(names)[mine]
        mine, its = mine[kept], its[kept]
        if not len(mine):
            raise BadInput("the two scores have no reading in common")
        before, after = other.of_readings[its], self.of_readings[mine]
        block, blocks = self.block[mine], self.blocks
        count = _sums(block, axes[mine].astype(np.float64), blocks).astype(np.int64)
        return tuple(  # type: ignore[return-value]
            BlockScores(_sums(block, values, blocks), count) for values in (before, after)
        )

    @property
    def of_readings(self) -> Floats:
        """The log-likelihood of each reading, all its axes together, (N,)."""
        return _sums(self.axes_row, self.log_likelihood, len(self.readings))

    def _of(self, names: Sequence[str]) -> NDArray[np.bool_]:
        wanted = np.array([sensor.name in names for sensor in self.readings.sensors], np.bool_)
        mine: NDArray[np.bool_] = wanted[self.readings.sensor]
        return mine

    def _keys(self, first_ns: int) -> Ints:
        """What a reading is known by, (N,): its time since the first, and its sensor."""
        sensors = len(self.readings.sensors)
        return (self.readings.t_ns - first_ns) * sensors + self.readings.sensor


def judge(
    readings: Readings,
    block: Ints,
    blocks: int,
    geometry: GridGeometry,
    occupied: Mapping[str, NDArray[np.float32]],
) -> Judged:
    """Each reading by the map of the others.

    ``occupied``, by layer: (F, rows, cols), the probability of each cell where the blocks of fold
    f (block % F) were kept out.
    """
    from mapping.kernels.held_out import log_likelihoods

    row = np.repeat(np.arange(len(readings)), np.diff(readings.begins))
    value, expected_m = np.zeros(len(row)), np.zeros(len(row))
    res, (x0, y0) = geometry.resolution_m, geometry.origin_m
    start = readings.world_from_sensor
    longest = float(geometry.rows + geometry.cols)  # no ray stays within the grid for longer
    for number, sensor in enumerate(readings.sensors):
        mine = np.flatnonzero(readings.sensor[row] == number)
        if not len(mine):
            continue
        at, maps, mixture = row[mine], occupied[sensor.layer], Mixture.of(sensor)
        is_scan = np.diff(readings.begins)[at[0]] > 1
        value[mine], expected_m[mine] = log_likelihoods(
            maps, block[at] % len(maps), (start.x_m[at] - x0) / res, (start.y_m[at] - y0) / res,
            start.heading_rad[at] + readings.bearings_rad[mine],
            np.zeros(1) if is_scan else fan_of(sensor.beam_width_rad),
            readings.ranges_m[mine] / res, np.minimum(readings.reach_m[mine] / res, longest), res,
            mixture.shares, mixture.error_m, mixture.error,
        )  # fmt: skip
    return Judged(readings, block, blocks, row, value, expected_m)


def fan_of(beam_width_rad: float) -> Floats:
    """Directions across a beam, (J,), at most five degrees apart; of a thin beam its axis alone."""
    steps = math.ceil(beam_width_rad / _RAY_SPACING_RAD)
    if steps < 3:
        return np.zeros(1)
    return np.linspace(-0.5, 0.5, steps + 1) * beam_width_rad


def as_occupied(probability: NDArray[np.floating], resolution_m: float) -> NDArray[np.float32]:
    """What the judge takes of a map, whose probabilities begin at 0.5, as if half of all were wall.

    Most of a room is free: the odds of each cell are those of the map times those that a beam ends
    in a cell of which nothing is known.
    """
    prior = min(resolution_m / FREE_PATH_M, 0.5)
    held = np.clip(probability, _LEAST, 1.0 - _LEAST)
    odds = held / (1.0 - held) * (prior / (1.0 - prior))
    occupied: NDArray[np.float32] = (odds / (1.0 + odds)).astype(np.float32)
    return occupied


def held_out(
    placed: PlacedSession,
    config: MappingConfig,
    geometry: GridGeometry,
    *,
    folds: int = FOLDS,
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Judged:
    """The readings of a session judged by its own maps, with the models and rules configured.

    Each sensor is judged by the map of its layer. ``progress(folds done, folds)``. Raises BadInput
    where there are too few readings to keep some out.
    """
    readings = Readings.joined(list(placed))
    block, blocks = blocks_of(len(readings))
    if blocks < 2:
        raise BadInput(f"{len(readings)} readings are too few to keep some of them out")
    folds = min(folds, blocks)
    found: dict[str, list[NDArray[np.float32]]] = {}
    for fold in range(folds):
        maps = empty_maps(placed.placement.sensors, geometry, config.grid, threads=threads)
        others = readings.chosen(block % folds != fold)
        for name, each in maps.items():
            each.merge_many(others)
            layer = each.layer()
            found.setdefault(name, []).append(as_occupied(layer.probability, geometry.resolution_m))
        if progress is not None:
            progress(fold + 1, folds)
    return judge(readings, block, blocks, geometry, {k: np.stack(v) for k, v in found.items()})
