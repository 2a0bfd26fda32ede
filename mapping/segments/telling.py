"""The stages on the way to lines as artifacts: one a stage, or one for all of a kind."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from mapping.artifacts import LineStage
from mapping.segments.stages import Corner, Fit, Merge, Place, Split, Stage

# In the order in which the methods go through them.
KINDS = ("split", "merge", "fit", "corner")


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
    told = [_told(stage) for stage in stages]
    pieces = np.array([piece for piece, _, _ in told if piece], np.float64).reshape(-1, 2, 2)
    places = np.array(list(itertools.chain(*(at for _, at, _ in told))), np.float64).reshape(-1, 2)
    sizes = tuple(size for _, _, size in told if size is not None)
    pieces.flags.writeable = places.flags.writeable = False
    return LineStage(layer, source, _kind(stages[0]), pieces, places, sizes)


def _told(stage: Stage) -> tuple[tuple[Place, Place] | None, list[Place], float | None]:
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
