"""Several maps of one session go in step, and each is in the recording as it is alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from comparison_support import COARSE, names, short_session
from hypothesis import given, settings
from hypothesis import strategies as st
from made_run import MadeRun

from echogrid import main
from mapping.artifacts import Artifact, Finished, MergedGrid, Snapshot, Started, TempGrid
from mapping.beams import Beam
from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.errors import BadInput
from recorder.messages import Radiation, Range
from recorder.session import read_session
from replay.comparison import Variant, from_values
from replay.comparison_run import compare_session
from replay.comparison_steps import in_step
from replay.rrd.comparison import comparison_writer
from replay.rrd.reader import read_maps, read_rrd


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_session(tmp_path_factory.mktemp("comparison"))


# In step

RUN = MadeRun(readings=14)
ARTIFACTS = list(RUN.artifacts())
BEAMS = [artifact for artifact in ARTIFACTS if isinstance(artifact, Beam)]
MESSAGES = [Range(b.t_ns, b.sensor, 1.0, 0.1, 0.0, 4.0, Radiation.ULTRASOUND) for b in BEAMS]


def without(left_out: set[int]) -> list[Artifact]:
    """The made run as it would come if some readings were dropped."""
    kept: list[Artifact] = []
    number = -1
    for artifact in ARTIFACTS:
        if isinstance(artifact, Beam):
            number += 1
        of_a_reading = isinstance(artifact, Beam | TempGrid | MergedGrid)
        if not (of_a_reading and number in left_out):
            kept.append(artifact)
    return kept


@settings(deadline=None, max_examples=40)
@given(st.lists(st.sets(st.integers(0, 13), max_size=12), min_size=1, max_size=4))
def test_runs_go_in_step_whatever_each_leaves_out(left_out: list[set[int]]) -> None:
    runs = {f"run{i}": without(some) for i, some in enumerate(left_out)}
    moments = list(in_step(runs, MESSAGES))
    for name, run in runs.items():
        seen = [moment[name] for moment in moments if name in moment]
        assert [id(a) for a in seen] == [id(a) for a in run]
    times = []
    for moment in moments:
        beams = [a for a in moment.values() if isinstance(a, Beam)]
        if beams:
            assert len(beams) == len(moment)
            assert len({(beam.sensor, beam.t_ns) for beam in beams}) == 1
            times.append(beams[0].t_ns)
    assert times == sorted(set(times))
    used = set(range(14)) - set.intersection(*left_out)
    assert len(times) == len(used)
    assert all(isinstance(a, Finished) for a in moments[-1].values())
    assert set(moments[-1]) == set(runs)


def test_alike_runs_share_every_moment() -> None:
    moments = list(in_step({"a": ARTIFACTS, "b": ARTIFACTS}, MESSAGES))
    assert len(moments) == len(ARTIFACTS)
    assert all(moment["a"] is moment["b"] for moment in moments)


def test_readings_of_one_time_are_distinguished() -> None:
    still = [Range(5, "ping", 1.0, 0.1, 0.0, 4.0, Radiation.ULTRASOUND) for _ in range(4)]
    beam = RUN.beam(0)
    beams = [Beam(i, 5, "ping", "ping", beam.world_from_base, beam.world_from_sensor,
                  beam.bearings_rad, beam.ranges_m, 0.1, 4.0) for i in range(4)]  # fmt: skip
    moments = list(in_step({"a": beams, "b": beams}, still))
    assert [moment["a"].number for moment in moments] == [0, 1, 2, 3]
    assert all(moment["a"] is moment["b"] for moment in moments)


def test_stages_on_the_way_stay_with_their_reading(session: Path) -> None:
    messages = list(read_session(session).messages())
    often = load_config(settings=[COARSE, "rerun.stages_every=40"])
    never = load_config(settings=[COARSE])
    runs = {"often": build_maps(messages, often), "never": build_maps(messages, never)}
    reading, halfway = -1, 0
    for moment in in_step(runs, messages):
        beams = [a for a in moment.values() if isinstance(a, Beam)]
        reading = beams[0].number if beams else reading
        snapshots = {n: a for n, a in moment.items() if isinstance(a, Snapshot)}
        if snapshots and not next(iter(snapshots.values())).final:
            assert list(snapshots) == ["often"]
            assert (reading + 1) % 40 == 0
            halfway += 1
        elif snapshots:
            assert list(snapshots) == ["often", "never"]
    assert halfway >= 2


# In the recording


def grids_alone(path: Path, variant: Variant) -> dict[str, list[np.ndarray]]:
    """The values of each layer after each of its readings, by mapping a session by itself."""
    grids: dict[str, list[np.ndarray]] = {}
    now: dict[str, np.ndarray] = {}
    for artifact in build_maps(read_session(path).messages(), variant.config):
        if isinstance(artifact, Started):
            shape = artifact.geometry.shape
        if isinstance(artifact, MergedGrid):
            if artifact.layer not in now:
                start = {"probability": 0.5, "odds": 1.0}.get(artifact.kind, 0.0)
                now[artifact.layer] = np.full(shape, start, np.float32)
            now[artifact.layer][artifact.window.slices] = artifact.values
            grids.setdefault(artifact.layer, []).append(now[artifact.layer].copy())
    return grids


@pytest.fixture(scope="module")
def all_rules(session: Path) -> tuple[Path, list[Variant]]:
    path = session.with_name("rules.rrd")
    variants = from_values("rules", settings=[COARSE])
    compare_session(session, variants, rrd=path, export=None)
    return path, variants


def test_every_map_reads_back_as_it_is_alone(
    all_rules: tuple[Path, list[Variant]], session: Path
) -> None:
    path, variants = all_rules
    maps = read_maps(path)
    assert list(maps) == names(variants)
    for variant in variants:
        alone = grids_alone(session, variant)
        for layer, expected in alone.items():
            recording = maps[variant.name]
            merged = [
                step.step for step in recording.steps
                if step.artifact == "MergedGrid" and step.layer == layer and layer in step.exact
            ]  # fmt: skip
            changes = dict(recording.grids(layer))  # of the steps that changed anything
            assert len(merged) == len(expected)
            for step, grid in zip(merged, expected, strict=True):
                newest = max((each for each in changes if each <= step), default=None)
                if newest is None:  # nothing happened yet
                    assert (grid == grid[0, 0]).all()
                else:
                    assert changes[newest].tobytes() == grid.tobytes()
            assert recording.grid(layer, merged[-1]).tobytes() == expected[-1].tobytes()


def test_the_same_step_is_the_same_reading_in_all_maps(
    all_rules: tuple[Path, list[Variant]],
) -> None:
    maps = read_maps(all_rules[0])
    first, *others = maps.values()
    readings = {s.step: s for s in first.steps if s.artifact in ("Beam", "TempGrid", "MergedGrid")}
    assert len(readings) > 200
    for other in others:
        there = {s.step: s for s in other.steps if s.step in readings}
        assert set(there) == set(readings)
        for step, one in readings.items():
            assert (one.reading, one.t_ns, one.artifact, one.layer) == (
                there[step].reading, there[step].t_ns, there[step].artifact, there[step].layer,
            )  # fmt: skip


def test_a_small_file_shows_the_same_readings_of_all_and_reports_it(
    session: Path, tmp_path: Path
) -> None:
    whole, path = tmp_path / "whole.rrd", tmp_path / "small.rrd"
    compared, fine = "sensors.*.update=bayes,count,himm", "grid.resolution_m=0.02"
    compare_session(session, from_values(compared, settings=[fine]), rrd=whole, export=None)
    budget_mb = round(0.6e-6 * whole.stat().st_size, 2)
    variants = from_values(compared, settings=[fine, f"rerun.budget_mb={budget_mb}"])
    result = compare_session(session, variants, rrd=path, export=None)
    assert f"{budget_mb:g} MB" in result.results["bayes"].left_out
    assert path.stat().st_size < whole.stat().st_size
    shown = [
        {step.reading for step in recording.steps if step.artifact == "Beam"}
        for recording in read_maps(path).values()
    ]
    assert shown[0] == shown[1] == shown[2]
    for name, recording in read_maps(path).items():  # and the end is exact, whatever was left out
        final = next(s for s in result.results[name].snapshots if s.layer.name == "ping")
        assert recording.grid("ping").tobytes() == final.layer.values.tobytes()


def test_a_comparison_is_no_single_map_and_the_other_way_round(
    all_rules: tuple[Path, list[Variant]], session: Path, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match="holds several maps: binary, count, sum"):
        read_rrd(all_rules[0])
    single = tmp_path / "single.rrd"
    assert main(["map", str(session), "-o", str(single), "--set", COARSE, "--quiet"]) == 0
    with pytest.raises(BadInput, match="holds one map"):
        read_maps(single)


def test_a_reading_that_only_one_map_uses(session: Path, tmp_path: Path) -> None:
    path = tmp_path / "reach.rrd"
    variants = from_values("sensors.ping.max_range_m=0.9,4.0", settings=[COARSE])
    result = compare_session(session, variants, rrd=path, export=None).results
    near, far = read_maps(path).values()
    beams = [{(b.t_ns, b.sensor): b.number for _, b in each.beams()} for each in (near, far)]
    assert 0 < len(beams[0]) < len(beams[1])
    assert sum(result["max_range_m-0.9"].finished.used.values()) == len(beams[0])
    assert all(beams[1][key] == number for key, number in beams[0].items())


def test_a_broken_off_comparison_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "none.rrd"
    variants = [Variant("a", load_config()), Variant("b", load_config())]

    def broken() -> Iterator[None]:
        with comparison_writer(path, variants, name="made") as writer:
            for number, artifact in enumerate(ARTIFACTS):
                writer({"a": artifact, "b": artifact})
                if number == 9:
                    raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        list(broken())
    assert list(tmp_path.iterdir()) == []
