"""A sensor's character, from readings whose true distance is known, and what it means for maps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mapping.learning.known_ranges import KnownRanges
from mapping.learning.mixture import FEWEST, BeamMixture, Fit, Pairs, fit_mixture
from mapping.learning.near_far import NearFar, near_and_far
from mapping.parameters import Sensor
from recorder.columns import Floats
from recorder.errors import BadInput
from recorder.messages import Radiation

_MAD = 1.4826
_BINS = 12
_FEWEST_IN_BIN = 20
_INCIDENCE_EDGES_DEG = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 75.0, 90.0)
_USABLE_HITS = 0.4  # of the readings at a distance: with less the sensor is not to be used there
_LONG_M, _LONG_SPREADS = 0.1, 3.0
_BAND_SPREADS = 2.5  # standard deviations of a hit that the band of a thin beam takes in
_LEAST_BAND = 0.01
_COARSE_STEPS = 12
_LEAST_SCALE = 0.5  # and at most twice: no ranger is so far off, but readings of another room are
_WIDEST_SPREAD = 0.5  # of a typical distance, one standard deviation


@dataclass(frozen=True, slots=True)
class RangeBin:
    """Readings at about one true distance: how far off their hits are, and what became of all.

    ``offset_m`` and ``spread_m`` are the median and the spread by median absolute deviation of the
    readings that are more likely hits than not (NaN of too few). Shares are of all readings.
    """

    from_m: float
    to_m: float
    readings: int
    offset_m: float
    spread_m: float
    hit: float
    short: float
    none: float
    long: float


@dataclass(frozen=True, slots=True)
class IncidenceBin:
    """Readings that met a surface at about one angle to its normal; shares of hits, no echo and
    echoes that are too long."""

    from_deg: float
    to_deg: float
    readings: int
    hit: float
    none: float
    long: float


@dataclass(frozen=True, slots=True)
class LearnedSensor:
    """What was learned of one sensor.

    ``against`` names what its ranges were held against. ``beam_width_rad`` and its interval are
    None where they could not be learned. ``long`` is the share of the echoes that are too long by
    more than 10 cm and three spreads. ``usable_m`` is where at least 40 % of the readings are hits,
    ``met_m`` the nearest and the farthest distance that was met: beyond these nothing is known.
    ``near_far`` are two models, where one is surely worse. ``tuned`` are the settings that proved
    better by the score without truth, where nothing better than a map is known (else None).
    ``pairs`` and ``hit_share`` (N,) are the readings behind it.
    """

    sensor: Sensor
    against: str
    fit: Fit
    beam_width_rad: float | None
    beam_interval_rad: tuple[float, float] | None
    long: float
    usable_m: tuple[float, float]
    met_m: tuple[float, float]
    by_range: tuple[RangeBin, ...]
    by_incidence: tuple[IncidenceBin, ...]
    pairs: Pairs
    hit_share: Floats
    tuned: Mapping[str, float] | None = None
    near_far: NearFar | None = None

    @property
    def typical_m(self) -> float:
        """The median true distance of its readings."""
        return float(np.median(self.pairs.true_m))

    @property
    def relative_error(self) -> float:
        """Two standard deviations of a hit at the typical distance, relative to it; of the far
        model, where there are two."""
        if self.near_far is not None:
            return 2.0 * self.near_far.far
        return float(2.0 * self.fit.mixture.std_m(self.typical_m)) / self.typical_m

    @property
    def _beam_is_known(self) -> bool:
        if self.beam_width_rad is None or self.beam_interval_rad is None:
            return False
        low, high = self.beam_interval_rad
        return high - low <= self.beam_width_rad

    def settings(self) -> dict[str, Any]:
        """The keys of ``[sensors.NAME]`` that follow from it.

        Bias and scale only where the interval of one of them leaves out 0 or 1, the beam's width
        only where its interval is no wider than the width itself: else they are chance.
        """
        if self.tuned is not None:
            return dict(self.tuned)
        fit, values = self.fit, dict[str, Any]()
        mixture = fit.mixture
        if "scale" not in fit.fixed:
            low, high = fit.interval["scale"]
            off_scale = not low <= 1.0 <= high
            low, high = fit.interval["bias_m"]
            if off_scale or not low <= 0.0 <= high:
                values["range_scale"] = round(mixture.scale, 4)
                values["range_bias_m"] = round(mixture.bias_m, 4)
        if self.beam_width_rad and self._beam_is_known:  # of a thin line the stated beam stays
            values["beam_width_deg"] = round(math.degrees(self.beam_width_rad), 1)
        values |= self._of_spread(self.relative_error)
        if self.near_far is not None:
            near = self._of_spread(2.0 * self.near_far.near)
            if near != self._of_spread(self.relative_error):
                values["ranges"] = [{"up_to_m": round(self.near_far.up_to_m, 3), **near}]
        return values

    def _of_spread(self, relative_error: float) -> dict[str, float]:
        """The keys of a model that follow from two standard deviations, relative to the range."""
        values = {"range_error": round(min(max(relative_error, 0.005), 0.5), 4)}
        if self.sensor.radiation is not Radiation.ULTRASOUND and self.sensor.model == "fading":
            band = _BAND_SPREADS / 2.0 * relative_error
            values["before"] = values["behind"] = round(min(max(band, _LEAST_BAND), 0.5), 4)
        return values


def learn_sensor(known: KnownRanges, against: str, *, own_map: bool = False) -> LearnedSensor:
    """Fit the mixture, at the beam width that explains the readings best where it can be known.

    ``own_map``: the distances come from the sensor's own map, which cannot tell bias and scale.
    Raises BadInput where there are too few readings, or they do not follow the distances.
    """
    width_rad, interval_rad = None, None
    if len(known.bearings_rad) > 1:
        width_rad, interval_rad = _beam_width(known)
    pairs, incidence_rad = known.within(width_rad or 0.0)
    fit = fit_mixture(pairs, unbiased=own_map)
    if not own_map:
        _check_follows(known.sensor.name, fit.mixture, pairs, against)
    good = np.isfinite(pairs.true_m) & (pairs.true_m > 0.0) & ~np.isnan(pairs.range_m)
    pairs, incidence_rad = pairs.select(good), incidence_rad[good]
    densities = fit.mixture.densities(pairs)
    cause = densities / np.maximum(densities.sum(axis=1), 1e-300)[:, None]
    long = _too_long(fit, pairs)
    seen = np.isfinite(pairs.range_m)
    by_range = _by_range(pairs, cause, long)
    return LearnedSensor(
        known.sensor, against, fit, width_rad, interval_rad, float(long[seen].mean()),
        _usable(pairs, cause, by_range), (float(pairs.true_m.min()), float(pairs.true_m.max())),
        by_range, _by_incidence(pairs, cause, incidence_rad, long), pairs, cause[:, 0],
        near_far=None if own_map else near_and_far(fit.mixture, pairs),
    )  # fmt: skip


def _check_follows(name: str, mixture: BeamMixture, pairs: Pairs, against: str) -> None:
    """Raises BadInput where what would be right readings has little to do with the distances."""
    typical_m = float(np.median(pairs.true_m[np.isfinite(pairs.true_m)]))
    share = float(mixture.std_m(typical_m)) / max(typical_m, 1e-9)
    if _LEAST_SCALE <= mixture.scale <= 1.0 / _LEAST_SCALE and share <= _WIDEST_SPREAD:
        return
    raise BadInput(
        f"{name}: its ranges do not follow {against} (the best fit is {mixture.scale:.2g} times "
        f"the distance, +-{100 * share:.0f} %): is it the right room, are poses and mount right?"
    )


def _too_long(fit: Fit, pairs: Pairs) -> np.ndarray[Any, np.dtype[np.bool_]]:
    mean_m, std_m = fit.mixture.mean_m(pairs.true_m), fit.mixture.std_m(pairs.true_m)
    beyond = pairs.range_m > mean_m + np.maximum(_LONG_M, _LONG_SPREADS * std_m)
    return np.asarray(beyond & np.isfinite(pairs.range_m))


def _beam_width(known: KnownRanges) -> tuple[float, tuple[float, float]]:
    """The width with the greatest likelihood, coarsely and then by whole rays, and an interval:
    the widths whose likelihood is not worse beyond what the blocks' differences come to."""
    of_width: dict[int, Floats] = {}
    spacing_rad = 2.0 * float(known.bearings_rad[-1] - known.bearings_rad[-2])
    most = (len(known.bearings_rad) - 1) // 2

    def by_block(rays: int) -> Floats:
        """The mean log-likelihood of a reading, by block what it adds."""
        if rays not in of_width:
            pairs, _ = known.within(rays * spacing_rad)
            value = fit_mixture(pairs).mixture.log_likelihoods(pairs)
            of_width[rays] = np.bincount(
                pairs.block, value, minlength=int(known.block.max()) + 1
            ) / max(len(pairs.range_m), 1)
        return of_width[rays]

    steps = sorted({round(k * most / _COARSE_STEPS) for k in range(_COARSE_STEPS + 1)})
    best = max(steps, key=lambda rays: float(by_block(rays).sum()))
    stride = max(1, math.ceil(most / _COARSE_STEPS))
    fine = range(max(best - stride, 0), min(best + stride, most) + 1)
    best = max(fine, key=lambda rays: float(by_block(rays).sum()))
    as_good = [rays for rays in of_width if _not_worse(by_block(rays) - by_block(best))]
    return best * spacing_rad, (min(as_good) * spacing_rad, max(as_good) * spacing_rad)


def _not_worse(difference: Floats) -> bool:
    """Whether differences by block (B,), below zero in sum, may be chance."""
    spread = float(np.std(difference)) * math.sqrt(len(difference))
    return float(difference.sum()) >= -1.96 * spread


def _by_range(pairs: Pairs, cause: Floats, long: np.ndarray[Any, Any]) -> tuple[RangeBin, ...]:
    edges = np.unique(np.quantile(pairs.true_m, np.linspace(0.0, 1.0, _BINS + 1)))
    if len(edges) < 2:
        edges = np.array([edges[0], edges[0]])
    of = np.clip(np.searchsorted(edges, pairs.true_m, "right") - 1, 0, len(edges) - 2)
    bins = []
    for number in np.unique(of).tolist():
        mine = of == number
        hits = mine & (cause[:, 0] > 0.5)
        off_m = (pairs.range_m - pairs.true_m)[hits]
        enough = len(off_m) >= _FEWEST_IN_BIN
        offset_m = float(np.median(off_m)) if enough else math.nan
        spread_m = _MAD * float(np.median(np.abs(off_m - offset_m))) if enough else math.nan
        shares = cause[mine].mean(axis=0)
        bins.append(
            RangeBin(
                float(edges[number]), float(edges[number + 1]), int(mine.sum()), offset_m,
                spread_m, float(shares[0]), float(shares[1]), float(shares[2]),
                float(long[mine].mean()),
            )
        )  # fmt: skip
    return tuple(bins)


def _by_incidence(
    pairs: Pairs, cause: Floats, incidence_rad: Floats, long: np.ndarray[Any, Any]
) -> tuple[IncidenceBin, ...]:
    bins, degrees = [], np.degrees(incidence_rad)
    for low, high in itertools.pairwise(_INCIDENCE_EDGES_DEG):
        mine = (degrees >= low) & (degrees < high)
        if int(mine.sum()) >= _FEWEST_IN_BIN:
            shares = cause[mine].mean(axis=0)
            seen = mine & np.isfinite(pairs.range_m)
            too_long = float(long[seen].mean()) if seen.any() else math.nan
            bins.append(
                IncidenceBin(
                    low, high, int(mine.sum()), float(shares[0]), float(shares[2]), too_long
                )
            )
    return tuple(bins)


def _usable(pairs: Pairs, cause: Floats, bins: tuple[RangeBin, ...]) -> tuple[float, float]:
    """The stretch of distances around the best one in which at least 40 % are hits; one bin with
    fewer between two with more, as where the robot faced a corner, does not end it."""
    hits = np.pad([each.hit for each in bins], 1, mode="edge")
    middle = np.median([hits[:-2], hits[1:-1], hits[2:]], axis=0)
    good = (middle >= _USABLE_HITS).tolist()
    if not any(good):
        return math.nan, math.nan
    best = int(np.argmax(middle))
    first = last = best
    while first > 0 and good[first - 1]:
        first -= 1
    while last < len(bins) - 1 and good[last + 1]:
        last += 1
    hits_m = pairs.true_m[cause[:, 0] > 0.5]
    low_m = float(hits_m.min()) if first == 0 else bins[first].from_m
    high_m = float(hits_m.max()) if last == len(bins) - 1 else bins[last].to_m
    return low_m, high_m


def check_enough(known: KnownRanges) -> None:
    """Raises BadInput where a sensor has too few readings to learn anything from."""
    seen = int(np.isfinite(known.range_m).sum())
    if seen < FEWEST:
        raise BadInput(f"{known.sensor.name}: {seen} echoes are too few to learn from ({FEWEST})")
