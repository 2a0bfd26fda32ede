"""Where the robot and its frames were at a reading's own time, one after the other."""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from mapping.tracks import is_sane
from recorder.clock import NS_PER_S
from recorder.geometry import IDENTITY, SE2, interpolate
from recorder.messages import BASE_FRAME, Transform


@dataclass(frozen=True, slots=True)
class Track:
    """Poses over time, sorted; between two of them the motion is taken as even."""

    t_ns: Sequence[int]
    poses: Sequence[SE2]
    max_gap_ns: int

    @classmethod
    def of(cls, stamped: Iterable[tuple[int, SE2]], max_gap_s: float) -> Track:
        """Sorted by time; poses of one time keep their order."""
        ordered = sorted(stamped, key=lambda each: each[0])
        return cls([t for t, _ in ordered], [p for _, p in ordered], round(max_gap_s * NS_PER_S))

    def at(self, t_ns: int) -> SE2 | None:
        """The pose at a time; None before the first, after the last, or in a longer gap."""
        after = bisect.bisect_left(self.t_ns, t_ns)
        if after < len(self.t_ns) and self.t_ns[after] == t_ns:
            return self.poses[after]
        if after == 0 or after == len(self.t_ns):
            return None
        t0, t1 = self.t_ns[after - 1], self.t_ns[after]
        if t1 - t0 > self.max_gap_ns:
            return None
        return interpolate(self.poses[after - 1], self.poses[after], (t_ns - t0) / (t1 - t0))


@dataclass(frozen=True, slots=True)
class FrameTree:
    """The mounts of a session, and frames that turn: where each stands on the robot."""

    static: dict[str, Transform] = field(default_factory=dict)
    moving: dict[str, tuple[str, Track]] = field(default_factory=dict)

    @classmethod
    def of(cls, transforms: Iterable[Transform], max_gap_s: float) -> FrameTree:
        """The last static transform of a frame counts; of a moving one, all do."""
        static: dict[str, Transform] = {}
        moving: dict[str, list[Transform]] = {}
        for each in transforms:
            if not is_sane(each.parent_from_child):
                continue
            if each.static:
                static[each.child] = each
            else:
                moving.setdefault(each.child, []).append(each)
        tracks = {
            child: (
                found[-1].parent,
                Track.of(((t.t_ns, t.parent_from_child) for t in found), max_gap_s),
            )
            for child, found in moving.items()
        }
        return cls(static, tracks)

    def parent_of(self, frame: str) -> str | None:
        """The frame that another one is fixed to or turns on; None where nothing is known."""
        if frame in self.moving:
            return self.moving[frame][0]
        return self.static[frame].parent if frame in self.static else None

    def base_from(self, frame: str, t_ns: int) -> SE2 | None:
        """Where a frame stands on the robot at a time; None where the session does not hold it."""
        motion = IDENTITY
        for _ in range(len(self.static) + len(self.moving) + 1):  # a circle of frames must end
            if frame == BASE_FRAME:
                return motion
            if frame in self.moving:
                parent, track = self.moving[frame]
                step = track.at(t_ns)
                if step is None:
                    return None
            elif frame in self.static:
                parent, step = self.static[frame].parent, self.static[frame].parent_from_child
            else:
                return None
            frame, motion = parent, step @ motion
        return None
