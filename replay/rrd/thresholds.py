"""Several thresholds side by side: what is occupied above each, and its borders.

At 0.51 one weak hit makes a cell black; at 0.60 thin walls break. The three are drawn at every
snapshot, each in a place of its own, so that they stand beside each other in a tab.
"""

from __future__ import annotations

import numpy as np

from mapping.artifacts import Artifact, Snapshot, Started
from mapping.borders import threshold_layer, trace_borders
from mapping.config import BordersSection
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas
from replay.tables import markdown_table


class ThresholdsOverlay:
    """Draws every snapshot at several thresholds; the tracer is the configuration's."""

    def __init__(self, section: BordersSection) -> None:
        self._thresholds, self._tracer = section.compare, section.tracer

    def start(self, canvas: Canvas, started: Started) -> None:
        """Nothing is known yet."""

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """The cells and borders of a snapshot at each threshold, and how many there are."""
        if not isinstance(artifact, Snapshot) or not self._thresholds:
            return ""
        rows = [self._draw_one(canvas, artifact, threshold) for threshold in self._thresholds]
        table = markdown_table([("threshold", "cells", "borders"), *rows])
        return f"Above each threshold:\n\n{table}"

    def _draw_one(self, canvas: Canvas, snapshot: Snapshot, threshold: float) -> tuple[str, ...]:
        layer = snapshot.layer
        root = layout.compared(layer.name, threshold)
        canvas.prepare(
            root, scene.set_up_two_classes, "at most the threshold", f"above {threshold:g}"
        )
        occupied = threshold_layer(layer, threshold).occupied
        canvas.draw_classes(root, occupied.astype(np.uint8), layout.ORDER_CLASSES)
        borders = trace_borders(occupied, tracer=self._tracer)
        strips = [
            layer.geometry.centres_of(np.vstack([border.cells, border.cells[:1]]))
            for border in borders
        ]
        entity = f"{root}/borders"
        canvas.prepare(entity, scene.set_up_borders)
        canvas.add(entity, columns.strips, strips, sum(strip.nbytes for strip in strips))
        return f"{threshold:g}", f"{int(occupied.sum()):,}", f"{len(borders):,}"
