"""A recorded session in the place of a robot: as a source of bytes and poses, or on a real port."""

from recorder.playback.link import FASTEST, ReplayedLink, check_speed
from recorder.playback.transmissions import Playback, mounts_of, playback_of, wheels_of

__all__ = [
    "FASTEST", "Playback", "ReplayedLink", "check_speed", "mounts_of", "playback_of", "wheels_of",
]  # fmt: skip
