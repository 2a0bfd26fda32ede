"""Poses that scatter, and whether a smoother mends them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.interface import Cause, Plot, Settings, Suspect, how_sure
from mapping.diagnosis.hypothesis import Hypothesis
from mapping.smoothing import Noise, smoothed_track
from mapping.tracks import MotionTrack, wrapped

LEAST_GAIN = (
    0.05  # in log-likelihood a reading: of poses off by 1 cm and 2 degrees it is 0.02 to 0.04
)
_COST = 0.1  # of the gain: a way round, so that what is truly wrong stands before it
LEAST_M, LEAST_RAD = 0.01, math.radians(1.0)  # all poses scatter a little, and smoothing helps
_LEVEL = 0.99  # at which the gain must hold: several things are tried
_SHOWN = 400  # poses of the plot


class Smoothing(Cause):
    """The poses against themselves smoothed: named where the score gains by it."""

    name, title = "smoothing", "the poses scatter, and smoothing helps"
    needs_walls = False

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """One question: is the map better with smoothed poses?"""
        placement, pose = case.placed.placement, case.config.pose
        if pose.smooth or pose.fixed is not None or case.placed.by_odometry:
            return
        track = smoothed_track(placement.track, Noise(), placement.odometry)
        away_m, turned_rad = _moved(placement.track, track)
        if away_m < LEAST_M and turned_rad < LEAST_RAD:
            return
        before, after = (
            case.judged(readings, case.judged_by)
            for readings in (case.session.under(hypothesis),
                             case.session.under(hypothesis, track))
        )  # fmt: skip
        gain = after.gain_over(before)
        if gain.mean < LEAST_GAIN or after.gain_over(before, level=_LEVEL).low <= 0.0:
            return
        beside = " and by dead reckoning" if placement.odometry is not None else ""
        yield Suspect(
            self.name, "",
            f"the poses scatter by {100 * away_m:.1f} cm and {math.degrees(turned_rad):.1f} "
            "degrees, and smoothing them helps",
            (f"held against those before and after them{beside}, half of the poses move by more "
             "than that, and the readings agree better",),
            _COST * gain.mean, how_sure(gain, math.nan),
            settings=_SMOOTH, value=turned_rad, unit="rad", gain=gain,
            plots=(_headings(case, placement.track, track),),
        )  # fmt: skip


_SMOOTH: Settings = {"pose": {"smooth": True}}


def _moved(before: MotionTrack, after: MotionTrack) -> tuple[float, float]:
    """By how much half of the poses were moved: metres, radians."""
    a, b = before.motions, after.motions
    turned = np.abs(wrapped(a.heading_rad - b.heading_rad))
    return (
        float(np.median(np.hypot(a.x_m - b.x_m, a.y_m - b.y_m))),
        float(np.median(turned)),
    )


def _headings(case: Case, before: MotionTrack, after: MotionTrack) -> Plot:
    """Some headings, and the same smoothed as a line."""
    first = max(len(before.t_ns) // 2 - _SHOWN // 2, 0)
    shown = slice(first, first + _SHOWN)
    seconds = (before.t_ns[shown] - case.start_ns) * 1e-9
    smooth = np.unwrap(after.motions.heading_rad[shown])
    single = smooth + wrapped(before.motions.heading_rad[shown] - smooth)
    return Plot(
        "headings, and smoothed", "time (s)", "heading (degrees)",
        points=np.column_stack([seconds, np.degrees(single)]),
        line=np.column_stack([seconds, np.degrees(smooth)]),
    )  # fmt: skip
