"""``echogrid learn`` as a user meets it: the file that map takes, the page, CSV, JSON, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from echogrid import main
from mapping.config import load_config
from mapping.update_rules.pooled_weights import SIGNS


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("learn") / "run.mcap"
    arguments = ["simulate", "square", "-o", str(file), "--duration", "40", "--quiet"]
    assert main([*arguments, "--range-scale", "dirrs=1.1"]) == 0
    return file


def test_the_sensor_file_is_a_configuration_and_the_map_gets_better(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, page, csv = (tmp_path / f"s{suffix}" for suffix in (".toml", ".html", ".csv"))
    arguments = ["learn", str(session), "-o", str(file), "--page", str(page), "--csv", str(csv)]
    assert main(arguments) == 0
    shown = capsys.readouterr().out
    assert "% long" in shown
    assert "Use it from" in shown
    config = load_config([file], [], None)
    assert config.sensors["dirrs"].range_scale == pytest.approx(1.1, abs=0.02)
    text = page.read_text("utf-8")
    assert text.count("<svg") >= 6
    assert "http" not in text.replace("http://www.w3.org", "")
    rows = csv.read_text("utf-8").splitlines()
    assert rows[0] == "sensor,true_m,range_m,hit_share"
    assert len(rows) > 500
    loss = []
    for more in ([], ["--config", str(file)]):
        coarse = ["--set", "grid.resolution_m=0.02", "--layer", "dirrs", "--json"]
        assert main(["score", str(session), *coarse, *more]) == 0
        loss.append(json.loads(capsys.readouterr().out)["layers"]["dirrs"]["log_loss"])
    assert loss[1] < 0.8 * loss[0]
    assert main(arguments) == 2  # they are there
    assert main([*arguments, "--force", "--quiet"]) == 0


def test_json_and_walls_by_name(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["learn", str(session), "--walls", "square", "--sensor", "dirrs", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"dirrs"}
    assert found["dirrs"]["against"] == "true walls"
    assert found["dirrs"]["mixture"]["scale"] == pytest.approx(1.1, abs=0.02)
    low, high = found["dirrs"]["interval"]["scale"]
    assert low < 1.1 < high


POOLED = ["--set", "sensors.*.update=pooled"]


def test_weights_of_several_rooms_are_tried_on_those_kept_out_and_map_takes_them(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, file = tmp_path / "other.mcap", tmp_path / "s.toml"
    made = ["simulate", "pillar", "-o", str(other), "--duration", "40", "--quiet"]
    assert main(made) == 0
    both = ["learn", str(session), str(other), "--walls", "square", "--walls", "pillar"]
    arguments = [*both, "--sensor", "ping", "--weights", "-o", str(file), *POOLED]
    assert main([*arguments, "--json"]) == 0
    worth = json.loads(capsys.readouterr().out)["ping"]["strengths"]
    assert [each["name"] for each in worth["kept_out"]] == ["run.mcap", "other.mcap"]
    assert not worth["same_room"]
    for each in worth["kept_out"]:
        assert each["before"] > 0.2
        assert each["learned"] < each["before"]  # of rooms with walls as mirrors like these
    assert set(worth["settings"]["weights"]["weights"]) == set(SIGNS)
    coarse = ["--set", "grid.resolution_m=0.02", "--layer", "ping", "--json", *POOLED]
    loss = []
    for more in ([], ["--config", str(file)]):
        assert main(["score", str(other), "--walls", "pillar", *coarse, *more]) == 0
        loss.append(json.loads(capsys.readouterr().out)["layers"]["ping"]["log_loss"])
    assert loss[1] < loss[0]


def test_of_one_session_its_halves_are_kept_out_and_of_other_rules_their_strengths_are_learned(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.toml"
    arguments = ["learn", str(session), "--sensor", "dirrs", "--weights", "-o", str(file)]
    assert main([*arguments, "--set", "sensors.*.update=bayes", "--json"]) == 0
    worth = json.loads(capsys.readouterr().out)["dirrs"]["strengths"]
    assert worth["same_room"]
    assert [each["name"] for each in worth["kept_out"]] == [
        "the first half of run.mcap", "the second half of run.mcap",
    ]  # fmt: skip
    assert set(worth["settings"]) == {"hit", "miss"}  # light does not fade
    assert main([*arguments, "--preset", "chapter", "--force"]) == 2
    assert "no strength to learn" in capsys.readouterr().err
    assert main([*arguments, "--distance", "0.3", "--force"]) == 2
    assert "not by --trust or --distance" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--walls", "nowhere.geojson"], "nowhere.geojson"),
        (["--walls", "nowhere"], "no room 'nowhere' and no such file"),
        (["--walls", "square", "--walls", "flat"], "2 times --walls for 1 sessions"),
        (["--walls", "corridor", "--sensor", "ping"], "its ranges do not follow true walls"),
        (["--sensor", "lidar"], "no readings of lidar"),
        (["--distance", "0.3,0.6"], "2 distances for 1 sessions"),
        (["--distance", "near"], "write metres"),
        (["-o", "x.json"], "must end in .toml"),
    ],
)
def test_refused_in_one_line(
    session: Path, arguments: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["learn", str(session), *arguments]) == 2
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


def test_without_walls_only_what_surely_predicts_better_is_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from recorder.session import SessionWriter
    from recorder.simulator.robot import simulate
    from recorder.simulator.rooms import ROOMS

    file, config = tmp_path / "bare.mcap", tmp_path / "c.toml"
    with SessionWriter(file) as writer:
        for log_ns, message in simulate(ROOMS["square"], duration_s=30.0, seed=3):
            writer.write(message, log_ns=log_ns)
    coarse = ["--set", "grid.resolution_m=0.04"]
    assert main(["learn", str(file), "-o", str(config), "--json", *coarse]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"ping", "dirrs"}
    for each in found.values():
        assert each["against"] == "its own map"
        assert "scale" not in each["interval"]
        assert set(each["settings"]) <= {"before", "behind"}
    load_config([config], [], None)
    assert main(["learn", str(file), "--trust", "dirrs", "--json", *coarse]) == 0
    trusted = json.loads(capsys.readouterr().out)
    assert set(trusted) == {"ping"}
    fitted = trusted["ping"]["mixture"]  # on cells of 4 cm; scale and bias make up for each other
    assert fitted["bias_m"] + 0.7 * fitted["scale"] == pytest.approx(0.7, abs=0.08)
    assert main(["learn", str(file), "--weights", "--sensor", "dirrs", "--json", *coarse]) == 0
    worth = json.loads(capsys.readouterr().out)["dirrs"]["strengths"]
    assert not worth["by_walls"]
    assert [each["name"] for each in worth["kept_out"]] == [
        "the first half of bare.mcap", "the second half of bare.mcap",
    ]  # fmt: skip
    assert main(["learn", str(file), "--trust", "lidar"]) == 2
    assert "no sensor 'lidar' to trust" in capsys.readouterr().err
