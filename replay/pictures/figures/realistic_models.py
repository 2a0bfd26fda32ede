"""More realistic sensor models: Gaussians over the beam, probabilities, and what is in front."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mapping.beams import Beam
from mapping.sensor_model import emptiness, regions_table
from replay.pictures import style
from replay.pictures.figures.bench import CHAPTER, Bench, Role, box_of_beam
from replay.pictures.figures.figure import Drawing, Figure
from replay.pictures.figures.learned_models import learned_model, near_and_far
from replay.pictures.figures.shading import (
    arc_m,
    blank,
    cone,
    counts,
    degrees,
    evidence,
    percent,
    probable,
    robot,
)
from replay.pictures.figures.simple_models import single
from replay.pictures.parts import Bars, Chart, Curve, Dots, Floats, Mark, Panel, Trail

ERROR, DENSITY = "Error Distribution", "Probability Density Functions"
GAUSSIAN, APPLYING = "Gaussian Distribution", "Applying Gaussian Distribution"
CONVERTING, BAYES = "Converting to Probabilities", "Bayesian Updating"
IMPROVING, LEARNING = "Improving the Sensor Model", "Learning the Sensor Model"
SUM: dict[str, Any] = {**CHAPTER, "emptiness": "none", "update": "sum"}
IN_BAND: dict[str, Any] = {**CHAPTER, "emptiness": "none"}
_BLUE, _RED = style.MORE_FREE, style.MORE_OCCUPIED


def _normal(x: Floats) -> Floats:
    density: Floats = np.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
    return density


def _anywhere(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    beam = bench.typical(role)
    range_m = float(beam.ranges_m[0])
    places = arc_m(beam, range_m, 7)
    marks: list[Mark] = [
        *cone(bench, beam), Dots(places, style.INK, 7.0, "places that fit the reading"),
        *robot(beam.world_from_base),
    ]  # fmt: skip
    caption = (
        f"{role.sensor.name} measured {range_m:.2f} m: whatever it met may stand anywhere along "
        f"the arc of {degrees(beam.beam_width_rad)}. All these places fit the reading alike."
    )
    return Drawing((blank(bench, "", marks, box_of_beam(beam)),), caption)


def _likelihood(bench: Bench) -> Drawing:
    role = bench.any_ranger
    single(role)
    half = math.degrees(role.sensor.beam_width_rad) / 2.0
    angle = np.linspace(-half, half, 181)
    curve = np.column_stack([angle, _normal(3.0 * angle / half) * 3.0 / half])
    chart = Chart(
        "", "angle from the axis, degrees", "density",
        (Curve(curve, style.sensor_colour(role.sensor.name, bench.sensors),
               f"where {role.sensor.name} met something", filled=True),),
    )  # fmt: skip
    caption = (
        "What is in the middle of the beam is likelier to have sent the echo than what is at its "
        f"edge: the place along the arc is a random variable, from {-half:.3g}° to {half:.3g}°."
    )
    return Drawing((chart,), caption)


def _density(bench: Bench) -> Drawing:
    x = np.linspace(-4.0, 4.0, 321)
    parts = tuple(
        Curve(np.column_stack([x, _normal(x / sigma) / sigma]), colour, f"σ = {sigma:g}")
        for sigma, colour in ((0.5, _RED), (1.0, style.INK), (2.0, _BLUE))
    )
    chart = Chart("", "x - μ", "p(x)", parts)
    caption = (
        "The normal distribution of mean μ for three standard deviations σ. The area below each "
        "curve is 1: the wider the lower."
    )
    return Drawing((chart,), caption)


def _six_regions(bench: Bench) -> Drawing:
    table, x = regions_table(6), np.linspace(-3.0, 3.0, 241)
    parts = (
        Bars(np.linspace(-3.0, 3.0, 7), table, _BLUE, "probability of each region", named=True),
        Curve(np.column_stack([x, _normal(x)]), style.INK, "normal distribution"),
    )
    caption = (
        "Six regions, each a standard deviation wide, from -3 to +3: the probability of each is "
        f"the area of the curve over it. Together they hold {table.sum():.4f}."
    )
    return Drawing((Chart("", "standard deviations", "probability", parts),), caption)


def _one(bench: Bench) -> tuple[Role, Beam]:
    role = bench.any_ranger
    single(role)
    return role, bench.typical(role)


def _pieces(bench: Bench) -> Drawing:
    role, beam = _one(bench)
    temp = bench.temp(role, beam, **{**IN_BAND, "regions": 6, "gaussian": "angle"})
    lines = [
        Trail(np.array([(beam.world_from_sensor.x_m, beam.world_from_sensor.y_m), end]),
              style.PALE_INK, 0.6, "six equal parts of the beam" if k == 0 else "")
        for k, end in enumerate(arc_m(beam, 1.1 * float(beam.ranges_m[0]), 7))
    ]  # fmt: skip
    marks: list[Mark] = [*lines, *robot(beam.world_from_base)]
    caption = (
        "The band of one reading cut into six parts across the beam: each has the probability of "
        "its region, 0.0214, 0.1359 and 0.3413 from the edge to the middle."
    )
    return Drawing((evidence("", temp, marks),), caption)


def _gaussian_maps(bench: Bench, which: str, words: str) -> Drawing:
    role = bench.any_ranger
    panels = []
    for title, gaussian in ((f"without, {words}", "none"), (f"with, {words}", which)):
        layer = bench.layer(role, **{**SUM, "gaussian": gaussian})
        panels.append(counts(bench, title, layer, ("nothing", "largest sum")))
    caption = (
        f"The sums of {role.sensor.name}'s likelihoods without and with a Gaussian {words}. With "
        "it the edges weigh less, and what many readings share stands out."
    )
    return Drawing(tuple(panels), caption)


def _across(bench: Bench) -> Drawing:
    return _gaussian_maps(bench, "angle", "across the beam")


def _along(bench: Bench) -> Drawing:
    return _gaussian_maps(bench, "distance", "along the beam")


def _depth(bench: Bench) -> Drawing:
    role, beam = _one(bench)
    temp = bench.temp(role, beam, **{**IN_BAND, "gaussian": "distance", "regions": 12})
    caption = (
        f"The same along the beam: within ±{percent(role.sensor.range_error)} of the range the "
        "obstacle is likeliest at the range itself."
    )
    return Drawing((evidence("", temp, robot(beam.world_from_base)),), caption)


def _both(bench: Bench) -> Drawing:
    role, beam = _one(bench)
    changes = {**IN_BAND, "regions": 6}
    temp, on_map = bench.temp(role, beam, **changes), bench.temp_on_map(role, beam, **changes)
    table = np.outer(regions_table(6), regions_table(6))
    caption = (
        "Both Gaussians together: 6 × 6 regions, whose probabilities are the products, from "
        f"{table.min():.10f} in a corner to {table.max():.10f} in the middle. This one reading "
        f"touches {int(on_map.band.sum()):,} cells of {100 * bench.geometry.resolution_m:g} cm."
    )
    return Drawing((evidence("", temp, robot(beam.world_from_base)),), caption)


def _three(bench: Bench) -> Drawing:
    role = bench.any_ranger
    panels = []
    for title, gaussian in (("on angle", "angle"), ("on distance", "distance"), ("both", "both")):
        layer = bench.layer(role, **{**SUM, "gaussian": gaussian})
        panels.append(counts(bench, title, layer, ("nothing", "largest sum")))
    caption = f"Sums of {role.sensor.name} with a Gaussian on angle, on distance, and on both."
    return Drawing(tuple(panels), caption)


def _finer_tables(bench: Bench) -> Drawing:
    parts = []
    for regions in (6, 12, 60):
        chart = Chart(
            f"{regions} regions", "standard deviations", "probability",
            (Bars(np.linspace(-3.0, 3.0, regions + 1), regions_table(regions), _BLUE,
                  "probability of a region", named=regions == 6),),
            frame=_SQUARE,
        )  # fmt: skip
        parts.append(chart)
    largest = [regions_table(n).max() for n in (6, 12, 60)]
    caption = (
        "The areas of the normal distribution for 6, 12 and 60 regions. The likeliest has "
        f"{largest[0]:.4f}, {largest[1]:.4f} and {largest[2]:.4f}."
    )
    return Drawing(tuple(parts), caption)


def _resolutions(bench: Bench) -> Drawing:
    role, beam = _one(bench)
    panels = [
        evidence(f"{n} regions", bench.temp(role, beam, **{**IN_BAND, "regions": n}))
        for n in (6, 12, 18, 24, 36, 60)
    ]
    caption = (
        "One reading with 6 to 60 regions on both axes: the steps become a smooth hill. Each "
        "panel is as dark as its own likeliest cell."
    )
    return Drawing(tuple(panels), caption)


def _normalised(bench: Bench) -> Drawing:
    role = bench.any_ranger
    sums, layer = bench.layer(role, **SUM), bench.layer(role, **IN_BAND)
    panels = (
        counts(bench, "sums", sums, ("nothing", "largest sum")),
        probable(bench, "probabilities", layer),
    )
    caption = (
        "Before: sums, in which white means unlikely and unknown alike. After: probabilities, in "
        "which a cell that no reading touched keeps its own colour, 0.5 is a middle grey, and "
        "only more is darker. Nothing is free yet."
    )
    return Drawing(panels, caption)


def _finer_weigh_less(bench: Bench) -> Drawing:
    role = bench.any_ranger
    panels, largest = [], []
    for regions in (6, 12, 60):
        layer = bench.layer(role, **{**IN_BAND, "regions": regions})
        panels.append(probable(bench, f"{regions} regions", layer))
        largest.append(float(layer.probability[layer.observed].max(initial=0.5)))
    caption = (
        "The finer the regions, the less a reading says of a cell: after all readings of "
        f"{role.sensor.name} the likeliest cell has {percent(largest[0])} with 6 regions, "
        f"{percent(largest[1])} with 12 and {percent(largest[2])} with 60."
    )
    return Drawing(tuple(panels), caption)


def _bayes_step(bench: Bench) -> Drawing:
    table = regions_table(6)
    t = 0.5 + float(table.max()) ** 2 / 2.0
    beliefs = [0.5]
    for _ in range(12):
        f = beliefs[-1]
        beliefs.append(t * f / (t * f + (1.0 - t) * (1.0 - f)))
    hits = np.column_stack([np.arange(13), beliefs])
    less = [0.5]
    for _ in range(12):
        f, miss = less[-1], 1.0 - t
        less.append(miss * f / (miss * f + (1.0 - miss) * (1.0 - f)))
    chart = Chart(
        "", "readings that say the same of a cell", "probability of being occupied",
        (Curve(hits, _RED, f"each says {t:.10f}"),
         Curve(np.column_stack([np.arange(13), less]), _BLUE, f"each says {1.0 - t:.10f}")),
    )  # fmt: skip
    caption = (
        f"Bayes' rule for one cell. It begins at 0.5; a reading of {t:.10f} makes it "
        f"{beliefs[1]:.10f}, a second one {beliefs[2]:.4f}, and {beliefs[12]:.4f} after twelve."
    )
    return Drawing((chart,), caption)


def _bayes_maps(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = bench.layer(role, **IN_BAND)
    p = layer.probability[layer.observed]
    caption = (
        f"All readings of {role.sensor.name} merged by Bayes' rule, the band of each alone: "
        f"{int((p > 0.5).sum()):,} cells are rather occupied, none is free."
    )
    return Drawing((probable(bench, "", layer),), caption)


def _implied(bench: Bench) -> Drawing:
    role, beam = _one(bench)
    error = role.sensor.range_error
    temp = bench.temp(role, beam, **CHAPTER)
    marks: list[Mark] = [*cone(bench, beam, error), *robot(beam.world_from_base)]
    left = Panel("what it implies", box_of_beam(beam), None, (), tuple(marks))
    right = evidence("on the grid", temp, robot(beam.world_from_base))
    caption = (
        f"An echo from {float(beam.ranges_m[0]):.2f} m also means that nothing stands nearer: all "
        "before the band is likely free, the surer the nearer to the sensor."
    )
    return Drawing((left, right), caption)


def _profiles(bench: Bench) -> Drawing:
    t = np.linspace(0.0, 1.0, 101)
    kinds = (("constant", _RED), ("linear", _BLUE), ("combined", style.INK))
    parts = tuple(
        Curve(np.column_stack([t, emptiness(kind, t)]), colour, kind) for kind, colour in kinds
    )
    chart = Chart("", "share of the way to the band", "evidence (-1: surely free)", parts)
    caption = (
        "How free a cell before the band is taken to be: the same everywhere (constant), less and "
        "less (linear), or sure for half of the way and then less and less (combined)."
    )
    return Drawing((chart,), caption)


_KINDS = ("constant", "linear", "combined")


def _emptiness_one(bench: Bench) -> Drawing:
    role, beam = _one(bench)
    panels = [
        evidence(kind, bench.temp(role, beam, **{**CHAPTER, "emptiness": kind}))
        for kind in ("none", *_KINDS)
    ]
    caption = (
        "One reading with four models of what is before its band: nothing said, constant, linear, "
        "combined. White is the strongest evidence of being free, black of an obstacle."
    )
    return Drawing(tuple(panels), caption, columns=2)


def _emptiness_many(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layers = [bench.layer(role, **{**CHAPTER, "emptiness": kind}) for kind in _KINDS]
    panels = [probable(bench, kind, layer) for kind, layer in zip(_KINDS, layers, strict=True)]
    left = [int((layer.observed & (layer.probability > 0.5)).sum()) for layer in layers]
    caption = (
        f"All readings of {role.sensor.name} with the three models: {left[0]:,}, {left[1]:,} and "
        f"{left[2]:,} cells are left rather occupied. The combined one is sure where it may be, "
        "and changes smoothly."
    )
    return Drawing(tuple(panels), caption)


def _unlikely(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = bench.layer(role, **CHAPTER)
    points, _ = bench.points(role)
    cells = layer.geometry.cells_of(points)
    inside = layer.geometry.contains(cells)
    p = np.full(len(points), np.nan)
    p[inside] = layer.probability[cells[inside, 0], cells[inside, 1]]
    bad = p < 0.5
    marks: list[Mark] = [
        Dots(points[p >= 0.5], style.sensor_colour(role.sensor.name, bench.sensors), 2.4,
             "points that the map bears out"),
        Dots(points[bad], _RED, 2.8, "points that it contradicts"),
    ]  # fmt: skip
    caption = (
        f"{int(bad.sum()):,} of {int(inside.sum()):,} points of {role.sensor.name} lie in cells "
        "that other readings went through: the improved model shows which readings are unlikely."
    )
    return Drawing((probable(bench, "", layer, marks),), caption)


def _narrow_map(bench: Bench) -> Drawing:
    role = bench.narrow
    layer = bench.layer(role, **CHAPTER)
    p = layer.probability[layer.observed]
    caption = (
        f"The same for {role.sensor.name}: {int((p > 0.5).sum()):,} cells rather occupied, "
        f"{int((p < 0.5).sum()):,} rather free. Its narrow beam leaves gaps."
    )
    return Drawing((probable(bench, "", layer),), caption)


_SQUARE = Chart("", "", "", ()).frame.grown_to(1.25, 1.0)

FIGURES = (
    Figure("anywhere-on-the-arc", ERROR, "What fits one reading", _anywhere),
    Figure("likelihood-across", ERROR, "How likely across the beam", _likelihood),
    Figure("normal-distribution", DENSITY, "The normal distribution", _density),
    Figure("six-regions", GAUSSIAN, "Six regions of the normal distribution", _six_regions),
    Figure("six-pieces", APPLYING, "The band in six parts", _pieces),
    Figure("gaussian-angle", APPLYING, "Without and with a Gaussian on angle", _across),
    Figure("gaussian-depth", APPLYING, "A Gaussian along the beam", _depth),
    Figure("gaussian-distance", APPLYING, "Without and with a Gaussian on distance", _along),
    Figure("gaussian-reading", APPLYING, "Both Gaussians for one reading", _both),
    Figure("gaussian-both", APPLYING, "Gaussians on angle, distance, both", _three),
    Figure("finer-tables", APPLYING, "6, 12 and 60 regions", _finer_tables),
    Figure("finer-readings", APPLYING, "One reading with 6 to 60 regions", _resolutions),
    Figure("normalised", CONVERTING, "Before and after normalising", _normalised),
    Figure("finer-weigh-less", CONVERTING, "Finer regions weigh less", _finer_weigh_less),
    Figure("bayes-cell", BAYES, "Bayes' rule for one cell", _bayes_step),
    Figure("bayes-map", BAYES, "A map by Bayes' rule", _bayes_maps, IN_BAND, "any"),
    Figure("implied-free", IMPROVING, "What a reading says of the way to it", _implied),
    Figure("emptiness-profiles", IMPROVING, "Three ways to be free", _profiles),
    Figure("emptiness-reading", IMPROVING, "Emptiness for one reading", _emptiness_one),
    Figure("emptiness-maps", IMPROVING, "Emptiness for all readings", _emptiness_many),
    Figure("unlikely-readings", IMPROVING, "Readings that are unlikely", _unlikely, CHAPTER, "any"),
    Figure("infrared-combined", IMPROVING, "The infrared's map", _narrow_map, CHAPTER, "narrow"),
    Figure("learned-model", LEARNING, "A learned model against an ideal one", learned_model),
    Figure("near-and-far-models", LEARNING, "Models for near and far readings", near_and_far),
)
