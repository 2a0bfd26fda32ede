"""The score of a layer: its cells, and its lines by where they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from mapping.scoring.cells import CellScore, score_cells
from mapping.scoring.lines import LineScore, score_lines
from mapping.scoring.truth import Floats, Truth


@dataclass(frozen=True, slots=True)
class LayerScore:
    """How right one layer is; no lines where the source holds none."""

    layer: str
    cells: CellScore
    lines: tuple[LineScore, ...]

    def lines_of(self, source: str) -> LineScore | None:
        """The score of the lines from the ``grid`` or from ``raw`` points."""
        return next((each for each in self.lines if each.source == source), None)


def score_layer(
    name: str,
    probability: NDArray[np.floating],
    geometry: GridGeometry,
    lines_m: Mapping[str, Floats],
    truth: Truth,
    seen: NDArray[np.bool_],
) -> LayerScore:
    """Judge a layer (rows, cols) and its lines (L, 2, 2) by source, where it could be ``seen``."""
    return LayerScore(
        name,
        score_cells(probability, geometry, truth, seen),
        tuple(
            score_lines(source, ends, geometry, truth, seen) for source, ends in lines_m.items()
        ),
    )  # fmt: skip
