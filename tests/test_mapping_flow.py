"""One flow: watched or not, live or file, one thread or two, the maps are the same to the bit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from mapping.artifacts import Artifact, Finished, MergedGrid, Snapshot, Started, TempGrid
from mapping.beams import Beam
from mapping.config import MappingConfig, load_config
from mapping.live_pipeline import build_live_maps
from mapping.pipeline import build_maps, stretches
from mapping.placed_session import place_session
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Scan
from recorder.session import read_session
from recorder.session.columns import open_session

LOGS = Path(__file__).resolve().parent.parent / "logs"
RULES = (
    "bayes", "odds", "count", "sum", "binary", "dempster-shafer", "himm", "saturating", "pooled",
)  # fmt: skip
MODELS = ("fading", "regions", "peak")
EVERYTHING = [(rule, model) for rule in RULES for model in MODELS]
COARSE = "grid.resolution_m=0.04"
OF_A_READING = (Beam, TempGrid, MergedGrid)


def config(*settings: str) -> MappingConfig:
    return load_config((), [COARSE, *settings], None)


def on_one_grid(artifacts: Iterable[Artifact], configuration: MappingConfig) -> MappingConfig:
    """The configuration with the grid of a run, so that live maps do not grow."""
    started = next(iter(artifacts))
    assert isinstance(started, Started)
    size_m = tuple(v - 0.25 * started.geometry.resolution_m for v in started.geometry.size_m)
    fixed = {"origin_m": started.geometry.origin_m, "size_m": size_m}
    grid = configuration.grid.model_copy(update=fixed)
    return configuration.model_copy(update={"grid": grid})


def bytes_of(artifacts: Iterable[Artifact]) -> dict[str, tuple[bytes, ...]]:
    layers = [a.layer for a in artifacts if isinstance(a, Snapshot) and a.final]
    return {
        each.name: tuple(
            array.tobytes()
            for array in (each.values, each.probability, each.observed, *each.extra.values())
        )
        for each in layers
    }


@pytest.fixture(autouse=True)
def _threads_however_few_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse maps are quick; what two threads make of them is tried all the same."""
    monkeypatch.setattr("mapping.batches._CELLS_WORTH_A_THREAD", 0)
    monkeypatch.setattr("mapping.kernels.batch.threads._WORTH", 0.0)


def assert_one_map(messages: list[Message], *settings: str, live: bool = True) -> None:
    configuration = on_one_grid(build_maps(messages, config(*settings)), config(*settings))
    watched = list(build_maps(messages, configuration))
    expected = bytes_of(watched)
    assert any(isinstance(a, MergedGrid) for a in watched)
    for threads in (1, 2):
        found = list(build_maps(messages, configuration, watched=False, threads=threads))
        assert not any(isinstance(a, OF_A_READING) for a in found)
        assert bytes_of(found) == expected, f"unwatched, {threads} threads"
        assert [type(a) for a in found] == [
            type(a) for a in watched if not isinstance(a, OF_A_READING)
        ]
        assert found[-1] == watched[-1]
    if live:
        assert bytes_of(build_live_maps(messages, configuration)) == expected, "live"


def settings_of(rule: str, model: str) -> list[str]:
    return [f"sensors.*.update={rule}", f"sensors.*.model={model}"]


@pytest.mark.parametrize(("rule", "model"), EVERYTHING)
def test_a_recorded_session(rule: str, model: str) -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())[:1500]
    assert_one_map(messages, *settings_of(rule, model))


@pytest.mark.parametrize("name", ["boxes_A", "flat_B", "lshape_C", "skew_A"])
@pytest.mark.real_data
def test_shared_rooms(shared_data: Path, name: str) -> None:
    path = shared_data / "rooms" / f"{name}.mcap"
    assert_one_map(list(read_session(path).messages())[:4000], live=False)


@pytest.mark.parametrize("rule", RULES)
def test_a_map_that_forgets(rule: str) -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())[:600]
    assert_one_map(messages, "sensors.ping.forget_s=3", f"sensors.*.update={rule}")


@pytest.mark.parametrize("rule", RULES)
def test_obstacles_too_far_to_be_marked(rule: str) -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())[:600]
    near = ["sensors.*.mark_to_m=0.5", f"sensors.*.update={rule}"]
    assert_one_map(messages, *near)
    everywhere, marked = (
        next(a.layer for a in build_maps(messages, config(*settings), watched=False)
             if isinstance(a, Snapshot) and a.layer.name == "ping")
        for settings in (near[1:], near)
    )  # fmt: skip
    assert (marked.probability > 0.5).sum() < (everywhere.probability > 0.5).sum()


@pytest.mark.parametrize("settings", [
    ["sensors.ping.rasteriser=arcs"],
    ["sensors.*.no_echo=empties", "sensors.ping.beam_width_deg=200"],
    ["sensors.*.kind=ultrasonic", "sensors.ping.model=regions", "sensors.dirrs.model=fading"],
    ["grid.origin_m=[0.3, 0.4]", "grid.size_m=[0.8, 0.5]"],
])  # fmt: skip
def test_what_no_kernel_knows_and_what_the_grid_cuts(settings: list[str]) -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())[:1500]
    assert_one_map(messages, *settings, live=False)


def scans(count: int) -> list[Message]:
    """A laser that turns; some of its beams fail, other ones each time, and one scan has one."""
    draw, ns = np.random.default_rng(5), 100_000_000
    messages: list[Message] = []
    for k in range(count):
        messages.append(Pose(k * ns, SE2(0.02 * k, 0.01 * k, 0.1 * k)))
        ranges = draw.uniform(0.5, 2.5, 60)
        ranges[draw.uniform(size=60) < (0.1 if k % 3 else 0.0)] = math.nan
        ranges[draw.uniform(size=60) < 0.1] = math.inf
        if k == 7:
            ranges[1:] = math.nan
        step = 2.0 * math.pi / 60
        messages.append(Scan(k * ns, "lidar", ranges, -math.pi, step, 0.05, 12.0))
    return messages


@pytest.mark.parametrize("rule", ["bayes", "count", "himm"])
def test_scans(rule: str) -> None:
    assert_one_map(scans(24), f"sensors.lidar.update={rule}", "sensors.lidar.model=fading")


def test_a_file_gone_through_by_columns_gives_the_maps_of_its_messages() -> None:
    path = LOGS / "room.mcap"
    by_columns = build_maps(open_session(path), config(), watched=False)
    one_by_one = build_maps(read_session(path).messages(), config(), watched=False)
    assert bytes_of(by_columns) == bytes_of(one_by_one)


@pytest.mark.parametrize("every", [1, 7, 100, 100_000])
def test_stretches_end_where_stages_are_shown(every: int) -> None:
    placed = place_session(read_session(LOGS / "room.mcap").messages(), config())
    found = list(stretches(placed, every))
    ends = [each.first_number + len(each) for each in found]
    total = sum(placed.counts.used.values())
    assert ends == [*range(every, total, every), total]
    assert sum(len(each) for each in found) == total
    whole = next(stretches(placed, 0))
    assert [b.t_ns for each in found for b in each.beams()] == [b.t_ns for b in whole.beams()]


def test_stages_in_between_are_the_same_watched_or_not() -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())[:1500]
    often = config("rerun.stages_every=50")
    runs = [list(build_maps(messages, often, watched=watched)) for watched in (True, False)]
    maps = [[a.layer for a in run if isinstance(a, Snapshot)] for run in runs]
    assert len(maps[0]) == len(maps[1]) > 6
    for one, two in zip(*maps, strict=True):
        assert one.values.tobytes() == two.values.tobytes()
    assert isinstance(runs[1][-1], Finished)


def test_who_counts_is_called_with_how_many_are_merged() -> None:
    messages = list(read_session(LOGS / "room.mcap").messages())[:1500]
    for watched in (True, False):
        counts: list[int] = []
        *_, finished = build_maps(messages, config(), watched=watched, merged=counts.append)
        assert isinstance(finished, Finished)
        assert counts[-1] == sum(finished.used.values())
        assert counts == sorted(counts)
