"""Odds, ways to display a map, maps of several sensors in one, and other rules of updating."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping import display
from mapping.config_sections import FusionSection
from mapping.fusion import classify, fuse, weights_of
from mapping.grid import Layer
from replay.pictures import style
from replay.pictures.figures.bench import CHAPTER, Bench
from replay.pictures.figures.figure import Drawing, Figure
from replay.pictures.figures.shading import counts, percent, probable, shares, walls
from replay.pictures.parts import Cells, Panel, Swatch
from replay.pictures.views import class_colours

ODDS, DISPLAY, FUSION = "Odds Representation", "Display Options", "Sensor Fusion"
OTHER = "Other Updating Strategies"
_RULES: tuple[tuple[str, str], ...] = (
    ("angular", "by angular resolution"), ("range", "by distance resolution"), ("equal", "equal"),
)  # fmt: skip


def _odds(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = bench.layer(role, **CHAPTER)
    odds = bench.layer(role, **{**CHAPTER, "update": "odds"})
    panels = (
        probable(bench, "probability", layer),
        shares(bench, "odds over the largest", odds.values, odds, ("odds 0", "largest odds")),
    )
    caption = (
        "The same map as probabilities, from 0 to 1, and as odds, from 0 without end: these are "
        f"drawn against the largest, {float(odds.values.max()):.3g}, so a few sure cells are dark "
        "and all others pale. Odds take one multiplication a cell and reading."
    )
    return Drawing(panels, caption)


def _coloured(
    bench: Bench, title: str, image: NDArray[np.uint8], layer: Layer, swatches: tuple[Swatch, ...]
) -> Panel:
    """A picture of cells; what was never seen stays so."""
    pixels = image.copy()
    pixels[~layer.observed] = np.round(255.0 * np.array(style.NEVER_SEEN)).astype(np.uint8)
    last = Swatch(style.NEVER_SEEN, "never seen")
    cells = Cells(layer.geometry, pixels)
    return Panel(title, bench.frame, cells, (*swatches, last), tuple(walls(bench)))


def _ink(colour: tuple[int, int, int]) -> style.Colour:
    r, g, b = (each / 255.0 for each in colour)
    return r, g, b


def _displays(bench: Bench) -> Drawing:
    sonar, narrow = bench.both
    a, b = bench.layer(sonar, **CHAPTER), bench.layer(narrow, **CHAPTER)
    both = fuse([a, b], [sonar.sensor, narrow.sensor], FusionSection(rule="weights"))
    grey = (Swatch(style.FREE, "free"), Swatch(style.OCCUPIED, "occupied"))
    two = (
        Swatch(_ink(display.RED), f"occupied by {a.name}"),
        Swatch(_ink(display.BLUE), f"occupied by {b.name}"),
    )  # fmt: skip
    three = (*two, Swatch(_ink(display.GREEN), "occupied by both"))
    panels = []
    for depth, levels in (("full depth", display.FULL_DEPTH), ("5 shades", display.REDUCED_DEPTH)):
        pa, pb = a.probability, b.probability
        panels += [
            _coloured(bench, f"grey, {depth}", display.grey(both.probability, levels=levels),
                      both, grey),
            _coloured(bench, f"two colours, {depth}", display.two_colours(pa, pb, levels=levels),
                      both, two),
            _coloured(bench, f"three colours, {depth}",
                      display.three_colours(pa, pb, levels=levels), both, three),
        ]  # fmt: skip
    caption = (
        f"Ways to draw {a.name} and {b.name} together: in grey, each in a colour of its own, and "
        "what both hold occupied in a third; above at full depth, below with five shades."
    )
    return Drawing(tuple(panels), caption)


def _separate(bench: Bench) -> Drawing:
    sonar, narrow = bench.both
    layers = [bench.layer(role, **CHAPTER) for role in (sonar, narrow)]
    fused = fuse(layers, [sonar.sensor, narrow.sensor], FusionSection(rule="weights"))
    panels = [probable(bench, layer.name, layer) for layer in (*layers, fused)]
    weights = weights_of(layers, [sonar.sensor, narrow.sensor], "angular")
    caption = (
        f"A map for each sensor, and the two put together, cell by cell: {weights[0]:.2f} of "
        f"{sonar.layer} and {weights[1]:.2f} of {narrow.layer}."
    )
    return Drawing(tuple(panels), caption)


def _weights(bench: Bench) -> Drawing:
    sonar, narrow = bench.both
    sensors = [sonar.sensor, narrow.sensor]
    layers = [bench.layer(role, **CHAPTER) for role in (sonar, narrow)]
    panels, words = [], []
    for kind, text in _RULES:
        section = FusionSection.model_validate({"rule": "weights", "weights": kind})
        panels.append(probable(bench, text, fuse(layers, sensors, section)))
        first, second = weights_of(layers, sensors, kind)
        words.append(f"{text} {first:.2f} and {second:.2f}")
    caption = (
        f"Three choices of the weights of {sonar.layer} and {narrow.layer}: {'; '.join(words)}."
    )
    return Drawing(tuple(panels), caption)


def _log_odds(bench: Bench) -> Drawing:
    sonar, narrow = bench.both
    layers = [bench.layer(role, **CHAPTER) for role in (sonar, narrow)]
    fused = fuse(layers, [sonar.sensor, narrow.sensor], FusionSection(rule="bayes"))
    p = fused.probability[fused.observed]
    caption = (
        "The two maps put together by Bayes' rule, their log-odds added: no weights, the surer "
        f"sensor wins. {int((p > 0.5).sum()):,} cells are rather occupied."
    )
    return Drawing((probable(bench, "", fused),), caption)


def _classes(bench: Bench) -> Drawing:
    layers = [bench.layer(role, **CHAPTER) for role in bench.both]
    found = classify(layers)
    table = class_colours(found.names)
    sizes = np.bincount(found.codes.ravel(), minlength=len(found.names))
    swatches = tuple(
        Swatch(_ink(tuple(table[k].tolist())), name)
        for k, name in enumerate(found.names)
        if sizes[k]
    )
    panel = Panel(
        "", bench.frame, Cells(found.geometry, table[found.codes]), swatches, tuple(walls(bench))
    )
    contradict = int(sizes[found.names.index("contradict")])
    caption = (
        "Where the two sensors agree, where one alone has evidence of a cell, and the "
        f"{contradict:,} cells in which they contradict each other: there one may hide what the "
        "other has seen."
    )
    return Drawing((panel,), caption)


def _dempster_shafer(bench: Bench) -> Drawing:
    role = bench.any_ranger
    layer = bench.layer(role, **_variant("dempster-shafer"))
    panels = [
        shares(bench, name, layer.extra[name], layer, ("mass 0", "largest mass"))
        for name in ("occupied", "empty", "unknown", "conflict")
    ]
    conflict = layer.extra["conflict"][layer.observed]
    caption = (
        f"Dempster-Shafer keeps three masses a cell of {role.sensor.name}, occupied, empty and "
        "unknown, which add up to 1; and how much readings contradicted each other: in "
        f"{percent(float((conflict > 0.5).mean()))} of the seen cells by more than one half. "
        "Conflict is not lack of evidence."
    )
    return Drawing(tuple(panels), caption, columns=2)


def _himm(bench: Bench) -> Drawing:
    role = bench.any_ranger
    himm, bayes = bench.layer(role, **_variant("himm")), bench.layer(role, **CHAPTER)
    panels = (
        counts(bench, "HIMM", himm, ("certainty 0", "largest certainty")),
        probable(bench, "Bayes", bayes),
    )
    caption = (
        "HIMM looks along the axis of each beam alone: 3 more where the echo came from, 1 less "
        f"before it, within 0 and 15. {int((himm.values > 0).sum()):,} cells of "
        f"{role.sensor.name} hold something; it is quick, and leaves gaps."
    )
    return Drawing(panels, caption)


def _variant(rule: str) -> dict[str, Any]:
    return {**CHAPTER, "update": rule}


FIGURES = (
    Figure("odds", ODDS, "Probabilities and odds", _odds, _variant("odds"), "any"),
    Figure("display-options", DISPLAY, "Ways to draw two maps", _displays),
    Figure("separate-maps", FUSION, "Separate maps, then one", _separate),
    Figure("fusion-weights", FUSION, "Weights of fusion", _weights),
    Figure("fusion-bayes", FUSION, "Fused without weights", _log_odds),
    Figure("classes", FUSION, "Where the sensors agree", _classes),
    Figure("dempster-shafer", OTHER, "Dempster-Shafer", _dempster_shafer,
           _variant("dempster-shafer"), "any"),
    Figure("himm", OTHER, "HIMM", _himm, _variant("himm"), "any"),
)  # fmt: skip
