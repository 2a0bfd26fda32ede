"""Poses that come late, or early: the robot was elsewhere when a reading was taken."""

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
from mapping.diagnosis.hypothesis import Hypothesis, Number, offset_of_poses
from mapping.diagnosis.search import Candidate, Found

_COARSE_S = (-0.3, -0.2, -0.1, 0.1, 0.2, 0.3)
_SHOWN_S = (-0.3, -0.2, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3)


class PoseTime(Cause):
    """One number for the whole session: ``pose.offset_s``."""

    name, title = "pose-time", "the poses come late or early"

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """Alone."""
        yield Candidate((offset_of_poses(),), (_COARSE_S,))

    def settings(self, case: Case, hypothesis: Hypothesis, subject: str) -> Settings:
        """What is set already, and more."""
        offset_s = case.config.pose.offset_s + hypothesis.offset_s
        return {"pose": {"offset_s": round(offset_s, 4)}}

    def explained(
        self, case: Case, number: Number, found: Found, hypothesis: Hypothesis
    ) -> Suspect | None:
        """How late, and how it shows where the robot turns."""
        if number.key != "offset_s":
            return None
        offset_s = hypothesis.offset_s
        error_s = found.error
        errors = abs(offset_s) / error_s if error_s > 0 else math.nan
        late = "late" if offset_s < 0 else "early"
        known = f" +- {1e3 * error_s:.2g}" if error_s > 0 else ""
        return Suspect(
            self.name, "", f"the poses come {abs(1e3 * offset_s):.0f}{known} ms {late}",
            (
                "seen while the robot turns or drives, the same wall lies at different places; "
                "with the poses moved in time the readings agree",
                *walls_text(found),
            ),
            found.cost, how_sure(found.gain, errors),
            self.settings(case, hypothesis, ""), value=offset_s, unit="s", gain=found.gain,
            error=error_s if error_s > 0 else None,
            plots=(profile(case, number, hypothesis, _SHOWN_S),),
        )  # fmt: skip
