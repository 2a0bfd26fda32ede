"""How good poses are by themselves: how far apart, how noisy, how often they jump."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mapping.tracks import MotionTrack, wrapped
from recorder.columns import Floats, Ints
from recorder.numbers import median

NOISY_RAD = math.radians(4.0)
FEWEST_JUMPS = 3
_JUMP_MPS, _JUMP_RADPS = 3.0, 12.0
_LEAST_JUMP_M, _LEAST_JUMP_RAD = 0.15, 0.5
_AWAY_S, _USUAL_MPS = 5.0, 0.5  # a tracker that errs comes back within so long
_FEWEST = 20
_STRIDE_S, _STRIDE_M, _STRAIGHT_RAD = 1.0, 0.05, math.radians(8.0)


def steps_of(track: MotionTrack) -> tuple[Floats, Floats, Floats]:
    """Between neighbouring poses: time (s), way (m) and turn (radians), (N - 1,) each."""
    dt = np.maximum(np.diff(track.t_ns) * 1e-9, 1e-3)
    way = np.hypot(np.diff(track.motions.x_m), np.diff(track.motions.y_m))
    return dt, way, np.abs(wrapped(np.diff(track.motions.heading_rad)))


def jumps(track: MotionTrack, max_gap_s: float) -> Ints:
    """Steps between neighbours that no small robot can make: which of them, (J,).

    Not those after which it stays elsewhere: it was carried, or the recording is cut.
    """
    at = _steps_too_large(track, max_gap_s)
    return at[~np.isin(at, relocations(track, max_gap_s))]


def relocations(track: MotionTrack, max_gap_s: float) -> Ints:
    """Steps to elsewhere from which it does not come back soon, nor has come from there, (R,)."""
    at = _steps_too_large(track, max_gap_s)
    _, way, _ = steps_of(track)
    x_m, y_m, t_s = track.motions.x_m, track.motions.y_m, track.t_ns * 1e-9
    returns = np.zeros(len(at), np.bool_)
    for k, first in enumerate(at.tolist()):
        later = at[(at > first) & (t_s[at] < t_s[first] + _AWAY_S)]
        left_m = np.hypot(x_m[later + 1] - x_m[first], y_m[later + 1] - y_m[first])
        back = later[left_m < _LEAST_JUMP_M + _USUAL_MPS * (t_s[later + 1] - t_s[first])]
        returns[k] |= len(back) > 0
        returns |= np.isin(at, back)
    return at[~returns & (way[at] > _LEAST_JUMP_M)]


def _steps_too_large(track: MotionTrack, max_gap_s: float) -> Ints:
    dt, way, turn = steps_of(track)
    leaps = way > np.maximum(_LEAST_JUMP_M, _JUMP_MPS * dt)
    flips = turn > np.maximum(_LEAST_JUMP_RAD, _JUMP_RADPS * dt)
    return np.flatnonzero((dt <= max_gap_s) & (leaps | flips))


def heading_noise_rad(track: MotionTrack, max_gap_s: float) -> float:
    """How much single headings scatter: by second differences, robustly, where poses are near.

    A steady turn has none; each pose's own error e enters as e0 - 2 e1 + e2, whose spread is √6
    times theirs. Headings that stay the same (a tracker that repeats itself) are left out.
    """
    gap_s = np.diff(track.t_ns) * 1e-9
    turn = wrapped(np.diff(track.motions.heading_rad))
    near = (gap_s[1:] <= max_gap_s) & (gap_s[:-1] <= max_gap_s)
    moved = (turn[1:] != 0.0) | (turn[:-1] != 0.0)
    second = np.abs(turn[1:] - turn[:-1])[near & moved]
    if len(second) < _FEWEST:
        return 0.0
    return 1.4826 * median(second) / math.sqrt(6.0)


def is_rough(track: MotionTrack, max_gap_s: float) -> bool:
    """Whether poses are too bad for walls to be drawn with them."""
    many = max(FEWEST_JUMPS, len(track.t_ns) // 200)
    return heading_noise_rad(track, max_gap_s) >= 0.75 * NOISY_RAD or (
        len(jumps(track, max_gap_s)) >= many
    )


@dataclass(frozen=True, slots=True)
class Travel:
    """How far to the left of its heading a robot drives, (radians), over ``steps`` pieces of way.

    ``error_rad`` is the standard error of the mean.
    """

    rad: float
    error_rad: float
    steps: int


def travel(track: MotionTrack, max_gap_s: float) -> Travel | None:
    """The direction of travel against the heading, where the robot drives straight; None: it
    hardly does.

    A robot on two wheels drives along its heading, forwards or backwards, so headings that are
    off show. One with omnidirectional wheels may drive as it likes.
    """
    t_s, at = track.t_ns * 1e-9, track.motions
    after = np.searchsorted(t_s, t_s + _STRIDE_S)
    first = np.arange(0, len(t_s), max(1, round(len(t_s) * _STRIDE_S / max(np.ptp(t_s), 1e-9))))
    first = first[after[first] < len(t_s)]
    last = after[first]
    x_m, y_m = at.x_m[last] - at.x_m[first], at.y_m[last] - at.y_m[first]
    turn = wrapped(at.heading_rad[last] - at.heading_rad[first])
    straight = (np.hypot(x_m, y_m) > _STRIDE_M) & (np.abs(turn) < _STRAIGHT_RAD)
    straight &= t_s[last] - t_s[first] < _STRIDE_S + max_gap_s
    if straight.sum() < _FEWEST:
        return None
    heading = at.heading_rad[first][straight] + 0.5 * turn[straight]
    off = wrapped(np.arctan2(y_m[straight], x_m[straight]) - heading)
    off = np.where(np.abs(off) > math.pi / 2, wrapped(off + math.pi), off)  # backwards
    middle = median(off)
    spread = 1.4826 * median(np.abs(off - middle))
    return Travel(middle, 1.25 * spread / math.sqrt(len(off)), len(off))
