"""A sensor that sits turned or shifted, against what is configured."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.headings import travel_text
from mapping.diagnosis.causes.interface import (
    Cause,
    Settings,
    Suspect,
    how_sure,
    profile,
    walls_text,
)
from mapping.diagnosis.hypothesis import Hypothesis, Number, offset_of_poses, x_of, y_of, yaw_of
from mapping.diagnosis.pose_quality import travel
from mapping.diagnosis.search import Candidate, Found

_COARSE_RAD = tuple(math.radians(v) for v in (-16, -10, -5, 5, 10, 16))
_PAIR_RAD = tuple(math.radians(v) for v in (-10, 10))
_PAIR_S = (-0.15, 0.15)
_SHOWN_RAD = tuple(math.radians(v) for v in (-16, -10, -5, -2, 0, 2, 5, 10, 16))
_SHOWN_M = (-0.05, -0.03, -0.015, 0.0, 0.015, 0.03, 0.05)


class Mount(Cause):
    """For each thin beam its yaw, and how far it sits to the left: ``sensors.NAME.mount``.

    How far ahead a single beam sits is the same thing as a bias of its ranges; a scan tells the
    two apart. A turned mount and a late pose
    feign each other where the robot spins, so they are tried together as well.
    """

    name, title = "mount", "a sensor sits turned or shifted"

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """Yaw, shift, and yaw with the time of the poses; of a cone its shift alone."""
        for sensor in case.thin:
            yield Candidate((yaw_of(sensor),), (_COARSE_RAD,))
            yield Candidate((y_of(sensor),))
            yield Candidate((offset_of_poses(), yaw_of(sensor)), (_PAIR_S, _PAIR_RAD))
            if case.is_scan(sensor):
                yield Candidate((x_of(sensor),))
        for sensor in case.wide:
            yield Candidate((y_of(sensor),), by_score=False)

    def settings(self, case: Case, hypothesis: Hypothesis, subject: str) -> Settings:
        """The whole mount."""
        mount, change = case.session.mount(subject), hypothesis.of(subject)
        return {"sensors": {subject: {"mount": [
            round(mount.x_m + change.x_m, 4), round(mount.y_m + change.y_m, 4),
            round(math.degrees(mount.heading_rad + change.yaw_rad), 3),
        ]}}}  # fmt: skip

    def explained(
        self, case: Case, number: Number, found: Found, hypothesis: Hypothesis
    ) -> Suspect | None:
        """Which way, how far."""
        if number.sensor is None or number.key not in ("yaw_rad", "x_m", "y_m"):
            return None
        sensor, value = number.sensor, hypothesis.number(number)
        error = found.error
        errors = abs(value) / error if error > 0 else math.nan
        gain = None if found.beside else found.gain
        if number.key == "yaw_rad":
            shown, unit, way = math.degrees(abs(value)), "degrees", "turned"
            sigma, values = math.degrees(error), _SHOWN_RAD
        else:
            shown, unit, way = 100.0 * abs(value), "cm", "shifted"
            sigma, values = 100.0 * error, _SHOWN_M
        known = f" +- {sigma:.2g}" if error > 0 else ""
        sides = ("ahead", "back") if number.key == "x_m" else ("to the left", "to the right")
        side = sides[0 if value > 0 else 1]
        return Suspect(
            self.name, sensor, f"{sensor} sits {way} by {shown:.2g}{known} {unit} {side}",
            (
                "seen from different directions the same wall lies at different places; with the "
                "mount mended its readings agree",
                *walls_text(found), *_or_the_headings(case, number),
                *(["the gain is that of the whole mount"] if found.beside else []),
            ),
            found.cost, how_sure(gain, errors),
            self.settings(case, hypothesis, sensor), value=value,
            unit="rad" if number.key == "yaw_rad" else "m", gain=gain,
            error=error if error > 0 else None,
            plots=(profile(case, number, hypothesis, values),),
        )  # fmt: skip


def _or_the_headings(case: Case, number: Number) -> Iterator[str]:
    """Of a single thin beam a turned mount looks as headings do that are off."""
    if number.key != "yaw_rad" or len(case.thin) > 1:
        return
    yield (
        "headings that are off by as much would look the same (pose.heading_offset_deg): no other "
        "thin beam tells which"
    )
    if (seen := travel(case.placed.placement.track, case.config.pose.max_gap_s)) is not None:
        yield travel_text(seen)
