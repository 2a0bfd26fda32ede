"""What the differences mean: noise of the readings, a wall that moved, or another room.

Two maps of one room never agree cell by cell: walls come out a cell or two off. A wall has changed
where one map holds cells occupied that the other has seen to be free, farther than any noise
from the other's walls, and in a patch long enough to be a wall. Where such a patch lies beside a
patch of the other map, along the same line, the wall moved there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.signal import fftconvolve

from mapping.fusion import FUSED
from replay.diff.alignment import Aligned
from replay.diff.cells import Flags
from replay.diff.layers import OCCUPIED, UNKNOWN
from replay.diff.patches import Ends
from replay.diff.walls import CommonSpace, WallChange, lies_within, saw_nothing_at, wall_changes

Floats = NDArray[np.float64]

# Walls of one room lie this near each other, whichever is more: metres, cells, and so many times
# the third quartile of what the two maps' own walls lie apart (less than a quarter will be new).
NOISE_M, NOISE_CELLS, NOISE_QUARTILES = 0.06, 3.0, 3.0
MOST_NOISE_M = 0.2  # a layer noisier than this cannot show whether a wall moved
_SAME_ROOM = 0.6  # of the occupied cells that the other has seen lie near its walls
_DESCRIBED = 3  # changes that the text describes
_MOST_FOR_SHIFT = 4_000_000  # cells

SAME, SAME_ROOM, WALL_MOVED, OTHER = "same", "same room", "wall moved", "different"


@dataclass(frozen=True, slots=True)
class LayerVerdict:
    """How near the walls of two layers lie: shares of occupied cells that the other has seen too.

    ``near_a``: those of A within ``near_m`` of B's; None where there are none to look at.
    ``noise_m``: what these two maps' walls lie apart without having moved.
    ``depth_m``: how deep the occupied cells lie in their walls, in the mean: small in sharp maps.
    ``beam_width_rad``: that of the layer's sensor; None where it is not known, or there are many.
    """

    near_m: float
    noise_m: float
    near_a: float | None
    near_b: float | None
    depth_m: float
    changes: tuple[WallChange, ...]
    beam_width_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Verdict:
    """The whole as text: ``kind`` is one of same, same room, wall moved, different."""

    kind: str
    text: str
    changes: tuple[WallChange, ...]


def layer_verdict(name: str, pair: Aligned, beam_width_rad: float | None = None) -> LayerVerdict:
    """What the differences of one layer mean for its walls."""
    resolution = pair.geometry.resolution_m
    a, b = pair.a_classes == OCCUPIED, pair.b_classes == OCCUPIED
    least_m = max(NOISE_M, NOISE_CELLS * resolution)
    if not a.any() or not b.any():
        return LayerVerdict(least_m, least_m, None, None, math.inf, (), beam_width_rad)
    to_a, to_b = _distances_m(a, resolution), _distances_m(b, resolution)
    known_a, known_b = a & (pair.b_classes != UNKNOWN), b & (pair.a_classes != UNKNOWN)
    apart = np.concatenate([to_b[known_a], to_a[known_b]])
    own_m = NOISE_QUARTILES * float(np.quantile(apart, 0.75)) if apart.size else 0.0
    noise_m = min(max(least_m, own_m), max(least_m, MOST_NOISE_M))
    depth_m = float(max(_distances_m(~side, resolution)[side].mean() for side in (a, b)))
    changes: tuple[WallChange, ...] = ()
    if own_m <= noise_m:
        changes = wall_changes(name, pair, to_a > noise_m, to_b > noise_m, noise_m, depth_m)
    near_a, near_b = _share(to_b <= least_m, known_a), _share(to_a <= least_m, known_b)
    return LayerVerdict(least_m, noise_m, near_a, near_b, depth_m, changes, beam_width_rad)


def overall(
    layers: Mapping[str, LayerVerdict], *, any_differs: bool, pairs: Mapping[str, Aligned]
) -> Verdict:
    """One verdict from those of all layers; the sharpest decides which walls changed."""
    if not any_differs:
        return Verdict(SAME, "same", ())
    shares = [s for v in layers.values() for s in (v.near_a, v.near_b) if s is not None]
    if not shares:
        return Verdict(OTHER, "different: there are no walls that both maps have seen", ())
    best = max(layers, key=lambda name: _agreement(layers[name]))
    agreement = _agreement(layers[best])
    if agreement < _SAME_ROOM:
        text = (
            f"different: of the occupied cells that both have seen, only {agreement:.0%} lie "
            f"within {layers[best].near_m:.2g} m of the other's (layer {best}): another room, or "
            "poses that do not fit"
        )
        return Verdict(OTHER, text + _shift_text(pairs[best]), ())
    changes = _all_changes(layers, pairs)
    if changes:
        return Verdict(WALL_MOVED, _changes_text(changes), changes)
    text = (
        f"same room, these cells differ: {agreement:.0%} of the occupied cells lie within "
        f"{layers[best].near_m:.2g} m of the other's (layer {best}), and no wall of layer "
        f"{sharpest_first(layers)[0]} stands where the other map is free"
    )
    return Verdict(SAME_ROOM, text, ())


def _all_changes(
    layers: Mapping[str, LayerVerdict], pairs: Mapping[str, Aligned]
) -> tuple[WallChange, ...]:
    """What the sharpest layer saw change; of others only what it knows nothing of.

    Those must lie in the space that both maps saw to be free in the sharpest: beyond it, a wide
    beam draws echoes rather than walls.
    """
    order = sharpest_first(layers)
    changes = list(layers[order[0]].changes)
    spaces = (CommonSpace.of(pairs[name]) for name in order)
    space = next((each for each in spaces if each is not None), None)
    if space is None:
        return tuple(changes)
    for number, name in enumerate(order[1:], start=1):
        noise_m, sharper = layers[name].noise_m, [pairs[each] for each in order[:number]]
        changes += [
            change
            for change in layers[name].changes
            if lies_within(change, space, noise_m)
            and all(saw_nothing_at(change, pair) for pair in sharper)
        ]
    return tuple(changes)


def sharpest_first(layers: Mapping[str, LayerVerdict]) -> list[str]:
    """Names of layers: by the width of their beams, or how thin their walls are; fused the last."""
    single = [verdict.beam_width_rad for name, verdict in layers.items() if name != FUSED]
    by_width = all(width is not None for width in single)

    def blur(name: str) -> tuple[bool, bool, float, float]:
        verdict = layers[name]
        nothing_there = not math.isfinite(verdict.depth_m)
        width = verdict.beam_width_rad or 0.0 if by_width else 0.0
        return nothing_there, name == FUSED, width, verdict.depth_m

    return sorted(layers, key=blur)


def _changes_text(changes: tuple[WallChange, ...]) -> str:
    texts = [change_text(change) for change in changes[:_DESCRIBED]]
    more = len(changes) - _DESCRIBED
    return "; ".join([*texts, f"and {more} more places"] if more > 0 else texts)


def change_text(change: WallChange) -> str:
    """One wall as text, with its place; carefully where the piece is short."""
    short = "" if change.sure else f", a short piece of {change.length_m:.2f} m"
    source = f"(layer {change.layer}{short})"
    if change.what == "moved" and change.from_m and change.to_m:
        verb = "moved" if change.sure else "may have moved"
        return (
            f"a wall {verb} by {change.moved_m:.2f} m: from {_ends(change.from_m)} "
            f"to {_ends(change.to_m)} {source}"
        )
    verb = change.what if change.sure else f"may have {change.what}"
    return f"a wall {verb}: {_ends(change.places_m[0])} {source}"


def _ends(ends: Ends) -> str:
    (x0, y0), (x1, y1) = ends
    return f"({x0:.2f}, {y0:.2f})-({x1:.2f}, {y1:.2f}) m"


def _agreement(verdict: LayerVerdict) -> float:
    shares = [s for s in (verdict.near_a, verdict.near_b) if s is not None]
    return min(shares, default=0.0)


def _distances_m(occupied: Flags, resolution_m: float) -> Floats:
    away: Floats = distance_transform_edt(~occupied) * resolution_m
    return away


def _share(near: Flags, of: Flags) -> float | None:
    number = int(np.count_nonzero(of))
    return int(np.count_nonzero(near & of)) / number if number else None


def _shift_text(pair: Aligned) -> str:
    """Whether one map pushed along as a whole would lie on the other; empty where it would not."""
    a, b = pair.a_classes == OCCUPIED, pair.b_classes == OCCUPIED
    if a.size > _MOST_FOR_SHIFT or not a.any() or not b.any():
        return ""
    fewer = min(int(a.sum()), int(b.sum()))
    common = fftconvolve(a.astype(np.float32), b[::-1, ::-1].astype(np.float32))
    row, col = np.unravel_index(int(np.argmax(common)), common.shape)
    share = float(common[row, col]) / fewer
    here = int(np.count_nonzero(a & b)) / fewer
    if share < 0.5 or share < 1.5 * here:
        return ""
    size = pair.geometry.resolution_m
    x, y = (int(col) - b.shape[1] + 1) * size, (int(row) - b.shape[0] + 1) * size
    return f" (B moved by {x:+.2f}, {y:+.2f} m would cover {share:.0%} of the smaller one's)"
