"""Where the robot was: the poses that a map went by, and as the text that evo and others read."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mapping.placed_session import PlacedSession
from recorder.messages import Pose


def poses_of(placed: PlacedSession) -> list[Pose]:
    """The poses that readings are placed by, in order of time."""
    track = placed.placement.track
    return [Pose(t_ns, track.motions.one(i)) for i, t_ns in enumerate(track.t_ns.tolist())]


def tum_text(poses: Sequence[Pose]) -> str:
    """The TUM format, a line a pose: ``t x y z qx qy qz qw`` (seconds, metres, map from base)."""
    lines = []
    for pose in poses:
        seconds, ns = divmod(pose.t_ns, 1_000_000_000)
        where, half_rad = pose.world_from_base, pose.world_from_base.heading_rad / 2.0
        turn = f"0 0 {math.sin(half_rad):.12g} {math.cos(half_rad):.12g}"
        lines.append(f"{seconds}.{ns:09d} {where.x_m:.12g} {where.y_m:.12g} 0 {turn}\n")
    return "".join(lines)
