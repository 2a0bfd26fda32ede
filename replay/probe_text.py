"""Why a cell is as it is, as text: a line a reading, in Markdown, and for the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mapping.fusion import FUSED
from mapping.probing import BEHIND, BESIDE, EMPTY, OBSTACLE, CellProbe, Touch
from replay.tables import markdown_table, text_table

STRONGEST = 8  # readings in a table
_HEAD = ("reading", "sensor", "range", "zone", "before", "after", "effect")
_TEXTS, _NUMBERS = (1, 3, 7, 8), (0, 2, 4, 5, 6)  # columns
_SUMS = 3  # that a reading moved most, of a rule of several

_PLACES = {
    OBSTACLE: "where the obstacle may be",
    EMPTY: "in the empty part before the obstacle",
    BEHIND: "behind the obstacle, so the reading is no evidence for it",
    BESIDE: "beside the beam, which changed it all the same",
}
_COUNTED = {
    OBSTACLE: "found it occupied",
    EMPTY: "found it free",
    BEHIND: "stopped before it",
    BESIDE: "passed beside it",
}
# Lowest probability of each shade, from black down.
_SHADES = ((0.8, "black"), (0.55, "dark grey"), (0.45, "grey"), (0.2, "light grey"), (0.0, "white"))


def shade_name(probe: CellProbe, layer: str) -> str:
    """The colour in which a layer's map shows the cell."""
    if layer not in probe.observed:
        return "blue-grey (never seen)"
    belief = probe.beliefs[layer]
    return next(shade for lowest, shade in _SHADES if belief >= lowest or lowest == 0.0)


def name_of(probe: CellProbe) -> str:
    """``(1.24, 0.51) m``: the point that was asked for."""
    x, y = probe.at_m
    return f"({x:g}, {y:g}) m"


def touch_text(touch: Touch) -> str:
    """One reading and its effect in one sentence."""
    model = f" (its model {touch.model})" if touch.model else ""
    head = (
        f"reading {touch.reading}, {touch.sensor} measured {_range(touch)}{model}: the cell, "
        f"{touch.distance_m:.3f} m away, lies {_PLACES[touch.zone]}"
    )
    if touch.zone == BEHIND:
        return head
    if touch.effect == 0:
        return f"{head}; it stays at {percent(touch.after)}"
    by = f", by {moved_by(touch.moved_by)}" if touch.moved_by else ""
    return f"{head}; {percent(touch.before)} → {percent(touch.after)}{by}"


def explanation(probe: CellProbe, layers: tuple[str, ...]) -> str:
    """Markdown: what the layers hold of the cell so far, and which readings moved it most."""
    row, col = probe.cell
    lines = [f"## Why is this cell so?\n\nThe cell at {name_of(probe)}: row {row}, column {col}.\n"]
    lines += [f"- **{layer}**: {_state(probe, layer)}" for layer in layers]
    if any(touch.effect for touch in probe.touches):
        strongest = probe.strongest(STRONGEST)
        lines.append(f"\n{_most(strongest, len(probe.touches))}, so far:\n")
        lines.append(markdown_table(_rows(strongest), right=_NUMBERS))
        lines.append("\nEffects are in points of per cent.")
    return "\n".join(lines)


def explanation_lines(probe: CellProbe, layers: tuple[str, ...]) -> list[str]:
    """The same for the terminal: a line a layer, each with its table."""
    row, col = probe.cell
    shown = layers[-1]  # the fused one, where there is one
    lines = [
        f"why is the cell at {name_of(probe)} (row {row}, column {col}) {shade_name(probe, shown)}?"
    ]
    for layer in layers:
        lines.append(f"{layer}: {_state(probe, layer)}")
        strongest = [touch for touch in probe.strongest(STRONGEST, layer) if touch.effect]
        if strongest:
            lines.append(f"  {_most(strongest, sum(probe.counts(layer).values()))}:")
            lines += [f"  {line}" for line in text_table(_rows(strongest), left=_TEXTS)]
    return lines


def percent(share: float) -> str:
    """``0.558`` → ``55.8 %``; a belief without any reading yet is a dash."""
    return "–" if math.isnan(share) else f"{100 * share:.1f} %"


def _state(probe: CellProbe, layer: str) -> str:
    """What a layer holds of the cell, and how many readings made it so."""
    counts = probe.counts(layer)
    total = sum(counts.values())
    if total == 0 and layer in probe.observed:
        return f"{percent(probe.beliefs[layer])} occupied: {shade_name(probe, layer)}"
    if total == 0:
        not_yet = layer == FUSED and layer not in probe.beliefs
        return "not made yet" if not_yet else "no reading reached it"
    zones = ", ".join(f"{count} {_COUNTED[zone]}" for zone, count in counts.items() if count)
    state = shade_name(probe, layer)
    if layer in probe.observed:
        state = f"{percent(probe.beliefs[layer])} occupied: {state}"
    return f"{state}. {total} reading{'s' * (total != 1)} reached it: {zones}"


def _most(shown: list[Touch], total: int) -> str:
    """Which of all readings a table shows."""
    if len(shown) == total:
        return "all of them, the strongest first" if total > 1 else "it"
    return f"the {len(shown)} that moved it most, of {total}"


def moved_by(changes: Sequence[tuple[str, float]]) -> str:
    """``misses near -0.87, misses -0.12``: the sums that changed most, in log-odds."""
    return ", ".join(f"{name} {change:+.2f}" for name, change in changes[:_SUMS])


def _range(touch: Touch) -> str:
    return f"{touch.range_m:.3f} m" if math.isfinite(touch.range_m) else "nothing"


def _rows(touches: list[Touch]) -> list[tuple[str, ...]]:
    by_sums = any(touch.moved_by for touch in touches)
    by_range = any(touch.model for touch in touches)
    rows = [
        (
            str(touch.reading), touch.sensor, _range(touch), touch.zone, percent(touch.before),
            percent(touch.after), f"{100 * touch.effect:+.1f}",
            *([moved_by(touch.moved_by)] * by_sums), *([touch.model] * by_range),
        )
        for touch in touches
    ]  # fmt: skip
    titles = [*(["by, in log-odds"] * by_sums), *(["model"] * by_range)]
    return [(*_HEAD, *titles), *rows]
