"""Simplified sensor models: a binary map, counts and their thresholds, how a beam meets cells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mapping.artifacts import TempGrid
from mapping.beams import Beam
from mapping.grid import Layer
from replay.pictures import style
from replay.pictures.figures.bench import MOST_SLOW, SIMPLE, Bench, Role, box_of_beam
from replay.pictures.figures.figure import Drawing, Figure, LeftOut
from replay.pictures.figures.shading import (
    arc_m,
    blank,
    counted,
    counts,
    degrees,
    evidence,
    percent,
    robot,
    yes_no,
)
from replay.pictures.parts import Dots, Floats, Mark, Strokes, Trail, Words

MODELS, APPLYING = "Sensor Models", "Applying a Sensor Model"
IMPLEMENTED = "Sensor Model Implementation"
# The chapter's samples along arcs, which alone draw an arc without depth.
ARC: dict[str, Any] = {**SIMPLE, "rasteriser": "arcs", "range_error": 0.0}
POINT: dict[str, Any] = {**SIMPLE, "range_error": 0.0}
BINARY: dict[str, Any] = {**POINT, "update": "binary"}
ERRORS = (0.05, 0.10)


def single(role: Role) -> None:
    """Raises LeftOut for a sensor whose readings have many beams."""
    if role.sensor.beam_width_rad < math.radians(2.0):
        raise LeftOut(f"{role.sensor.name} has beams like lines")


def some(bench: Bench, role: Role) -> str:
    """What a map of thinned readings is of, in words."""
    count = len(role.rows)
    few = (
        f"{MOST_SLOW:,} of the {count:,} readings"
        if count > MOST_SLOW
        else f"all {count:,} readings"
    )
    return f"{few} of {role.sensor.name}"


def _model_on_grid(bench: Bench) -> Drawing:
    panels = []
    for role in _roles(bench):
        beam = bench.typical(role)
        temp = bench.temp(role, beam, emptiness="none")
        panels.append(evidence(role.sensor.name, temp, robot(beam.world_from_base)))
    caption = (
        "One reading laid on the grid: the darker a cell, the likelier the obstacle is there. In "
        "the middle of the beam and at the measured range it is likeliest."
    )
    return Drawing(tuple(panels), caption)


def _roles(bench: Bench) -> list[Role]:
    roles = []
    for name in ("sonar", "narrow"):
        try:
            roles.append(getattr(bench, name))
        except LeftOut:
            continue
    return roles


def _binary_points(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = bench.layer(role, **BINARY)
    cells = int((layer.values > 0).sum())
    caption = (
        f"Every reading of {role.sensor.name} taken at its word: the cell straight ahead at the "
        f"measured range is occupied, {cells:,} cells in all."
    )
    return Drawing((yes_no(bench, "", layer.values > 0, layer),), caption)


def _binary_wedges(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    layer = bench.layer(role, MOST_SLOW, **ARC)
    caption = (
        f"Every cell along the arc of {degrees(role.sensor.beam_width_rad)} taken as occupied, "
        f"from {some(bench, role)}: hardly a cell stays free."
    )
    return Drawing((yes_no(bench, "", layer.values > 0, layer),), caption)


def _count(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = _counted_arcs(bench, role)
    caption = (
        f"A counter for each cell: how many arcs went through it, from {some(bench, role)}. The "
        f"darkest cell was counted {int(layer.values.max()):,} times."
    )
    return Drawing((counts(bench, "", layer),), caption)


def _counted_arcs(bench: Bench, role: Role) -> Layer:
    """Counts along the arcs of a cone, or at the points of a line."""
    try:
        single(role)
    except LeftOut:
        return bench.layer(role, **POINT)
    return bench.layer(role, MOST_SLOW, **ARC)


def _count_thresholds(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = _counted_arcs(bench, role)
    most = float(layer.values.max())
    panels, kept = [], []
    for share in (0.25, 0.50, 0.75):
        above = layer.values >= share * most
        kept.append(int(above.sum()))
        panels.append(yes_no(bench, f"at least {percent(share)}", above, layer))
    caption = (
        f"Counts below a share of the largest, {int(most):,}, are thrown away: "
        f"{kept[0]:,}, {kept[1]:,} and {kept[2]:,} cells are left of {role.sensor.name}."
    )
    return Drawing(tuple(panels), caption)


def _narrow_model(bench: Bench) -> Drawing:
    role = bench.narrow
    points = bench.layer(role, **POINT)
    arcs = _counted_arcs(bench, role)
    width = degrees(role.sensor.beam_width_rad)
    panels = (
        counts(bench, "without a model", points),
        counts(bench, f"with arcs of {width}", arcs),
    )
    caption = (
        f"{role.sensor.name} with its beam of only {width}: points, and counts along the arcs. A "
        "narrow beam blurs little."
    )
    return Drawing(panels, caption)


def _to_be_fused(bench: Bench) -> Drawing:
    panels = []
    for role in bench.both:
        layer = _counted_arcs(bench, role)
        panels.append(counts(bench, role.sensor.name, layer))
    caption = (
        "What each sensor counted. Before the two are put together each needs its errors of range."
    )
    return Drawing(tuple(panels), caption)


def _arc_ends(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    beam = bench.typical(role)
    range_m = float(beam.ranges_m[0])
    arc = arc_m(beam, range_m)
    at = np.array([beam.world_from_sensor.x_m, beam.world_from_sensor.y_m])
    ends = np.array([[at, arc[0]], [at, arc[-1]]])
    cell_m = bench.geometry.resolution_m
    chord_m = float(np.hypot(*(arc[-1] - arc[0])))
    samples = arc_m(beam, range_m, max(2, round(chord_m / cell_m) + 1))
    marks: list[Mark] = [
        Strokes(ends, style.PALE_INK, 0.9, "edges of the beam"),
        Strokes(np.array([[at, beam.points_m[0]]]), style.INK, 0.9, "its axis"),
        Trail(np.array([arc[0], arc[-1]]), style.PALE_INK, 0.8, "chord", dashed=True),
        Dots(samples, style.sensor_colour(beam.sensor, bench.sensors), 2.6, "samples"),
        *robot(beam.world_from_base),
        Words(_beyond(at, arc[0]), "a", style.INK), Words(_beyond(at, arc[-1]), "b", style.INK),
        Words(_beyond(at, beam.points_m[0]), "r", style.INK),
    ]  # fmt: skip
    caption = (
        f"Which cells an arc meets: from a to b, σ = {degrees(beam.beam_width_rad)} wide at "
        f"r = {range_m:.2f} m, the chord is {chord_m:.2f} m or {chord_m / cell_m:.0f} cells long. "
        f"Samples {degrees(beam.beam_width_rad / max(chord_m / cell_m, 1))} apart meet about one "
        "cell each."
    )
    return Drawing((blank(bench, "", marks, box_of_beam(beam)),), caption)


def _beyond(start: Floats, end: Floats) -> tuple[float, float]:
    x, y = (start + 1.05 * (end - start)).tolist()
    return x, y


def _samples(bench: Bench, beam: Beam, role: Role, error: float, *, second: bool) -> TempGrid:
    changes = {**ARC, "range_error": error, "second_grid": second}
    return bench.temp_on_map(role, beam, **changes)


def _hits(temp: TempGrid) -> Floats:
    """How many samples of a reading fell into each cell of its window."""
    hits = np.zeros(temp.band.shape)
    for each in temp.sub_grids or (temp,):
        rows, cols = each.window.row0 - temp.window.row0, each.window.col0 - temp.window.col0
        hits[rows : rows + each.window.rows, cols : cols + each.window.cols] += each.band
    return hits


def _speckle(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    beam = bench.typical(role)
    panels, missed = [], []
    for error in ERRORS:
        temp = _samples(bench, beam, role, error, second=False)
        hits = _hits(temp)
        panels.append(counted(f"±{percent(error)}", hits, temp))
        cured = bench.temp_on_map(role, beam, **{**SIMPLE, "range_error": error})
        missed.append((int((hits > 1).sum()), int((cured.band & (hits == 0)).sum())))
    caption = (
        "One reading with an error of its range is a band, not an arc. Sampled straight into the "
        f"map, cells are hit several times ({missed[0][0]:,} and {missed[1][0]:,} of them) or not "
        f"at all ({missed[0][1]:,} and {missed[1][1]:,}): the map is speckled."
    )
    return Drawing(tuple(panels), caption)


def _speckle_cured(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    beam = bench.typical(role)
    error = role.sensor.range_error
    raw = _samples(bench, beam, role, error, second=False)
    merged = _samples(bench, beam, role, error, second=True)
    panels = (
        counted("straight into the map", _hits(raw), raw),
        counted("by a second grid", merged.band.astype(float), merged),
    )
    caption = (
        "The cure of the speckle: each reading is first sampled into a grid of its own, where a "
        "cell counts once, and that grid is then merged into the map."
    )
    return Drawing(panels, caption)


def _error_maps(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    without = bench.layer(role, MOST_SLOW, **ARC)
    panels = [counts(bench, "without an error", without)]
    for error in ERRORS:
        layer = bench.layer(role, **{**SIMPLE, "range_error": error})
        title = f"±{percent(error)} of the range"
        panels.append(counts(bench, title, layer))
    caption = (
        f"Counts of {role.sensor.name} along arcs, and in bands of ±5 % and ±10 % of the range: "
        "the arcs become blurred bands."
    )
    return Drawing(tuple(panels), caption)


def _narrow_error(bench: Bench) -> Drawing:
    role = bench.narrow
    without = _counted_arcs(bench, role)
    error = role.sensor.range_error
    layer = bench.layer(role, **{**SIMPLE, "range_error": error})
    panels = (
        counts(bench, "without an error", without),
        counts(bench, f"±{percent(error)}", layer),
    )
    caption = f"The same for {role.sensor.name}, whose range is known to ±{percent(error)}."
    return Drawing(panels, caption)


FIGURES = (
    Figure("model-on-the-grid", MODELS, "A reading laid on the grid", _model_on_grid),
    Figure("binary-points", APPLYING, "A binary map of points", _binary_points, BINARY, "any"),
    Figure("binary-wedges", APPLYING, "A binary map of arcs", _binary_wedges,
           {**ARC, "update": "binary"}, "any"),
    Figure("counts", APPLYING, "A map of counts", _count, ARC, "any"),
    Figure("count-thresholds", APPLYING, "Counts above 25, 50 and 75 %", _count_thresholds),
    Figure("infrared-model", APPLYING, "Infrared, without and with a model", _narrow_model),
    Figure("to-be-fused", APPLYING, "Two sensors, side by side", _to_be_fused),
    Figure("arc-ends", IMPLEMENTED, "The cells along an arc", _arc_ends),
    Figure("speckle", IMPLEMENTED, "An error of the range, and speckle", _speckle),
    Figure("distance-errors", IMPLEMENTED, "Maps without and with an error", _error_maps),
    Figure("speckle-cured", IMPLEMENTED, "The speckle cured", _speckle_cured),
    Figure("infrared-error", IMPLEMENTED, "Infrared, without and with an error", _narrow_error),
)  # fmt: skip
