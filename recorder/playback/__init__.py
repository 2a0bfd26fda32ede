"""A recorded session in the place of a robot: as a source of bytes and poses, or on a real port."""

from recorder.playback.transmissions import (
    FASTEST,
    Playback,
    ReplayedLink,
    Timetable,
    check_speed,
    mounts_of,
    playback_of,
    replayed,
    wheels_of,
)

__all__ = [
    "FASTEST", "Playback", "ReplayedLink", "Timetable", "check_speed", "mounts_of", "playback_of",
    "replayed", "wheels_of",
]  # fmt: skip
