"""`saturating`: evidence for and against summed apart, so that no number of readings is final."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from mapping.artifacts import TempGrid
from mapping.numbers import expit
from mapping.parameters import Positive
from mapping.update_rules.base import Cells, Floats, UpdateRule, log_odds
from recorder.messages import Radiation
from recorder.sensors import SensorKind

STEPS = 2.0**24  # in evidence of 1: sums of whole steps are the same in any order

# Fitted on simulated rooms, for the model `fading`; all else is the catalogue's.
_USUAL: dict[Radiation, dict[str, float]] = {Radiation.ULTRASOUND: {"hit": 4.74, "miss": 0.41}}


def in_steps(evidence: Floats) -> Floats:
    """The nearest whole number of steps of 2^-24."""
    rounded: Floats = np.rint(evidence * STEPS) / STEPS
    return rounded


class Saturating(UpdateRule):
    """Log-odds (H - M) / (1 + (H + M) / saturation) of the evidence for and against, H and M.

    The hundredth echo from one corner is hardly news: log-odds end at plus or minus the
    ``saturation``, however many readings agree, and where they contradict, their share decides.
    Sums are whole steps of 2^-24 up to 5e8, so any order of readings gives the same bytes, and the
    sums of two maps add up to the map of both.
    """

    name = "saturating"
    start: ClassVar[dict[str, float]] = {"evidence_for": 0.0, "evidence_against": 0.0}

    class Parameters(UpdateRule.Parameters):
        saturation: Positive = Field(7.12, description="log-odds that no number of readings passes")

    multiplies_odds = False

    def usual(self, kind: SensorKind) -> dict[str, Any]:
        return dict(_USUAL.get(kind.radiation, {})) if kind.model == "fading" else {}

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        evidence = in_steps(log_odds(temp.probability))
        cells["evidence_for"] += np.maximum(evidence, 0.0)
        cells["evidence_against"] += np.maximum(-evidence, 0.0)

    def values(self, cells: Cells) -> Floats:
        above, below = cells["evidence_for"], cells["evidence_against"]
        return expit((above - below) / self._damping(above + below))

    def terms(self, cells: Cells) -> dict[str, Floats]:
        above, below = cells["evidence_for"], cells["evidence_against"]
        damping = self._damping(above + below)
        return {"evidence for": above / damping, "evidence against": -below / damping}

    def _damping(self, total: Floats) -> Floats:
        damping: Floats = 1.0 + total / self.parameters.saturation
        return damping
