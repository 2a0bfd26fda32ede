"""Poses that are too few, that jump, or whose headings are noisy."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapping.diagnosis.causes.interface import Cause, Evidence, Plot, Suspect
from mapping.diagnosis.pose_quality import (
    FEWEST_JUMPS,
    NOISY_RAD,
    heading_noise_rad,
    jumps,
    steps_of,
)
from recorder.numbers import median

_DROPPED = 0.1
_BRIDGED_S = 0.8  # over longer gaps a straight way between two poses is a guess
_FEWEST = 10  # poses
_NO_POSE = "no pose at that time"


class Poses(Cause):
    """What the poses themselves show; nothing of it needs a map."""

    name, title = "poses", "the poses are few, jump or scatter"

    def suspects(self, evidence: Evidence) -> Iterator[Suspect]:
        """Each kind of trouble that there is."""
        track = evidence.placed.placement.track
        if evidence.config.pose.fixed is not None or len(track.t_ns) < _FEWEST:
            return
        yield from _few(evidence)
        yield from _jumps(evidence)
        yield from _noise(evidence)


def _few(evidence: Evidence) -> Iterator[Suspect]:
    counts = evidence.placed.counts
    share = counts.dropped.get(_NO_POSE, 0) / max(counts.readings, 1)
    if share < _DROPPED:
        return
    gaps_s = np.diff(evidence.placed.placement.track.t_ns) * 1e-9
    wide = gaps_s[gaps_s > evidence.config.pose.max_gap_s]
    usual_s = median(wide) if len(wide) else math.nan
    bridged = usual_s < _BRIDGED_S
    yield Suspect(
        "poses", "", f"{share:.0%} of the readings have no pose",
        (f"{len(wide)} gaps between poses are longer than pose.max_gap_s, "
         f"half of them over {usual_s:.2g} s",),
        0.5 * share, "almost certain",
        settings={"pose": {"max_gap_s": round(1.5 * usual_s, 2)}} if bridged else None,
        advice="" if bridged else "the tracker loses the robot: look at its light and its camera",
        value=share, unit="share",
    )  # fmt: skip


def _jumps(evidence: Evidence) -> Iterator[Suspect]:
    track, gap_s = evidence.placed.placement.track, evidence.config.pose.max_gap_s
    seconds = (track.t_ns[1:] - evidence.placed.counts.first_ns) * 1e-9
    dt, way, turn = steps_of(track)
    both = jumps(track, gap_s)
    if len(both) < FEWEST_JUMPS:
        return
    yield Suspect(
        "poses", "", f"the poses jump {len(both)} times",
        (f"by up to {way[both].max():.2f} m and {math.degrees(turn[both].max()):.0f} degrees "
         "between neighbours",),
        min(1.0, 4.0 * len(both) / len(dt)), "almost certain",
        advice="the tracker takes something else for the tag: look at its camera; what else is "
        "told of this session is less sure",
        value=float(len(both)), unit="jumps",
        seconds=tuple((float(s) - 0.5, float(s) + 0.5) for s in seconds[both[:20]]),
    )  # fmt: skip


def _noise(evidence: Evidence) -> Iterator[Suspect]:
    track = evidence.placed.placement.track
    noise_rad = heading_noise_rad(track, evidence.config.pose.max_gap_s)
    if noise_rad < NOISY_RAD:
        return
    seconds = (track.t_ns - evidence.placed.counts.first_ns) * 1e-9
    shown = slice(0, 400)
    yield Suspect(
        "poses", "", f"the headings are noisy: +- {math.degrees(noise_rad):.1f} degrees each",
        ("neighbouring headings differ by more than any turn explains",),
        0.02 * math.degrees(noise_rad), "likely",
        value=noise_rad, unit="rad",
        plots=(Plot("headings of the first poses", "time (s)", "heading (degrees)",
                    points=np.column_stack([
                        seconds[shown], np.degrees(track.motions.heading_rad[shown])])),),
    )  # fmt: skip
