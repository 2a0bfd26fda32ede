"""The frames of a session by their names: which hangs on which, and which of them move."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from recorder.columns import TransformColumns
from recorder.messages import BASE_FRAME

WORLDS = ("map", "odom", "world", "earth", "odom_combined")
BASES = (BASE_FRAME, "base_footprint", "base")
_STILL = 1e-6  # metres and radians: a frame that moves by less is a mount
_LEVEL = math.cos(math.radians(2.0))


@dataclass(frozen=True, slots=True)
class Link:
    """All transforms of one frame: what it hangs on, whether it moves, how far up it points."""

    parent: str
    child: str
    columns: tuple[TransformColumns, ...]
    moves: bool
    up: float

    @property
    def mirrors(self) -> bool:
        """Whether it hangs upside down."""
        return self.up < 0.0

    @property
    def is_level(self) -> bool:
        """Whether a plane in it is a plane in its parent."""
        return abs(self.up) >= _LEVEL

    @property
    def tilt_deg(self) -> float:
        """How far its plane is from its parent's."""
        return math.degrees(math.acos(min(abs(self.up), 1.0)))


class FrameLinks:
    """The tree of frames: each hangs on one other, or on none."""

    def __init__(self, transforms: Iterable[TransformColumns]) -> None:
        of_child: dict[str, list[TransformColumns]] = {}
        for each in transforms:
            kept = each[_sane(each)]
            if len(kept):
                of_child.setdefault(each.child, []).append(kept)
        self.links: Mapping[str, Link] = {
            child: _link(child, columns) for child, columns in of_child.items()
        }

    def __contains__(self, frame: str) -> bool:
        return frame in self.links or any(link.parent == frame for link in self.links.values())

    @property
    def names(self) -> list[str]:
        """All frames that there are."""
        parents = (link.parent for link in self.links.values())
        return list(dict.fromkeys([*parents, *self.links]))

    def path(self, frame: str) -> list[str]:
        """A frame, what it hangs on, and so on up to the root."""
        found = [frame]
        while found[-1] in self.links and (parent := self.links[found[-1]].parent) not in found:
            found.append(parent)
        return found

    def base_on(self, path: Sequence[str]) -> str:
        """Which frame on the way up from a sensor is the robot's.

        One called as bases are; else the highest below a world, below what moves, or of all.
        """
        for name in BASES:
            for frame in path:
                if basename(frame) == name:
                    return frame
        below = [frame for frame in path if basename(frame) not in WORLDS]
        if len(below) < len(path):
            return below[-1] if below else path[0]
        moving = [frame for frame in path if frame in self.links and self.links[frame].moves]
        return moving[-1] if moving else path[-1]

    def any_base(self) -> str:
        """The robot's frame where no sensor has one; "" where there is none."""
        for name in BASES:
            for frame in self.names:
                if basename(frame) == name:
                    return frame
        moving = [frame for frame, link in self.links.items() if link.moves]
        return self.base_on(self.path(moving[0])) if moving else ""

    def world_of(self, base: str) -> str:
        """In which frame the transforms know the robot's; "" where in none."""
        above = self.path(base)[1:]
        named = [frame for frame in above if basename(frame) == WORLDS[0]]
        return (named or above[-1:] or [""])[0]

    def mirrored(self, frame: str, base: str) -> bool:
        """Whether a frame hangs upside down on the robot."""
        path = self.path(frame)
        path = path[: path.index(base)] if base in path else path
        return sum(each in self.links and self.links[each].mirrors for each in path) % 2 == 1


def basename(frame: str) -> str:
    """A frame without its namespace."""
    return frame.rpartition("/")[2]


def _sane(columns: TransformColumns) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    sane: np.ndarray[tuple[int], np.dtype[np.bool_]] = (
        np.isfinite(columns.x_m) & np.isfinite(columns.y_m) & np.isfinite(columns.heading_rad)
    )
    return sane


def _link(child: str, columns: Sequence[TransformColumns]) -> Link:
    """The last one names the parent; one that never moves is a mount however often it is sent."""
    last = max(columns, key=lambda each: int(each.row[-1]))
    found = tuple(each for each in columns if each.parent == last.parent)
    sent = [each for each in found if not each.static]
    moves = False
    if sent:
        x_m, y_m = (np.concatenate([getattr(c, name) for c in sent]) for name in ("x_m", "y_m"))
        heading_rad = np.concatenate([each.heading_rad for each in sent])
        turned = np.abs(np.remainder(heading_rad - heading_rad[0] + math.pi, math.tau) - math.pi)
        moves = bool(max(np.ptp(x_m), np.ptp(y_m), turned.max()) > _STILL)
    return Link(last.parent, child, found, moves, float(last.up[-1]))
