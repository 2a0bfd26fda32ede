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
from scipy.ndimage import binary_dilation, distance_transform_edt, label
from scipy.signal import fftconvolve

from replay.diff.alignment import Aligned
from replay.diff.cells import Flags
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN
from replay.diff.patches import Ends, patch_of

Floats = NDArray[np.float64]

# Walls of one room lie this near each other, whichever is more: metres, cells, and so many times
# the third quartile of what the two maps' own walls lie apart (less than a quarter will be new).
NOISE_M, NOISE_CELLS, NOISE_QUARTILES = 0.06, 3.0, 3.0
MOST_NOISE_M = 0.2  # a layer noisier than this does not tell whether a wall moved
# Shorter patches are not called walls: in metres, in noises, and in mean depths of a wall. (The
# cells of a band are a quarter of its width deep in the mean: one and a half widths.)
_LEAST_WALL_M, _LEAST_WALL_NOISES, _LEAST_WALL_DEPTHS = 0.15, 2.0, 6.0
_LEAST_CELLS = 5
_SAME_ROOM = 0.6  # of the occupied cells that the other has seen lie near its walls
_GOOD_PART = 0.3  # of what the layer that saw most saw
_SAID = 3  # changes that are put in words
_MOST_FOR_SHIFT = 4_000_000  # cells

SAME, SAME_ROOM, WALL_MOVED, OTHER = "same", "same room", "wall moved", "different"


@dataclass(frozen=True, slots=True)
class WallChange:
    """A wall that is not where it was: ``what`` is moved, appeared or vanished.

    ``from_m`` and ``to_m`` are two ends each, metres, map frame; ``moved_m`` how far it moved at a
    right angle to itself (None: it was not found again).
    """

    what: str
    layer: str
    from_m: Ends | None
    to_m: Ends | None
    moved_m: float | None
    length_m: float


@dataclass(frozen=True, slots=True)
class LayerVerdict:
    """How near the walls of two layers lie: shares of occupied cells that the other has seen too.

    ``near_a``: those of A within ``near_m`` of B's; None where there are none to look at.
    ``noise_m``: what these two maps' walls lie apart without having moved.
    ``depth_m``: how deep the occupied cells lie in their walls, in the mean: small in sharp maps.
    """

    near_m: float
    noise_m: float
    near_a: float | None
    near_b: float | None
    depth_m: float
    changes: tuple[WallChange, ...]


@dataclass(frozen=True, slots=True)
class Verdict:
    """The whole in words: ``kind`` is one of same, same room, wall moved, different."""

    kind: str
    words: str
    changes: tuple[WallChange, ...]


def layer_verdict(name: str, pair: Aligned) -> LayerVerdict:
    """What the differences of one layer say about its walls."""
    resolution = pair.geometry.resolution_m
    a, b = pair.a_classes == OCCUPIED, pair.b_classes == OCCUPIED
    least_m = max(NOISE_M, NOISE_CELLS * resolution)
    if not a.any() or not b.any():
        return LayerVerdict(least_m, least_m, None, None, math.inf, ())
    to_a, to_b = _distances_m(a, resolution), _distances_m(b, resolution)
    known_a, known_b = a & (pair.b_classes != UNKNOWN), b & (pair.a_classes != UNKNOWN)
    apart = np.concatenate([to_b[known_a], to_a[known_b]])
    own_m = NOISE_QUARTILES * float(np.quantile(apart, 0.75)) if apart.size else 0.0
    noise_m = min(max(least_m, own_m), max(least_m, MOST_NOISE_M))
    depth_m = float(max(_distances_m(~side, resolution)[side].mean() for side in (a, b)))
    least_wall_m = max(_LEAST_WALL_M, _LEAST_WALL_NOISES * noise_m, _LEAST_WALL_DEPTHS * depth_m)
    changes: tuple[WallChange, ...] = ()
    if own_m <= noise_m:
        changes = _wall_changes(name, pair, to_a > noise_m, to_b > noise_m, least_wall_m)
    near_a, near_b = _share(to_b <= least_m, known_a), _share(to_a <= least_m, known_b)
    return LayerVerdict(least_m, noise_m, near_a, near_b, depth_m, changes)


def _wall_changes(
    name: str, pair: Aligned, far_from_a: Flags, far_from_b: Flags, least_wall_m: float
) -> tuple[WallChange, ...]:
    """Walls of either map that the other saw to be free, each once."""
    a, b = pair.a_classes == OCCUPIED, pair.b_classes == OCCUPIED
    far_a, far_b = a & far_from_b, b & far_from_a
    changes = [
        *_changes(name, pair, far_a & (pair.b_classes == FREE), far_b, (a, b), vanished=True),
        *_changes(name, pair, far_b & (pair.a_classes == FREE), far_a, (b, a), vanished=False),
    ]
    return _each_once([change for change in changes if change.length_m >= least_wall_m])


def overall(
    layers: Mapping[str, LayerVerdict], *, any_differs: bool, pairs: Mapping[str, Aligned]
) -> Verdict:
    """One verdict from those of all layers.

    Of the layers that saw walls change, the sharpest that saw a good part of it tells where.
    """
    if not any_differs:
        return Verdict(SAME, "same", ())
    shares = [s for v in layers.values() for s in (v.near_a, v.near_b) if s is not None]
    if not shares:
        return Verdict(OTHER, "different: there are no walls that both maps have seen", ())
    best = max(layers, key=lambda name: _agreement(layers[name]))
    agreement = _agreement(layers[best])
    if agreement < _SAME_ROOM:
        words = (
            f"different: of the occupied cells that both have seen, only {agreement:.0%} lie "
            f"within {layers[best].near_m:.2g} m of the other's (layer {best}): another room, or "
            "poses that do not fit"
        )
        return Verdict(OTHER, words + _shift_words(pairs[best]), ())
    changes = _told(layers)
    if changes:
        return Verdict(WALL_MOVED, _changes_words(changes), changes)
    words = (
        f"same room, these cells differ: {agreement:.0%} of the occupied cells lie within "
        f"{layers[best].near_m:.2g} m of the other's (layer {best}), and no wall stands where the "
        "other map is free"
    )
    return Verdict(SAME_ROOM, words, ())


def _told(layers: Mapping[str, LayerVerdict]) -> tuple[WallChange, ...]:
    lengths = {name: sum(c.length_m for c in v.changes) for name, v in layers.items()}
    most = max(lengths.values())
    good = [name for name in layers if lengths[name] > 0.0 and lengths[name] >= _GOOD_PART * most]
    return layers[min(good, key=lambda name: layers[name].depth_m)].changes if good else ()


def _changes_words(changes: tuple[WallChange, ...]) -> str:
    said = [change_words(change) for change in changes[:_SAID]]
    more = len(changes) - _SAID
    return "; ".join([*said, f"and {more} more places"] if more > 0 else said)


def change_words(change: WallChange) -> str:
    """One wall in words, with its place."""
    if change.what == "moved" and change.from_m and change.to_m:
        return (
            f"a wall moved by {change.moved_m:.2f} m: from {_ends(change.from_m)} "
            f"to {_ends(change.to_m)} (layer {change.layer})"
        )
    where = change.from_m or change.to_m
    assert where is not None
    return f"a wall {change.what}: {_ends(where)} (layer {change.layer})"


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


def _changes(
    name: str, pair: Aligned, strong: Flags, far: Flags, sides: tuple[Flags, Flags], *,
    vanished: bool,
) -> list[WallChange]:  # fmt: skip
    """One change for each patch of ``strong`` cells of one map.

    ``far`` are cells of the other map's new walls, ``sides`` all occupied cells of both, the
    patch's own map first.
    """
    cells = np.argwhere(strong)
    if not len(cells):
        return []
    labels, count = label(binary_dilation(strong, np.ones((3, 3), bool), iterations=2))
    owner = labels[cells[:, 0], cells[:, 1]]
    geometry = pair.geometry
    elsewhere, own, other = (geometry.centres_of(np.argwhere(f)) for f in (far, *sides))
    found = []
    for number in range(1, count + 1):
        points = geometry.centres_of(cells[owner == number])
        if len(points) < _LEAST_CELLS:
            continue
        patch = patch_of(points, geometry.resolution_m)
        place = patch.nearest_wall_m(other, elsewhere)
        here = patch.span(patch.middle_m(own, 0.0))
        there = None if place is None else patch.span(patch.middle_m(other, place))
        moved = None
        if place is not None:
            moved = abs(patch.middle_m(other, place) - patch.middle_m(own, 0.0))
        one, two = (here, there) if vanished else (there, here)
        what = "moved" if there else "vanished" if vanished else "appeared"
        found.append(WallChange(what, name, one, two, moved, patch.length_m))
    return found


def _each_once(changes: list[WallChange]) -> tuple[WallChange, ...]:
    """A wall that both maps tell of is told once, the longest first."""
    kept: list[WallChange] = []
    for change in sorted(changes, key=lambda each: -each.length_m):
        if not any(_one_wall(change, other) for other in kept):
            kept.append(change)
    return tuple(kept)


def _one_wall(a: WallChange, b: WallChange) -> bool:
    if not (a.what == b.what == "moved" and a.from_m and b.from_m and a.to_m and b.to_m):
        return False
    gaps = [
        np.hypot(*(np.mean(p, axis=0) - np.mean(q, axis=0)))
        for p, q in ((a.from_m, b.from_m), (a.to_m, b.to_m))
    ]
    near = max(gaps) < max(a.length_m, b.length_m) / 2.0 and min(gaps) < _LEAST_WALL_M
    return bool(near)


def _shift_words(pair: Aligned) -> str:
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
