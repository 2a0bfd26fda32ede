"""Every input of every command: never a pipe or a device, never replaced by an output."""

from __future__ import annotations

import os
import shutil
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PIL import Image

from echogrid import main

ROOM = '{"type": "LineString", "coordinates": [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]}'
TRACE = "t_ms,ping_cm\n" + "".join(f"{50 * i},{40 + i % 9}\n" for i in range(30))
RULE = (
    "from recorder.protocols import LineProtocol\n\n\nclass Mine(LineProtocol):\n    name = 'm'\n"
)
# Each command, with {bad} where an input stands; {o} is an output.
READS = (
    ["info", "{bad}"], ["recover", "{bad}", "-o", "{o}.mcap"], ["map", "{bad}", "-o", "-"],
    ["map", "{s}", "{bad}", "-o", "-"], ["map", "{s}", "-o", "-", "--config", "{bad}"],
    ["map", "{s}", "-o", "-", "--config", "{c}", "--config", "{bad}"],
    ["map", "{s}", "-o", "-", "--plugin", "{bad}"], ["import", "{bad}", "-o", "{o}.mcap"],
    ["import", "--format", "comp4807", "{bad}", "-o", "{o}.mcap"],
    ["import", "--format", "carmen", "{bad}", "-o", "{o}.mcap"],
    ["import", "--format", "sonar-ring", "{bad}", "-o", "{o}.mcap"],
    ["import", "--format", "csv", "{bad}", "-o", "{o}.mcap"], ["diff", "{bad}", "{s}"],
    ["diff", "{s}", "{bad}"], ["diff", "{s}", "{s}", "--config", "{bad}"],
    ["diff", "{s}", "{s}", "--plugin", "{bad}"], ["view", "{bad}"], ["replay", "{bad}"],
    ["config", "--config", "{bad}"], ["config", "--plugin", "{bad}"], ["check", "{bad}"],
    ["simulate", "{bad}", "-o", "{o}.mcap"], ["record", "replay:{bad}", "-o", "{o}.mcap"],
    ["record", "sim:{bad}", "-o", "{o}.mcap"],
    ["record", "nowhere", "--protocol", "{bad}.py", "-o", "{o}.mcap"],
)  # fmt: skip
# Each command whose output may be one of its inputs, {x}; and the file that this is.
REPLACES = (
    ("s.mcap", ["record", "replay:{x}", "-o", "{x}"]),
    ("s.mcap", ["recover", "{x}", "-o", "{x}"]),
    ("s.mcap", ["import", "{d}/t.csv", "{x}", "-o", "{x}"]),
    ("t.csv", ["import", "{x}", "-o", "{x}"]),
    ("room.geojson", ["simulate", "{x}", "-o", "{x}", "--duration", "1"]),
    ("room.geojson", ["record", "sim:{x}", "-o", "{x}", "--duration", "1"]),
    ("mine.py", ["record", "nowhere", "--protocol", "{x}", "-o", "{x}"]),
    ("mine.py", ["record", "replay:{d}/s.mcap", "--protocol", "{x}", "-o", "{x}"]),
    ("a.rrd", ["diff", "{x}", "{d}/b.npz", "-o", "{x}"]),
    ("a.rrd", ["diff", "{x}#bayes", "{d}/b.npz", "-o", "{x}"]),
    ("a.rrd", ["diff", "{d}/b.npz", "{x}#bayes", "-o", "{x}"]),
    ("c.png", ["diff", "{d}/m.yaml", "{d}/m.yaml", "-o", "{x}"]),
    ("c.png", ["diff", "{d}/s.mcap", "{d}/s.mcap", "--config", "{x}", "-o", "{x}"]),
    ("c.rrd", ["map", "{d}/s.mcap", "--config", "{x}", "-o", "{x}"]),
    ("c.rrd", ["map", "{x}", "-o", "{x}"]),
    ("c.rrd", ["map", "{d}/s.mcap", "{x}", "-o", "{x}"]),
)  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    assert main(["simulate", "room", "-o", f"{folder}/s.mcap", "--duration", "1", "--quiet"]) == 0
    (folder / "room.geojson").write_text(ROOM)
    (folder / "t.csv").write_text(TRACE)
    (folder / "mine.py").write_text(RULE + "    def read(self, line):\n        return None\n")
    (folder / "c.toml").write_text("")
    for name in ("a.rrd", "b.npz", "c.rrd"):
        (folder / name).write_text("")
    (folder / "m.yaml").write_text(
        "image: c.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    Image.new("L", (4, 4), 254).save(folder / "c.png")
    return folder


@pytest.fixture
def pipe(tmp_path: Path) -> str:
    os.mkfifo(tmp_path / "pipe")
    os.mkfifo(tmp_path / "pipe.py")
    return str(tmp_path / "pipe")


@pytest.fixture
def device(tmp_path: Path) -> str:
    for name in ("zero", "zero.py"):
        (tmp_path / name).symlink_to("/dev/zero")
    return str(tmp_path / "zero")


@pytest.fixture
def listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.chdir(tmp_path)  # a socket's name must be short
    with socket.socket(socket.AF_UNIX) as server, socket.socket(socket.AF_UNIX) as other:
        server.bind("listener")
        other.bind("listener.py")
        yield str(tmp_path / "listener")


@pytest.mark.parametrize("kind", ["pipe", "device", "listener"])
@pytest.mark.parametrize("command", READS, ids=" ".join)
def test_what_is_no_regular_file_is_refused_in_one_line(
    made: Path, tmp_path: Path, command: list[str], kind: str, request: pytest.FixtureRequest,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """25 commands, three kinds of files that are none; none of them waits."""
    words = {
        "bad": request.getfixturevalue(kind), "s": f"{made}/s.mcap", "c": f"{made}/c.toml",
        "o": f"{tmp_path}/out",
    }  # fmt: skip
    assert main([word.format_map(words) for word in command]) == 2
    captured = capfd.readouterr()
    assert captured.err.count("\n") == 1, captured.err
    assert "no regular file" in captured.err or "no such file" in captured.err, captured.err
    assert not [each for each in tmp_path.iterdir() if each.suffix == ".mcap"]


def by_its_name(path: Path) -> Path:
    return path


def by_a_link(path: Path) -> Path:
    link = path.with_name(f"link{path.suffix}")
    link.symlink_to(path.name)
    return link


def by_a_second_name(path: Path) -> Path:
    other = path.with_name(f"second{path.suffix}")
    other.hardlink_to(path)
    return other


@pytest.mark.parametrize("named", [by_its_name, by_a_link, by_a_second_name])
@pytest.mark.parametrize(("name", "command"), REPLACES)
def test_an_input_is_never_the_output(
    made: Path, tmp_path: Path, name: str, command: list[str], named: Callable[[Path], Path],
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """16 ways to name an input as the output, by three kinds of names, all with --force."""
    shutil.copytree(made, tmp_path / "d")
    folder = tmp_path / "d"
    words = {"d": str(folder), "x": str(folder / name)}
    arguments = [word.format_map(words) for word in command]
    arguments[arguments.index("-o") + 1] = str(named(folder / name))
    before = {each.name: each.read_bytes() for each in folder.iterdir()}
    assert main([*arguments, "--force", "--quiet"]) == 2
    assert "is an input as well" in capfd.readouterr().err or command[0] == "recover"
    assert {each.name: each.read_bytes() for each in folder.iterdir()} == before
