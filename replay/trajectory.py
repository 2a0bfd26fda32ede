"""Where the robot was: the poses that a map went by, and as the text that evo and others read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import overload

from mapping.placed_session import PlacedSession
from recorder.messages import Pose


class TrackPoses(Sequence[Pose]):
    """The poses that readings are placed by, in order of time; each is made when it is asked for.

    As columns they take a tenth of the room.
    """

    def __init__(self, placed: PlacedSession) -> None:
        self._track = placed.placement.track

    def __len__(self) -> int:
        return len(self._track.t_ns)

    @overload
    def __getitem__(self, at: int) -> Pose: ...
    @overload
    def __getitem__(self, at: slice) -> list[Pose]: ...
    def __getitem__(self, at: int | slice) -> Pose | list[Pose]:
        """One pose, or several."""
        if isinstance(at, slice):
            return [self[k] for k in range(*at.indices(len(self)))]
        return Pose(int(self._track.t_ns[at]), self._track.motions.one(at))


def tum_lines(poses: Iterable[Pose]) -> Iterator[str]:
    """The TUM format, a line a pose: ``t x y z qx qy qz qw`` (seconds, metres, map from base)."""
    for pose in poses:
        seconds, ns = divmod(pose.t_ns, 1_000_000_000)
        where, half_rad = pose.world_from_base, pose.world_from_base.heading_rad / 2.0
        turn = f"0 0 {math.sin(half_rad):.12g} {math.cos(half_rad):.12g}"
        yield f"{seconds}.{ns:09d} {where.x_m:.12g} {where.y_m:.12g} 0 {turn}\n"
