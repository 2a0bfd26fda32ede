"""How the finished maps of a comparison differ: a row of numbers for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment, Snapshot
from mapping.fusion import FUSED
from mapping.grid import GridGeometry, Layer
from mapping.update_rules import UPDATE_RULES

NEVER_SEEN, FREE, UNDECIDED, OCCUPIED = range(4)
_REFERENCE = "bayes"  # the rule that the others are held against, where it takes part


@dataclass(frozen=True, slots=True)
class MapRow:
    """One finished layer: its cells by what they are taken for, and how far it is from one of all.

    ``differs`` is the share of the cells seen in either map that the two take for different
    things; None for the map that the others are held against, NaN where nothing was seen.
    """

    name: str
    layer: str
    rule: str
    occupied: int
    free: int
    undecided: int
    differs: float | None


def map_rows(
    snapshots: Mapping[str, Sequence[Snapshot]], layer: str, thresholds: Mapping[str, float]
) -> list[MapRow]:
    """A row for each map that has the layer, in their order.

    ``thresholds`` are the probabilities above which a cell counts as occupied, by map; as far
    below 0.5 it counts as free. The others are held against the map of the rule ``bayes``, or
    against the first where no map is called so.
    """
    rules: dict[str, str] = {}
    found: dict[str, tuple[GridGeometry, NDArray[np.uint8]]] = {}
    for name, some in snapshots.items():
        for snapshot in some:
            if snapshot.layer.name == layer:
                states = states_of(snapshot.layer, thresholds[name])
                found[name] = (snapshot.layer.geometry, states)
                rules[name] = _rules(some, snapshot)
    against = _REFERENCE if rules.get(_REFERENCE) == _REFERENCE else next(iter(found), "")
    rows = []
    for name, here in found.items():
        count = np.bincount(here[1].ravel(), minlength=4)
        differs = None if name == against else _differing(found[against], here)
        rows.append(MapRow(
            name, layer, rules[name], int(count[OCCUPIED]), int(count[FREE]),
            int(count[UNDECIDED]), differs,
        ))  # fmt: skip
    return rows


def _rules(all_of_it: Sequence[Snapshot], snapshot: Snapshot) -> str:
    """The update rule of a layer; of the fused one, the rules of the layers that it is made of."""
    if snapshot.layer.name != FUSED:
        return snapshot.rule
    return ", ".join(dict.fromkeys(s.rule for s in all_of_it if s.layer.name != FUSED))


def states_of(layer: Layer, threshold: float) -> NDArray[np.uint8]:
    """What each cell is taken for, (rows, cols): never seen, free, undecided or occupied."""
    p = layer.probability
    states = np.where(p > threshold, OCCUPIED, np.where(p < 1.0 - threshold, FREE, UNDECIDED))
    return np.where(layer.observed, states, NEVER_SEEN).astype(np.uint8)


def _differing(
    first: tuple[GridGeometry, NDArray[np.uint8]], other: tuple[GridGeometry, NDArray[np.uint8]]
) -> float:
    """Compared at the centres of the first map's cells: the grids may lie differently."""
    geometry, states = first
    rows, cols = np.indices(geometry.shape)
    centres_m = geometry.centres_of(np.stack([rows.ravel(), cols.ravel()], axis=1))
    there, found = other
    cells = there.cells_of(centres_m)
    inside = there.contains(cells)
    theirs = np.full(len(cells), NEVER_SEEN, np.uint8)
    theirs[inside] = found[cells[inside, 0], cells[inside, 1]]
    ours = states.ravel()
    seen = (ours != NEVER_SEEN) | (theirs != NEVER_SEEN)
    return float((ours != theirs)[seen].mean()) if seen.any() else float("nan")


def shown_layer(snapshots: Mapping[str, Sequence[Snapshot]]) -> str:
    """The layer that stands for all: the last one that every map has (the fused one, if any)."""
    named = [[snapshot.layer.name for snapshot in some] for some in snapshots.values()]
    common = [name for name in named[0] if all(name in others for others in named[1:])]
    return (common or named[0])[-1]


def table_of(rows: Sequence[MapRow]) -> list[tuple[str, ...]]:
    """The same as rows of text, the head first; the rule is left out where it adds nothing."""
    table: list[tuple[str, ...]]
    against = next(row.name for row in rows if row.differs is None)
    table = [("map", "rule", "occupied", "free", "undecided", f"differs from {against}")]
    for row in rows:
        differs = "" if row.differs is None else f"{100 * row.differs:.1f} %"
        counts = (f"{count:,}" for count in (row.occupied, row.free, row.undecided))
        table.append((row.name, row.rule, *counts, differs))
    named_so = all(row.rule == row.name for row in rows)
    if named_so or len({row.rule for row in rows}) == 1:
        return [(line[0], *line[2:]) for line in table]
    return table


def footnotes(rows: Sequence[MapRow]) -> list[str]:
    """What must be known to read the table: which maps hold no evidence for free cells."""
    used = {rule for row in rows for rule in row.rule.split(", ")}
    some = [rule.name for rule in UPDATE_RULES.values() if rule.never_free and rule.name in used]
    if not some:
        return []
    verb = "know" if len(some) > 1 else "knows"
    return [f"{_listed(some)} {verb} no emptiness below zero: free means hardly or never hit"]


def same_maps(
    snapshots: Mapping[str, Sequence[Snapshot]],
    segments: Mapping[str, Sequence[Segment]],
    thresholds: Mapping[str, float],
) -> list[str]:
    """A sentence for each group of maps that came out the same in every cell and every line."""
    groups: list[list[str]] = []
    for name in snapshots:
        for group in groups:
            first = group[0]
            if (
                thresholds[first] == thresholds[name]
                and _same_cells(snapshots[first], snapshots[name])
                and _ends(segments[first]) == _ends(segments[name])
            ):
                group.append(name)
                break
        else:
            groups.append([name])
    return [
        f"{_listed(group)} are the same map: what was varied changed nothing"
        for group in groups if len(group) > 1
    ]  # fmt: skip


def _same_cells(one: Sequence[Snapshot], other: Sequence[Snapshot]) -> bool:
    if len(one) != len(other):
        return False
    pairs = [(a.layer, b.layer) for a, b in zip(one, other, strict=True)]
    return all(
        (a.name, a.kind, a.geometry) == (b.name, b.kind, b.geometry)
        and np.array_equal(a.values, b.values, equal_nan=True)
        and np.array_equal(a.observed, b.observed)
        for a, b in pairs
    )


def _ends(segments: Sequence[Segment]) -> list[tuple[object, ...]]:
    return [(s.layer, s.source, s.start_m, s.end_m) for s in segments]


def _listed(names: Sequence[str]) -> str:
    """``a, b and c``."""
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)
