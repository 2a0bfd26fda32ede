"""Ranges that are too long or too short by a factor: the same wall, seen from near and from far."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.interface import Cause, Plot, Settings, Suspect, how_sure
from mapping.diagnosis.hypothesis import Hypothesis, Number, scale_of
from mapping.diagnosis.patches import find_patches
from mapping.diagnosis.search import Candidate, Found


class RangeScale(Cause):
    """A factor for each thin beam: ``sensors.NAME.range_scale``."""

    name, title = "range", "a sensor reads long or short"

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """The score does not see it: a world drawn smaller is nearly as consistent."""
        for sensor in case.thin:
            yield Candidate(((self.name, sensor),), (scale_of(sensor),), by_score=False)

    def settings(self, case: Case, hypothesis: Hypothesis, subject: str) -> Settings:
        """The factor, on top of what is configured."""
        known = case.placed.sensors[subject]
        change = hypothesis.of(subject)
        keys = {}
        if change.scale != 1.0:
            keys["range_scale"] = round(known.range_scale * change.scale, 5)
        if change.bias_m != 0.0:
            bias_m = known.range_bias_m + change.bias_m * known.range_scale
            keys["range_bias_m"] = round(bias_m, 4)
        return {"sensors": {subject: keys}}

    def explained(
        self, case: Case, number: Number, found: Found, hypothesis: Hypothesis
    ) -> Suspect | None:
        """By how much, and the residuals against the range."""
        if number.sensor is None or number.key != "scale":
            return None
        sensor, excess = number.sensor, hypothesis.number(number) - 1.0
        error = found.errors[found.candidate.numbers.index(number)]
        errors = abs(excess) / error if error > 0 else math.nan
        way = "long" if excess > 0 else "short"
        return Suspect(
            self.name, sensor,
            f"{sensor} reads {100 * abs(excess):.1f} +- {100 * error:.1f} % {way}",
            ("the same wall lies nearer when it is seen from afar, or farther",),
            max(found.gain.mean, 0.1 * abs(excess)), how_sure(None, errors),
            self.settings(case, hypothesis, sensor), value=hypothesis.number(number), unit="times",
            error=error if error > 0 else None, gain=found.gain, plots=(_residuals(case, sensor, hypothesis, number),),
        )  # fmt: skip


def _residuals(case: Case, sensor: str, hypothesis: Hypothesis, number: Number) -> Plot:
    """Against the range, with the number as the session has it; the line is what was found."""
    before = hypothesis.with_number(number, number.neutral)
    points = case.beams([sensor]).points(before)
    patches = find_patches(points)
    used = patches.weight > 0
    residual_m = (points.range_m - patches.expected_m)[used]
    shown = np.column_stack([patches.expected_m[used], 100.0 * residual_m])
    return Plot(
        "measured less expected range, about the mean of each piece of wall",
        "range (m)",
        "residual (cm)",
        points=shown,
    )
