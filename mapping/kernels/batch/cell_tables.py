"""What ``cellwise`` and ``sums`` know of sensors and rules. This file does not load numba."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MODELS = ("regions", "peak", "fading")
SUM, MASSES, EVIDENCE = range(3)  # the rules of `cellwise`
SATURATING, POOLED = range(2)  # the rules of `sums`
KINDS = ("none", "constant", "linear", "combined")
(HALF_WIDTH, MODEL, EMPTINESS, HIT, MISS, NEAR, FADE, P_HIT, P_MISS, A_MAX, Q_MAX) = range(11)


class CellSensor(NamedTuple):
    """One sensor: its beam and what its model takes; a factor not modelled is a table of one 1."""

    beam_width_rad: float
    model: str
    emptiness: str
    hit: float
    miss: float
    near: float
    fade_m: float
    p_hit: float
    p_miss: float
    angle: Floats
    distance: Floats


def tables_of(sensors: Sequence[CellSensor]) -> tuple[Floats, Floats, Floats]:
    """The tables ``add_cellwise`` takes: (S, 11), factors of the angular regions (S, A) and (S, B).

    Sensors of different numbers of regions get as many as hold all of them.
    """
    a = math.lcm(*(s.angle.size for s in sensors))
    b = math.lcm(*(s.distance.size for s in sensors))
    rows = [
        (s.beam_width_rad / 2.0, MODELS.index(s.model), KINDS.index(s.emptiness), s.hit, s.miss,
         s.near, s.fade_m, s.p_hit, s.p_miss, s.angle.max(), s.distance.max())
        for s in sensors
    ]  # fmt: skip
    angles = np.array([np.repeat(s.angle, a // s.angle.size) for s in sensors])
    distances = np.array([np.repeat(s.distance, b // s.distance.size) for s in sensors])
    return np.array(rows, np.float64), angles, distances
