"""Strangers' files, names and settings: no traceback, one line at most, exit codes 0, 1 and 2.

What is tried is generated: every command with every kind of bad path, every key of the
configuration with every hostile value, every reader with damaged files, every call of a plugin.
"""

from __future__ import annotations

import dataclasses
import os
import signal
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import pytest
import zstandard
from mcap.records import Chunk
from pydantic import BaseModel

from benchmarks.bombs import BOMBS, Bomb
from benchmarks.fuzz import Reader, failures, make_readers
from echogrid import main
from mapping.config import MappingConfig, load_config, validate
from mapping.config_sections import sensor_section
from mapping.pipeline import build_maps
from mapping.sensor_model import SENSOR_MODELS
from mapping.update_rules import UPDATE_RULES
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Scan
from recorder.names import printable, unusable_name
from recorder.session import SessionWriter
from recorder.session.unpacking import MOST_FILE_BYTES, UnpackingBudget

S = 1_000_000_000
LONGEST_S = 60
READERS = (
    "npz", "map yaml", "map picture", "lines", "borders", "summary", "rrd", "mcap", "toml", "room",
)  # fmt: skip


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Reader]:
    made = {reader.name: reader for reader in make_readers(tmp_path_factory.mktemp("good"))}
    assert tuple(made) == READERS
    return made


@pytest.fixture(scope="module")
def good(readers: dict[str, Reader]) -> Path:
    """A folder with good files of every kind."""
    return readers["mcap"].good.parent


@pytest.fixture(autouse=True)
def _no_test_hangs() -> Iterator[None]:
    """What waits for a pipe, or reads a device, waits for ever."""

    def end(*_: object) -> None:
        raise TimeoutError("it hangs")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(LONGEST_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def tables() -> Iterator[None]:
    """What a plugin registers is gone afterwards."""
    kept = [(table, dict(table)) for table in (SENSOR_MODELS, UPDATE_RULES)]
    yield
    for table, before in kept:
        table.clear()
        table.update(before)


def ends_well(
    arguments: list[str], capfd: pytest.CaptureFixture[str], codes: tuple[int, ...] = (2,)
) -> str:
    """Run a command; what it wrote to standard error, which is one line at most.

    That loops are compiled does not count: it depends on what ran before on this machine.
    """
    capfd.readouterr()
    code = main(arguments)
    written = capfd.readouterr().err.splitlines(keepends=True)
    err = "".join(line for line in written if not line.startswith("echogrid: compiling "))
    assert code in codes, (arguments, code, err)
    assert err.count("\n") <= 1, (arguments, err)
    assert "Traceback" not in err
    assert printable(err.strip("\n")) == err.strip("\n")
    return err


# ---- every command x every kind of bad path

BAD_PATHS = ("missing", "folder", "empty", "pipe", "device", "long", "bytes", "controls", "below")


def bad_path(kind: str, folder: Path, ending: str) -> str:
    """A path that no command can use; names that are odd belong to files of nonsense."""
    path = folder / f"bad{ending}"
    match kind:
        case "folder":
            path.mkdir()
        case "empty":
            path.touch()
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "long":
            return str(folder / ("n" * 300 + ending))
        case "bytes":
            path = Path(os.fsdecode(os.fsencode(folder) + b"/\xff\xfe" + ending.encode()))
            path.write_bytes(b"nonsense")
        case "controls":
            path = folder / f"\x1b[2J\u202e{ending}"
            path.write_bytes(b"nonsense")
        case "below":
            (folder / "file").write_bytes(b"x")
            return str(folder / "file" / f"bad{ending}")
    return str(path)


TAKES_A_PATH = (
    ("info {bad}", ".mcap"), ("recover {bad} -o {new}.mcap", ".mcap"),
    ("import {bad} -o {new}.mcap", ".csv"), ("simulate {bad} -o {new}.mcap", ".geojson"),
    ("map {bad} -o -", ".mcap"), ("map {good}/s.mcap {bad} -o -", ".mcap"),
    ("map {good}/s.mcap -o - --config {bad}", ".toml"),
    ("map {good}/s.mcap -o - --plugin {bad}", ".py"),
    ("diff {good}/s.mcap {bad}", ".mcap"), ("diff {bad} {good}/s.rrd", ".rrd"),
    ("diff {bad} {good}/export/fused.npz", ".npz"), ("diff {good}/export {bad}", ".yaml"),
    ("diff {good}/export {bad}", ".pgm"), ("diff {good}/export {bad}", ""),
    ("config --config {bad}", ".toml"), ("config --plugin {bad}", ".py"), ("check {bad}", ".py"),
    ("view {bad}", ".rrd"), ("view --web {bad}", ".rrd"),
)  # fmt: skip
# An empty configuration is one that changes nothing.
FINE = {("map {good}/s.mcap -o - --config {bad}", "empty"), ("config --config {bad}", "empty")}


@pytest.mark.parametrize("kind", BAD_PATHS)
@pytest.mark.parametrize(("command", "ending"), TAKES_A_PATH)
def test_a_bad_path_gets_one_line(
    command: str, ending: str, kind: str, good: Path, tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    bad = bad_path(kind, tmp_path, ending)
    parts = [p.format(bad=bad, good=good, new=tmp_path / "new") for p in command.split()]
    if (command, kind) in FINE:
        assert not ends_well([*parts], capfd, (0,))
        return
    assert ends_well(parts, capfd).startswith("echogrid: ")
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize(("command", "ending"), TAKES_A_PATH)
def test_what_may_not_be_read_gets_one_line(
    command: str, ending: str, good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / f"bad{ending}"
    bad.write_bytes(b"x")
    bad.chmod(0)
    parts = [p.format(bad=bad, good=good, new=tmp_path / "new") for p in command.split()]
    ends_well(parts, capfd)


WRITES = (
    ("map {good}/s.mcap -o {out} --set grid.resolution_m=0.1 --quiet", ".rrd"),
    ("map {good}/s.mcap -o - --export {out} --set grid.resolution_m=0.1 --quiet", ""),
    ("diff {good}/export {good}/export -o {out} --quiet", ".png"),
    ("diff {good}/export {good}/export -o {out} --quiet", ".rrd"),
    ("recover {good}/s.mcap -o {out} --quiet", ".mcap"),
    ("simulate room -o {out} --duration 1 --quiet", ".mcap"),
)
BAD_OUTPUTS = ("below a file", "unwritable", "long", "a folder")


@pytest.mark.parametrize("kind", BAD_OUTPUTS)
@pytest.mark.parametrize(("command", "ending"), WRITES)
def test_an_output_that_cannot_be_written_gets_one_line(
    command: str, ending: str, kind: str, good: Path, tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "file").write_bytes(b"x")
    (tmp_path / f"folder{ending}").mkdir()
    out = {
        "below a file": tmp_path / "file" / f"x{ending}",
        "unwritable": Path("/proc") / f"x{ending}",
        "long": tmp_path / ("n" * 300 + ending),
        "a folder": tmp_path / f"folder{ending}",
    }[kind]
    parts = [part.format(good=good, out=out) for part in command.split()]
    if kind == "a folder" and not ending:
        assert not ends_well(parts, capfd, (0,))
        return
    ends_well(parts, capfd)
    assert {path.name for path in tmp_path.iterdir()} == {"file", f"folder{ending}"}


# ---- every key x every hostile value

HOSTILE = (
    1e308, 1e-308, 5e-324, -1e308, float("nan"), float("inf"), -1, 0, -0.0, 2**31, 2**63, 10**4000,
    True, None, "", "x" * 10_000, "\x1b[2J", "../../etc/passwd", [], {}, [1e308, 1e308],
    [1e-308, 1e-308], [1e9, 1e9, 1e9], {"a": {"a": {}}},
)  # fmt: skip


def keys() -> Iterator[tuple[str, str]]:
    """Section and name of every key."""
    for section, field in MappingConfig.model_fields.items():
        kind = field.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from ((section, key) for key in kind.model_fields)
    yield from (("sensors", key) for key in sensor_section().model_fields)


def run() -> list[Message]:
    """Some readings of two sensors, and poses around them."""
    messages: list[Message] = []
    for i in range(6):
        pose = SE2(0.1 * i, 0.0, 0.3 * i)
        messages.append(Pose(i * S // 10, pose))
        for name, radiation in (("ping", Radiation.ULTRASOUND), ("dirrs", Radiation.INFRARED)):
            messages.append(
                Range(i * S // 10, name, 0.5, radiation=radiation, beam_width_rad=0.3,
                      min_range_m=0.02, max_range_m=0.8)
            )  # fmt: skip
    return messages


@pytest.mark.parametrize(("section", "key"), list(keys()))
def test_a_hostile_value_is_refused_or_mapped_with(section: str, key: str) -> None:
    tried = 0
    base: dict[str, Any] = {"grid": {"resolution_m": 0.1}, "fusion": {}}
    for value in HOSTILE:
        data = {**base, section: {**base.get(section, {}), key: value}}
        if section == "sensors":
            data[section] = {"*": {key: value}}
        tried += 1
        refusal = ""
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                assert list(build_maps(run(), validate(data)))
            except BadInput as error:
                refusal = str(error)
        assert "\n" not in refusal
        assert len(refusal) < 600
    assert tried == len(HOSTILE)


SETTINGS = (
    "grid.max_cells=" + "9" * 5000, "grid.resolution_m=" + "[" * 50_000, "a" + ".a" * 50_000 + "=1",
    "grid.resolution_m=1e999", "x" * 100_000, "grid=" + "{a=" * 900 + "1" + "}" * 900,
    "grid.resolution_m=2026-01-01", "grid.resolution_m=0x" + "f" * 40_000,
)  # fmt: skip


@pytest.mark.parametrize("setting", SETTINGS, ids=range(len(SETTINGS)))
def test_deep_and_long_settings_get_one_line(
    setting: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert len(ends_well(["config", "--set", setting], capfd)) < 2100
    file = tmp_path / "c.toml"
    name, _, value = setting.partition("=")
    file.write_text(f"{name} = {value}")
    ends_well(["config", "--config", str(file)], capfd)


# ---- every reader x damaged files

DAMAGED = dict.fromkeys(READERS, 60) | {"rrd": 4, "mcap": 40}


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_read_or_refused(
    name: str, readers: dict[str, Reader], tmp_path: Path
) -> None:
    random = np.random.default_rng(14)
    found = list(failures(readers[name], random, tmp_path, 10.0, DAMAGED[name]))
    assert len(found) >= 2
    assert [each for each in found if each is not None] == []


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9])
def test_a_cut_recording_gets_one_line_from_view(
    share: float, good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    whole = (good / "s.rrd").read_bytes()
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(whole[: int(len(whole) * share)])
    err = ends_well(["view", str(cut)], capfd)
    assert "cut.rrd" in err or "no display" in err  # it can be shown as far as it goes


# ---- plugins

RULE = """
from mapping.update_rules import UpdateRule
class Mine(UpdateRule):
    name = "mine"
    start = {{"a": 0.0}}
    def merge(self, cells, temp):
        {merge}
    def values(self, cells):
        {values}
"""
MODEL = """
from mapping.sensor_model import SensorModel
class Mine(SensorModel):
    name = "mine"
    def occupied(self, sensor, beam_cells):
        {occupied}
    def band(self, sensor):
        {band}
"""
FAULTS = (
    "raise OSError('x' * 1000)", "raise RecursionError", "1 / 0", "import sys; sys.exit(0)",
    "raise MemoryError", "return None", "return 'text'", "import numpy; return numpy.zeros(3)",
    "raise UnicodeError('\\n\\n')", "raise SystemExit", "return [[1], [2, 3]]",
)  # fmt: skip


def plugin(method: str, fault: str) -> tuple[str, str]:
    """A file whose method has a fault, and the key that chooses it."""
    methods = {
        "merge": "pass", "values": "return cells['a'] + 0.5", "band": "return 0.1, 0.1",
        "occupied": "return beam_cells.rho_m * 0 + 0.6",
    }  # fmt: skip
    template = RULE if method in ("merge", "values") else MODEL
    text = template.format(**{**methods, method: fault})
    return text, "update" if template is RULE else "model"


@pytest.mark.usefixtures("tables")
@pytest.mark.parametrize("method", ["merge", "values", "occupied", "band"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_plugin_that_fails_is_named(
    method: str, fault: str, good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.py"
    text, key = plugin(method, fault)
    file.write_text(text)
    arguments = ["map", f"{good}/s.mcap", "-o", "-", "--quiet", "--set", "grid.resolution_m=0.1"]
    arguments += ["--plugin", str(file), "--set", f"sensors.*.{key}=mine"]
    if method == "merge" and fault.startswith(("return", "import numpy")):
        assert not ends_well(arguments, capfd, (0,))  # what it returns, nobody asks for
        return
    err = ends_well(arguments, capfd)
    assert f"mine.py: Mine.{method} " in err


@pytest.mark.parametrize("line", [*FAULTS[:5], "raise SystemExit('bye')", "def"])
def test_a_file_that_cannot_be_run_is_named(
    line: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"{line}\n")
    for command in (["check", str(file)], ["config", "--plugin", str(file)]):
        assert "mine.py, line 1: " in ends_well(command, capfd)


# ---- names, and sensors that cannot be

BAD_NAMES = (
    "", " ", "../up", "a/b", "a\\b", ".hidden", "\x1b[31mred", "\u202eright to left", "n" * 65,
    "tab\t", "line\n", "\ud800", "nul\0", "c:",
)  # fmt: skip


@pytest.mark.parametrize("name", BAD_NAMES, ids=range(len(BAD_NAMES)))
def test_names_that_lead_elsewhere_are_refused(name: str) -> None:
    assert unusable_name(name)
    messages = [
        Range(m.t_ns, name, m.range_m, m.beam_width_rad, m.min_range_m, m.max_range_m, m.radiation)
        if isinstance(m, Range) else m
        for m in run()
    ]  # fmt: skip
    with pytest.raises(BadInput, match="cannot be called") as refused:
        list(build_maps(messages, MappingConfig()))
    assert printable(str(refused.value)) == str(refused.value)


def test_usual_names_are_taken() -> None:
    assert not any(map(unusable_name, ("ping", "sonar_1", "front left", "Sonar-µ", "n" * 64)))


def named_run(*names: str) -> list[Message]:
    reading = next(m for m in run() if isinstance(m, Range))
    readings = [Range(reading.t_ns, name, 0.5, 0.3, 0.02, 0.8, reading.radiation) for name in names]
    return [*(m for m in run() if isinstance(m, Pose)), *readings]


def test_a_sensor_may_not_take_the_place_of_the_fused_map() -> None:
    config = load_config(settings=["grid.resolution_m=0.1", "sensors.ping.layer=ping"])
    with pytest.raises(BadInput, match=r"rename it with sensors\.fused\.layer"):
        list(build_maps(named_run("ping", "fused"), load_config(settings=[
            "sensors.ping.layer=ping", "sensors.fused.layer=fused"])))  # fmt: skip
    assert list(build_maps(named_run("fused"), config))  # alone, it is in nobody's way


def test_more_layers_than_can_be_told_apart_are_refused() -> None:
    names = [f"s{i}" for i in range(300)]
    settings = [f"sensors.{name}.layer={name}" for name in names]
    with pytest.raises(BadInput, match="300 layers, at most 100"):
        list(build_maps(named_run(*names), load_config(settings=settings)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("what", ["angle_min_rad", "angle_increment_rad"])
def test_a_scan_without_angles_is_dropped_and_counted(bad: float, what: str) -> None:
    angles = {"angle_min_rad": 0.0, "angle_increment_rad": 0.1, what: bad}
    scan = Scan(t_ns=S // 10, sensor="lidar", ranges_m=np.ones(5), min_range_m=0.1,
                max_range_m=5.0, **angles)  # fmt: skip
    with pytest.raises(BadInput, match="1 no usable beam"):
        list(build_maps([*named_run(), scan], MappingConfig()))


# ---- bounds

HEAVY_TO_MAKE = ("npz of 4 GB", "attachment of 1 GB", "900 million pixels", "chunk of 4 GB")
LIGHT_BOMBS = [bomb for bomb in BOMBS if bomb[0] not in HEAVY_TO_MAKE]


@pytest.mark.parametrize("bomb", LIGHT_BOMBS, ids=lambda bomb: bomb[0])
def test_a_bomb_gets_one_line(
    bomb: Bomb, good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """What they cost is measured by ``python -m benchmarks.bombs``."""
    _, file, make, commands = bomb
    make(tmp_path / file)
    for command in commands:
        parts = [p.format(bad=tmp_path / file, good=good / "s.mcap") for p in command.split()]
        ends_well([*parts], capfd, (0, 1, 2) if parts[0] == "info" else (2,))


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
@pytest.mark.parametrize("claimed", [0, 999, 1001, 1 << 40])
def test_a_chunk_gives_what_it_states_or_nothing(compression: str, claimed: int) -> None:
    data = bytes(1000)
    packed = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}[compression](data)
    chunk = Chunk(compression=compression, data=packed, message_end_time=0, message_start_time=0,
                  uncompressed_crc=zlib.crc32(data), uncompressed_size=1000)  # fmt: skip
    budget = UnpackingBudget(0)
    assert budget.unpacked(chunk) == data
    left = budget.left
    with pytest.raises(ValueError, match=r"size|would unpack"):
        budget.unpacked(dataclasses.replace(chunk, uncompressed_size=claimed))
    assert left - 1_000_000 <= budget.left <= left


def test_a_file_unpacks_to_so_much_only() -> None:
    data = bytes(1 << 20)
    chunk = Chunk(compression="", data=data, message_end_time=0, message_start_time=0,
                  uncompressed_crc=0, uncompressed_size=len(data))  # fmt: skip
    budget, taken = UnpackingBudget(1000), 0
    while budget.left >= len(data):
        taken += len(budget.unpacked(chunk))
    assert MOST_FILE_BYTES - len(data) < taken <= MOST_FILE_BYTES + 100_000
    with pytest.raises(ValueError, match="too much for this file"):
        budget.unpacked(chunk)


@pytest.mark.parametrize("size_m", [97.0, 300.0, 1e6])
def test_maps_too_large_for_memory_are_refused_before_it_is_taken(size_m: float) -> None:
    config = load_config(settings=[f"grid.size_m=[{size_m}, {size_m}]", "grid.origin_m=[0, 0]"])
    with pytest.raises(BadInput, match=r"grid\.max_(memory_mb|cells)"):
        next(build_maps(run(), config))


def test_cells_never_seen_are_occupied_nowhere(good: Path, tmp_path: Path) -> None:
    """For every rule, with a threshold below where the rule begins, and both ways of fusion."""
    from mapping.artifacts import Snapshot, Thresholded

    for rule in UPDATE_RULES:
        for fusion in ("bayes", "weights"):
            config = load_config(settings=[
                "grid.resolution_m=0.05", "borders.threshold=0.25", f"fusion.rule={fusion}",
                f"sensors.*.update={rule}",
            ])  # fmt: skip
            artifacts = list(build_maps(run(), config))
            seen = {a.layer.name: a.layer.observed for a in artifacts if isinstance(a, Snapshot)}
            shown = [a for a in artifacts if isinstance(a, Thresholded)]
            assert {each.layer for each in shown} == {"ping", "dirrs", "fused"}
            assert not any((each.occupied & ~seen[each.layer]).any() for each in shown)


# ---- what to do


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("run.csv", b"t_s,range\n0,1\n", "echogrid import FILE"),
        ("run.log", b"FLASER 3 1 1 1 0 0 0 0 0 0 0 nohost 0\n", "echogrid import FILE"),
        ("run.mcap.zstd", b"\x28\xb5\x2f\xfd" + b"\xff" * 50, "run.mcap.zstd"),
        ("run.mcap.gz", b"\x1f\x8b" + bytes(50), "gunzip FILE"),
    ],
)
def test_map_names_what_makes_a_session_of_it(
    name: str, content: bytes, words: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert words in ends_well(["map", str(tmp_path / name), "-o", "-"], capfd)


def test_without_poses_the_way_out_is_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "s.mcap"
    with SessionWriter(session) as writer:
        for message in run():
            if isinstance(message, Range):
                writer.write(message, log_ns=message.t_ns)
    assert "--pose X,Y,DEG" in ends_well(["map", str(session), "-o", "-"], capfd)


def test_keys_without_use_are_reported(good: Path, capfd: pytest.CaptureFixture[str]) -> None:
    setting = ["--set", "sensors.*.gaussian=none"]
    assert "sensors.*.gaussian is set" in ends_well(["config", *setting], capfd, (0,))
    command = ["map", str(good / "s.mcap"), "-o", "-", "--set", "grid.resolution_m=0.1", *setting]
    assert "sensors.*.gaussian is set" in ends_well(command, capfd, (0,))
    command += ["--compare", "sensors.*.model=fading,peak"]
    err = ends_well(command, capfd, (0,))
    assert err == (
        "echogrid: fading: sensors.*.gaussian is set, but the chosen model or rule has no use for "
        "it\n"
    )
