"""The picture of a layer that goes with its exported files: titled, with axes and a scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mapping.artifacts import Segment
from mapping.grid import Layer
from replay.pictures.parts import Floats
from replay.pictures.views import Overlaid, view_of_grid
from replay.pictures.writing import page_of


def layer_picture(layer: Layer, rule: str, segments: Sequence[Segment], path_m: Floats) -> bytes:
    """A PNG of the map at the end, with the lines found in it and the path (N, 2), metres."""
    from replay.pictures.drawing.pages import page_bytes

    ends = np.array([(s.start_m, s.end_m) for s in segments], np.float64).reshape(-1, 2, 2)
    view = view_of_grid(
        layer.geometry, layer.probability, layer.observed, Overlaid(ends, path_m=path_m), file="",
        layer=layer.name, when="at the end", rule=rule,
    )  # fmt: skip
    return page_bytes(page_of([view]), "png")
