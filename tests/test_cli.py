"""The command line as a user meets it: exit codes, one line for an error, files that appear."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from echogrid import main
from recorder.session import Limits, PartedWriter, read_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cli") / "run.mcap"
    arguments = ["simulate", "room", "-o", str(path), "--duration", "20", "--seed", "1", "--quiet"]
    assert main(arguments) == 0
    return path


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What stands on stderr, which must be one line that names the program."""
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("echogrid: ")
    return lines[0]


def test_info_lists_what_is_inside(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(session)]) == 0
    out = capsys.readouterr().out
    assert f"{len(read_session(session).records)} messages" in out
    assert all(word in out for word in ("/range/ping", "/range/dirrs", "/pose", "truth.geojson"))


def test_map_exports_its_layers(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["map", str(session), "-o", "-", "--export", str(out), "--quiet"]) == 0
    for layer in ("ping", "dirrs", "fused"):
        with np.load(out / f"{layer}.npz") as arrays:
            assert (arrays["values"] > 0.55).any()
        assert (out / f"{layer}.pgm").read_bytes().startswith(b"P5")
    assert json.loads((out / "summary.json").read_text())
    assert not list(tmp_path.glob("*.rrd"))


def test_nonsense_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "nonsense.mcap"
    path.write_bytes(b"this is no session\n" * 20)
    assert main(["map", str(path), "-o", "-"]) == 2
    assert "nonsense.mcap: not an MCAP file" in one_line(capsys)
    assert main(["info", str(tmp_path / "missing.mcap")]) == 2
    assert "missing.mcap" in one_line(capsys)


def test_an_unknown_key_is_refused(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", str(session), "-o", "-", "--set", "grid.resolution=0.1"]) == 2
    line = one_line(capsys)
    assert "unknown key grid.resolution" in line
    assert "resolution_m" in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "update=foo"], "unknown key update; did you mean sensors.*.update?"),
        (["--set", "resolution_m=1"], "unknown key resolution_m; did you mean grid.resolution_m?"),
        (["--preset", "foo"], "unknown preset 'foo'; known: chapter"),
    ],
)
def test_a_key_without_its_section_and_an_unknown_preset_are_put_right(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", *arguments]) == 2
    assert capsys.readouterr().err == f"echogrid: {message}\n"


@pytest.mark.parametrize("web", [[], ["--web"]])
def test_a_session_is_not_viewed_but_mapped_first(
    web: list[str], session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(session), *web]) == 2
    mapped = session.with_suffix(".rrd")
    assert capsys.readouterr().err == (
        f"echogrid: {session} is a session; map it first: echogrid map {session} -o {mapped}\n"
    )


def test_existing_outputs_are_kept(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = session.read_bytes()
    assert main(["simulate", "room", "-o", str(session), "--duration", "1"]) == 2
    assert "exists already" in one_line(capsys)
    assert session.read_bytes() == before
    rrd = tmp_path / "out.rrd"
    rrd.write_bytes(b"precious")
    assert main(["map", str(session), "-o", str(rrd), "--quiet"]) == 2
    assert "exists already" in one_line(capsys)
    assert rrd.read_bytes() == b"precious"


def extent_m(points_m: NDArray[np.float64]) -> tuple[float, float]:
    """Sides, longer first, of the smallest rectangle around the inner 98 % along each side.

    The axes are searched over a quarter turn: those of the covariance lean towards whichever
    wall was seen more often.
    """
    sizes = []
    for angle in np.radians(np.arange(0.0, 90.0, 0.5)):
        c, s = np.cos(angle), np.sin(angle)
        low, high = np.percentile(points_m @ np.array([[c, -s], [s, c]]), [1, 99], axis=0)
        sizes.append(tuple(sorted((high - low).tolist(), reverse=True)))
    return min(sizes, key=lambda size: size[0] * size[1])


def test_the_real_arena_has_its_size(shared_data: Path, tmp_path: Path) -> None:
    trace = shared_data / "comp4807" / "trace21.trc"
    run, out = tmp_path / "t.mcap", tmp_path / "out"
    assert main(["import", str(trace), "-o", str(run), "--quiet"]) == 0
    assert main(["map", str(run), "-o", "-", "--export", str(out), "--quiet"]) == 0
    with np.load(out / "dirrs.npz") as arrays:
        occupied = np.argwhere(arrays["values"] > 0.55)
        points_m = np.asarray(occupied[:, ::-1] + 0.5, np.float64) * float(arrays["resolution_m"])
    longer_m, shorter_m = extent_m(points_m)
    # Nobody surveyed the arena: 213 x 160 cm is an estimate, and walls in the map have a width.
    assert longer_m == pytest.approx(2.13, rel=0.07)
    assert shorter_m == pytest.approx(1.60, rel=0.07)


def test_parts_of_a_session_are_mapped_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, parts = tmp_path / "whole.mcap", tmp_path / "parts.mcap"
    assert main(["simulate", "room", "-o", str(whole), "--duration", "6", "--quiet"]) == 0
    limits = Limits(split_s=2.0)
    with PartedWriter(parts, limits, metadata=read_session(whole).metadata) as writer:
        for record in read_session(whole).records:
            writer.write(record.message, log_ns=record.log_ns)
    files = sorted(str(path) for path in tmp_path.glob("parts*.mcap"))
    assert len(files) > 2
    coarse = ["-o", "-", "--set", "grid.resolution_m=0.05"]
    assert main(["map", str(whole), *coarse]) == 0
    whole_info = capsys.readouterr().out
    assert main(["map", *files, *coarse]) == 0
    assert capsys.readouterr().out == whole_info


@pytest.mark.parametrize(
    "arguments",
    [
        ["map", "{s}", "-o", "{s}", "--force"],
        ["map", "{s}", "-o", "{other}", "--force"],
        ["map", "{s}", "{other}", "-o", "{other}", "--compare", "rules", "--force"],
        ["record", "replay:{s}", "-o", "{s}", "--duration", "1", "--force"],
        ["import", "{s}", "-o", "{s}", "--format", "comp4807", "--force"],
        ["diff", "{rrd}", "{s}", "-o", "{rrd}", "--force"],
        ["recover", "{s}", "-o", "{s}", "--force"],
    ],
)
def test_an_input_is_never_replaced(
    arguments: list[str], session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, other, rrd = tmp_path / "s.mcap", tmp_path / "other.mcap", tmp_path / "m.rrd"
    for path in (mine, other, rrd):
        path.write_bytes(session.read_bytes())
    names = {"s": mine, "other": other, "rrd": rrd}
    assert main([argument.format(**names) for argument in arguments]) == 2
    one_line(capsys)
    for path in (mine, other, rrd):
        assert path.read_bytes() == session.read_bytes()
