"""How the later stages look: whole maps, thresholds, classes, borders, points and segments."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Border, Classes, RawPoints, Segment, Snapshot, Thresholded
from replay.rrd import columns, layout, scene
from replay.rrd.canvas import Canvas


class Results:
    """Draws results on a canvas; borders and segments gather until their stage starts anew."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._gathered: dict[str, list[list[tuple[NDArray[np.float64], str]]]] = {}

    def draw_snapshot(self, snapshot: Snapshot) -> None:
        """A whole layer, with its exact values and its rule's further arrays."""
        layer, canvas = snapshot.layer, self._canvas
        state = canvas.begin(layer.name, layer.kind, snapshot.rule)
        state.see_whole(layer.observed)
        state.update(layer.geometry.whole, layer.values, layer.probability)
        canvas.draw_whole(layer.name)
        for name, array in layer.extra.items():
            values = np.asarray(array, np.float32)
            entity = layout.extra(layer.name, name)
            canvas.prepare(entity, functools.partial(scene.set_up_extra, name=name))
            canvas.add(entity, columns.float32_values, values.copy(), values.nbytes)

    def draw_thresholded(self, thresholded: Thresholded) -> None:
        """The occupied cells over the map; borders and lines of an earlier time go."""
        layer = thresholded.layer
        self._restart(layout.borders(layer))
        self._restart(layout.segments(layer, "grid"))
        picture = thresholded.occupied.astype(np.uint8)
        self._canvas.layer(layer)
        threshold = np.array([thresholded.threshold])
        self._canvas.add(layout.thresholded(layer), columns.number_records, threshold)
        self._canvas.draw_classes(layout.thresholded(layer), picture, layout.ORDER_THRESHOLDED)

    def draw_classes(self, classes: Classes) -> None:
        """The class map, a view of its own."""
        set_up = functools.partial(scene.set_up_classes, names=classes.names)
        self._canvas.prepare(f"{layout.CLASSES}/names", set_up)
        self._canvas.draw_classes(layout.CLASSES, classes.codes, layout.ORDER_CLASSES)

    def draw_border(self, border: Border) -> None:
        """One more border, closed, through the centres of its cells."""
        root = layout.borders(border.layer)
        centres = border.geometry.centres_of(np.vstack([border.cells, border.cells[:1]]))
        label = f"border {border.number}, {'outer' if border.outer else 'hole'}"
        entity = self._gather(root, centres, scene.set_up_borders, label)
        record = np.column_stack(
            [np.full(len(border.cells), border.number), np.full(len(border.cells), border.outer),
             border.cells]
        ).astype(np.int64)  # fmt: skip
        self._canvas.add(entity, columns.number_records, record, record.nbytes)

    def draw_raw_points(self, points: RawPoints) -> None:
        """All obstacle points of a layer; raw lines of an earlier time go."""
        self._restart(layout.segments(points.layer, "raw"))
        entity, xy = layout.raw_points(points.layer), np.asarray(points.points_m, np.float64)
        self._canvas.layer(points.layer)
        self._canvas.add(entity, columns.points, xy, xy.nbytes)
        self._canvas.add(entity, columns.number_records, xy, xy.nbytes)

    def draw_segment(self, segment: Segment) -> None:
        """One more straight line."""
        root = layout.segments(segment.layer, segment.source)
        set_up = functools.partial(scene.set_up_segments, raw=segment.source == "raw")
        label = f"{segment.length_m:.2f} m, rms {1000 * segment.rms_m:.0f} mm, n {segment.points}"
        ends = np.array([segment.start_m, segment.end_m])
        entity = self._gather(root, ends, set_up, label)
        border = np.nan if segment.border is None else segment.border
        record = np.array(
            [*segment.start_m, *segment.end_m, segment.rho_m, segment.alpha_rad,
             *np.asarray(segment.covariance).ravel(), segment.rms_m, segment.points, border],
            np.float64,
        )  # fmt: skip
        self._canvas.add(entity, columns.number_records, record, record.nbytes)

    def _gather(
        self, root: str, strip: NDArray[np.float64], set_up: scene.SetUp, label: str
    ) -> str:
        """Add a strip to the newest group below a root, and draw that group; its entity."""
        groups = self._gathered.setdefault(root, [[]])
        if len(groups[-1]) == layout.GROUP:
            groups.append([])
        groups[-1].append((strip, label))
        entity = layout.group(root, len(groups) - 1)
        self._canvas.prepare(entity, set_up)
        strips, labels = [each[0] for each in groups[-1]], [each[1] for each in groups[-1]]
        self._canvas.add(entity, columns.strips, strips, sum(s.nbytes for s in strips))
        self._canvas.add(entity, columns.labels, labels, sum(len(text) for text in labels))
        return entity

    def _restart(self, root: str) -> None:
        for number, _ in enumerate(self._gathered.pop(root, [])):
            self._canvas.add(layout.group(root, number), columns.strips, [])
            self._canvas.add(layout.group(root, number), columns.labels, [])
