"""What a map is to a comparison, wherever it comes from: layers with values, classes and lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment
from mapping.grid import GridGeometry
from mapping.update_rules import rule_of

Values = NDArray[np.floating]
Codes = NDArray[np.uint8]

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
CLASS_NAMES = ("unknown", "free", "occupied")
OCCUPIED_ABOVE, FREE_BELOW = 0.55, 0.45


@dataclass(frozen=True, slots=True)
class Line:
    """A straight piece of wall between two ends, metres, map frame; ``source``: raw or grid."""

    source: str
    start_m: tuple[float, float]
    end_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Outline:
    """A closed border: the centres of its cells (N, 2) in metres, map frame, in trace order."""

    outer: bool
    points_m: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MapLayer:
    """One layer of a map. Arrays are (rows, cols); ``start`` is what an unseen cell holds.

    ``classes`` hold UNKNOWN, FREE or OCCUPIED; ``rule`` is empty where the source does not tell it.
    A map that knows nothing else has its values empty,
    and ``reclass`` brings another layer to the classes as such a file would have written them.
    ``beam_width_rad`` is that of the layer's sensor, where the source holds it.
    Lines and borders are None where the source does not hold them.
    """

    name: str
    kind: str
    geometry: GridGeometry
    values: Values | None
    classes: Codes
    start: float
    lines: tuple[Line, ...] | None = None
    borders: tuple[Outline, ...] | None = None
    reclass: Callable[[MapLayer], Codes] | None = None
    rule: str = ""
    extra: Mapping[str, Values] = field(default_factory=dict)
    beam_width_rad: float | None = None

    @property
    def probability(self) -> NDArray[np.float64]:
        """The values as probabilities, by the rule that has their unit.

        A map of a rule that is not built in brings them itself, as the array ``probability``.
        """
        values, extra = self.exact_values()
        if "probability" in extra:
            return extra["probability"]
        largest = float(np.nanmax(values, initial=0.0))
        return rule_of(self.kind, self.rule).probability_of_values(values, largest, extra)

    def exact_values(self) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]:
        """Values and further arrays as rules take them; a map of classes has none."""
        assert self.values is not None
        extra = {name: np.asarray(array, np.float64) for name, array in self.extra.items()}
        return np.asarray(self.values, np.float64), extra


@dataclass(frozen=True, slots=True)
class Moment:
    """One step of a recording: its number, the reading that it belongs to, and what came then."""

    step: int
    reading: int
    artifact: str


class History(Protocol):
    """What a recording knows beyond its last map."""

    def last_written(self, layer: str, row: int, col: int) -> Moment | None:
        """The step at which a cell took the value that it ends with."""

    def grids(self, layer: str) -> Iterator[tuple[Moment, Values]]:
        """The layer at each step at which its exact values are known, in order."""


@dataclass(frozen=True, slots=True)
class Source:
    """Everything that one side of a comparison brings.

    ``what`` is its kind for people; ``single`` that it is a file of one layer;
    ``config_toml`` the configuration that made it, where it is known; ``notes`` for people.
    """

    path: Path
    what: str
    layers: Mapping[str, MapLayer]
    single: bool = False
    config_toml: str = ""
    notes: tuple[str, ...] = ()
    damaged: bool = False
    history: History | None = None


def never_seen(layer: MapLayer) -> NDArray[np.bool_]:
    """Cells that hold what they began with (or no number): as good as never seen."""
    if layer.values is None:
        return np.equal(layer.classes, UNKNOWN)
    values, extra = layer.exact_values()
    return rule_of(layer.kind, layer.rule).untouched(values, extra, layer.start)


def classes_of(layer: MapLayer) -> Codes:
    """UNKNOWN, FREE (probability below 0.45) or OCCUPIED (above 0.55) for each cell."""
    probability = layer.probability
    codes = np.zeros(probability.shape, np.uint8)
    codes[probability < np.float32(FREE_BELOW)] = FREE
    codes[probability > np.float32(OCCUPIED_ABOVE)] = OCCUPIED
    codes[never_seen(layer)] = UNKNOWN
    return codes


def value_layer(
    name: str,
    kind: str,
    geometry: GridGeometry,
    values: Values,
    *,
    rule: str = "",
    start: float | None = None,
    extra: Mapping[str, Values] | None = None,
    lines: tuple[Line, ...] | None = None,
    borders: tuple[Outline, ...] | None = None,
    beam_width_rad: float | None = None,
) -> MapLayer:
    """A layer of values (rows, cols) in the unit ``kind``, with its classes.

    ``rule`` and ``start`` are the rule's name and what a cell began with, where the source tells.
    """
    start = rule_of(kind, rule).start_value if start is None else start
    layer = MapLayer(
        name, kind, geometry, values, np.zeros(values.shape, np.uint8), start, lines, borders,
        rule=rule, extra=extra or {}, beam_width_rad=beam_width_rad,
    )  # fmt: skip
    return replace(layer, classes=classes_of(layer))


def line_of(segment: Segment) -> Line:
    """What a comparison needs of a segment."""
    return Line(segment.source, segment.start_m, segment.end_m)


def outline_of(border: Border) -> Outline:
    """What a comparison needs of a border."""
    return Outline(border.outer, border.geometry.centres_of(border.cells))
