"""Ranges too long or too short by a factor, or all by as much: walls seen from near and far."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mapping.diagnosis.case import Case
from mapping.diagnosis.causes.interface import Cause, Plot, Settings, Suspect, how_sure, walls_text
from mapping.diagnosis.hypothesis import Hypothesis, Number, bias_of, scale_of
from mapping.diagnosis.patches import find_patches
from mapping.diagnosis.search import Candidate, Found

_LEAST_OF_CONES = 0.016
_COST_OF_USUAL = 0.005  # of the usual fault, at least, in log-likelihood a reading


class Ranges(Cause):
    """A factor and a bias for each sensor: ``sensors.NAME.range_scale``, ``range_bias_m``."""

    name, title = "range", "a sensor reads long or short"

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """The score does not see them: a world drawn smaller is nearly as consistent."""
        for sensor in case.thin:
            yield Candidate((scale_of(sensor),), by_score=False)
            yield Candidate((bias_of(sensor),), by_score=False)
        for sensor in case.wide:  # corners and what else is in a cone feign a percent or so
            yield Candidate((scale_of(sensor, _LEAST_OF_CONES),), by_score=False)
            yield Candidate((bias_of(sensor),), by_score=False)

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
        if number.sensor is None or number.key not in ("scale", "bias_m"):
            return None
        sensor, excess = number.sensor, hypothesis.number(number) - number.neutral
        unit, times = ("%", 100.0) if number.key == "scale" else ("cm", 100.0)
        way = "long" if excess > 0 else "short"
        evidence = ["the same wall lies at different places when it is seen from near and from far"]
        if number.key == "bias_m":
            evidence = [
                "walls lie too near or too far by as much from everywhere",
                "a sensor that sits farther ahead shows the same, and so does a bias of the other "
                "sensor, the other way: the one that explains the readings better is named",
            ]
        if sensor in case.wide or (case.wide and number.key == "bias_m"):
            evidence.append("seen where cones and thin beams measure the same piece of wall")
        return Suspect(
            self.name, sensor,
            f"{sensor} reads {times * abs(excess):.1f} +- {times * found.error:.1f} {unit} {way}",
            (*evidence, *walls_text(found)),
            max(found.cost, _COST_OF_USUAL * abs(excess) / number.usual),
            how_sure(None, abs(excess) / found.error), self.settings(case, hypothesis, sensor),
            value=hypothesis.number(number), unit="times" if number.key == "scale" else "m",
            error=found.error, gain=found.gain,
            plots=(_residuals(case, sensor, hypothesis, number),) if sensor in case.thin else (),
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
