"""What the kernel for `regions` and `peak` knows of a sensor, as tables. Does not load numba."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HALF_WIDTH, EMPTY_0, EMPTY_T, LARGEST = range(4)  # columns of the table of sensors
EMPTINESS = {
    "none": (0.0, 0.0), "constant": (1.0, 0.0), "linear": (1.0, -1.0), "combined": (2.0, -2.0),
}  # fmt: skip
"""Emptiness is the smaller of 1 and e0 + e1 t, t = 0 .. 1 from the sensor to the band."""


@dataclass(frozen=True, slots=True)
class RegionSensor:
    """One sensor: its beam, and z = 2p - 1 of its angular regions (A,), of both (A, B).

    ``front`` is what emptiness is multiplied with (z = -front emptiness), ``band`` z in the band.
    """

    beam_width_rad: float
    emptiness: str
    front: Floats
    band: Floats


def regions_sensor(
    beam_width_rad: float, emptiness: str, angle: Floats, distance: Floats
) -> RegionSensor:
    """`regions`: z = a q. ``angle`` (A,) and ``distance`` (B,) are the factors of the regions,
    each a one where it is not modelled."""
    return RegionSensor(beam_width_rad, emptiness, angle, np.outer(angle, distance))


def peak_sensor(
    beam_width_rad: float, emptiness: str, angle: Floats, distance: Floats, p_hit: float,
    p_miss: float,
) -> RegionSensor:  # fmt: skip
    """`peak`: the same scaled to p_hit at the likeliest place and p_miss at the sensor."""
    a, q = angle / angle.max(), distance / distance.max()
    band = np.outer((2.0 * p_hit - 1.0) * a, q)
    return RegionSensor(beam_width_rad, emptiness, (1.0 - 2.0 * p_miss) * a, band)


def tables_of(
    sensors: Sequence[RegionSensor],
) -> tuple[Floats, NDArray[np.float32], NDArray[np.int32]]:
    """The tables ``add_regions`` takes: (S, 4), (S, A) and (S, A, B).

    Sensors of different numbers of regions get as many as hold all of them.
    """
    a = math.lcm(*(s.front.size for s in sensors))
    b = math.lcm(*(s.band.shape[1] for s in sensors))
    rows, factors, tables = [], [], []
    for s in sensors:
        e0, e1 = EMPTINESS[s.emptiness]
        rows.append((s.beam_width_rad / 2.0, e0, e1, float(np.abs(s.front).max())))
        factors.append(np.repeat(s.front, a // s.front.size))
        repeated = np.repeat(s.band, a // s.band.shape[0], axis=0)
        tables.append(steps_of(np.repeat(repeated, b // s.band.shape[1], axis=1)))
    return np.array(rows), np.array(factors, np.float32), np.array(tables, np.int32)


def steps_of(z: Floats) -> NDArray[np.int32]:
    """z = 2p - 1 → steps of log-odds, clamped at 13.8."""
    with np.errstate(divide="ignore"):
        log_odds = np.log1p(z) - np.log1p(-z)
    steps: NDArray[np.int32] = np.rint(np.clip(log_odds, -13.8, 13.8) * (1 << 24)).astype(np.int32)
    return steps
