"""What happens on the way from points to lines, one frozen value a step, so that it can be shown.

All places are in metres, in the frame of the points that went in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Place = tuple[float, float]


def place_of(point_m: NDArray[np.float64]) -> Place:
    """A point (2,) as a place."""
    return float(point_m[0]), float(point_m[1])


@dataclass(frozen=True, slots=True)
class Split:
    """The points between two ends are cut at ``at_m``.

    ``distance_m`` is what was too large: the distance of that point from the chord, or the rms of
    a fit that had grown until here.
    """

    start_m: Place
    end_m: Place
    at_m: Place
    distance_m: float


@dataclass(frozen=True, slots=True)
class Merge:
    """Two neighbouring pieces, which met at ``joint_m``, became one between the two ends.

    ``cost`` is how much they differed, by the rule in force, over what it allows (below 1).
    """

    start_m: Place
    joint_m: Place
    end_m: Place
    cost: float


@dataclass(frozen=True, slots=True)
class Fit:
    """A line was fitted to ``points`` points; its ends are its outer points, put on the line."""

    start_m: Place
    end_m: Place
    points: int
    rms_m: float


@dataclass(frozen=True, slots=True)
class Corner:
    """Two neighbouring lines were drawn out, or cut, to where they cross."""

    at_m: Place


Stage = Split | Merge | Fit | Corner
Observer = Callable[[Stage], None]
