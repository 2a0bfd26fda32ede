"""The update rules that keep one number a cell, or masses; and the table of all rules.

Who draws, exports or compares looks a rule up here, by the names that a file holds
(:func:`rule_of`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar

import numpy as np

from mapping.artifacts import TempGrid
from mapping.numbers import expit
from mapping.update_rules.axis import axis_cells
from mapping.update_rules.base import (
    CLAMP,
    Cells,
    Flags,
    Floats,
    UpdateRule,
    log_odds,
    share_of_largest,
)
from mapping.update_rules.pooled import Pooled
from mapping.update_rules.saturating import Saturating

__all__ = [
    "BUILT_IN_RULES", "CLAMP", "HIMM_HIT", "HIMM_MISS", "HIMM_MOST", "UPDATE_RULES", "Bayes",
    "Binary", "Cells", "Count", "DempsterShafer", "Flags", "Floats", "Himm", "Odds", "Pooled",
    "Saturating", "Sum", "UpdateRule", "combine_masses", "floored", "log_odds", "rule_of",
    "share_of_largest", "unit_gives_probability", "unit_gives_start",
]  # fmt: skip

UNKNOWN_FLOOR = 1e-6  # Dempster-Shafer: the mass that stays unknown, so that no cell is stuck
HIMM_HIT, HIMM_MISS, HIMM_MOST = 3.0, 1.0, 15.0


class Binary(UpdateRule):
    """A cell in a band once is occupied for good."""

    name, kind, start = "binary", "binary", {"occupied": 0.0}

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        cells["occupied"][temp.band] = 1.0

    def values(self, cells: Cells) -> Floats:
        return cells["occupied"]


class Count(UpdateRule):
    """How many readings had the cell in their band."""

    name, kind, start = "count", "count", {"count": 0.0}
    against_largest = True

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        cells["count"] += temp.band

    def values(self, cells: Cells) -> Floats:
        return cells["count"]


class Sum(UpdateRule):
    """The likelihoods added up: 2p - 1 of each reading, which the chapter's model makes a q."""

    name, kind, start = "sum", "sum", {"sum": 0.0}
    against_largest = True

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        cells["sum"] += 2.0 * temp.probability - 1.0

    def values(self, cells: Cells) -> Floats:
        return cells["sum"]


class Bayes(UpdateRule):
    """t f / (t f + (1 - t)(1 - f)) from a prior of 0.5, kept as clamped log-odds."""

    name, kind, start = "bayes", "probability", {"log_odds": 0.0}

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        total = cells["log_odds"] + log_odds(temp.probability)
        np.clip(total, -CLAMP, CLAMP, out=cells["log_odds"])

    def values(self, cells: Cells) -> Floats:
        return expit(cells["log_odds"])


class Odds(Bayes):
    """r / (1 - r) times the odds: Bayes in another unit, with less to calculate."""

    name, kind = "odds", "odds"
    shown_as_odds = True

    def values(self, cells: Cells) -> Floats:
        return np.exp(cells["log_odds"])

    def probability(self, cells: Cells, largest: float) -> Floats:
        return expit(cells["log_odds"])  # odds / (1 + odds)

    def probability_of_values(
        self, values: Floats, largest: float, extra: Mapping[str, Floats]
    ) -> Floats:
        with np.errstate(invalid="ignore"):
            return np.where(np.isinf(values), 1.0, values / (1.0 + values))


class DempsterShafer(UpdateRule):
    """Masses for occupied, empty and unknown; ``conflict`` is where readings contradicted.

    A temp grid's p means the masses max(0, 2p - 1), max(0, 1 - 2p) and the rest. The conflict is
    1 - product of (1 - K) over the readings: after one contradiction it is K itself, and in any
    order of readings it comes out the same.
    """

    name, kind = "dempster-shafer", "mass"
    start: ClassVar[dict[str, float]] = {
        "occupied": 0.0, "empty": 0.0, "unknown": 1.0, "conflict": 0.0,
    }  # fmt: skip

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        touched = temp.probability != 0.5
        evidence = 2.0 * temp.probability[touched] - 1.0
        reading = floored(
            np.maximum(evidence, 0.0), np.maximum(-evidence, 0.0), 1.0 - np.abs(evidence)
        )
        o, e, u = (cells[name][touched] for name in ("occupied", "empty", "unknown"))
        occupied, empty, unknown, conflict = combine_masses((o, e, u), reading)
        o, e, u = floored(occupied, empty, unknown)
        cells["occupied"][touched], cells["empty"][touched], cells["unknown"][touched] = o, e, u
        cells["conflict"][touched] = 1.0 - (1.0 - cells["conflict"][touched]) * (1.0 - conflict)

    def values(self, cells: Cells) -> Floats:
        return cells["occupied"]

    def extra(self, cells: Cells) -> dict[str, Floats]:
        return dict(cells)

    def probability_of_values(
        self, values: Floats, largest: float, extra: Mapping[str, Floats]
    ) -> Floats:
        """The pignistic probability; the occupied part alone where a file lacks the masses."""
        if not {"occupied", "unknown"} <= extra.keys():
            return values
        return extra["occupied"] + extra["unknown"] / 2.0

    def untouched(self, values: Floats, extra: Mapping[str, Floats], start: float) -> Flags:
        if "unknown" not in extra:
            return super().untouched(values, extra, start)
        untouched: Flags = (extra["unknown"] == 1.0) | ~np.isfinite(values)
        return untouched


Masses = tuple[Floats, Floats, Floats]


def combine_masses(a: Masses, b: Masses) -> tuple[Floats, Floats, Floats, Floats]:
    """Dempster's rule for (occupied, empty, unknown) → the same and the conflict K.

    Where K = 1 the rule is undefined (two certain contradictions): the result there is NaN.
    """
    (o1, e1, u1), (o2, e2, u2) = a, b
    conflict = o1 * e2 + e1 * o2
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (1.0 - conflict)
        occupied = (o1 * o2 + o1 * u2 + u1 * o2) * scale
        empty = (e1 * e2 + e1 * u2 + u1 * e2) * scale
        return occupied, empty, u1 * u2 * scale, conflict


def floored(occupied: Floats, empty: Floats, unknown: Floats) -> Masses:
    """Keep a little mass unknown, so that no reading is final; the three still add up to 1."""
    unknown = np.maximum(unknown, UNKNOWN_FLOOR)
    scale = (1.0 - unknown) / np.maximum(occupied + empty, UNKNOWN_FLOOR)
    return occupied * scale, empty * scale, unknown


class Himm(UpdateRule):
    """Certainty 0 .. 15 along the axis only: 1 less in front, then 3 more at the obstacle."""

    name, kind, start = "himm", "certainty", {"certainty": 0.0}
    order_matters = True
    per_sample = False
    along_axis = True
    shown_as_odds = True

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        passed, hit = axis_cells(temp)
        certainty = cells["certainty"]
        certainty[passed] = np.maximum(certainty[passed] - HIMM_MISS, 0.0)
        certainty[hit] = np.minimum(certainty[hit] + HIMM_HIT, HIMM_MOST)

    def values(self, cells: Cells) -> Floats:
        return cells["certainty"]

    def probability_of_values(
        self, values: Floats, largest: float, extra: Mapping[str, Floats]
    ) -> Floats:
        return values / HIMM_MOST


class _Unknown(UpdateRule):
    """Stands for the rule of a file that is not known here: its values are taken as they are."""

    start: ClassVar[dict[str, float]] = {"value": 0.0}

    def values(self, cells: Cells) -> Floats:
        return cells["value"]


BUILT_IN_RULES: tuple[UpdateRule, ...] = (
    Binary(), Count(), Sum(), Bayes(), Odds(), DempsterShafer(), Himm(), Saturating(), Pooled()
)  # fmt: skip
UPDATE_RULES: dict[str, UpdateRule] = {rule.name: rule for rule in BUILT_IN_RULES}
_UNKNOWN = _Unknown()


def rule_of(kind: str, name: str = "") -> UpdateRule:
    """The rule that a file names by the unit of its values and, where it holds it, by its name.

    Of several rules with one unit (a fused map has no rule of its own) the first stands for all.
    """
    named = UPDATE_RULES.get(name)
    if named is not None and named.kind == kind:
        return named
    return _first_of(kind, UPDATE_RULES.values())


def unit_gives_start(kind: str, start: float) -> bool:
    """Whether who knows only the built-in rules knows from the unit what a cell began with.

    If not, a file of the map holds it, as the number ``start``.
    """
    return start == _first_of(kind, BUILT_IN_RULES).start_value


def unit_gives_probability(rule: UpdateRule) -> bool:
    """Whether who knows only the built-in rules gets the rule's probabilities from a file.

    If not (a plugin with a unit of its own), its maps carry them, as the array ``probability``.
    """
    known, own = _first_of(rule.kind, BUILT_IN_RULES), type(rule)
    return (
        own.probability in (UpdateRule.probability, type(known).probability)
        and own.probability_of_values is type(known).probability_of_values
        and rule.against_largest == known.against_largest
    )


def _first_of(kind: str, rules: Iterable[UpdateRule]) -> UpdateRule:
    return next((rule for rule in rules if rule.kind == kind), _UNKNOWN)
