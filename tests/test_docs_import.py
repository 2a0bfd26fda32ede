"""The page on other people's recordings: its commands work, on files as it describes them."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest
from conftest import ROOT

from echogrid import main
from recorder.protocols.csv import parse_columns

PAGE = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
HEADER = "x,y,angle,Dirrs+|0|-3|0|0.05|3,Sonar|0|4|0|0.10|19"


def blocks(language: str) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found, f"the page has no {language}"
    return found


def carmen_log() -> str:
    """A laser in a corridor 2 m wide that drives along it."""
    rows = []
    for k in range(20):
        ranges = " ".join(["1.0"] * 60 + ["4.0"] * 61 + ["1.0"] * 60)
        pose = f"{0.1 * k:.2f} 0.0 0.0"
        rows.append(f"FLASER 181 {ranges} {pose} {pose} {k * 0.2:.1f} robot {k * 0.2:.1f}")
    return "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The files that the page speaks of, in the folder where its commands are run."""
    (tmp_path / "sweep.csv").write_text(blocks("csv")[0])
    (tmp_path / "robot.log").write_text(carmen_log())
    rows = ["300,300,0,30,200", "303,300,0,31,200", "306,300,0,200,32"]
    (tmp_path / "trace.trc").write_text("\n".join([HEADER, *rows]))
    shutil.copy(ROOT / "logs" / "room.mcap", tmp_path / "bag.mcap")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_command_works(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line in "".join(blocks("sh")).splitlines():
        assert main(shlex.split(line)[1:]) == 0, (line, capsys.readouterr())
        if "import sweep.csv -o sweep.mcap" in line:
            assert "t_ms,head:deg,ping:cm (guessed)" in capsys.readouterr().out
    for name in ("sweep.rrd", "bag.rrd", "robot.rrd", "plan.mcap", "out/fused.npz"):
        assert (folder / name).stat().st_size > 1000, name
    described = set(re.findall(r"`LAYER\.([a-z.-]+)`", PAGE))
    assert {"pgm", "png", "pgw", "segments.geojson"} <= described
    described -= {"picture.png"}  # on request
    for ending in described:
        assert (folder / "plan" / f"lidar.{ending}").exists(), ending
    lines = json.loads((folder / "plan" / "lidar.segments.geojson").read_text())
    assert (lines["frame"], lines["unit"]) == ("map", "metre")
    assert len((folder / "plan" / "trajectory.tum").read_text().splitlines()) == 20


def test_the_columns_of_the_table_are_columns() -> None:
    table = PAGE.split("| column | means |")[1].split("\n\n")[0]
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    for cell in cells:
        for name in re.findall(r"`([^`]+)`", cell):
            others = {"x:m": "y:m,heading:deg", "y:m": "x:m,heading:deg", "heading:deg": "x:m,y:m",
                      "left": "right", "right": "left"}.get(name, "")  # fmt: skip
            assert parse_columns(",".join(part for part in (name, others, "tof:cm") if part))
