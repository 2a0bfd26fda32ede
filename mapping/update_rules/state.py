"""The map of one layer while it grows: a rule, its arrays, and what each reading changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import MergedGrid, Sums, TempGrid
from mapping.grid import GridGeometry, Layer, Window, read_only
from mapping.names import choose
from mapping.update_rules.forgetting import Forgetting
from mapping.update_rules.rules import (
    BUILT_IN_RULES,
    UPDATE_RULES,
    Bayes,
    Binary,
    Cells,
    Count,
    DempsterShafer,
    Floats,
    Pooled,
    Saturating,
    Sum,
    UpdateRule,
    unit_gives_probability,
)

if TYPE_CHECKING:
    from mapping.kernels.batch.readings import Place

LANES = 16  # as in the kernels' ``batch/steps.py``
_AT_ONCE = 1 << 18  # cells
STEP = np.float64(2.0**-24)  # of log-odds


class Target(NamedTuple):
    """A map, or a window of it, as the batch kernels take it.

    ``array`` is (rows, a multiple of 16) steps of log-odds, or (K, rows, a multiple of 16) for a
    rule of K arrays; ``place`` is where its first cell lies.
    """

    array: NDArray[Any]
    observed: NDArray[np.bool_]
    place: Place


Kernel = Callable[[Target], None]
# Rules that change no cell but those of which a temp grid says something.
_CHANGE_WHAT_IS_EVIDENT = (Binary, Count, Sum, DempsterShafer, Saturating, Pooled)


class MapState:
    """The growing map of one layer; made by :func:`start`.

    Log-odds are whole steps of 2^-24, so that their sum is the same in any order. ``largest`` is
    the largest value so far, for a rule whose probability is a share of it.
    """

    def __init__(
        self, rule: UpdateRule, geometry: GridGeometry, forget_s: float | None = None
    ) -> None:
        self.rule = rule
        self._forgetting = None
        if forget_s is not None:
            self._forgetting = Forgetting(forget_s, rule.start, geometry.shape)
        self.geometry = geometry
        self._values_are_probabilities = (
            type(rule).probability is UpdateRule.probability
            and type(rule).probability_of_values is UpdateRule.probability_of_values
            and not rule.against_largest
        )
        self._has_terms = type(rule).terms is not UpdateRule.terms  # somebody may ask about sums
        self._steps: NDArray[np.int32] | None = None
        self._stack = blank_stack(0, *geometry.shape)
        self._arrays: Cells = {}
        if type(rule).merge is Bayes.merge and forget_s is None:
            from mapping.kernels.batch import steps

            self._steps = steps.blank(geometry.rows, geometry.cols)
        elif type(rule) in (type(known) for known in BUILT_IN_RULES):
            self._stack = blank_stack(len(rule.start), *geometry.shape)
            self._arrays = dict(zip(rule.start, self._stack[:, :, : geometry.cols], strict=True))
            for name, value in rule.start.items():
                if value:  # zeros take no memory until a reading comes
                    self._arrays[name][...] = value
        else:
            self._arrays = {k: np.full(geometry.shape, v) for k, v in rule.start.items()}
        self._observed = np.zeros(geometry.shape, np.bool_)
        self._largest = 0.0
        self._probability = np.full(geometry.shape, np.float32(rule.start_probability))
        self._stale = False  # of the two: readings were merged of which nobody saw what they did

    @property
    def cells(self) -> Cells:
        """The rule's arrays over the whole grid, by name; log-odds as a copy."""
        everywhere = Window(0, 0, *self.geometry.shape)
        cells = self._cut(everywhere)
        return cells if self._forgetting is None else self._forgetting.faded(cells, everywhere)

    @property
    def largest(self) -> float:
        """The largest value of the map, for a rule that needs it; 0 otherwise."""
        if self._stale or self._forgetting is not None:
            self._look_again()
        return self._largest

    def pass_time(self, t_ns: int) -> None:
        """It is ``t_ns`` now, as other layers' readings tell: a map that forgets does so."""
        if self._forgetting is not None:
            self._forgetting.now_ns = max(self._forgetting.now_ns, t_ns)

    def merge(self, temp: TempGrid, kernel: Kernel | None = None) -> MergedGrid:
        """Merge one reading and return what the map holds now where the reading could change it.

        ``kernel``, where there is one, adds the reading to the cells; otherwise the temp grid is
        what is added. A probability that is a share of the largest value uses the largest one so
        far.
        """
        if self._stale:
            self._look_again()
        here = temp.window.slices
        previous = self._probability[here].copy()
        if self._forgetting is not None:
            self._forgetting.draw(self._cut(temp.window), temp.window, temp.beam.t_ns)
        before = self._largest_in(temp.window)
        sums = self._summed(temp, kernel)
        self._follow_largest(temp.window, before)
        probability, values = self._now(temp.window, previous, sums)
        self._probability[here] = probability
        if kernel is None:  # a rule for thin beams may change cells whose centres lie beside
            self._observed[here] |= probability != previous
        for array in (previous, probability, values):
            read_only(array)
        return MergedGrid(
            beam=temp.beam, layer=temp.beam.layer, rule=self.rule.name, kind=self.rule.kind,
            geometry=self.geometry, window=temp.window, values=values, probability=probability,
            previous=previous, sums=sums if self._has_terms else None,
        )  # fmt: skip

    def _summed(self, temp: TempGrid, kernel: Kernel | None) -> Sums | None:
        """Add one reading to the cells; where there are several sums what it did to them."""
        window = temp.window
        cells = np.arange(window.rows * window.cols)
        if kernel is not None:  # which covers no other cell than the temp grid
            cells = np.flatnonzero(temp.free | temp.band)
        before = self._sums_of(window, cells) if self._has_terms else {}
        if kernel is None:
            self._merge_cells(temp)
        elif self._has_terms:
            kernel(Target(self._stack, self._observed, self._place(0, 0)))
        elif not window.empty:
            self._change(window, kernel)
        if not self._has_terms:
            return None
        after = self._sums_of(window, cells)
        return Sums(cells, window.cols, before, after, self.rule)

    def _sums_of(self, window: Window, cells: NDArray[np.int64]) -> Cells:
        """The arrays of some cells of a window; a copy."""
        if not len(self._stack):
            return {name: array.ravel()[cells] for name, array in self._cut(window).items()}
        inner_rows = cells // max(window.cols, 1)
        inner_cols = cells - inner_rows * window.cols
        flat = (inner_rows + window.row0) * self._stack.shape[2] + inner_cols + window.col0
        some = np.take(self._stack.reshape(len(self._stack), -1), flat, axis=1)
        return dict(zip(self._arrays, some, strict=True))

    def _now(
        self, window: Window, previous: NDArray[np.float32], sums: Sums | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Probability and values of a window; of sums only those of the cells that they name."""
        if sums is None or not self._values_are_probabilities or self._forgetting is not None:
            cells = self._cut(window)
            probability = self.rule.probability(cells, self._largest).astype(np.float32)
            if self._values_are_probabilities:
                return probability, probability
            return probability, self.rule.values(cells).astype(np.float32)
        probability = previous.copy()
        probability.ravel()[sums.cells] = self.rule.probability({**sums.after}, self._largest)
        return probability, probability

    def merge_many(self, kernel: Kernel) -> None:
        """Let a kernel add readings to the whole map; what each of them changes is not looked at.

        The map is the one that :meth:`merge` with the same kernel comes to, reading by reading.
        """
        array = self._stack if self._steps is None else self._steps
        kernel(Target(array, self._observed, self._place(0, 0)))
        self._stale = True

    def merge_unseen(self, temp: TempGrid) -> None:
        """What :meth:`merge` does without a kernel, where nobody wants to see what it changed."""
        if self._forgetting is None and type(self.rule) in _CHANGE_WHAT_IS_EVIDENT:
            self._merge_cells(temp)
            self._stale = True
        else:
            self.merge(temp)

    def _change(self, window: Window, kernel: Kernel) -> None:
        """Let a kernel change a window: on a copy of it, as it wants whole rows."""
        from mapping.kernels.batch import steps

        observed = self._observed[window.slices].copy()
        place, columns = self._place(window.row0, window.col0), np.s_[..., : window.cols]
        stack: NDArray[Any]
        if self._steps is None:
            stack = blank_stack(len(self._stack), window.rows, window.cols)
        else:
            stack = steps.blank(window.rows, window.cols)
        whole: NDArray[Any] = self._stack if self._steps is None else self._steps
        old, cells = whole[..., *window.slices], stack[columns]
        cells[...] = old
        kernel(Target(stack, observed, place))
        old[...] = cells
        self._observed[window.slices] = observed

    def _merge_cells(self, temp: TempGrid) -> None:
        """Merge what a temp grid holds, cell by cell."""
        parts = temp.sub_grids if self.rule.per_sample and temp.sub_grids else (temp,)
        for part in parts:
            window = part.window
            if self._steps is None:
                self.rule.merge(self._cut(window), part)
            elif not window.empty:
                from mapping.kernels.loops import add_log_odds

                add_log_odds(self._steps, window.row0, window.col0, part.probability)
            self._observed[window.slices] |= part.band | (part.probability != 0.5)

    def _place(self, row0: int, col0: int) -> Place:
        from mapping.kernels.batch.readings import place_of

        return place_of(self.geometry.origin_m, self.geometry.resolution_m, row0, col0)

    def _look_again(self) -> None:
        self._stale = False
        if self.rule.against_largest:
            self._largest = float(self.rule.values(self.cells).max(initial=0.0))
        self._probability = self._worked_out(self._probability_of)

    def _probability_of(self, cells: Cells) -> Floats:
        return self.rule.probability(cells, self._largest)

    def _worked_out(self, function: Callable[[Cells], Floats]) -> NDArray[np.float32]:
        """A function of each cell, for all cells: some rows at a time, for memory's sake."""
        rows, cols = self.geometry.shape
        found, some = np.empty((rows, cols), np.float32), max(_AT_ONCE // max(cols, 1), 1)
        for row in range(0, rows, some):
            window = Window(row, 0, min(some, rows - row), cols)
            cells = self._cut(window)
            if self._forgetting is not None:
                cells = self._forgetting.faded(cells, window)
            found[window.slices] = function(cells)
        return found

    def layer(self, name: str) -> Layer:
        """The whole map as it stands; a copy, read-only."""
        if self._stale or self._forgetting is not None:
            self._look_again()
        probability = self._worked_out(self._probability_of)
        values = probability
        if not self._values_are_probabilities:
            values = self._worked_out(self.rule.values)
        extra = {key: _exported(array) for key, array in self.rule.extra(self.cells).items()}
        if not unit_gives_probability(self.rule):
            extra["probability"] = probability
        observed = self._observed.copy()
        if self._has_terms:  # sums may leave a cell undecided, as if it had not been seen
            observed &= probability != 0.5
        for array in (values, probability, observed):
            read_only(array)
        return Layer(
            name=name, kind=self.rule.kind, geometry=self.geometry, values=values,
            probability=probability, observed=observed, extra=extra,
        )  # fmt: skip

    def _cut(self, window: Window) -> Cells:
        if self._steps is not None:
            log_odds: Floats = self._steps[window.slices] * STEP
            return {"log_odds": log_odds}
        return {name: array[window.slices] for name, array in self._arrays.items()}

    def _largest_in(self, window: Window) -> float:
        if not self.rule.against_largest:
            return 0.0
        return float(self.rule.values(self._cut(window)).max(initial=0.0))

    def _follow_largest(self, window: Window, before: float) -> None:
        """Keep the largest value of the whole map, looking at all of it only when it may sink."""
        if not self.rule.against_largest:
            return
        now = self._largest_in(window)
        if now >= self._largest:
            self._largest = now
        elif before >= self._largest:
            self._largest = float(self.rule.values(self.cells).max(initial=0.0))


def blank_stack(arrays: int, rows: int, cols: int) -> Floats:
    """Zeros (arrays, rows, a multiple of 16)."""
    return np.zeros((arrays, rows, -(-cols // LANES) * LANES))


def _exported(array: Floats) -> NDArray[np.float32]:
    copy = array.astype(np.float32)
    read_only(copy)
    return copy


def start(
    rule: str,
    geometry: GridGeometry,
    parameters: Mapping[str, Any] | None = None,
    *,
    forget_s: float | None = None,
) -> MapState:
    """An empty map for an update rule; BadInput where there is no rule of that name.

    The rule finds the values of its own keys among ``parameters``. In ``forget_s`` evidence halves;
    such a map takes readings one by one, in the order of time, and without a kernel.
    """
    known = choose(UPDATE_RULES, rule, "update rule")
    return MapState(known.with_parameters(parameters or {}), geometry, forget_s)
