"""Several maps of one session: which they are, how they differ, and what is reported of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from comparison_support import COARSE, names, short_session, toml
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_live_placing import LivePlacer
from naive_placing import laid_on
from naive_poses import Track

from echogrid import main
from mapping.artifacts import Segment, Snapshot, Started, TempGrid
from mapping.config import load_config
from mapping.fusion import FUSED
from mapping.grid import GridGeometry, Layer
from mapping.pipeline import build_maps
from mapping.update_rules import UPDATE_RULES
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Range, Scan
from recorder.session import read_session
from replay.comparison import Variant, from_files, from_values
from replay.comparison_run import compare_session
from replay.comparison_steps import Distances, Moment, in_step
from replay.comparison_table import footnotes, map_rows, same_maps, table_of
from replay.mapping_run import map_session
from replay.rrd.comparison_explanation import Compared, describe_moment
from replay.rrd.reader import read_maps

FINITE = {"allow_nan": False, "allow_infinity": False}
POSES = st.builds(
    SE2,
    st.floats(-9, 9, **FINITE),
    st.floats(-9, 9, **FINITE),
    st.floats(-3.1, 3.1, **FINITE),
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_session(tmp_path_factory.mktemp("comparison"))


# Which maps


def test_each_file_is_one_map_and_settings_go_to_all(tmp_path: Path) -> None:
    one = toml(tmp_path, "one", "[sensors.ping]\nupdate = 'count'\n")
    two = toml(tmp_path, "two", "[grid]\nresolution_m = 0.1\n")
    first, second = from_files([one, two], ["borders.threshold=0.6"])
    assert (first.name, second.name) == ("one", "two")
    assert (first.config.grid.resolution_m, second.config.grid.resolution_m) == (0.01, 0.1)
    assert first.config.sensors["ping"].update == "count"
    assert second.config.sensors == {}
    assert {v.config.borders.threshold for v in (first, second)} == {0.6}


def test_the_shorthands_name_all_rules_all_models_and_both_poses() -> None:
    rules = from_values("rules")
    assert names(rules) == list(UPDATE_RULES)
    assert [v.config.sensors["*"].update for v in rules] == names(rules)
    models = from_values("models")
    assert {"regions", "peak", "fading"} <= set(names(models))
    assert {v.config.sensors["*"].update for v in models} == {"bayes"}  # only the models differ
    for each in from_values("models", settings=["sensors.ping.update=count"]):
        assert each.config.sensors["*"].update is None
        assert each.config.sensors["ping"].update == "count"
    tracker, wheels = from_values("pose")
    assert (tracker.name, wheels.name) == ("pose", "odom")
    assert (tracker.config.pose.odom_start, wheels.config.pose.odom_start) == ("own", "tracker")
    assert "tracker" in wheels.note


def test_a_sensor_that_has_the_key_itself_takes_the_values_too(tmp_path: Path) -> None:
    file = toml(tmp_path, "base", "[sensors.ping]\nupdate = 'himm'\nregions = 6\n")
    for variant in from_values("sensors.*.update=bayes,count", [file]):
        assert variant.config.sensors["ping"].update == variant.name
        assert variant.config.sensors["ping"].regions == 6


@pytest.mark.parametrize(
    ("compare", "expected"),
    [
        ("grid.resolution_m=0.02,0.1", ["resolution_m-0.02", "resolution_m-0.1"]),
        ("grid.origin_m=[0,0],[1, 2]", ["origin_m-0_0", "origin_m-1_2"]),
        ("sensors.*.second_grid=true,false", ["second_grid-true", "second_grid-false"]),
        ("segments.method=ransac,hough", ["ransac", "hough"]),
    ],
)
def test_values_of_any_key_make_names(compare: str, expected: list[str]) -> None:
    assert names(from_values(compare)) == expected


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--compare", "rulez"], "unknown comparison 'rulez'; the nearest known one is rules"),
        (["--compare", "foo"], "there are rules, models, pose, or A.B=C,D with values of one key"),
        (["--compare", "bayes,himm"], "Write --compare sensors.*.update=bayes,himm"),
        (["--compare", "a,b"], "Write --compare A.B=a,b"),
        (["--compare", "sensors.*.update=bayes,bays"], "unknown update rule 'bays'"),
        (["--compare", "sensors.*.model=peek,fading"], "the nearest known one is peak"),
        (["--compare", "grid.resolution=1,2"], "unknown key grid.resolution"),
        (["--compare", "grid.resolution_m=0.1"], "name two values or more"),
        (["--compare", "grid.resolution_m=0.1,0.1"], "2 of the maps to compare would be called"),
        (["--compare", "rules", "--probe", "0.5,0.5"], "--probe follows a cell of one map"),
        (["--compare", "rules", "--config", "{a}", "--config", "{b}"], "give one --config"),
        (["--config", "{a}", "--config", "{other_a}"], "2 of the maps to compare would be called"),
        (["--config", "{a}", "--config", "{broken}"], "broken.toml: unknown key grid.res"),
        (["--config", "{a}", "--config", "{nowhere}"], "nowhere.toml: no such file"),
        (["--config", "{a}", "--config", "{rule}"], "rule: unknown update rule 'never'"),
    ],
)
def test_what_cannot_be_compared_is_reported_in_one_line(
    arguments: list[str], message: str, session: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "other").mkdir()
    files = {
        "a": toml(tmp_path, "a", ""),
        "b": toml(tmp_path, "b", ""),
        "other_a": toml(tmp_path / "other", "a", ""),
        "broken": toml(tmp_path, "broken", "[grid]\nres = 1\n"),
        "rule": toml(tmp_path, "rule", "[sensors.ping]\nupdate = 'never'\n"),
        "nowhere": tmp_path / "nowhere.toml",
    }
    filled = [argument.format(**files) for argument in arguments]
    out = tmp_path / "out.rrd"
    assert main(["map", str(session), "-o", str(out), *filled]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert message in captured.err
    assert not out.exists()


# Wheels beside the tracker


@settings(deadline=None, max_examples=60)
@given(POSES, st.lists(POSES, min_size=2, max_size=6), st.integers(0, 3))
def test_exact_dead_reckoning_lies_on_the_tracker(
    odom_from_world: SE2, poses: list[SE2], late: int
) -> None:
    t_ns = [i * 100 for i in range(len(poses))]
    odometry = Track.of(
        [(t, odom_from_world @ pose) for t, pose in zip(t_ns, poses, strict=True)], 1.0
    )
    known = list(zip(t_ns, poses, strict=True))[min(late, len(poses) - 1) :]
    laid = laid_on(odometry, Track.of(known, 1.0))
    for time, pose in zip(t_ns, poses, strict=True):
        found = laid.at(time)
        assert found is not None
        assert math.hypot(found.x_m - pose.x_m, found.y_m - pose.y_m) < 1e-9
        turned = (found.heading_rad - pose.heading_rad + math.pi) % (2 * math.pi) - math.pi
        assert abs(turned) < 1e-9


def test_dead_reckoning_without_a_common_time_is_refused() -> None:
    early = Track.of([(0, SE2(0, 0, 0)), (10, SE2(0, 0, 0))], 1.0)
    late = Track.of([(20, SE2(0, 0, 0)), (30, SE2(0, 0, 0))], 1.0)
    with pytest.raises(BadInput, match="no time at which"):
        laid_on(early, late)


def test_a_live_map_cannot_be_laid_on_the_tracker() -> None:
    with pytest.raises(BadInput, match="needs a finished session"):
        LivePlacer(load_config(settings=["pose.odom_start=tracker"]))


def test_a_map_from_the_wheels_starts_at_the_tracker_and_drifts(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["map", str(session), "-o", "-", "--compare", "pose", "--set", COARSE]) == 0
    out = capsys.readouterr().out
    assert "laid on the tracker's pose at its start" in out
    assert "odom: the robot ends 0." in out
    variants = from_values("pose", settings=[COARSE])
    messages = list(read_session(session).messages())
    distances, first = Distances(), {}
    for moment in in_step({v.name: build_maps(messages, v.config) for v in variants}, messages):
        distances.take(moment)
        first = first or dict(distances.last)
    assert first["odom"][0] < 0.02  # tracker noise and the first centimetres
    assert distances.last["odom"][0] < 0.5


# The numbers


def layer(values: list[list[float]], origin_m: tuple[float, float] = (0.0, 0.0)) -> Snapshot:
    p = np.array(values, np.float32)
    geometry = GridGeometry(origin_m, 1.0, *p.shape)
    return Snapshot(Layer("ping", "probability", geometry, p, p, p != 0.5, {}), "bayes", True)


def test_the_table_counts_cells_and_compares_them_where_they_lie() -> None:
    first = layer([[0.9, 0.1, 0.5], [0.52, 0.9, 0.1]])
    same = layer([[0.5, 0.5, 0.5, 0.5], [0.5, 0.95, 0.2, 0.5], [0.5, 0.53, 0.6, 0.3]], (-1.0, -1.0))
    other = layer([[0.1, 0.1, 0.9], [0.52, 0.9, 0.1]])
    snapshots = {"first": [first], "same": [same], "other": [other]}
    lines = map_rows(snapshots, "ping", dict.fromkeys(snapshots, 0.55))
    assert [(x.occupied, x.free, x.undecided) for x in lines] == [(2, 2, 1), (2, 2, 1), (2, 3, 1)]
    assert [line.differs for line in lines] == [None, 0.0, pytest.approx(2 / 6)]
    table = table_of(lines)
    assert table[0] == ("map", "occupied", "free", "undecided", "differs from first")
    assert table[-1] == ("other", "2", "3", "1", "33.3 %")


def test_bayes_is_what_the_others_are_held_against_where_it_takes_part() -> None:
    a, b = layer([[0.9, 0.1]]), layer([[0.9, 0.9]])
    snapshots = {"count": [replace(a, rule="count")], "bayes": [b], "odds": [b]}
    lines = map_rows(snapshots, "ping", dict.fromkeys(snapshots, 0.55))
    assert [line.differs for line in lines] == [0.5, None, 0.0]
    assert table_of(lines)[0][-1] == "differs from bayes"
    assert footnotes(lines) == [
        "count knows no emptiness below zero: free means hardly or never hit"
    ]
    assert footnotes(lines[1:]) == []
    only_called_so = {"x": [a], "bayes": [replace(b, rule="count")]}
    lines = map_rows(only_called_so, "ping", dict.fromkeys(only_called_so, 0.55))
    assert table_of(lines)[0][-1] == "differs from x"


def test_maps_that_are_the_same_are_named() -> None:
    one, other = layer([[0.9, 0.1]]), layer([[0.9, 0.2]])
    snapshots = {"a": [one], "b": [other], "c": [one], "d": [one]}
    thresholds = dict.fromkeys(snapshots, 0.55)
    none: dict[str, list[Segment]] = {name: [] for name in snapshots}
    message = "are the same map: what was varied changed nothing"
    assert same_maps(snapshots, none, thresholds) == [f"a, c and d {message}"]
    line = Segment("ping", "grid", 0, (0, 0), (1, 0), 0.0, 0.0, np.zeros((2, 2)), 0.0, 9)
    assert same_maps(snapshots, {**none, "c": [line]}, thresholds) == [f"a and d {message}"]
    assert same_maps(snapshots, none, {**thresholds, "d": 0.6}) == [f"a and c {message}"]
    assert same_maps(snapshots, {**none, "c": [line]}, {**thresholds, "d": 0.6}) == []


def test_a_key_that_changes_nothing_is_reported(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for compare, same in (("regions=6,12", True), ("beam_width_deg=10,38", False)):
        arguments = ["--set", COARSE, "--compare", f"sensors.ping.{compare}"]
        assert main(["map", str(session), "-o", "-", *arguments]) == 0
        assert ("are the same map" in capsys.readouterr().out) == same


def test_progress_counts_the_readings(session: Path) -> None:
    """Up to all of them, those that were dropped too, and no pose or transform among them."""
    readings = sum(isinstance(m, Range | Scan) for m in read_session(session).messages())
    variants = from_values("sensors.ping.update=bayes,count", settings=[COARSE])
    compared: list[tuple[int, int]] = []
    compare_session(
        session, variants, rrd=None, export=None,
        progress=lambda done, total: compared.append((done, total)),
    )  # fmt: skip
    alone: list[tuple[int, int]] = []
    map_session(
        session, variants[0].config, rrd=None, export=None,
        progress=lambda done, total: alone.append((done, total)),
    )  # fmt: skip
    for calls in (compared, alone):
        assert {total for _, total in calls} == {readings}
        assert [done for done, _ in calls] == sorted(done for done, _ in calls)
        assert calls[-1] == (readings, readings)


def test_the_rule_of_a_fused_map_is_that_of_its_layers(session: Path) -> None:
    settings_ = [COARSE, "sensors.dirrs.update=odds"]
    variants = from_values("sensors.ping.update=himm,count", settings=settings_)
    results = compare_session(session, variants, rrd=None, export=None).results
    snapshots = {name: result.snapshots for name, result in results.items()}
    lines = map_rows(snapshots, FUSED, dict.fromkeys(snapshots, 0.55))
    assert [set(line.rule.split(", ")) for line in lines] == [{"himm", "odds"}, {"count", "odds"}]


# In text


def explanations_of(session: Path, variants: list[Variant]) -> Iterator[tuple[Moment, str]]:
    """Each moment of a comparison, and its explanation."""
    messages = list(read_session(session).messages())
    begun: dict[str, Started] = {}
    finals: dict[str, list[Snapshot]] = {variant.name: [] for variant in variants}
    distances = Distances()
    by_name = {variant.name: variant for variant in variants}
    for moment in in_step({v.name: build_maps(messages, v.config) for v in variants}, messages):
        distances.take(moment)
        for name, artifact in moment.items():
            if isinstance(artifact, Started):
                begun[name] = artifact
            if isinstance(artifact, Snapshot) and artifact.final:
                finals[name].append(artifact)
        yield moment, describe_moment(moment, Compared(by_name, begun, finals, distances, ""))


def test_each_step_is_explained_for_all_maps(session: Path) -> None:
    texts: dict[str, list[str]] = {}
    for moment, text in explanations_of(session, from_values("pose", settings=[COARSE])):
        assert text.startswith("## ")
        kinds = {type(artifact).__name__ for artifact in moment.values()}
        texts.setdefault("/".join(sorted(kinds)), []).append(text)
    assert "- **odom**: dead reckoning" in texts["Started"][0]
    assert "In **odom** the robot stands **0." in texts["Beam"][-1]
    assert all("| pose |" in text and "| odom |" in text for text in texts["MergedGrid"])
    assert any(" → **" in text for text in texts["MergedGrid"])
    assert "differs from pose" in texts["Finished"][-1]
    assert "odom: the robot ends" in texts["Finished"][-1]


def test_evidence_that_all_maps_share_is_explained_once(session: Path) -> None:
    variants = from_values("sensors.*.update=bayes,count", settings=[COARSE])
    temps = [
        text for moment, text in explanations_of(session, variants)
        if isinstance(moment.get("bayes"), TempGrid)
    ]  # fmt: skip
    assert temps
    assert all("| bayes |" not in text for text in temps)


# On the command line


def test_two_files_make_two_maps_and_two_folders(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a = toml(tmp_path, "a", "[sensors.'*']\nupdate = 'bayes'\n")
    b = toml(tmp_path, "b", "[sensors.'*']\nupdate = 'count'\n")
    out, rrd = tmp_path / "out", tmp_path / "ab.rrd"
    both = ["--config", str(a), "--config", str(b), "--set", COARSE]
    assert main(["map", str(session), "-o", str(rrd), *both, "--export", str(out)]) == 0
    message = capsys.readouterr().out
    assert "differs from a" in message
    assert f"wrote {rrd} and {out}" in message
    for name, config in (("a", a), ("b", b)):
        alone = tmp_path / f"alone-{name}"
        one = ["--config", str(config), "--set", COARSE, "--quiet"]
        assert main(["map", str(session), "-o", "-", *one, "--export", str(alone)]) == 0
        for layer_name in ("ping", "dirrs", "fused"):
            mine, theirs = (f / f"{layer_name}.npz" for f in (out / name, alone))
            assert mine.read_bytes() == theirs.read_bytes()
    assert main(["map", str(session), "-o", str(rrd), *both]) == 2  # it is there already
    assert "exists already" in capsys.readouterr().err


def test_config_prints_each_file_as_a_configuration_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = (
        toml(tmp_path, n, f"[grid]\nresolution_m = {v}\n") for n, v in (("a", 0.5), ("b", 0.25))
    )
    assert main(["config", "--config", str(a), "--config", str(b)]) == 0
    out = capsys.readouterr().out
    assert out.index(f"# {a}") < out.index("resolution_m = 0.5") < out.index(f"# {b}")
    assert out.index(f"# {b}") < out.index("resolution_m = 0.25")


@pytest.mark.real_data
def test_all_rules_on_the_real_arena(shared_data: Path, tmp_path: Path) -> None:
    trace = shared_data / "comp4807" / "trace21.trc"
    part, run = tmp_path / "part.trc", tmp_path / "part.mcap"
    part.write_text("".join(trace.read_text().splitlines(keepends=True)[:20]))
    assert main(["import", str(part), "-o", str(run), "--quiet"]) == 0
    rrd = tmp_path / "rules.rrd"
    arguments = ["--compare", "rules", "--set", COARSE, "--quiet"]
    assert main(["map", str(run), "-o", str(rrd), *arguments]) == 0
    maps = read_maps(rrd)
    assert list(maps) == list(UPDATE_RULES)
    bayes, odds = maps["bayes"].grid("dirrs"), maps["odds"].grid("dirrs")
    assert (bayes > 0.55).sum() > 10
    np.testing.assert_allclose(odds / (1 + odds), bayes, atol=1e-5)
    assert set(np.unique(maps["binary"].grid("dirrs"))) == {0.0, 1.0}
    counts = maps["count"].grid("dirrs")
    assert ((counts > 0) == (maps["binary"].grid("dirrs") > 0)).all()
    assert maps["himm"].grid("dirrs").max() <= 15
