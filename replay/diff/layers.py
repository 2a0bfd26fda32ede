"""What a map is to a comparison, wherever it comes from: layers with values, classes and lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment
from mapping.grid import GridGeometry, start_of
from mapping.update_rules.rules import HIMM_MOST

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

    ``classes`` hold UNKNOWN, FREE or OCCUPIED. A map that knows nothing else has its values empty,
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
    extra: Mapping[str, Values] = field(default_factory=dict)
    beam_width_rad: float | None = None


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


def probability_of(
    kind: str, values: Values, extra: Mapping[str, Values] | None = None
) -> NDArray[np.float64]:
    """Values (rows, cols) in the unit ``kind`` as probabilities; shares of the largest for counts.

    The same as the update rules' own, from what a file holds: masses need the arrays ``occupied``
    and ``unknown``, and are their occupied part without.
    """
    v = np.asarray(values, np.float64)
    match kind:
        case "odds":
            with np.errstate(invalid="ignore"):
                return np.where(np.isinf(v), 1.0, v / (1.0 + v))
        case "count" | "sum":
            largest = float(np.nanmax(v, initial=0.0))
            return np.clip(v / largest, 0.0, 1.0) if largest > 0.0 else np.zeros_like(v)
        case "certainty":
            return v / HIMM_MOST
        case "mass" if extra and {"occupied", "unknown"} <= set(extra):
            pignistic: NDArray[np.float64] = (
                np.asarray(extra["occupied"], np.float64)
                + np.asarray(extra["unknown"], np.float64) / 2.0
            )
            return pignistic
        case _:
            return v


def never_seen(
    kind: str, values: Values, extra: Mapping[str, Values] | None = None
) -> NDArray[np.bool_]:
    """Cells that hold what they began with (or no number): as good as never seen."""
    v = np.asarray(values)
    if kind == "mass" and extra and "unknown" in extra:
        untouched: NDArray[np.bool_] = (np.asarray(extra["unknown"]) == 1.0) | ~np.isfinite(v)
        return untouched
    same: NDArray[np.bool_] = (v == v.dtype.type(start_of(kind))) | np.isnan(v)
    return same


def classes_of(kind: str, values: Values, extra: Mapping[str, Values] | None = None) -> Codes:
    """UNKNOWN, FREE (probability below 0.45) or OCCUPIED (above 0.55) for each cell."""
    probability = probability_of(kind, values, extra)
    codes = np.zeros(probability.shape, np.uint8)
    codes[probability < np.float32(FREE_BELOW)] = FREE
    codes[probability > np.float32(OCCUPIED_ABOVE)] = OCCUPIED
    codes[never_seen(kind, values, extra)] = UNKNOWN
    return codes


def value_layer(
    name: str,
    kind: str,
    geometry: GridGeometry,
    values: Values,
    *,
    extra: Mapping[str, Values] | None = None,
    lines: tuple[Line, ...] | None = None,
    borders: tuple[Outline, ...] | None = None,
    beam_width_rad: float | None = None,
) -> MapLayer:
    """A layer of values (rows, cols) in the unit ``kind``, with its classes."""
    return MapLayer(
        name, kind, geometry, values, classes_of(kind, values, extra), start_of(kind), lines,
        borders, extra=extra or {}, beam_width_rad=beam_width_rad,
    )  # fmt: skip


def line_of(segment: Segment) -> Line:
    """What a comparison needs of a segment."""
    return Line(segment.source, segment.start_m, segment.end_m)


def outline_of(border: Border) -> Outline:
    """What a comparison needs of a border."""
    return Outline(border.outer, border.geometry.centres_of(border.cells))
