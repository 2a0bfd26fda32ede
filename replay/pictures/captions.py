"""What is to be seen in the picture of a map, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mapping.beams import Beam
from replay.pictures.views import CLASSES, MapView


def caption_of(view: MapView) -> str:
    """A few sentences: which map, how far along, what the newest reading was, what was found."""
    rule = f", made by the rule {view.rule}" if view.rule else ""
    sentences = [f"The map {view.layer} {view.when}{rule}."]
    if view.layer == CLASSES:
        sentences = [
            f"The classes {view.when}: where the sensors agree, where one alone has evidence, and "
            "where they contradict each other."
        ]
    if view.counted is not None:
        seen, occupied = view.counted.seen, view.counted.occupied
        sentences.append(f"{seen:,} cells were seen, {occupied:,} of them are rather occupied.")
    if view.over.beam is not None:
        sentences.append(_reading(view.over.beam))
    if len(view.over.found_m):
        lengths = np.hypot(*(view.over.found_m[:, 1] - view.over.found_m[:, 0]).T)
        lines = "line was" if len(lengths) == 1 else "lines were"
        sentences.append(
            f"{len(lengths)} straight {lines} found in it, the longest of {lengths.max():.2f} m."
        )
    return " ".join(sentences)


def _reading(beam: Beam) -> str:
    seen = beam.ranges_m[beam.saw_something]
    if len(beam.ranges_m) > 1:
        nearest = f", the nearest obstacle at {seen.min():.2f} m" if len(seen) else ""
        return (
            f"In this reading of {beam.sensor} {len(seen)} of {len(beam.ranges_m)} beams came "
            f"back{nearest}."
        )
    if not len(seen):
        return f"In this reading {beam.sensor} saw nothing: its beam is free as far as it reaches."
    width = math.degrees(beam.beam_width_rad)
    return (
        f"In this reading {beam.sensor} measured {seen[0]:.2f} m; its beam is {width:.3g}° wide, "
        f"so the obstacle may stand anywhere along the arc."
    )


def compared_caption(views: Sequence[MapView]) -> str:
    """The same for several maps side by side."""
    parts = []
    for view in views:
        counts = ""
        if view.counted is not None:
            seen, occupied = view.counted.seen, view.counted.occupied
            counts = f": {seen:,} cells seen, {occupied:,} rather occupied"
        lines = f", {len(view.over.found_m)} lines" if len(view.over.found_m) else ""
        parts.append(f"{view.file} ({view.layer} {view.when}){counts}{lines}.")
    return "The same scale in all panels. " + " ".join(parts)
