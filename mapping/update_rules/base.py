"""What an update rule is: how a temp grid changes the map, behind one small interface.

A rule names the arrays that it keeps for each cell, changes a rectangle of them for one reading,
and states what they mean: a value in the rule's own unit, and a probability. All that anyone has to
know of a rule stands on its class. A rule of your own is such a class; see docs/plugins.md.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.parameters import Configurable, ParameterSection
from recorder.sensors import SensorKind

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Cells = dict[str, Floats]

CLAMP = 13.8  # log-odds: a probability stays within 1e-6 of 0 and 1, and can always come back


class UpdateRule(Configurable):
    """Base of all rules. ``kind`` is the unit of its values; ``start`` what a cell begins with.

    ``Parameters`` are the keys of its own in ``[sensors.NAME]``; ``parameters`` holds their values.
    """

    kind: ClassVar[str] = "probability"
    start: ClassVar[dict[str, float]] = {}
    """The arrays that the rule keeps, by name, and what each cell begins with."""
    order_matters: ClassVar[bool] = False
    """True where the same readings in another order may give another map."""
    against_largest: ClassVar[bool] = False
    """True where ``probability`` needs the largest value of the map (it is 0 otherwise)."""
    per_sample: ClassVar[bool] = True
    """False where a reading counts once, however often its samples hit a cell."""
    along_axis: ClassVar[bool] = False
    """True where a beam counts as a thin line: cells beside its axis stay as they are."""

    needs_a_view: ClassVar[bool] = False
    """True where a cell is held back until a beam passed through it: the first one may raise it."""

    ignores: ClassVar[frozenset[str]] = frozenset()
    """Keys of sensor models by which the rule does not go: it has its own idea of the evidence."""

    _configured: ParameterSection | None = None

    @property
    def parameters(self) -> Any:
        """The values of the rule's own keys, as its ``Parameters`` holds them."""
        return self.Parameters() if self._configured is None else self._configured

    def with_parameters(self, values: Mapping[str, Any]) -> UpdateRule:
        """The rule with its own keys among ``values``; itself where it has no keys."""
        own = self.Parameters.own_of(values)
        if not own:
            return self
        configured = copy.copy(self)
        configured._configured = self.Parameters.model_validate(own)
        return configured

    def usual(self, kind: SensorKind) -> dict[str, Any]:
        """Keys of a sensor that suit this rule better than those of the catalogue, by kind."""
        return {}

    def merge(self, cells: Cells, temp: TempGrid) -> None:
        """Change ``cells``, the arrays over ``temp.window``, in place for one reading."""
        raise NotImplementedError

    def values(self, cells: Cells) -> Floats:
        """What the arrays hold, in the rule's own unit."""
        raise NotImplementedError

    def probability(self, cells: Cells, largest: float) -> Floats:
        """The same as a probability; ``largest`` is the largest value in the whole map."""
        return self.probability_of_values(self.values(cells), largest, self.extra(cells))

    def extra(self, cells: Cells) -> dict[str, Floats]:
        """Further arrays to show, by name."""
        return {}

    def terms(self, cells: Cells) -> dict[str, Floats]:
        """What each sum adds to the log-odds of a cell, by what it counts; empty: one sum is all.

        A cell is moved by the terms that a reading changed.
        """
        return {}

    def probability_of_values(
        self, values: Floats, largest: float, extra: Mapping[str, Floats]
    ) -> Floats:
        """A probability from what files hold: the values, and the arrays of ``extra``."""
        return share_of_largest(values, largest) if self.against_largest else values

    def untouched(self, values: Floats, extra: Mapping[str, Floats], start: float) -> Flags:
        """Cells that hold what they began with (or no number): as good as never seen."""
        same: Flags = (values == start) | np.isnan(values)
        return same

    @property
    def start_value(self) -> float:
        """What a cell without readings holds, as a file has it: in single precision."""
        return float(np.float32(self.values(self._one_cell)[0]))

    @property
    def start_probability(self) -> float:
        """The probability of a cell without readings."""
        return float(self.probability(self._one_cell, 0.0)[0])

    @property
    def never_free(self) -> bool:
        """Whether a cell cannot become more free than it began: nothing lies below 0."""
        return self.start_probability <= 0.0

    @property
    def multiplies_odds(self) -> bool:
        """Whether the log of exact values may predict a reading's outcome: odds times p / (1 - p).

        It checks each prediction, so a rule that does otherwise costs only the try.
        """
        return self.kind in ("probability", "odds")

    @property
    def shown_as_odds(self) -> bool:
        """Whether the values themselves are what a picture of odds holds against the largest."""
        return self.against_largest

    @property
    def _one_cell(self) -> Cells:
        return {name: np.full(1, value) for name, value in self.start.items()}


def share_of_largest(values: Floats, largest: float) -> Floats:
    """Values over the largest, 0 .. 1; all 0 where nothing was counted yet."""
    if largest <= 0.0:
        return np.zeros_like(values)
    shares: Floats = np.clip(values / largest, 0.0, 1.0)
    return shares


def log_odds(probability: Floats) -> Floats:
    """ln(p / (1 - p)), clamped so that 0 and 1 stay finite."""
    with np.errstate(divide="ignore"):
        ratio = np.log(probability) - np.log1p(-probability)
    clamped: Floats = np.clip(ratio, -CLAMP, CLAMP)
    return clamped
