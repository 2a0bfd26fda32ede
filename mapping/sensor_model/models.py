"""The evidence of a reading for a cell: the sensor models, behind one small interface.

A model states where the band of a reading lies, and how likely each cell that the beam covers is
occupied. It never sees a grid, only distances and angles, so every rasteriser can use it. A model
of your own is a class with a ``name`` and an ``occupied``; see docs/plugins.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mapping.numbers import expit
from mapping.parameters import Configurable, Fraction, NonNegative, Positive, Sensor
from recorder.errors import BadInput

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

NEAR_M = 0.35  # `fading`: within this distance of the sensor emptiness is surer
# The chapter's own digits for half of the regions; its worked figures need them.
_CHAPTER_REGIONS = {
    6: (0.0214, 0.1359, 0.3413),
    12: (0.0049, 0.0166, 0.0440, 0.0919, 0.1498, 0.1915),
}


@lru_cache(maxsize=64)
def regions_table(regions: int) -> Floats:
    """Probability of each of n equal regions over ±3 standard deviations, ``(n,)``.

    The chapter's rounded digits for 6 and 12, differences of the normal distribution function for
    any other multiple of 6. Raises BadInput for anything else.
    """
    if regions <= 0 or regions % 6:
        raise BadInput(f"regions must be a multiple of 6 (6, 12, 18 ...), not {regions}")
    if regions in _CHAPTER_REGIONS:
        half = np.array(_CHAPTER_REGIONS[regions])
    else:
        borders = np.linspace(-3.0, 0.0, regions // 2 + 1).tolist()
        half = np.diff([0.5 * math.erfc(-x / math.sqrt(2.0)) for x in borders])
    table = np.concatenate([half, half[::-1]])
    table.flags.writeable = False
    return table


def region_of(fraction: Floats, regions: int) -> NDArray[np.int64]:
    """Region that holds a fraction 0 .. 1 of the way across: min(floor(fraction n), n - 1)."""
    return np.clip(np.floor(fraction * regions).astype(np.int64), 0, regions - 1)


@dataclass(frozen=True, slots=True)
class CellsInBeam:
    """The cells (or samples) that one reading covers, as seen from its sensor; all arrays (N,).

    ``rho_m`` is the distance from the sensor; ``along_m`` and ``across_m`` the same in the
    direction of the beam's axis and to its left. ``range_m`` is the reading of the axis that the
    cell belongs to (how far the sensor sees where nothing came back). The beam passed through what
    is nearer than ``band_start_m``; ``in_band`` are the cells from there to ``band_end_m``, where
    the obstacle may be. ``half_width_rad`` is half the beam's width.
    """

    rho_m: Floats
    along_m: Floats
    across_m: Floats
    range_m: Floats
    band_start_m: Floats
    band_end_m: Floats
    in_band: Flags
    half_width_rad: float

    def of(self, some: NDArray[np.int64]) -> CellsInBeam:
        """The same for some of the cells."""
        return CellsInBeam(
            self.rho_m[some],
            self.along_m[some],
            self.across_m[some],
            self.range_m[some],
            self.band_start_m[some],
            self.band_end_m[some],
            self.in_band[some],
            self.half_width_rad,
        )

    @property
    def alpha_rad(self) -> Floats:
        """Angle from the axis, counter-clockwise."""
        alpha: Floats = np.arctan2(self.across_m, self.along_m)
        return alpha

    @property
    def across_fraction(self) -> Floats:
        """0 at the right edge of the beam, 0.5 on its axis, 1 at the left edge."""
        return np.clip(0.5 + 0.5 * self.alpha_rad / self.half_width_rad, 0.0, 1.0)

    @property
    def band_fraction(self) -> Floats:
        """0 where the band begins, 1 where it ends; 0.5 where it has no depth."""
        depth = self.band_end_m - self.band_start_m
        deep = depth > 0.0
        ahead = self.rho_m - self.band_start_m
        return np.clip(np.where(deep, ahead / np.where(deep, depth, 1.0), 0.5), 0.0, 1.0)

    @property
    def way_to_band(self) -> Floats:
        """t: 0 at the sensor, 1 where the band begins."""
        ahead = self.band_start_m > 0.0
        return np.where(ahead, self.rho_m / np.where(ahead, self.band_start_m, 1.0), 1.0)


class SensorModel(Configurable):
    """Base of all models: the band is the range and its relative error on both sides.

    ``Parameters`` are the keys of ``[sensors.NAME]`` that the model goes by, besides what every
    sensor has; it reads their values from the sensor.
    """

    def band(self, sensor: Sensor) -> tuple[float, float]:
        """How far the band reaches before and behind a range, relative to the range."""
        return sensor.range_error, sensor.range_error

    def occupied(self, sensor: Sensor, beam_cells: CellsInBeam) -> Floats:
        """Probability, given this reading alone, that each of ``beam_cells`` is occupied, (N,)."""
        raise NotImplementedError


def emptiness(kind: str, t: Floats) -> Floats:
    """q in front of the band, -1 (surely empty) .. 0 (no evidence), at t = 0 .. 1 of the way."""
    if kind == "constant":
        return np.full_like(t, -1.0)
    if kind == "linear":
        return t - 1.0
    if kind == "combined":
        return -np.minimum(1.0, 2.0 * (1.0 - t))
    return np.zeros_like(t)


def _angle_factor(sensor: Sensor, beam_cells: CellsInBeam) -> tuple[Floats, float]:
    """Factor a of each cell, and the largest that there is."""
    if sensor.gaussian not in ("both", "angle"):
        return np.ones_like(beam_cells.rho_m), 1.0
    table = regions_table(sensor.regions)
    return table[region_of(beam_cells.across_fraction, sensor.regions)], float(table.max())


def _distance_factor(sensor: Sensor, beam_cells: CellsInBeam) -> tuple[Floats, float]:
    """Factor q of each cell (negative in front of the band), and the largest that there is."""
    empty = emptiness(sensor.emptiness, beam_cells.way_to_band)
    if sensor.gaussian not in ("both", "distance"):
        return np.where(beam_cells.in_band, 1.0, empty), 1.0
    table = regions_table(sensor.regions)
    likely = table[region_of(beam_cells.band_fraction, sensor.regions)]
    return np.where(beam_cells.in_band, likely, empty), float(table.max())


class Regions(SensorModel):
    """The chapter's: 0.5 + a q / 2. The finer the regions, the less a cell weighs."""

    name = "regions"

    class Parameters(SensorModel.Parameters):
        regions: int = Field(12, description="regions over +-3 standard deviations: 6, 12 ...")
        gaussian: Literal["both", "angle", "distance", "none"] = Field(
            "both", description="which of the two errors are Gaussian"
        )
        emptiness: Literal["none", "constant", "linear", "combined"] = Field(
            "combined", description="what is said of the cells in front of the band"
        )

    def occupied(self, sensor: Sensor, beam_cells: CellsInBeam) -> Floats:
        a, _ = _angle_factor(sensor, beam_cells)
        q, _ = _distance_factor(sensor, beam_cells)
        return 0.5 + a * q / 2.0


class Peak(SensorModel):
    """The same shape scaled to ``p_hit`` at the likeliest place and ``p_miss`` at the sensor."""

    name = "peak"

    class Parameters(Regions.Parameters):
        p_hit: Fraction = Field(0.7, description="probability at the likeliest place")
        p_miss: Fraction = Field(0.4, description="probability close to the sensor")

    def occupied(self, sensor: Sensor, beam_cells: CellsInBeam) -> Floats:
        a, a_max = _angle_factor(sensor, beam_cells)
        q, q_max = _distance_factor(sensor, beam_cells)
        a = a / a_max
        hit = 0.5 + (sensor.p_hit - 0.5) * a * q / q_max
        miss = 0.5 + (0.5 - sensor.p_miss) * a * q
        return np.where(beam_cells.in_band, hit, miss)


class Fading(SensorModel):
    """A wall lies on the arc or behind it, and far readings count less; the same over the beam."""

    name = "fading"

    class Parameters(SensorModel.Parameters):
        hit: NonNegative = Field(description="log-odds of the band, close by")
        miss: NonNegative = Field(description="log-odds taken in front")
        near: NonNegative = Field(description="how much surer close to the sensor")
        before: NonNegative = Field(description="band before the range, relative")
        behind: NonNegative = Field(description="band behind the range, relative")
        fade_m: Positive = Field(description="range at which half is believed")

    def band(self, sensor: Sensor) -> tuple[float, float]:
        return sensor.before, sensor.behind

    def occupied(self, sensor: Sensor, beam_cells: CellsInBeam) -> Floats:
        hit = sensor.hit / (1.0 + np.square(beam_cells.range_m / sensor.fade_m))
        closeness = 1.0 + sensor.near * np.exp(-np.square(beam_cells.rho_m / NEAR_M))
        miss = sensor.miss * closeness / (1.0 + np.square(beam_cells.rho_m / sensor.fade_m))
        return expit(np.where(beam_cells.in_band, hit, -miss))


SENSOR_MODELS: dict[str, SensorModel] = {
    model.name: model for model in (Regions(), Peak(), Fading())
}
