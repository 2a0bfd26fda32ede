"""What a run does not reach of the mapping stage gives what it gave, part by part.

Pictures, borders of figures of all kinds, lines step by step, single scans, probes, predictions,
the laws on rules and models that break them, and the words of the configuration.
``pytest -n0 --update-golden`` writes the expected fingerprints anew, after a change that is meant.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fingerprints import Golden, by_kind, outcome
from regression_sessions import WALLS_M, laser, noise, odd, turning_head, two_rangers

from mapping import cli, display
from mapping.artifacts import Artifact, Classes, RawPoints, Snapshot, Thresholded
from mapping.beams import Beam
from mapping.borders import find_borders, trace_borders, walk_border
from mapping.config import PRESETS, SegmentsSection, load_config
from mapping.config_text import commented_toml
from mapping.fusion import classify, fuse
from mapping.grid import GridGeometry
from mapping.laws import check_plugin, check_rule
from mapping.pipeline import build_maps
from mapping.plugins import load_plugin
from mapping.prediction import RangePredictor
from mapping.probing import CellProbe
from mapping.segments import (
    LINE_METHODS,
    reachable_cells,
    segments_from_grid,
    segments_from_points,
    segments_from_ridge,
    segments_from_scan,
    stages_of_points,
)
from mapping.update_rules import UPDATE_RULES

GOLDEN = Golden(Path(__file__).parent / "golden" / "parts.json")
HERE = Path(__file__).parent
ARCS = ("sensors.*.rasteriser=arcs", "sensors.*.second_grid=false")
SESSIONS = {"rangers": two_rangers, "head": turning_head, "laser": laser, "odd": odd}


@lru_cache
def run_of(name: str, *settings: str) -> tuple[Artifact, ...]:
    config = load_config(settings=["grid.resolution_m=0.04", *settings])
    return tuple(build_maps(SESSIONS[name](), config, walls_m=WALLS_M))


def layers_of(name: str) -> dict[str, Snapshot]:
    return {a.layer.name: a for a in run_of(name) if isinstance(a, Snapshot) and a.final}


def figure(kind: int, rows: int, cols: int) -> np.ndarray:
    """Blobs, one-cell walls, holes and dust, the same everywhere."""
    k = np.arange(rows * cols).reshape(rows, cols)
    dust = (k * 48_271 + kind * 7_919) % 65_537 / 65_537.0
    if kind % 3 == 0:
        return np.asarray(dust < 0.25 + 0.06 * kind)
    row, col = np.indices((rows, cols))
    waves = np.sin(row / (2.0 + kind)) * np.cos(col / 3.0) + 0.3 * np.sin(row * col / 17.0)
    return np.asarray((waves > 0.1 * kind - 0.3) ^ (dust < 0.03 * (kind % 2)))


def thresholded(kind: int, rows: int = 40, cols: int = 55) -> Thresholded:
    geometry = GridGeometry((-0.3, 0.2), 0.05, rows, cols)
    return Thresholded("made", geometry, 0.55, figure(kind, rows, cols))


def room_points(count: int = 240) -> np.ndarray:
    """Points round the walls of a room with gaps, a little off them."""
    points = []
    for k, (a, b) in enumerate(WALLS_M[:6]):
        t = np.linspace(0.02, 0.98, count // 6)[:, None]
        normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.hypot(*(b - a))
        off = np.array([noise(k * 100 + i, 0.008) for i in range(len(t))])[:, None]
        wall = a + t * (b - a) + off * normal
        points.append(wall[(np.arange(len(wall)) // 9) % 4 != 3] if k == 2 else wall)
    points.append(np.array([[1.0, 1.0], [np.nan, 0.0], [1.02, 1.01], [5.0, 5.0]]))
    return np.concatenate(points)


@pytest.fixture(autouse=True)
def _compare_or_update(request: pytest.FixtureRequest) -> None:
    GOLDEN.update = bool(request.config.getoption("--update-golden", default=False))


@pytest.mark.parametrize("kind", range(9))
def test_borders_of_figures(kind: int) -> None:
    found = {}
    for rows, cols in ((12, 15), (1, 9), (7, 1), (40, 55)):
        occupied = figure(kind, rows, cols)
        for tracer in ("closed", "chapter"):
            borders = trace_borders(occupied, tracer=tracer)  # type: ignore[arg-type]
            found[f"{tracer} {rows} {cols}"] = borders
            if rows == 12:
                found[f"{tracer} walks"] = [list(walk_border(occupied, b)) for b in borders]
    GOLDEN.check(f"borders {kind}", found)


@pytest.mark.parametrize("kind", [1, 2, 4, 5])
@pytest.mark.parametrize("source", ["borders", "ridge"])
def test_lines_of_figures(kind: int, source: str) -> None:
    made, found = thresholded(kind), {}
    borders = find_borders(made, load_config().borders)
    half = np.zeros(made.geometry.shape, np.bool_)
    half[:, :30] = True
    for words in ({}, {"wrap": "off"}, {"wrap": "drop"}, {"merge": "none"}, {"method": "hough"}):
        config = SegmentsSection(source=source, **words)  # type: ignore[arg-type]
        for name, seen in (("all", None), ("half", half)):
            stages: list[object] = []
            lines = segments_from_grid(
                made, borders, config, observed=seen, reachable=seen, observe=stages.append
            )
            found[f"{words} {name}"] = [lines, by_kind(stages)]
    GOLDEN.check(f"lines of figure {kind}, {source}", found)


@pytest.mark.parametrize("method", [*LINE_METHODS, "magic"])
def test_lines_of_points(method: str) -> None:
    points, found = room_points(), {}
    for words in (
        {}, {"order": "bearing"}, {"order": "path"}, {"merge": "collinear"}, {"merge": "none"},
        {"merge": "angle"}, {"merge": "endpoints"}, {"fit": "y-on-x"}, {"epsilon_m": 0.015},
        {"rms_m": 0.003}, {"gap_m": 0.1}, {"wrap": "off"}, {"wrap": "drop"}, {"min_points": 20},
        {"corner_reach_m": 0.01}, {"seed": 2},
    ):  # fmt: skip
        config = SegmentsSection(method=method, **words)  # type: ignore[arg-type]
        for closed in (None, True, False):
            stages: list[object] = []
            found[f"{words} {closed}"] = outcome(
                lambda config=config, closed=closed, stages=stages: segments_from_points(
                    points, config, layer="p", closed=closed, observe=stages.append
                )
            )
            found[f"told {words} {closed}"] = by_kind(stages)
    config = SegmentsSection(method=method)
    found["stages"] = outcome(lambda: stages_of_points(points, config))
    found["around"] = outcome(
        lambda: segments_from_points(
            points, config.model_copy(update={"order": "bearing"}), layer="p", origin_m=(0.4, 0.5),
            gap_m=0.2,
        )
    )  # fmt: skip
    for count in range(4):
        few = points[:count]
        found[f"{count} points"] = outcome(
            lambda few=few: segments_from_points(few, config, layer="p")
        )
    GOLDEN.check(f"lines of points, {method}", found)


@pytest.mark.parametrize("method", LINE_METHODS)
def test_lines_of_scans(method: str) -> None:
    beams = [a for a in run_of("laser") if isinstance(a, Beam)][:6]
    config, found = SegmentsSection(method=method), {}
    for sigma_m in (None, 0.005, 0.05):
        stages: list[object] = []
        lines = [
            segments_from_scan(b, config, sigma_m=sigma_m, observe=stages.append) for b in beams
        ]
        found[f"{sigma_m}"] = [lines, by_kind(stages)]
    GOLDEN.check(f"lines of scans, {method}", found)


def test_pictures() -> None:
    layers, found = layers_of("rangers"), {}
    ping, dirrs, fused = (layers[n].layer.probability for n in ("ping", "dirrs", "fused"))
    for levels in (1, 2, display.REDUCED_DEPTH, display.FULL_DEPTH):
        found[f"depth {levels}"] = display.at_depth(ping, levels)
        found[f"grey {levels}"] = display.grey(np.array([[np.nan, -1.0, 0.2, 7.0]]), levels=levels)
        found[f"two {levels}"] = display.two_colours(ping, dirrs, levels=levels)
        found[f"three {levels}"] = display.three_colours(ping, dirrs, levels=levels)
        found[f"all three {levels}"] = display.three_colours(ping, dirrs, fused, levels=levels)
    found["largest"] = display.against_largest(ping * 3.0)
    found["no largest"] = display.against_largest(np.zeros((2, 3)))
    found["alpha"] = display.with_alpha(display.grey(ping), layers["ping"].layer.observed)
    classes = [a for a in run_of("rangers") if isinstance(a, Classes)]
    found["classes"] = [display.classes(each) for each in classes]
    names = tuple(f"{s} alone {w}" for s in "abcde" for w in ("occupied", "empty"))
    found["colours"] = display.class_colours(("unknown", *names, "something else"))
    GOLDEN.check("pictures", found)


def test_layers_together() -> None:
    rangers, head = layers_of("rangers"), layers_of("head")
    three = [rangers["ping"].layer, rangers["dirrs"].layer, rangers["fused"].layer]
    found = {f"classes of {n}": outcome(lambda n=n: classify(three[:n])) for n in range(4)}
    section = load_config().fusion
    weights = section.model_copy(update={"rule": "weights"})
    found["two grids"] = outcome(lambda: fuse([three[0], head["ping"].layer], [], section))
    found["none"] = outcome(lambda: fuse([], [], section))
    found["no sensors"] = outcome(lambda: fuse(three, [], weights))
    values = three[0].values
    for share in (0.25, 0.5, 0.75):
        found[f"share {share}"] = (values > 0) & (values >= share * float(values.max()))
    positions = np.array([[0.75, 1.55], [np.nan, 0.0], [40.0, 0.0]])
    for passage_m in (0.05, 0.12, 0.4):
        found[f"reached {passage_m}"] = reachable_cells(three[2], positions, passage_m=passage_m)
    found["reached from nowhere"] = reachable_cells(three[2], positions[1:])
    GOLDEN.check("layers together", found)


@pytest.mark.filterwarnings("ignore:invalid value encountered in cast")  # a probe at NaN
@pytest.mark.parametrize("name", ["rangers", "head", "laser", "odd"])
@pytest.mark.parametrize(
    "settings", [(), ("sensors.*.rasteriser=arcs", "sensors.*.second_grid=false")]
)
def test_probes_and_predictions(name: str, settings: tuple[str, ...]) -> None:
    artifacts, found = run_of(name, *settings), {}
    for at_m in ((0.3, 0.5), (1.49, 1.21), (0.02, 0.6), (1.6, 0.1), (0.95, 0.9), (0.75, 1.2)):
        probe = CellProbe(at_m)
        for artifact in artifacts:
            probe(artifact)
        found[f"probe {at_m}"] = [
            probe.touches, probe.beliefs, probe.observed, probe.cell, probe.centre_m,
            probe.strongest(5), probe.strongest(3, "ping"), probe.counts(), probe.counts("dirrs"),
            [touch.effect for touch in probe.touches],
        ]  # fmt: skip
    for at_m in ((90.0, 0.0), (float("nan"), 0.0), (0.0, -50.0)):
        found[f"outside {at_m}"] = outcome(
            lambda at_m=at_m: [CellProbe(at_m)(each) for each in artifacts[:3]]
        )
    for threshold in (0.5, 0.55, 0.8):
        predictor, predicted = RangePredictor(threshold), []
        for artifact in artifacts:
            if isinstance(artifact, Beam):
                predicted.append(predictor.ranges_m(artifact))
            predictor(artifact)
        found[f"predicted {threshold}"] = predicted
    GOLDEN.check(f"probes in {name} {' '.join(settings)}", found)


def test_grids_and_points() -> None:
    grid = GridGeometry((-0.35, 0.15), 0.05, 30, 20)
    points = np.array([[x * 0.05 - 0.5, y * 0.05 - 0.1] for x in range(40) for y in range(40)])
    cells = grid.cells_of(points)
    windows = [grid.window_around(points[k], points[k + 3]) for k in range(0, 1500, 37)]
    found = {
        "cells": cells, "centres": grid.centres_of(cells), "inside": grid.contains(cells),
        "windows": windows, "empty": [w.empty for w in windows],
        "slices": [[s.indices(99) for s in w.slices] for w in windows],
        "whole": [grid.shape, grid.size_m, grid.whole],
        "points": [a for a in run_of("head") if isinstance(a, RawPoints)],
        "beams": [
            (b.headings_rad, b.saw_something, b.points_m, b.spread_rad, b.bounds_m(1.1))
            for b in run_of("laser") if isinstance(b, Beam)
        ],
        "ridge": segments_from_ridge(thresholded(2), SegmentsSection(merge="none")),
    }  # fmt: skip
    GOLDEN.check("grids and points", found)


@pytest.mark.parametrize("rule", ["binary", "sum", "himm", "dempster-shafer"])
def test_laws_on_rules(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapping.laws.rule_laws.SAME_SPOT", 300)
    GOLDEN.check(f"laws, {rule}", {"found": check_rule(UPDATE_RULES[rule])})


@pytest.mark.parametrize("seed", [0, 1])
def test_laws_on_what_breaks_them(seed: int, monkeypatch: pytest.MonkeyPatch, plugin: Path) -> None:
    monkeypatch.setattr("mapping.laws.rule_laws.SAME_SPOT", 300)
    found = {f"{f.subject} {f.law}": f.broken for f in check_plugin(plugin, seed=seed)}
    assert sum(broken is not None for broken in found.values()) > 20
    here = f"{plugin.parent}/"  # another folder each time
    bare = {name: broken and broken.replace(here, "") for name, broken in found.items()}
    GOLDEN.check(f"broken laws {seed}", bare)


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file of rules and models that each break something."""
    for table in ("mapping.plugins.SENSOR_MODELS", "mapping.plugins.UPDATE_RULES"):
        module, _, name = table.rpartition(".")
        monkeypatch.setattr(table, _Forgetful(__import__(module, fromlist=[name]).__dict__[name]))
    file = tmp_path / "breaks.py"
    file.write_text((HERE / "regression_plugin.py").read_text("utf-8"), "utf-8")
    return file


class _Forgetful(dict):  # type: ignore[type-arg]
    """A table of which nobody else sees what is added."""


BAD_PLUGINS = {
    "empty": "x = 1\n",
    "broken": "1 / 0\n",
    "no name": "from mapping.update_rules import UpdateRule\nclass A(UpdateRule):\n    pass\n",
    "built in": (
        "from mapping.update_rules import UpdateRule\nclass A(UpdateRule):\n    name = 'bayes'\n"
    ),
    "no start": (
        "from mapping.update_rules import UpdateRule\nclass A(UpdateRule):\n    name = 'a'\n"
    ),
    "no merge": (
        "from mapping.update_rules import UpdateRule\n"
        "class A(UpdateRule):\n    name, start = 'a', {'s': 0.0}\n"
    ),
    "no occupied": (
        "from mapping.sensor_model import SensorModel\nclass A(SensorModel):\n    name = 'a'\n"
    ),
    "not made": (
        "from mapping.sensor_model import SensorModel\n"
        "class A(SensorModel):\n    name = 'a'\n    def __init__(self): raise KeyError(3)\n"
    ),
    "only a base": (
        "from mapping.sensor_model import SensorModel\nclass _A(SensorModel):\n    name = 'a'\n"
    ),
}


def test_plugins_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = {}
    for name, text in BAD_PLUGINS.items():
        Path("mine.py").write_text(text)
        found[name] = outcome(lambda: load_plugin("mine.py"))
    found["missing"] = outcome(lambda: load_plugin("missing.py"))
    GOLDEN.check("plugins refused", found)


BAD_SETTINGS = (
    "grid.resolution=0.1", "grid.resolution_m=-1", "sensors.ping.modell='x'", "gird.x=1", "=3",
    "a", "a..b=1", "grid.resolution_m=inf", "sensors.ping.beam_width_deg=361", "pose.fixed=[1,2]",
    "sensors.ping.range_error=1.0", "borders.threshold=1.01", "segments.min_points=1",
    "rerun.every=0", "grid.max_cells=0", "segments.corner_angle_deg=91", "grid.zzzz=1",
    "rerun.stages_every=-1", "sensors.ping.min_range_m=-0.1", "segments.epsilon_m=0",
)  # fmt: skip


def test_the_words_of_the_configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found: dict[str, object] = {f"preset {name}": load_config(preset=name) for name in PRESETS}
    for setting in BAD_SETTINGS:
        found[setting] = outcome(lambda setting=setting: load_config(settings=[setting]))
    found["preset"] = outcome(lambda: load_config(preset="chaptr"))
    Path("a.toml").write_text("[grid]\nresolution_m = 0.03\n[sensors.ping]\nregions = 6\n")
    Path("b.toml").write_text("[sensors.ping]\nhit = 0.5\n[pose]\nfixed = [1, 2, 3]\n")
    both = load_config([Path("a.toml"), Path("b.toml")], ["sensors.ping.hit=0.7", "pose.topic=/p"])
    found["files"] = [
        commented_toml(both),
        commented_toml(load_config()),
        both.segments.largest_rms_m,
    ]
    found["rms"] = load_config(settings=["segments.rms_m=0.5"]).segments.largest_rms_m
    Path("c.toml").write_text("[grid\n")
    for name in ("c.toml", "missing.toml"):
        found[name] = outcome(lambda name=name: load_config([Path(name)]))
    GOLDEN.check("configuration", {k: repr(v) for k, v in found.items()})


def test_the_commands(plugin: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapping.laws.rule_laws.SAME_SPOT", 300)
    run = CliRunner()
    config = run.invoke(cli.config, ["--preset", "chapter", "--set", "grid.resolution_m=0.02"])
    check = run.invoke(cli.check, [str(plugin)], standalone_mode=False)
    good = plugin.with_name("good.py")
    good.write_text(
        "from mapping.sensor_model.models import Peak\nclass Mine(Peak):\n    name = 'my-peak'\n"
    )
    kept = run.invoke(cli.check, [str(good)], standalone_mode=False)
    config_plugins = ["plugins", ["--plugin"]]  # came after the golden values
    options = [[c.help, [[p.name, p.opts] for p in c.params]] for c in cli.COMMANDS]
    options[0][1].remove(config_plugins)
    broken = check.output.replace(f"{plugin.parent}/", "")  # another folder each time
    found = {
        "config": [config.output, config.exit_code], "check": [broken, check.return_value],
        "kept": [kept.output, kept.return_value], "names": [c.name for c in cli.COMMANDS],
        "options": options,
    }  # fmt: skip
    GOLDEN.check("commands", found)
