"""Poses over time, smoothed: what a tracker measures, or how it differs from dead reckoning.

A tracker's poses scatter, its headings by degrees where the tag is small; the robot itself moves
smoothly. Without odometry, x, y and heading each move at a speed that changes little by little.
With odometry the motion between two poses is known but for a slow drift: first the heading's
offset is smoothed, then that of the position along the way that odometry has, turned by it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping.config_sections import PoseSection
from mapping.smoothing.kalman import Motion, filtered, smoothed
from mapping.tracks import Motions, MotionTrack, wrapped
from recorder.clock import NS_PER_S
from recorder.columns import Floats

JUMP_M, JUMP_RAD = 0.02, math.radians(3.0)  # who is off by less never jumps
FASTEST_MPS, FASTEST_RADPS = 1.0, 3.0  # of small robots, one standard deviation
_FEWEST = 8  # poses: of fewer nothing can be estimated
_REPEATED_S = 0.25  # a tracker that repeats itself measures no more often than this
_LEAST_M, _LEAST_RAD = 5e-4, math.radians(0.02)  # no tracker is better
_STRETCHES, _STRETCH = 3, 500  # poses by which noise is estimated
_LEAST_KNOWN = 0.9  # of the poses: odometry that covers fewer is not used
_DRIVES = (1e-2, 1.0, 1e2, 1e4)  # to start from, a part of the noise
_STEPS = (16.0, 4.0, 2.0, 1.4)  # factors by which noise and drive are searched


@dataclass(frozen=True, slots=True)
class Noise:
    """How much each pose scatters, one standard deviation; None: estimated from the poses."""

    position_m: float | None = None
    heading_rad: float | None = None


def noise_of(section: PoseSection) -> Noise:
    """What a configuration states of it."""
    degrees = section.smooth_deg
    return Noise(section.smooth_m, None if degrees is None else math.radians(degrees))


def smoothed_track(
    track: MotionTrack, noise: Noise, odometry: MotionTrack | None = None
) -> MotionTrack:
    """The same poses at the same times, each by all of them.

    Nothing is smoothed over a gap longer than the track's ``max_gap_ns``, nor over a jump: where
    two poses in a row lie elsewhere, a stretch of its own begins. Of fewer in a row none is
    believed. ``odometry`` is used where it knows all times.
    """
    if len(track.t_ns) < _FEWEST:
        return track
    samples, poses = _samples_of(track), track.motions
    wheels = _along(odometry, track)
    known = wheels is not None
    by_wheels = np.zeros(len(poses)) if wheels is None else np.unwrap(wheels.heading_rad)
    turn = Motion(_squared(noise.heading_rad), 0.0, known, 2.0 * math.pi, JUMP_RAD, FASTEST_RADPS)
    (off,) = _smooth(samples, [poses.heading_rad - by_wheels], turn, _LEAST_RAD)
    way = np.zeros((2, len(poses))) if wheels is None else _way_of(wheels, off)
    move = Motion(_squared(noise.position_m), 0.0, known, 0.0, JUMP_M, FASTEST_MPS)
    x, y = _smooth(samples, [poses.x_m - way[0], poses.y_m - way[1]], move, _LEAST_M)
    return replace(track, motions=Motions(x + way[0], y + way[1], wrapped(off + by_wheels)))


def _squared(deviation: float | None) -> float:
    """A variance; 0: it is to be estimated."""
    return 0.0 if deviation is None else deviation**2


@dataclass(frozen=True, slots=True)
class _Samples:
    """When there are poses (N,), which of them were measured, and where a stretch is cut off."""

    t_s: Floats
    measured: NDArray[np.bool_]
    cut: NDArray[np.bool_]

    def of(self, rows: NDArray[np.int64]) -> _Samples:
        """Some of them."""
        return _Samples(self.t_s[rows], self.measured[rows], self.cut[rows])


def _samples_of(track: MotionTrack) -> _Samples:
    t_s = (track.t_ns - track.t_ns[0]) / NS_PER_S
    cut = np.append(True, np.diff(track.t_ns) > track.max_gap_ns)
    measured = ~_repeats(track, t_s) | cut | np.append(cut[1:], True)
    return _Samples(t_s, measured, cut)


def _repeats(track: MotionTrack, t_s: Floats) -> NDArray[np.bool_]:
    """Which poses are the one before once more: it was measured once, but for one that lasts."""
    poses, repeats = track.motions, np.zeros(len(t_s), np.bool_)
    same = (
        (np.diff(poses.x_m) == 0.0)
        & (np.diff(poses.y_m) == 0.0)
        & (np.diff(poses.heading_rad) == 0.0)
    )
    last_s = t_s[0]
    for at in range(1, len(t_s)):
        repeats[at] = same[at - 1] and t_s[at] - last_s < _REPEATED_S
        if not repeats[at]:
            last_s = t_s[at]
    return repeats


def _along(odometry: MotionTrack | None, track: MotionTrack) -> Motions | None:
    """Dead reckoning at the times of a track; where it is silent, the last that it knew."""
    if odometry is None:
        return None
    motions, known = odometry.at(track.t_ns)
    if known.mean() < _LEAST_KNOWN:
        return None
    newest = np.maximum.accumulate(np.where(known, np.arange(len(known)), int(np.argmax(known))))
    return motions[newest]


def _way_of(wheels: Motions, off_rad: Floats) -> Floats:
    """How far odometry has the robot gone since the first pose, (2, N), in the map's directions."""
    dx, dy = np.diff(wheels.x_m), np.diff(wheels.y_m)
    turn = 0.5 * (off_rad[1:] + off_rad[:-1])
    steps = [dx * np.cos(turn) - dy * np.sin(turn), dx * np.sin(turn) + dy * np.cos(turn)]
    return np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)


def _smooth(
    samples: _Samples, values: Sequence[Floats], motion: Motion, least: float
) -> list[Floats]:
    """Coordinates (N,) that move alike, each smoothed."""
    motion = _estimated(samples, values, motion, least)
    t_s, measured, cut = samples.t_s, samples.measured, samples.cut
    return [smoothed(t_s, filtered(t_s, each, measured, cut, motion), motion) for each in values]


def _estimated(samples: _Samples, values: Sequence[Floats], motion: Motion, least: float) -> Motion:
    """The drive by which the measurements are likeliest (their innovations: Schweppe, 1965), and
    the noise where it is 0, no smaller than ``least`` squared.

    One after the other, by ever smaller factors.
    """
    rows = np.flatnonzero(samples.measured)
    parts = [(samples.of(part), [each[part] for each in values]) for part in _stretches(rows)]

    def cost(tried: Motion) -> float:
        return sum(
            filtered(some.t_s, each, some.measured, some.cut, tried).cost
            for some, of_each in parts for each in of_each
        )  # fmt: skip

    keys = ("drive",) if motion.noise else ("drive", "noise")
    if not motion.noise:
        spread = max(_spread(np.diff(each[rows]), motion.turn) for each in values)
        motion = replace(motion, noise=max(spread, least) ** 2)
    begins = [replace(motion, drive=each * max(motion.noise, least**2)) for each in _DRIVES]
    best = min(begins, key=cost)
    lowest = cost(best)
    for factor in _STEPS:
        best, lowest = _descended(best, lowest, keys, factor, least * least, cost)
    return best


def _descended(
    best: Motion,
    lowest: float,
    keys: Sequence[str],
    factor: float,
    least: float,
    cost: Callable[[Motion], float],
) -> tuple[Motion, float]:
    """Steps of one factor for as long as they lower the cost."""
    improved = True
    while improved:
        improved = False
        for key in keys:
            for step in (factor, 1.0 / factor):
                value = getattr(best, key) * step
                tried = replace(best, **{key: max(value, least if key == "noise" else 1e-9)})
                if tried != best and (found := cost(tried)) < lowest - 1e-6:
                    best, lowest, improved = tried, found, True
    return best, lowest


def _stretches(rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The measured poses, or stretches of them spread evenly, where they are many."""
    if len(rows) <= _STRETCHES * _STRETCH:
        return [rows]
    firsts = np.linspace(0, len(rows) - _STRETCH, _STRETCHES).astype(np.int64)
    return [rows[first : first + _STRETCH] for first in firsts]


def _spread(steps: Floats, turn: float) -> float:
    """How much single values scatter, by second differences, robustly."""
    if turn:
        steps = wrapped(steps)
    return 1.4826 * float(np.median(np.abs(np.diff(steps)))) / math.sqrt(6.0)
