"""The rule `pooled` as a recording follows it: what a reading adds to the sums of a cell, and the
value that sums stand for.

The writer and the reader of a log both keep the eight sums of every cell, so a record need not hold
the values that come of them. They need the rule's logarithms and exponentials to the last bit on
every machine, which no library promises: these are made here of sums and products alone, as tables
with a short series between their knots.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.update_rules import pooled
from mapping.update_rules.pooled import Pooled

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

SUMS = len(Pooled.start)
PIECES = 128  # of the curve from a total to a value, for 1 of the total
FARTHEST = 64.0  # total of log-odds that the curve reaches to
_LN2 = (0.6931471803691238, 1.9082149292705877e-10)  # its first bits, and the rest
_COUNTS = struct.Struct("<dddddd")


@dataclass(frozen=True, slots=True)
class SummedReading:
    """What one reading of one beam adds: where its sensor stood, and as the rule's kernel has it:
    the share of a hit, how far the arc's own cells reach, where the last stretch before it begins,
    and the range (metres, infinite where nothing came back)."""

    sensor_m: tuple[float, float]
    share: float
    arc_end_m: float
    last_m: float
    range_m: float

    def packed(self) -> bytes:
        """In :data:`LENGTH` bytes."""
        return _COUNTS.pack(*self.sensor_m, self.share, self.arc_end_m, self.last_m, self.range_m)

    @property
    def numbers(self) -> Floats:
        """As the kernel takes it, (4,)."""
        return np.array([self.share, self.arc_end_m, self.last_m, self.range_m])


LENGTH = _COUNTS.size


def unpacked(data: bytes) -> SummedReading:
    """The other way round."""
    x_m, y_m, *numbers = _COUNTS.unpack(data)
    return SummedReading((x_m, y_m), *numbers)


@dataclass(frozen=True)
class Formula:
    """The rule's numbers: weights (8,) in the order of its sums, then bias, the most of a cell that
    no beam passed through, the fading range, the limits, the least and the most of evidence."""

    numbers: Floats

    @classmethod
    def of(cls, rule: Pooled) -> Formula:
        """That of a rule with its weights."""
        learned = rule.learned
        weights = [learned.of[name] for name in Pooled.start]
        return cls(np.array([
            *weights, learned.bias, learned.most_unpassed, learned.fade_m,
            pooled.NEAR_M, pooled.MIDDLE_M, pooled.LEAST, pooled.MOST,
        ]))  # fmt: skip

    @cached_property
    def start(self) -> Floats:
        """The sums of a cell that no reading touched, (8,)."""
        return np.array(list(Pooled.start.values()))

    @cached_property
    def curve(self) -> Floats:
        """Cubics (N, 4) from a total of log-odds to the value, :data:`PIECES` for each 1."""
        return curve(float(self.numbers[-1]))

    def reading(self, temp: TempGrid) -> SummedReading:
        """What a reading of one beam adds."""
        beam, sensor = temp.beam, temp.beam.world_from_sensor
        range_m, fade_m = float(beam.ranges_m[0]), float(self.numbers[SUMS + 2])
        is_seen = math.isfinite(range_m) and range_m <= beam.mark_to_m
        share, end_m = 0.0, 0.0
        if math.isfinite(range_m):
            share = float(np.rint(2.0**24 / (1.0 + (range_m / fade_m) ** 2)) / 2.0**24)
            end_m = float(pooled.arc_end_m(np.array(range_m), temp.geometry.resolution_m)) + 1e-9
        last_m = range_m - pooled.BEFORE_ARC_M if is_seen else math.inf
        return SummedReading((sensor.x_m, sensor.y_m), share, end_m, last_m, range_m)


@cache
def logarithms() -> Floats:
    """ln and 1 / m at 513 places m evenly from 1/2 to 1, (513, 2)."""
    places = 0.5 + np.arange(513) / 1024.0
    return np.column_stack([_ln(places), 1.0 / places])


def _ln(m: Floats) -> Floats:
    """Of numbers from 1/2 to 1, as a series of the ratio (m - c) / (m + c)."""
    ratio = (m - 0.75) / (m + 0.75)
    series, square = np.zeros_like(m), ratio * ratio
    for k in range(25, 0, -2):
        series = series * square + 1.0 / k
    return 2.0 * ratio * series - 0.2876820724517809


@cache
def curve(most: float) -> Floats:
    """The cubics of 1 / (1 + exp(-most tanh(t / most))), t from -FARTHEST to FARTHEST, (N, 4)."""
    step = 1.0 / PIECES
    t = -FARTHEST + step * np.arange(int(2 * FARTHEST * PIECES) + 1)
    far = _exp(-2.0 * np.abs(t) / most)
    bent = np.where(t < 0.0, -1.0, 1.0) * (1.0 - far) / (1.0 + far)
    p = 1.0 / (1.0 + _exp(-most * bent))
    slope = p * (1.0 - p) * (1.0 - bent * bent) * step
    rise = p[1:] - p[:-1]
    return np.column_stack([
        p[:-1], slope[:-1], 3.0 * rise - 2.0 * slope[:-1] - slope[1:],
        slope[:-1] + slope[1:] - 2.0 * rise,
    ])  # fmt: skip


def _exp(x: Floats) -> Floats:
    whole = np.floor(x / _LN2[0] + 0.5)
    rest = (x - whole * _LN2[0]) - whole * _LN2[1]
    series = np.ones_like(x)
    for k in range(15, 0, -1):
        series = 1.0 + series * rest / k
    return np.ldexp(series, whole.astype(np.int64))
