"""What somebody meets who never saw the program: its help, its words, its answers to mistakes."""

from __future__ import annotations

import tomllib
from pathlib import Path

import click
import numpy as np
import pytest

import echogrid
from echogrid import main
from mapping.artifacts import Finished
from mapping.config import load_config
from mapping.config_sections import sensor_section
from mapping.config_text import explained_toml
from mapping.grid import GridGeometry, Layer
from mapping.segments.methods import LINE_METHODS
from mapping.sensor_model import SENSOR_MODELS
from mapping.update_rules import UPDATE_RULES
from recorder.sensors import CATALOGUE
from replay.terminal import map_lines

HELP_COLUMNS = 66  # of a command's line in the list of all commands, in a window of 80


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short drive through the room."""
    path = tmp_path_factory.mktemp("first") / "run.mcap"
    assert main(["simulate", "room", "-o", str(path), "--duration", "15", "--quiet"]) == 0
    return path


def error_line(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that was printed."""
    reported = capsys.readouterr()
    assert reported.out == ""
    assert reported.err.count("\n") == 1
    return reported.err


@pytest.mark.parametrize("name", sorted(echogrid.cli.commands))
def test_every_option_has_a_help_text(name: str) -> None:
    command = echogrid.cli.commands[name]
    options = [each for each in command.params if isinstance(each, click.Option)]
    assert [each.opts for each in options if not each.help] == []
    assert "Example:" in (command.epilog or "")
    assert not command.get_short_help_str(HELP_COLUMNS).endswith("...")


def test_without_a_command_the_help_is_printed_as_it_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("Usage: echogrid")
    assert sum(line.startswith("  map ") for line in lines) == 1


def test_what_is_no_recording_is_not_viewed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("no recording")
    for web in ([], ["--web"]):
        assert main(["view", str(text), *web]) == 2
        assert "not a recording; echogrid map SESSION" in error_line(capsys)
        assert main(["view", str(tmp_path), *web]) == 2
        assert "no recording (.rrd) in this folder" in error_line(capsys)


def test_a_recording_is_distinguished_from_a_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.rrd"
    path.write_bytes(b"RRF2" + bytes(60))
    assert main(["info", str(path)]) == 2
    assert "look at it with echogrid view" in error_line(capsys)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "run.txt"], "run.txt: the name of a recording must end in .rrd"),
        (["-o", "-", "--pose", "1,2"], "'1,2' is not x,y,deg (metres, degrees), as in 0.5,0.6,90"),
        (["-o", "-", "--set", "grid.size_m=3"], "numbers in square brackets are wanted"),
        (["-o", "-", "--set", "pose.fixed=[1]"], "a number is missing"),
    ],
)
def test_a_wrong_value_is_refused_with_a_right_one(
    arguments: list[str],
    message: str,
    session: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["map", str(session), *arguments]) == 2
    assert message in error_line(capsys)
    assert list(tmp_path.iterdir()) == []


def test_a_sensor_that_is_not_there_is_named(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["map", str(session), "-o", "-", "--set", "grid.resolution_m=0.05"]
    assert main([*command, "--set", "sensors.pong.update=count"]) == 0
    assert "sensors.pong is configured, but the map has no reading" in capsys.readouterr().err
    assert main([*command, "--set", "sensors.ping.update=count"]) == 0
    assert "configured" not in capsys.readouterr().err


def test_the_terminal_shows_the_map_of_the_narrowest_beam(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["map", str(session), "-o", "-", "--set", "grid.resolution_m=0.05"]
    assert main(command) == 0
    reported = capsys.readouterr().out
    assert "\nlayer dirrs: " in reported
    assert "\nfurther layers: ping, fused\n" in reported
    assert main([*command, "--set", "sensors.*.beam_width_deg=30"]) == 0
    assert "\nlayer fused: " in capsys.readouterr().out  # none is narrower than the other
    assert main([*command, "--set", "sensors.dirrs.max_range_m=0.2"]) == 0
    assert "\nlayer fused: " in capsys.readouterr().out  # the narrower one saw no wall


def test_the_terminal_shows_what_was_seen_of_a_grid() -> None:
    probability = np.full((40, 60), 0.5, np.float32)
    observed = np.zeros((40, 60), np.bool_)
    observed[10:12, 20:23] = True
    probability[10:12, 20:23] = 0.1
    probability[10, 20] = 0.9
    done = Finished(1, {"ping": 1}, {})

    def drawn(seen: np.ndarray) -> list[str]:
        geometry = GridGeometry((0.0, 0.0), 0.1, 40, 60)
        layer = Layer("ping", "probability", geometry, probability, probability, seen, {})
        return map_lines(layer, done)

    assert drawn(observed)[0] == "▄  "
    assert len(drawn(observed)) == 3
    assert len(drawn(np.zeros_like(observed))[0]) == 60  # nothing seen: the whole grid


def test_the_configuration_names_all_there_is_to_choose(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["config"]) == 0
    text = capsys.readouterr().out
    assert text == explained_toml(load_config())
    lines = text.splitlines()
    for key, field in sensor_section().model_fields.items():
        (line,) = (each for each in lines if each.startswith(f"# {key} ="))
        assert field.description is not None
        assert field.description in line
    (method,) = (each for each in lines if each.startswith("method ="))
    (update,) = (each for each in lines if each.startswith("# update ="))
    (model,) = (each for each in lines if each.startswith("# model ="))
    (fit,) = (each for each in lines if each.startswith("fit ="))
    (width,) = (each for each in lines if each.startswith("# beam_width_deg ="))
    assert f"one of {', '.join(LINE_METHODS)}" in method
    assert f"one of {', '.join(UPDATE_RULES)}" in update
    assert f"one of {', '.join(SENSOR_MODELS)}" in model
    assert "one of total, y-on-x" in fit
    assert "(ping 38, dirrs 6, lidar 1)" in width
    for kind in CATALOGUE.values():
        assert f"#   {kind.name:<12}{kind.summary()}" in lines
    default = load_config().model_dump(exclude_none=True, exclude={"sensors"}, mode="json")
    assert tomllib.loads(text) == default


def test_a_folder_that_is_not_there_is_named(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "none" / "new.mcap"
    for command in (["simulate", "room", "--duration", "1"], ["recover", str(session)]):
        assert main([*command, "-o", str(target)]) == 2
        assert f"{target}: there is no folder {target.parent}" in error_line(capsys)
    assert list(tmp_path.iterdir()) == []
