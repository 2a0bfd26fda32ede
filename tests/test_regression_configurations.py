"""Every model, rule, rasteriser, line method and option gives what it gave: all that a run yields.

``pytest -n0 --update-golden`` writes the expected fingerprints anew, after a change that is meant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fingerprints import Golden, by_kind, outcome
from regression_sessions import (
    WALLS_M,
    laser,
    odd,
    odometry_only,
    turning_head,
    two_rangers,
)

from mapping.config import MappingConfig, load_config
from mapping.live_pipeline import build_live_maps
from mapping.pipeline import build_maps
from recorder.messages import Message

GOLDEN = Golden(Path(__file__).parent / "golden" / "configurations.json")
COARSE = "grid.resolution_m=0.05"
RULES = (
    "binary", "count", "sum", "bayes", "odds", "dempster-shafer", "himm", "saturating", "pooled",
)  # fmt: skip
METHODS = ("split-and-merge", "incremental", "line-regression", "ransac", "hough", "em")

Case = tuple[Callable[[], tuple[Message, ...]], tuple[str, ...]]


def all_sensors(*pairs: str) -> tuple[str, ...]:
    return (COARSE, *(f"sensors.*.{pair}" for pair in pairs))


def rule_cases() -> Iterator[tuple[str, Case]]:
    for rule in RULES:
        for raster in (("cells",), ("arcs",), ("arcs", "second_grid=false")):
            settings = all_sensors(f"update={rule}", f"rasteriser={raster[0]}", *raster[1:])
            yield f"{rule}, {' '.join(raster)}", (two_rangers, settings)
        yield f"{rule}, laser", (laser, all_sensors(f"update={rule}"))


def model_cases() -> Iterator[tuple[str, Case]]:
    for gaussian, emptiness in (
        ("both", "none"), ("both", "constant"), ("both", "linear"), ("both", "combined"),
        ("angle", "combined"), ("distance", "linear"), ("none", "constant"),
    ):  # fmt: skip
        shape = (f"gaussian={gaussian}", f"emptiness={emptiness}")
        for model in (("regions", "regions=18"), ("regions", "regions=6"), ("peak", "p_hit=0.8")):
            settings = all_sensors(f"model={model[0]}", *model[1:], *shape)
            yield f"{' '.join(model)}, {gaussian}, {emptiness}", (two_rangers, settings)
    for model in ("regions", "peak", "fading"):
        arcs = all_sensors(f"model={model}", "rasteriser=arcs", "gaussian=none")
        yield f"{model}, arcs, no Gaussian", (two_rangers, arcs)
        yield f"{model}, laser", (laser, all_sensors(f"model={model}"))
        yield f"{model}, laser, arcs", (laser, all_sensors(f"model={model}", "rasteriser=arcs"))


def sensor_cases() -> Iterator[tuple[str, Case]]:
    for pairs in (
        ("model=peak", "p_miss=0.2"), ("hit=1.5", "miss=0.3", "near=3.0"), ("fade_m=0.4",),
        ("before=0.2", "behind=0.3"), ("before=0.0", "behind=0.0"), ("beam_width_deg=200",),
        ("beam_width_deg=360",), ("model=peak", "range_error=0.3"), ("no_echo='empties'",),
        ("model=peak", "range_error=0.0"), ("no_echo='skipped'",), ("mount=[0.1, -0.05, 30.0]",),
        ("min_range_m=0.4",), ("max_range_m=0.6",), ("layer='one'",), ("kind='dirrs'",),
        ("beam_width_deg=200", "rasteriser=arcs"), ("model=nonsense",), ("update=byes",),
        ("model=regions", "regions=7"), ("rasteriser=arcs", "range_error=0.0", "model=peak"),
    ):  # fmt: skip
        yield " ".join(pairs), (two_rangers, all_sensors(*pairs))
    yield "a head, mount set", (turning_head, (COARSE, "sensors.ping.mount=[0.1, 0.0, 10.0]"))
    yield "one of them", (two_rangers, (COARSE, "sensors.ping.update=count"))
    yield "odd, named", (odd, (COARSE, "sensors.sharp.kind='lidar'", "sensors.ping2.layer='x'"))


def pose_and_grid_cases() -> Iterator[tuple[str, Case]]:
    for settings in (
        ("pose.topic='/odom'",), ("pose.topic='/odom'", "pose.odom_start='tracker'"),
        ("pose.max_gap_s=0.06",), ("pose.fixed=[0.5, 0.6, 30.0]",), ("rerun.stages_every=30",),
        ("grid.origin_m=[-0.5, -0.5]",), ("grid.size_m=[1.5, 1.25]",), ("grid.max_cells=100",),
        ("grid.origin_m=[0.2, 0.1]", "grid.size_m=[1.0, 0.77]"), ("borders.threshold=0.3",),
        ("borders.threshold=0.9",), ("borders.tracer='chapter'",), ("fusion.rule='weights'",),
        ("fusion.rule='weights'", "fusion.weights='range'"),
        ("fusion.rule='weights'", "fusion.weights='equal'"),
        ("fusion.rule='weights'", "fusion.weights={ping=3.0, dirrs=1.0}"),
        ("fusion.rule='weights'", "fusion.weights={ping=3.0}"),
        ("fusion.rule='weights'", "fusion.weights={ping=0.0, dirrs=0.0}"),
        ("fusion.rule='weights'", "fusion.weights={ping=3.0, dirrs=1.0, lidr=1.0}"),
    ):  # fmt: skip
        yield " ".join(settings), (two_rangers, (COARSE, *settings))
    yield "odometry only", (odometry_only, (COARSE,))
    yield "odometry laid on nothing", (odometry_only, (COARSE, "pose.odom_start='tracker'"))
    yield "a head", (turning_head, (COARSE,))
    yield "a tag on the head", (turning_head, (COARSE, "pose.rides_on='head'"))
    yield "odd", (odd, (COARSE,))
    yield "nothing", (tuple, (COARSE,))
    yield "poses only", (lambda: two_rangers()[:3], (COARSE,))


def line_cases() -> Iterator[tuple[str, Case]]:
    fine = "grid.resolution_m=0.02"
    for method in METHODS:
        for source in ("borders", "ridge"):
            settings = (fine, f"segments.method={method}", f"segments.source={source}")
            yield f"{method}, {source}", (two_rangers, settings)
        yield f"{method}, laser", (laser, (fine, f"segments.method={method}"))
    for settings in (
        ("fit='y-on-x'",), ("wrap='off'",), ("wrap='drop'",), ("merge='angle'",), ("merge='none'",),
        ("merge='collinear'",), ("merge='endpoints'",), ("order='bearing'",), ("order='path'",),
        ("epsilon_m=0.02",), ("epsilon_m=0.15",), ("rms_m=0.005",), ("min_points=12",),
        ("min_length_m=0.5",), ("wall_m=0.3",), ("wall_m=0.0",), ("gap_m=0.05",), ("gap_m=1.0",),
        ("corner_angle_deg=60",), ("corner_reach_m=0.02",), ("corner_reach_m=1.0",),
        ("merge='angle'", "merge_angle_deg=40"), ("method='ransac'", "seed=3"), ("method='magic'",),
    ):  # fmt: skip
        names = tuple(f"segments.{each}" for each in settings)
        yield " ".join(settings), (two_rangers, (fine, *names))
        yield f"{' '.join(settings)}, laser", (laser, (fine, *names))


CASES: dict[str, Case] = {
    "as it comes": (two_rangers, (COARSE,)),
    **dict(rule_cases()),
    **dict(model_cases()),
    **dict(sensor_cases()),
    **dict(pose_and_grid_cases()),
    **dict(line_cases()),
}


def results(
    messages: Callable[[], tuple[Message, ...]], config: MappingConfig
) -> dict[str, object]:
    """All artifacts of a run by their kinds, or why there are none."""
    yielded = outcome(lambda: build_maps(messages(), config, walls_m=WALLS_M))
    return by_kind(yielded) if isinstance(yielded, list) else {"refused": yielded}


LINES_ALONE = frozenset(name for name, _ in line_cases())
PER_READING = ("Beam", "TempGrid", "MergedGrid")


@pytest.fixture(autouse=True)
def _compare_or_update(request: pytest.FixtureRequest) -> None:
    GOLDEN.update = bool(request.config.getoption("--update-golden", default=False))


@pytest.mark.parametrize("name", CASES)
def test_a_configuration_gives_what_it_gave(name: str) -> None:
    messages, settings = CASES[name]
    found = results(messages, load_config(settings=settings))
    if name in LINES_ALONE:
        found = {kind: value for kind, value in found.items() if kind not in PER_READING}
    GOLDEN.check(name, found)


@pytest.mark.parametrize("preset", ["chapter"])
def test_a_preset_gives_what_it_gave(preset: str) -> None:
    config = load_config(settings=[COARSE], preset=preset)
    GOLDEN.check(f"preset {preset}", results(two_rangers, config))


LIVE: dict[str, tuple[Case, int]] = {  # how many messages are followed before some come late
    "two rangers": ((two_rangers, (COARSE,)), 10_000),
    "stages": ((two_rangers, (COARSE, "rerun.stages_every=40")), 10_000),
    "late": ((two_rangers, (COARSE,)), 300),
    "a head": ((turning_head, (COARSE,)), 10_000),
    "odd": ((odd, (COARSE,)), 10_000),
    "laser": ((laser, (COARSE,)), 10_000),
    "odometry": ((odometry_only, (COARSE, "pose.topic='/odom'")), 10_000),
    "a given grid": ((two_rangers, (COARSE, "grid.origin_m=[0.0, 0.0]")), 10_000),
    "a given size": ((two_rangers, (COARSE, "grid.size_m=[1.0, 1.0]")), 10_000),
    "standing still": ((two_rangers, (COARSE, "pose.fixed=[0.5, 0.6, 30.0]")), 10_000),
    "nothing": ((tuple, (COARSE,)), 10_000),
}


@pytest.mark.parametrize("name", LIVE)
def test_a_stream_gives_what_it_gave(name: str) -> None:
    (messages, settings), on_time = LIVE[name]
    config, asked = load_config(settings=settings), iter(range(10_000))

    def is_late() -> bool:
        k = next(asked)
        return k >= on_time and k % 50 < 40

    yielded = outcome(lambda: build_live_maps(messages(), config, walls_m=WALLS_M, is_late=is_late))
    found = by_kind(yielded) if isinstance(yielded, list) else {"refused": yielded}
    GOLDEN.check(f"live, {name}", found)
