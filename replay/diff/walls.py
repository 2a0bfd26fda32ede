"""Walls that stand in one map where the other is free: which, where, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, label
from scipy.spatial import ConvexHull

from replay.diff.alignment import Aligned
from replay.diff.cells import Flags
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN, Codes
from replay.diff.patches import Ends, Patch, patch_of

Floats = NDArray[np.float64]

# Shorter patches are not called walls: in metres, in noises, and in mean depths of a wall. (The
# cells of a band are a quarter of its width deep in the mean: one and a half widths.)
_LEAST_WALL_M, _LEAST_WALL_NOISES, _LEAST_WALL_DEPTHS = 0.15, 2.0, 6.0
_SURE = 2.0  # a piece so many times as long as the shortest wall is reported without a "may"
_LEAST_CELLS = 5
_BESIDE_M, _BESIDE_DEPTHS = 0.1, 2.0  # free space beside a wall, from its axis: half a wall more
_SEEN = 0.1  # a place of which less was seen was not seen


@dataclass(frozen=True, slots=True)
class WallChange:
    """A wall that is not where it was: ``what`` is moved, appeared or vanished.

    ``from_m`` and ``to_m`` are two ends each, metres, map frame; ``moved_m`` how far it moved at a
    right angle to itself (None: it was not found again). ``sure`` is False for a short piece.
    """

    what: str
    layer: str
    from_m: Ends | None
    to_m: Ends | None
    moved_m: float | None
    length_m: float
    sure: bool = True

    @property
    def places_m(self) -> tuple[Ends, ...]:
        """Where it stands in either map."""
        return tuple(ends for ends in (self.from_m, self.to_m) if ends is not None)


@dataclass(frozen=True, slots=True)
class _Side:
    """One map as a search for its new walls needs it: the centres of its cells, (N, 2) metres.

    ``new_m`` are occupied cells far from the walls of the other map.
    """

    occupied_m: Floats
    free_m: Floats
    new_m: Floats


@dataclass(frozen=True, slots=True)
class _Scale:
    """What counts as long and as near in this layer, metres."""

    least_wall_m: float
    beside_m: float
    noise_m: float


def wall_changes(
    name: str, pair: Aligned, far_from_a: Flags, far_from_b: Flags, noise_m: float, depth_m: float
) -> tuple[WallChange, ...]:
    """Walls of either map that the other saw to be free, each once, the longest first.

    ``far_from_a`` and ``far_from_b`` (rows, cols) are the cells beyond ``noise_m`` of the walls
    of one map; ``depth_m`` is how deep cells lie in their walls, in the mean.
    """
    least_m = max(_LEAST_WALL_M, _LEAST_WALL_NOISES * noise_m, _LEAST_WALL_DEPTHS * depth_m)
    scale = _Scale(least_m, _BESIDE_M + _BESIDE_DEPTHS * depth_m, noise_m)
    far_a = (pair.a_classes == OCCUPIED) & far_from_b
    far_b = (pair.b_classes == OCCUPIED) & far_from_a
    a, b = _side(pair, pair.a_classes, far_a), _side(pair, pair.b_classes, far_b)
    gone, come = far_a & (pair.b_classes == FREE), far_b & (pair.a_classes == FREE)
    changes = [
        *_changes(name, pair, gone, (a, b), scale, vanished=True),
        *_changes(name, pair, come, (b, a), scale, vanished=False),
    ]
    return _each_once(changes)


def _side(pair: Aligned, classes: Codes, new: Flags) -> _Side:
    occupied, free = classes == OCCUPIED, classes == FREE
    return _Side(*(pair.geometry.centres_of(np.argwhere(f)) for f in (occupied, free, new)))


def _changes(
    name: str, pair: Aligned, strong: Flags, sides: tuple[_Side, _Side], scale: _Scale, *,
    vanished: bool,
) -> list[WallChange]:  # fmt: skip
    """One change for each patch of ``strong`` cells of one map; ``sides``: that map, the other."""
    space = CommonSpace.of(pair)
    cells = np.argwhere(strong)
    if not len(cells) or space is None:
        return []
    labels, count = label(binary_dilation(strong, np.ones((3, 3), bool), iterations=2))
    owner = labels[cells[:, 0], cells[:, 1]]
    found = []
    for number in range(1, count + 1):
        points = pair.geometry.centres_of(cells[owner == number])
        if len(points) < _LEAST_CELLS:
            continue
        patch = patch_of(points, pair.geometry.resolution_m)
        if patch.length_m >= scale.least_wall_m and space.holds(patch.centre_m, scale.noise_m):
            found.append(_change(name, patch, sides, scale, vanished=vanished))
    return found


def _change(
    name: str, patch: Patch, sides: tuple[_Side, _Side], scale: _Scale, *, vanished: bool
) -> WallChange:
    """What became of one patch of the first side."""
    own, other = sides
    here_m = patch.middle_m(own.occupied_m, 0.0)
    facing = patch.facing(own.free_m, here_m, scale.beside_m)
    place = patch.nearest_wall_m(
        other.occupied_m,
        other.new_m,
        # The opposite face of a thing is another wall: one that moved keeps its free side.
        lambda at_m: facing * patch.facing(other.free_m, at_m, scale.beside_m) >= 0,
    )
    sure = patch.length_m >= _SURE * scale.least_wall_m
    here = patch.span(here_m)
    if place is None:
        if vanished:
            return WallChange("vanished", name, here, None, None, patch.length_m, sure)
        return WallChange("appeared", name, None, here, None, patch.length_m, sure)
    there_m = patch.middle_m(other.occupied_m, place)
    there = patch.span(there_m)
    one, two = (here, there) if vanished else (there, here)
    return WallChange("moved", name, one, two, abs(there_m - here_m), patch.length_m, sure)


def _each_once(changes: list[WallChange]) -> tuple[WallChange, ...]:
    """A wall that both maps show is reported once, the longest first."""
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


@dataclass(frozen=True, slots=True)
class CommonSpace:
    """What both maps saw to be free: the smallest convex outline that holds all of it."""

    outline: NDArray[np.float64]  # (K, 3): outward normal and offset of each side

    @classmethod
    def of(cls, pair: Aligned) -> CommonSpace | None:
        """Of a pair of layers; None where they have no free cell in common."""
        cells = np.argwhere((pair.a_classes == FREE) & (pair.b_classes == FREE))
        if not len(cells):
            return None
        half = pair.geometry.resolution_m / 2.0
        corners = half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        points = (pair.geometry.centres_of(cells)[:, None] + corners).reshape(-1, 2)
        return cls(ConvexHull(points).equations)

    def holds(self, point_m: Floats, margin_m: float) -> bool:
        """Whether a point (2,) lies inside, or outside by no more than a margin."""
        return bool((self.outline[:, :2] @ point_m + self.outline[:, 2] <= margin_m).all())


def saw_nothing_at(change: WallChange, pair: Aligned) -> bool:
    """Whether a pair of layers knows next to nothing of the places that a change names."""
    return all(_seen_share(ends, pair) < _SEEN for ends in change.places_m)


def lies_within(change: WallChange, space: CommonSpace, margin_m: float) -> bool:
    """Whether the middles of all places that a change names lie in a space."""
    return all(space.holds(np.mean(ends, axis=0), margin_m) for ends in change.places_m)


def _seen_share(ends: Ends, pair: Aligned) -> float:
    """Of the cells within two of a wall's axis: the share that either map has seen."""
    geometry = pair.geometry
    start, end = np.array(ends)
    count = int(np.hypot(*(end - start)) / geometry.resolution_m) + 2
    along = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
    around = np.array([(r, c) for r in range(-2, 3) for c in range(-2, 3)])
    cells = (geometry.cells_of(along)[:, None] + around).reshape(-1, 2)
    rows, cols = cells[geometry.contains(cells)].T
    seen = (pair.a_classes[rows, cols] != UNKNOWN) | (pair.b_classes[rows, cols] != UNKNOWN)
    return float(seen.sum()) / (count * len(around))
