"""What every update rule must keep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import TempGrid
from mapping.laws.made_readings import (
    GRID,
    READINGS,
    Draw,
    one_spot_readings,
    random_beam,
    random_reading,
    random_sensor,
)
from mapping.sensor_model import SENSOR_MODELS
from mapping.sensor_model.cells import rasterise_cells
from mapping.update_rules import MapState, UpdateRule
from mapping.update_rules.axis import axis_cells

Floats = NDArray[np.float64]

SAME_SPOT = 100_000
"""How many readings of one spot neither break a rule nor leave a cell stuck."""
CONTRARY = 100
"""After so many readings of the opposite, a cell must have moved."""
ROUNDING = 1e-9
ORDER_TOLERANCE = 1e-5


def _cells(rule: UpdateRule, shape: tuple[int, int] = GRID.shape) -> dict[str, Floats]:
    return {name: np.full(shape, value) for name, value in rule.start.items()}


def stays_finite(rule: UpdateRule, draw: Draw) -> str | None:
    """Values stay finite and probabilities within 0 and 1, whatever is read."""
    state = MapState(rule, GRID)
    for _ in range(READINGS):
        state.merge(random_reading(draw, echo=bool(draw.random() < 0.8)))
        layer = state.layer("made")
        if not np.isfinite(layer.values).all():
            return "a value is not a finite number"
        if not ((layer.probability >= 0.0) & (layer.probability <= 1.0)).all():
            low, high = layer.probability.min(), layer.probability.max()
            return f"probabilities run from {low:g} to {high:g}"
    return None


def no_evidence_no_change(rule: UpdateRule, draw: Draw) -> str | None:
    """A reading without evidence for any cell changes nothing."""
    state = MapState(rule, GRID)
    for _ in range(3):
        state.merge(random_reading(draw))
    before = state.layer("made").values
    sensor = replace(random_sensor(draw), no_echo="skipped")
    silent = random_beam(draw, sensor, echo=False)
    state.merge(rasterise_cells(silent, sensor, SENSOR_MODELS["peak"], GRID))
    changed = int((state.layer("made").values != before).sum())
    return f"{changed} cells changed" if changed else None


def changes_only_what_was_covered(rule: UpdateRule, draw: Draw) -> str | None:
    """Only cells that the beam covered, or that lie on its axis, change their value."""
    state = MapState(rule, GRID)
    for _ in range(READINGS):
        before = state.layer("made").values
        temp = random_reading(draw)
        passed, hit = axis_cells(temp)
        covered = np.zeros(GRID.shape, np.bool_)
        covered[temp.window.slices] = temp.band | temp.free | passed | hit
        state.merge(temp)
        outside = (state.layer("made").values != before) & ~covered
        if outside.any():
            row, col = (int(v) for v in np.argwhere(outside)[0])
            return f"{int(outside.sum())} cells beside the beam changed, such as [{row}, {col}]"
    return None


def evidence_counts_its_own_way(rule: UpdateRule, draw: Draw) -> str | None:
    """Evidence for occupied does not lower the probability, for empty does not raise it."""
    cells = _cells(rule)
    most = 10.0 * READINGS  # a share of the largest needs one that stays the same
    passed_before = np.zeros(GRID.shape, np.bool_)
    for _ in range(READINGS):
        temp = random_reading(draw)
        here = {name: array[temp.window.slices] for name, array in cells.items()}
        before = rule.probability(here, most).copy()
        rule.merge(here, temp)
        rise = rule.probability(here, most) - before
        passed, hit = axis_cells(temp)
        sunk = temp.band & (temp.probability > 0.5) & (rise < -ROUNDING)
        if rule.along_axis:  # which runs into the band a little
            sunk &= ~passed
        # The centre of the obstacle's own cell may lie in front of the band: no evidence.
        free = temp.free & ~hit
        risen = free & (temp.probability < 0.5) & (rise > ROUNDING)
        if rule.needs_a_view:
            risen &= passed_before[temp.window.slices]
        passed_before[temp.window.slices] |= temp.free
        for wrong, wanted in ((sunk, "occupied: the probability sank"), (risen, "empty: it rose")):
            if wrong.any():
                row, col = np.argwhere(wrong)[0]
                p, by = temp.probability[row, col], rise[row, col]
                return f"a reading of {p:.3g} said {wanted} by {abs(by):.3g}"
    return None


def order_does_not_matter(rule: UpdateRule, draw: Draw) -> str | None:
    """The same readings in another order give the same map, unless ``order_matters``."""
    if rule.order_matters:
        return None
    temps = [random_reading(draw) for _ in range(READINGS)]
    # Certain readings run into the clamp, where the order does show.
    temps = [_weakened(temp) for temp in temps]
    first, second = MapState(rule, GRID), MapState(rule, GRID)
    for temp in temps:
        first.merge(temp)
    for k in draw.permutation(len(temps)):
        second.merge(temps[k])
    gap = np.abs(first.layer("made").probability - second.layer("made").probability).max()
    if gap > ORDER_TOLERANCE:
        return f"probabilities differ by {gap:.3g} (set order_matters = True if that is meant)"
    return None


def _weakened(temp: TempGrid) -> TempGrid:
    probability = np.clip(temp.probability, 0.3, 0.7)
    probability.flags.writeable = False
    return replace(temp, probability=probability)


def survives_one_spot(rule: UpdateRule, draw: Draw) -> str | None:
    """100,000 readings of one spot give no NaN, and the opposite can still move the cell.

    A rule that never listens to the opposite (a count of hits) is not stuck: it is deaf to it.
    """
    far, near = one_spot_readings()
    for often, then, state in ((far, near, "occupied"), (near, far, "empty")):
        cell = (often.window.rows // 2, _spot_column(often))
        cells = _cells(rule, often.probability.shape)
        rule.merge(cells, often)
        deaf = not _moves(rule, {k: v.copy() for k, v in cells.items()}, then, cell, 1)
        for _ in range(SAME_SPOT - 1):
            rule.merge(cells, often)
        value = rule.values(cells)[cell]
        if not np.isfinite(value):
            return f"{SAME_SPOT:,} readings that said {state} left {value}"
        if not deaf and not _moves(rule, cells, then, cell, CONTRARY):
            return f"{SAME_SPOT:,} readings that said {state} left a cell stuck at {value:g}"
    return None


def _spot_column(temp: TempGrid) -> int:
    return int(temp.probability.shape[1]) - 1


def _moves(
    rule: UpdateRule, cells: dict[str, Floats], temp: TempGrid, cell: tuple[int, int], times: int
) -> bool:
    before = float(rule.values(cells)[cell])
    for _ in range(times):
        rule.merge(cells, temp)
    after = float(rule.values(cells)[cell])
    return bool(np.isfinite(after)) and after != before


def keeps_to_itself(rule: UpdateRule, draw: Draw) -> str | None:
    """Two maps of one rule share nothing, and the same readings give the same map again."""
    first, second, untouched = (MapState(rule, GRID) for _ in range(3))
    empty = untouched.layer("made").values
    for _ in range(4):
        temp = random_reading(draw)
        first.merge(temp)
        second.merge(temp)
    if not np.array_equal(first.layer("made").values, second.layer("made").values):
        return "the same readings gave two different maps"
    if not np.array_equal(untouched.layer("made").values, empty):
        return "a map changed while readings went into another one"
    return None


RuleLaw = Callable[[UpdateRule, Draw], "str | None"]
RULE_LAWS: dict[str, RuleLaw] = {
    "values stay finite, probabilities within 0 and 1": stays_finite,
    "a reading that says nothing changes nothing": no_evidence_no_change,
    "only covered cells change": changes_only_what_was_covered,
    "evidence counts its own way": evidence_counts_its_own_way,
    "the order of readings does not matter": order_does_not_matter,
    "100,000 readings of one spot": survives_one_spot,
    "a map keeps to itself": keeps_to_itself,
}
