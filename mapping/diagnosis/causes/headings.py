"""Headings that are off by one angle, and poses that drift.

Headings that are off turn all mounts alike: of several thin beams that is told from one mount that
is turned. Of a single one it is not, but a robot on two wheels drives where it heads: if it drives
to one side of its headings, by what the walls ask for, it is they that are off.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.interface import (
    Cause,
    Settings,
    Suspect,
    how_sure,
    profile,
    walls_text,
)
from mapping.diagnosis.fitting import fit
from mapping.diagnosis.hypothesis import (
    Hypothesis,
    Number,
    drift_of_poses,
    heading_of_poses,
    offset_of_poses,
    y_of,
    yaw_of,
)
from mapping.diagnosis.pose_quality import Travel, travel
from mapping.diagnosis.search import Candidate, Found

_COARSE_RAD = tuple(math.radians(v) for v in (-16, -10, -5, -2, 2, 5, 10, 16))
_PAIR_RAD = tuple(math.radians(v) for v in (-12, -5, 5, 12))
_PAIR_S = (-0.2, -0.1, 0.1, 0.2)
_SHOWN_RAD = tuple(math.radians(v) for v in (-16, -10, -5, -2, 0, 2, 5, 10, 16))
_AGREED_RAD = math.radians(1.5)
_LEAST_TRAVEL_RAD = math.radians(1.2)
_SURE = 5.0
_TOTALS_RAD = tuple(math.radians(v) for v in (-24, -10, -5, 5, 10, 24))
_SHOWN_TOTALS = (-1.0, -0.6, -0.3, -0.15, 0.0, 0.15, 0.3, 0.6, 1.0)


class Headings(Cause):
    """One number for the whole session: ``pose.heading_offset_deg``."""

    name, title = "heading", "the headings are off by one angle"

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """Alone; of one thin beam only if the travel agrees, and then with the time of the poses
        as well, as mounts are."""
        if len(case.thin) > 1:
            yield Candidate((heading_of_poses(),), (_COARSE_RAD,))
        if len(case.thin) != 1 or not _travel_agrees(case):
            return
        # Where all walls are as far away a turn and a shift of the beam look alike, too.
        instead = (yaw_of(case.thin[0]), y_of(case.thin[0]))
        yield Candidate((heading_of_poses(),), (_COARSE_RAD,), instead_of=instead)
        yield Candidate(
            (offset_of_poses(), heading_of_poses()),
            (_PAIR_S, _PAIR_RAD), instead_of=instead,
        )  # fmt: skip

    def settings(self, case: Case, hypothesis: Hypothesis, subject: str) -> Settings:
        """What is set already, and more."""
        deg = case.config.pose.heading_offset_deg + math.degrees(hypothesis.heading_rad)
        return {"pose": {"heading_offset_deg": round(deg, 3)}}

    def explained(
        self, case: Case, number: Number, found: Found, hypothesis: Hypothesis
    ) -> Suspect | None:
        """By how much, and what shows that it is not a mount."""
        if number.key != "heading_rad":
            return None
        value = hypothesis.heading_rad
        error = found.error
        errors = abs(value) / error if error > 0 else math.nan
        known = f" +- {math.degrees(error):.2g}" if error > 0 else ""
        side = "left" if value < 0 else "right"
        return Suspect(
            self.name, "",
            f"the headings are {math.degrees(abs(value)):.2g}{known} degrees too far to the {side}",
            (*_evidence(case), *walls_text(found)), found.cost, how_sure(found.gain, errors),
            self.settings(case, hypothesis, ""), value=value, unit="rad", gain=found.gain,
            error=error if error > 0 else None,
            plots=(profile(case, number, hypothesis, _SHOWN_RAD),),
        )  # fmt: skip


def _evidence(case: Case) -> Iterator[str]:
    if len(case.thin) > 1:
        yield (
            f"{', '.join(case.thin)} all seem turned by the same angle; turned together, the walls "
            "that they draw from different directions agree"
        )
    else:
        yield (
            f"seen from different directions the walls of {case.thin[0]} lie at different places; "
            "with the headings mended they agree (a mount that is turned by as much would look the "
            "same)"
        )
    if (seen := _travel_of(case)) is not None:
        yield travel_text(seen)


def travel_text(seen: Travel) -> str:
    """Where a robot drives, against its headings."""
    side = "left" if seen.rad > 0 else "right"
    return (
        f"where the robot drives straight, it drives {math.degrees(abs(seen.rad)):.1f} +- "
        f"{math.degrees(seen.error_rad):.1f} degrees to the {side} of its headings"
    )


def _travel_of(case: Case) -> Travel | None:
    return travel(case.placed.placement.track, case.config.pose.max_gap_s)


def _travel_agrees(case: Case) -> bool:
    """Whether the robot drives to one side of its headings by what the walls ask for."""
    seen = _travel_of(case)
    if case.rough or seen is None or case.config.pose.rides_on == "head":
        return False
    if abs(seen.rad) < max(_LEAST_TRAVEL_RAD, _SURE * seen.error_rad):
        return False
    number = heading_of_poses()
    asked = fit(case.beams(case.thin), [number], Hypothesis(heading_rad=seen.rad))
    off = abs(asked.value(number) - seen.rad)
    return not asked.failed and off < _AGREED_RAD + 3.0 * seen.error_rad


class Drift(Cause):
    """A steady drift of the headings, or of the places: ``pose.drift_per_min``."""

    name, title = "drift", "the poses drift"

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """Headings; and places, along x and y."""
        lasted_s = _lasted_s(case)
        coarse = tuple(total / lasted_s for total in _TOTALS_RAD)
        yield Candidate((drift_of_poses("heading_radps", lasted_s),), (coarse,))
        for key in ("x_mps", "y_mps"):
            yield Candidate((drift_of_poses(key, lasted_s),))

    def settings(self, case: Case, hypothesis: Hypothesis, subject: str) -> Settings:
        """What is set already, and more."""
        found = (hypothesis.x_mps, hypothesis.y_mps, math.degrees(hypothesis.heading_radps))
        known = case.config.pose.drift_per_min
        return {"pose": {"drift_per_min": [
            round(old - 60.0 * more, 4) for old, more in zip(known, found, strict=True)
        ]}}  # fmt: skip

    def explained(
        self, case: Case, number: Number, found: Found, hypothesis: Hypothesis
    ) -> Suspect | None:
        """How fast, and how far over the whole session."""
        x, y = hypothesis.x_mps, hypothesis.y_mps
        if number.key not in ("heading_radps", "x_mps", "y_mps") or (number.key == "y_mps" and x):
            return None  # x and y are one drift
        if number.key == "heading_radps":
            what, unit, times, widest = "headings", "degrees", math.degrees(60.0), math.radians(40)
            rate = -hypothesis.heading_radps
            size, way = abs(rate), "to the left" if rate > 0 else "to the right"
        else:
            what, unit, times, widest = "places", "cm", 6000.0, 1.0
            rate = size = math.hypot(x, y)
            way = f"towards {math.degrees(math.atan2(-y, -x)):.0f} degrees"
        error, lasted_s = found.error, _lasted_s(case)
        known = f" +- {times * error:.2g}" if error > 0 else ""
        return Suspect(
            self.name, what,
            f"the {what} drift by {times * size:.2g}{known} {unit} a minute {way}",
            (
                f"the same wall lies elsewhere the later it is seen; "
                f"{times / 60.0 * size * lasted_s:.2g} {unit} over the whole session",
                *walls_text(found),
            ),
            found.cost, how_sure(found.gain, size / error if error > 0 else math.nan),
            self.settings(case, hypothesis, ""), value=rate,
            unit="rad/s" if number.key == "heading_radps" else "m/s", gain=found.gain,
            error=error if error > 0 else None,
            plots=(profile(case, number, hypothesis,
                           [widest * each / lasted_s for each in _SHOWN_TOTALS]),),
        )  # fmt: skip


def _lasted_s(case: Case) -> float:
    t_ns = case.readings.t_ns
    return max(float(t_ns.max() - t_ns.min()) * 1e-9, 1.0)
