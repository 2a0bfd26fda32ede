"""Every kind of source in any pairing: the same run is the same, one cell changed is named."""

from __future__ import annotations

import itertools
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_run import MadeRun
from PIL import Image

from echogrid import main
from mapping.config import load_config
from recorder.errors import BadInput
from recorder.session import SessionWriter, read_session
from replay.diff.comparing import compare
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN
from replay.diff.sources.arrays import read_npz, write_npz
from replay.diff.sources.opening import open_map
from replay.diff.sources.sessions import map_one
from replay.diff.verdict import SAME, SAME_ROOM, WALL_MOVED
from replay.rrd.run_drawer import RunDrawer
from replay.rrd.writer import RrdWriter

SETTING = "grid.resolution_m=0.04"
CONFIG = load_config(settings=[SETTING])
SESSION = ROOT / "logs" / "room.mcap"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One session as everything that it can become, by kind."""
    folder = tmp_path_factory.mktemp("sources")
    rrd, export = folder / "run.rrd", folder / "out"
    arguments = ["map", str(SESSION), "-o", str(rrd), "--export", str(export), "--set", SETTING]
    assert main([*arguments, "--quiet"]) == 0
    golden = folder / "golden.npz"
    write_npz(golden, map_one(SESSION, CONFIG))
    return {
        "session": SESSION, "rrd": rrd, "folder": export, "golden": golden,
        "npz": export / "dirrs.npz", "map": export / "dirrs.yaml",
    }  # fmt: skip


KINDS = ("session", "rrd", "folder", "golden", "npz", "map")


@pytest.mark.parametrize(("a", "b"), list(itertools.combinations_with_replacement(KINDS, 2)))
def test_one_run_is_the_same_as_itself(made: dict[str, Path], a: str, b: str) -> None:
    config = None if a != b or a != "session" else CONFIG
    if {a, b} <= {"session", "npz", "map"}:
        config = CONFIG  # the other side does not hold how it was made
    found = compare(made[a], made[b], config)
    assert not found.differs
    assert found.verdict.kind == SAME
    single = {a, b} & {"npz", "map"}
    assert {each.name for each in found.layers} == (
        {"dirrs"} if single else {"ping", "dirrs", "fused"}
    )
    if not single:
        assert all(each.lines is not None and each.lines.same for each in found.layers)
        assert all(each.borders is not None and each.borders.same for each in found.layers)


def change_cell(path: Path, row: int, col: int, by: float) -> tuple[float, float]:
    """Change one cell of an exported layer; its values before and after."""
    with np.load(path) as stored:
        arrays: dict[str, Any] = {key: stored[key] for key in stored.files}
    before = float(arrays["values"][row, col])
    arrays["values"][row, col] += np.float32(by if before < 0.5 else -by)
    np.savez(path, **arrays)
    return before, float(arrays["values"][row, col])


def test_a_cell_changed_by_a_millionth_is_named_with_its_step(
    made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shutil.copytree(made["folder"], out)
    assert main(["diff", str(made["rrd"]), str(out)]) == 0
    assert "verdict: same\n" in capsys.readouterr().out
    with np.load(out / "ping.npz") as stored:
        rows, cols = np.nonzero((stored["values"] > 0.6) & (stored["values"] < 0.9))
    row, col = int(rows[7]), int(cols[7])
    before, after = change_cell(out / "ping.npz", row, col, 1e-6)
    assert main(["diff", str(made["rrd"]), str(out)]) == 1
    reported = capsys.readouterr().out
    assert f"layer ping: 1 of {rows.size and stored_size(out)} cells differ; worst x " in reported
    assert f" m (row {row}, col {col} of A): {before:.3g} in A, {after:.3g} in B" in reported
    assert main(["diff", str(made["rrd"]), str(out), "--tolerance", "2e-6", "--quiet"]) == 0
    # The step is the one at which the recording's grid took the value that it ends with.
    found = compare(made["rrd"], out)
    moment = next(each for each in found.layers if each.name == "ping").written_a
    assert moment is not None
    history = open_map(made["rrd"]).history
    assert history is not None
    values = {m.step: float(g[row, col]) for m, g in history.grids("ping")}
    steps = sorted(values)
    assert all(values[s] == before for s in steps if s >= moment.step)
    assert values[steps[steps.index(moment.step) - 1]] != before
    assert f"A wrote it last at step {moment.step} (reading {moment.reading} merged)" in reported


def test_one_of_several_maps_is_named(
    made: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short, rules, one = tmp_path / "short.mcap", tmp_path / "rules.rrd", tmp_path / "one.rrd"
    assert main(["simulate", "room", "-o", str(short), "--duration", "3", "--quiet"]) == 0
    compared = ["--compare", "sensors.*.update=bayes,himm", "--set", SETTING]
    assert main(["map", str(short), "-o", str(rules), *compared, "--quiet"]) == 0
    bayes = ["--set", SETTING, "--set", "sensors.*.update=bayes"]
    assert main(["map", str(short), "-o", str(one), *bayes, "--quiet"]) == 0
    capsys.readouterr()
    assert main(["diff", str(one), str(rules)]) == 2
    reported = capsys.readouterr().err
    assert reported.endswith(f"holds several maps: bayes, himm; name one, as in {rules}#bayes\n")
    assert main(["diff", str(one), f"{rules}#bayes"]) == 0
    assert f"B  {rules}#bayes (recording)\nverdict: same\n" in capsys.readouterr().out
    assert main(["diff", f"{rules}#bayes", f"{rules}#himm", "--quiet"]) == 1
    for path, words in (
        (f"{rules}#nope", "no map 'nope'; the maps in it are bayes, himm"),
        (f"{one}#bayes", "no map 'bayes'; it holds a single map"),
        (f"{one}x#bayes", "no such file"),
    ):
        assert main(["diff", str(one), path]) == 2
        assert words in capsys.readouterr().err
    widths_rad = {name: each.beam_width_rad for name, each in open_map(one).layers.items()}
    assert (widths_rad["ping"] or 0.0) > (widths_rad["dirrs"] or 9.0) > 0.0
    assert widths_rad["fused"] is None


def stored_size(out: Path) -> str:
    with np.load(out / "ping.npz") as stored:
        return f"{stored['values'].size:,}"


def test_recordings_part_at_a_step(tmp_path: Path) -> None:
    def write(path: Path, **how: Any) -> Path:
        with RrdWriter(path, RunDrawer(), name="made") as writer:
            for artifact in MadeRun(readings=8, **how).artifacts():
                writer(artifact)
        return path

    one, same = write(tmp_path / "a.rrd"), write(tmp_path / "b.rrd")
    assert compare(one, same).step_divergence is None
    found = compare(one, write(tmp_path / "c.rrd", longest_m=0.4))
    divergence = found.step_divergence
    assert divergence is not None
    left, right = open_map(one).history, open_map(tmp_path / "c.rrd").history
    assert left is not None
    assert right is not None
    a = {m.step: g for m, g in left.grids(divergence.layer)}
    b = {m.step: g for m, g in right.grids(divergence.layer)}
    first = min(step for step in a if step in b and not np.array_equal(a[step], b[step]))
    assert divergence.a.step == divergence.b.step == first
    assert a[first][divergence.row, divergence.col] == divergence.a_value != divergence.b_value


def simulated(path: Path, room: str, seed: int, *more: str) -> Path:
    arguments = ["simulate", room, "-o", str(path), "--duration", "40", "--seed", str(seed)]
    assert main([*arguments, *more, "--quiet"]) == 0
    return path


def wider_room(path: Path) -> str:
    """The room with its right wall 15 cm further to the right."""
    from recorder.simulator.rooms import load_room
    from recorder.truth import walls_to_geojson

    room = load_room("room")
    data = json.loads(walls_to_geojson(room.walls_m, room.name))
    text = json.dumps(data).replace("[2.2,", "[2.35,")
    path.write_text(text)
    return str(path)


ROUTE = "0.3,0.3;1.15,0.42;1.9,0.3;1.92,0.85;1.9,1.32;1.15,1.22;1.13,0.45;1.17,1.2;0.3,1.32"


def test_two_seeds_are_the_same_room_and_a_moved_wall_is_found(tmp_path: Path) -> None:
    config = load_config(settings=["grid.resolution_m=0.02"])
    one, two = (simulated(tmp_path / f"{n}.mcap", "room", n, "--route", ROUTE) for n in (1, 2))
    noise = compare(one, two, config)
    assert noise.differs
    assert noise.verdict.kind == SAME_ROOM
    assert noise.verdict.changes == ()
    wide = simulated(
        tmp_path / "wide.mcap", wider_room(tmp_path / "wide.geojson"), 3, "--route", ROUTE
    )
    moved = compare(one, wide, config).verdict
    assert moved.kind == WALL_MOVED
    change = moved.changes[0]
    assert change.what == "moved"
    assert change.moved_m == pytest.approx(0.15, abs=0.04)
    assert change.from_m is not None
    assert change.to_m is not None
    assert [end[0] for end in change.from_m] == pytest.approx([2.2, 2.2], abs=0.05)
    assert [end[0] for end in change.to_m] == pytest.approx([2.35, 2.35], abs=0.05)
    back = compare(wide, one, config).verdict
    assert back.kind == WALL_MOVED


def with_one_range_changed(path: Path, number: int, by_m: float) -> Path:
    """The session again with one of its readings, counted from 0, a little longer."""
    from dataclasses import replace

    from recorder.messages import Range

    seen = 0
    with SessionWriter(path) as writer:
        for record in read_session(SESSION).records:
            message = record.message
            if isinstance(message, Range):
                if seen == number:
                    message = replace(message, range_m=message.range_m + by_m)
                seen += 1
            writer.write(message, log_ns=record.log_ns)
    return path


def test_the_first_reading_after_which_sessions_part(tmp_path: Path) -> None:
    same = with_one_range_changed(tmp_path / "same.mcap", -1, 0.0)
    assert compare(SESSION, same, CONFIG).divergence is None
    number = next(n for n in itertools.count(100) if _is_ping(n))
    other = with_one_range_changed(tmp_path / "other.mcap", number, 0.2)
    found = compare(SESSION, other, CONFIG)
    assert found.differs
    divergence = found.divergence
    assert divergence is not None
    assert divergence.a is not None
    assert divergence.b is not None
    assert (divergence.layer, divergence.a.sensor, divergence.b.sensor) == ("ping", "ping", "ping")
    assert divergence.b.range_m == pytest.approx((divergence.a.range_m or 0.0) + 0.2, abs=1e-5)
    assert divergence.a.t_ns == divergence.b.t_ns == _readings()[number].t_ns
    assert divergence.a.range_m == pytest.approx(_readings()[number].range_m)


def _readings() -> list[Any]:
    from recorder.messages import Range

    return [r.message for r in read_session(SESSION).records if isinstance(r.message, Range)]


def _is_ping(number: int) -> bool:
    reading = _readings()[number]
    return reading.sensor == "ping" and 0.3 < reading.range_m < 1.5


def test_sessions_of_different_length_part_where_one_ends(tmp_path: Path) -> None:
    half = tmp_path / "half.mcap"
    records = read_session(SESSION).records
    with SessionWriter(half) as writer:
        for record in records[: len(records) // 2]:
            writer.write(record.message, log_ns=record.log_ns)
    divergence = compare(SESSION, half, CONFIG).divergence
    assert divergence is not None
    assert divergence.b is None
    assert divergence.a is not None


def test_real_halves_are_one_room(shared_data: Path, tmp_path: Path) -> None:
    """The long recording of the arena, cut in two: one robot, one room, other ways through it."""
    run = tmp_path / "run.mcap"
    trace = shared_data / "comp4807" / "trace21.trc"
    assert main(["import", str(trace), "-o", str(run), "--quiet"]) == 0
    records = read_session(run).records
    halves = []
    for k in range(2):
        half = tmp_path / f"half{k}.mcap"
        with SessionWriter(half) as writer:
            for i, record in enumerate(records):
                static = record.topic == "/tf_static"
                sonar = record.topic == "/range/ping"  # too blurred to decide anything; saves time
                if static or (i * 2 // len(records) == k and not sonar):
                    writer.write(record.message, log_ns=record.log_ns)
        halves.append(half)
    found = compare(*halves, load_config(settings=["grid.resolution_m=0.02"]))
    assert found.differs
    assert found.verdict.kind == SAME_ROOM


def test_echoes_outside_the_arena_are_no_walls(shared_data: Path, tmp_path: Path) -> None:
    """Two recordings of one arena: the sonar draws walls that move, far outside of it."""
    runs = []
    for name in ("trace9", "trace21"):
        run = tmp_path / f"{name}.mcap"
        trace = shared_data / "comp4807" / f"{name}.trc"
        arguments = ["import", str(trace), "-o", str(run), "--format", "comp4807", "--quiet"]
        assert main(arguments) == 0
        runs.append(run)
    found = compare(*runs, load_config(settings=["grid.resolution_m=0.02"]))
    for change in found.verdict.changes:
        assert change.layer == "dirrs"
        assert not change.sure
        for x_m, y_m in np.concatenate(change.places_m):
            assert -0.1 < x_m < 2.2
            assert -0.1 < y_m < 1.7


MAP = (
    b"{image: x.pgm, resolution: 0.1, origin: [0, 0, 0], negate: 0, occupied_thresh: 0.65, "
    b"free_thresh: 0.2}"
)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("x.npz", b"no archive", "cannot be read as a NumPy archive"),
        ("x.npz", b"", "an empty file"),
        ("x.yaml", b"a: [", "cannot be read as YAML"),
        ("x.yaml", b"a: 1", r"image, resolution, origin, negate, .* is missing: map_server"),
        ("x.yaml", b"- 1", "no map of map_server"),
        ("x.yaml", MAP.replace(b"0.1", b"-1"), "are no place"),
        ("x.yaml", MAP.replace(b"0.1", b"9" * 5000), "are no place"),
        ("x.yaml", MAP.replace(b"0.1", b"2026-01-01"), "are no numbers"),
        ("x.yaml", MAP.replace(b"0, 0]", b"0, 1]"), "turned by 1 rad"),
        ("x.yaml", MAP.replace(b"free_thresh: 0.2", b""), "free_thresh is missing"),
        ("x.yaml", MAP.replace(b"}", b", mode: blue}"), "unknown mode"),
        ("x.yaml", MAP, "the picture of the map is missing"),
        ("x.yaml", MAP.replace(b"x.pgm", b"x.yaml"), "cannot be read as a picture"),
        ("x.yaml", b"a: &a [1]\nb: [*a, *a]", "cannot be read as YAML"),
        ("x.yaml", b"[" * 60_000, "cannot be read as YAML"),
        ("x.yaml", b" " * 70_000, "at most 65,536"),
        ("x.pgm", b"P5", "x.yaml that holds where the map lies is missing"),
        ("x.rrd", b"no recording", "cannot be read as a Rerun recording"),
        ("x.txt", b"", "not a map"),
    ],
)
def test_bad_sources_are_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(BadInput) as refused:
        open_map(path)
    assert re.search(words, str(refused.value))
    assert "\n" not in str(refused.value)
    assert name.split(".")[0] in str(refused.value)


def test_arrays_without_a_place_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, values=np.zeros((2, 2)))
    with pytest.raises(BadInput, match="holds no origin_m"):
        read_npz(path)
    np.savez(path, values=np.zeros(3), origin_m=np.zeros(2), resolution_m=0.1)
    with pytest.raises(BadInput, match="no grid of numbers"):
        read_npz(path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(BadInput, match="holds no layer"):
        read_npz(path)
    with pytest.raises(BadInput, match=r"x.npz: holds no layer"):
        open_map(tmp_path)
    path.unlink()
    with pytest.raises(BadInput, match="a folder without maps"):
        open_map(tmp_path)


def test_a_golden_file_holds_everything_and_is_the_same_bytes(tmp_path: Path) -> None:
    first, second = tmp_path / "a.npz", tmp_path / "new" / "b.npz"
    made = map_one(SESSION, load_config(settings=[SETTING, "sensors.*.update=dempster-shafer"]))
    write_npz(first, made)
    write_npz(second, read_npz(first))
    assert first.read_bytes() == second.read_bytes()
    for name, layer in read_npz(first).layers.items():
        original = made.layers[name]
        assert layer.geometry == original.geometry
        assert layer.kind == original.kind
        np.testing.assert_array_equal(layer.values, original.values)
        np.testing.assert_array_equal(layer.classes, original.classes)
        assert set(layer.extra) == set(original.extra)
        assert layer.lines == original.lines
        assert layer.borders is not None
        assert original.borders is not None
        for a, b in zip(layer.borders, original.borders, strict=True):
            assert a.outer == b.outer
            np.testing.assert_array_equal(a.points_m, b.points_m)


def test_a_map_of_map_server_by_its_own_rules(tmp_path: Path) -> None:
    greys = np.array([[0, 254, 205, 89, 90]], np.uint8)  # 1 - 89/255 = 0.651, 1 - 90/255 = 0.647
    Image.fromarray(np.vstack([greys, 255 - greys])).save(tmp_path / "m.pgm")
    reported = "image: m.pgm\nresolution: 0.05\norigin: [-1, 2, 0]\nnegate: {}\n"
    reported += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    for negate in (0, 1):
        (tmp_path / "m.yaml").write_text(reported.format(negate))
        (layer,) = open_map(tmp_path / "m.yaml").layers.values()
        upper = [OCCUPIED, FREE, UNKNOWN, OCCUPIED, UNKNOWN]
        assert layer.classes[1 - negate].tolist() == upper  # row 0 lies at the lowest y
        assert (layer.geometry.origin_m, layer.geometry.resolution_m) == ((-1.0, 2.0), 0.05)


def nav2_cell(
    rgba: tuple[int, ...], most: int, mode: str, negate: bool, matte: bool,
    thresholds: tuple[float, float] = (0.196, 0.65),
) -> int:  # fmt: skip
    """One pixel by nav2_map_server's map_io.cpp, line by line; ``thresholds``: free, occupied."""
    free, occupied = thresholds
    channels = list(rgba[:-1])
    opaque = rgba[-1] == most
    if mode == "trinary" and matte:
        channels.append(rgba[-1])
    shade = sum(channels) / len(channels) / most
    occ = shade if negate else 1.0 - shade
    if mode == "raw":
        percent = round(shade * 255)
        occ = percent / 100.0 if percent <= 100 else math.nan
    if mode == "scale" and not opaque:
        return -1
    return 100 if occ > occupied else 0 if occ < free else -1


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    st.sampled_from(["L", "LA", "RGB", "RGBA", "I;16"]),
    st.sampled_from(["trinary", "scale", "raw"]),
    st.booleans(), st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_any_picture_is_read_as_nav2_reads_it(
    tmp_path: Path, picture: str, mode: str, negate: bool, seed: int
) -> None:
    random = np.random.default_rng(seed)
    depth = {"L": 1, "LA": 2, "RGB": 3, "RGBA": 4, "I;16": 1}[picture]
    most = 65535 if picture == "I;16" else 255
    numbers = random.integers(0, most + 1, (3, 4, depth))
    if depth in (2, 4):
        numbers[..., -1] = np.where(random.random((3, 4)) < 0.5, most, numbers[..., -1])
    array = numbers.astype(np.uint16 if most > 255 else np.uint8)
    Image.fromarray(array[..., 0] if depth == 1 else array).save(tmp_path / "m.png")
    (tmp_path / "m.yaml").write_text(
        f"image: m.png\nresolution: 1\norigin: [0, 0, 0]\nnegate: {int(negate)}\n"
        f"mode: {mode}\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (layer,) = open_map(tmp_path / "m.yaml").layers.values()
    names = {OCCUPIED: 100, FREE: 0, UNKNOWN: -1}
    for row, col in np.ndindex(3, 4):
        pixel = numbers[row, col].tolist()
        colours, alpha = (pixel[:-1], pixel[-1]) if depth in (2, 4) else (pixel, most)
        rgba = (*(colours * 3)[:3], alpha) if depth < 3 else (*colours, alpha)
        expected = nav2_cell(rgba, most, mode, negate, depth in (2, 4))
        assert names[int(layer.classes[2 - row, col])] == expected, (pixel, mode)
