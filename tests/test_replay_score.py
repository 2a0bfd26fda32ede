"""``echogrid score`` as a user meets it: sessions, maps, what is true, JSON, the picture."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from echogrid import main
from mapping.scoring.truth import TrueWalls
from recorder.errors import BadInput
from recorder.session import SessionWriter
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import ROOMS
from recorder.truth import WALLS, WALLS_TYPE, walls_to_geojson
from replay.pytest_plugin import SessionMapper
from replay.scoring.judging import judge_map, open_truth

COARSE = ["--set", "grid.resolution_m=0.04"]


def write(path: Path, *, walls: bool) -> Path:
    with SessionWriter(path) as session:
        if walls:
            session.attach(WALLS, WALLS_TYPE, walls_to_geojson(ROOMS["empty"].walls_m, "empty"))
        for log_ns, message in simulate(ROOMS["empty"], duration_s=25.0, seed=2):
            session.write(message, log_ns=log_ns)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with its walls, the same without, and the maps of it."""
    here = tmp_path_factory.mktemp("score")
    write(here / "with.mcap", walls=True)
    write(here / "without.mcap", walls=False)
    (here / "walls.geojson").write_bytes(walls_to_geojson(ROOMS["empty"].walls_m, "mine"))
    arguments = ["map", str(here / "with.mcap"), "-o", "-", "--export", str(here / "maps")]
    assert main([*arguments, *COARSE, "--quiet"]) == 0
    return here


def figures(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    capsys.readouterr()
    assert main(["score", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_session_brings_its_own_walls(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = figures(capsys, folder / "with.mcap", *COARSE)
    assert set(found) == {"map", "truth", "judged_over", "layers", "held_out", "notes"}
    assert found["truth"] == "the walls that with.mcap carries"
    assert set(found["layers"]) == {"ping", "dirrs", "fused"}
    fused = found["layers"]["fused"]
    assert 0.0 < fused["log_loss"] < math.log(2.0)
    assert fused["log_loss"] == pytest.approx(
        (fused["log_loss_free"] + fused["log_loss_walls"]) / 2
    )
    assert 0.5 < fused["auc"] <= 1.0
    assert {"brier", "iou", "calibration", "ghost_m2", "wall_found", "lines"} <= set(fused)
    within = found["layers"]["dirrs"]["lines"]["raw"]["within"]
    assert [each["tolerance_m"] for each in within] == [0.02, 0.05, 0.1]
    assert within[0]["completeness"] <= within[1]["completeness"] <= within[2]["completeness"]
    assert set(found["held_out"]) == {"all sensors", "ping", "dirrs"}
    low, mean, high = (found["held_out"]["dirrs"][k] for k in ("low", "log_likelihood", "high"))
    assert low < mean < high


def test_walls_by_name_by_file_and_as_a_map(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = figures(capsys, folder / "with.mcap", *COARSE)["layers"]
    for walls in ("empty", folder / "walls.geojson"):
        assert figures(capsys, folder / "without.mcap", "--walls", walls, *COARSE)["layers"] == own
    map_file = folder / "maps" / "dirrs.yaml"
    of_map = figures(capsys, folder / "with.mcap", "--walls", map_file, "--layer", "dirrs", *COARSE)
    assert set(of_map["layers"]) == {"dirrs"}
    assert of_map["layers"]["dirrs"]["auc"] > 0.99  # its own map


def test_without_walls_only_what_was_kept_out_judges(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["score", str(folder / "without.mcap"), *COARSE]) == 0
    shown = capsys.readouterr().out
    assert "no walls are known (--walls)" in shown
    assert "log-likelihood" in shown
    assert figures(capsys, folder / "without.mcap", *COARSE)["layers"] == {}


def test_exported_maps_with_and_without_their_session(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    maps, session = folder / "maps", folder / "with.mcap"
    own = figures(capsys, session, *COARSE)["layers"]
    with_poses = figures(capsys, maps, "--session", session)
    assert with_poses["held_out"] == {}
    for name, cells in with_poses["layers"].items():  # values in a file are single precision
        for key in ("log_loss", "auc", "ghost_m2", "wall_found"):
            assert cells[key] == pytest.approx(own[name][key], rel=1e-4)
        assert set(cells["lines"]) == set(own[name]["lines"])
    alone = figures(capsys, maps / "fused.npz", "--walls", "empty")
    assert "all cells within the walls" in alone["judged_over"]
    assert set(alone["layers"]) == {"fused"}
    inside = alone["layers"]["fused"]["free_cells"] * 0.04**2
    assert inside == pytest.approx(2.0 * 1.5, rel=0.06)
    classes = figures(capsys, maps / "fused.yaml", "--session", session)
    assert classes["layers"]["fused"]["lines"] == {}


def test_the_table_and_the_picture(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "score.png"
    arguments = ["score", str(folder / "with.mcap"), *COARSE, "-o", str(picture)]
    assert main(arguments) == 0
    shown = capsys.readouterr().out
    for word in ("log-loss", "ghosts", "lines/wall", "without truth", f"wrote {picture}"):
        assert word in shown
    pixels = np.asarray(Image.open(picture).convert("RGB"))
    colours = {tuple(colour) for colour in pixels.reshape(-1, 3)[::7].tolist()}
    assert (44, 140, 44) in colours  # walls that were found
    assert (255, 127, 14) in colours  # ghosts
    assert main(arguments) == 2  # it is there
    assert main([*arguments, "--force", "--quiet"]) == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["maps"], "what is true"),
        (["maps", "--walls", "emty"], "did you mean 'empty'"),
        (["with.mcap", "--session", "with.mcap"], "is a session itself"),
        (["with.mcap", "--layer", "lidar"], "no layer 'lidar'"),
        (["without.mcap", "-o", "x.svg"], "is drawn as .png"),
        (["missing.npz", "--walls", "empty"], "no such file"),
    ],
)
def test_what_cannot_be_judged_is_refused_in_one_line(
    folder: Path, arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    assert main(["score", *arguments]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


def test_as_an_assertion(folder: Path, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    settings = ["grid.resolution_m=0.04"]
    session_map = SessionMapper(request, tmp_path)
    made = session_map(folder / "with.mcap", settings=settings).score()
    assert made["fused"].cells.log_loss < 0.6
    assert made["dirrs"].lines_of("raw").within[1].correctness > 0.8
    bare = session_map(folder / "without.mcap", settings=settings)
    assert bare.score("empty") == made
    assert bare.score(folder / "walls.geojson") == made
    with pytest.raises(BadInput, match="carries no walls"):
        bare.score()


def test_the_figures_of_python_are_those_of_the_command(folder: Path) -> None:
    truth = open_truth("empty")
    assert isinstance(truth, TrueWalls)
    report = judge_map(folder / "maps", walls="empty", only=["ping"])
    assert list(report.scores) == ["ping"]
    assert report.held_out == ()
