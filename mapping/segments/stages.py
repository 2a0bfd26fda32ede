"""What happens on the way from points to lines, one frozen value a step, so that it can be shown.

All places are in metres, in the frame of the points that went in.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import LineStage

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


@dataclass(frozen=True, slots=True)
class Move:
    """The line between two ends was fitted again to the readings it explains: ``moved_m`` across.

    Where several lines became one, it is the longest of them.
    """

    start_m: Place
    end_m: Place
    moved_m: float


@dataclass(frozen=True, slots=True)
class Drop:
    """The line between two ends is none: the readings speak against it, or for a better one."""

    start_m: Place
    end_m: Place


Stage = Split | Merge | Fit | Corner | Move | Drop
Observer = Callable[[Stage], None]

# In the order in which the methods go through them.
KINDS = ("split", "merge", "fit", "corner", "move", "drop")


def line_stages(
    stages: Sequence[Stage], *, layer: str, source: str, each: bool
) -> Iterator[LineStage]:
    """Artifacts of some stages: ``each`` gives one a stage in turn, else one for each kind."""
    if each:
        groups = [[stage] for stage in stages]
    else:
        groups = [[stage for stage in stages if _kind(stage) == kind] for kind in KINDS]
    for group in groups:
        if group:
            yield _together(group, layer, source)


def _kind(stage: Stage) -> str:
    return type(stage).__name__.lower()


def _together(stages: Sequence[Stage], layer: str, source: str) -> LineStage:
    """``stages`` are of one kind."""
    parts = [_parts(stage) for stage in stages]
    pieces = np.array([piece for piece, _, _ in parts if piece], np.float64).reshape(-1, 2, 2)
    places = np.array(list(itertools.chain(*(at for _, at, _ in parts))), np.float64).reshape(-1, 2)
    sizes = tuple(size for _, _, size in parts if size is not None)
    pieces.flags.writeable = places.flags.writeable = False
    return LineStage(layer, source, _kind(stages[0]), pieces, places, sizes)


def _parts(stage: Stage) -> tuple[tuple[Place, Place] | None, list[Place], float | None]:
    """The piece that a stage is about, the places of note on it, and what decided."""
    match stage:
        case Split():
            return (stage.start_m, stage.end_m), [stage.at_m], stage.distance_m
        case Merge():
            return (stage.start_m, stage.end_m), [stage.joint_m], stage.cost
        case Fit():
            return (stage.start_m, stage.end_m), [], stage.rms_m
        case Corner():
            return None, [stage.at_m], None
        case Move():
            return (stage.start_m, stage.end_m), [], stage.moved_m
        case Drop():
            return (stage.start_m, stage.end_m), [], None
