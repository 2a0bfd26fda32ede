"""The map of one layer while it grows: a rule, its arrays, and what each reading changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import MergedGrid, TempGrid
from mapping.grid import GridGeometry, Layer, Window, read_only
from mapping.names import choose
from mapping.update_rules.rules import (
    UPDATE_RULES,
    Cells,
    Floats,
    UpdateRule,
    unit_gives_probability,
)


class MapState:
    """The growing map of one layer; made by :func:`start`.

    ``cells`` are the rule's arrays over the whole grid, ``largest`` the largest value so far for a
    rule whose probability is a share of it.
    """

    def __init__(self, rule: UpdateRule, geometry: GridGeometry) -> None:
        self.rule = rule
        self.geometry = geometry
        self.largest = 0.0
        self._values_are_probabilities = (
            type(rule).probability is UpdateRule.probability
            and type(rule).probability_of_values is UpdateRule.probability_of_values
            and not rule.against_largest
        )
        self.cells: Cells = {
            name: np.full(geometry.shape, value) for name, value in rule.start.items()
        }
        self._observed = np.zeros(geometry.shape, np.bool_)
        self._probability = rule.probability(self.cells, 0.0).astype(np.float32)

    def merge(self, temp: TempGrid) -> MergedGrid:
        """Merge one reading and return what the map holds now where the reading could change it.

        A probability that is a share of the largest value uses the largest one so far.
        """
        here = temp.window.slices
        previous = self._probability[here].copy()
        parts = temp.sub_grids if self.rule.per_sample and temp.sub_grids else (temp,)
        before = self._largest_in(temp.window)
        for part in parts:
            self.rule.merge(self._cut(part.window), part)
            self._observed[part.window.slices] |= part.band | (part.probability != 0.5)
        self._follow_largest(temp.window, before)
        cells = self._cut(temp.window)
        probability = self.rule.probability(cells, self.largest).astype(np.float32)
        values = probability
        if not self._values_are_probabilities:
            values = self.rule.values(cells).astype(np.float32)
        self._probability[here] = probability
        # A rule for thin beams may change cells whose centres lie beside the beam.
        self._observed[here] |= probability != previous
        for array in (previous, probability, values):
            read_only(array)
        return MergedGrid(
            beam=temp.beam, layer=temp.beam.layer, rule=self.rule.name, kind=self.rule.kind,
            geometry=self.geometry, window=temp.window, values=values, probability=probability,
            previous=previous,
        )  # fmt: skip

    def layer(self, name: str) -> Layer:
        """The whole map as it stands; a copy, read-only."""
        values = self.rule.values(self.cells)
        probability = self.rule.probability(self.cells, self.largest)
        extra = {key: _exported(array) for key, array in self.rule.extra(self.cells).items()}
        if not unit_gives_probability(self.rule):
            extra["probability"] = _exported(probability)
        observed = self._observed.copy()
        read_only(observed)
        return Layer(
            name=name, kind=self.rule.kind, geometry=self.geometry, values=_exported(values),
            probability=_exported(probability), observed=observed, extra=extra,
        )  # fmt: skip

    def _cut(self, window: Window) -> Cells:
        return {name: array[window.slices] for name, array in self.cells.items()}

    def _largest_in(self, window: Window) -> float:
        if not self.rule.against_largest:
            return 0.0
        return float(self.rule.values(self._cut(window)).max(initial=0.0))

    def _follow_largest(self, window: Window, before: float) -> None:
        """Keep the largest value of the whole map, looking at all of it only when it may sink."""
        if not self.rule.against_largest:
            return
        now = self._largest_in(window)
        if now >= self.largest:
            self.largest = now
        elif before >= self.largest:
            self.largest = float(self.rule.values(self.cells).max(initial=0.0))


def _exported(array: Floats) -> NDArray[np.float32]:
    copy = array.astype(np.float32)
    read_only(copy)
    return copy


def start(
    rule: str, geometry: GridGeometry, parameters: Mapping[str, Any] | None = None
) -> MapState:
    """An empty map for an update rule; BadInput where there is no rule of that name.

    The rule finds the values of its own keys among ``parameters``.
    """
    known = choose(UPDATE_RULES, rule, "update rule")
    return MapState(known.with_parameters(parameters or {}), geometry)
