"""The catalogue of sensors: complete, and all that a new sensor needs."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from echogrid import main
from mapping.config import (
    MappingConfig,
    ReportedSensor,
    load_config,
    resolve_sensor,
    unused_keys,
)
from mapping.config_text import explained_toml
from mapping.sensor_model import SENSOR_MODELS
from mapping.sensors import resolve_sensors
from recorder.errors import BadInput
from recorder.messages import Radiation, Range, Scan
from recorder.recording.options import parse_sensor
from recorder.sensors import CATALOGUE, UNKNOWN_KIND, SensorKind, guess_kind, kind_of
from recorder.session import SessionReader, read_session
from recorder.simulator.robot import simulate
from recorder.simulator.rooms import load_room
from recorder.summary import summary_lines

MUST_HAVE_A_SOURCE = {
    "beam_width_deg", "min_range_m", "max_range_m", "range_error", "rate_hz", "model_parameters",
    "update", "faults",
}  # fmt: skip
EVERY_KIND = pytest.mark.parametrize("kind", CATALOGUE.values(), ids=CATALOGUE)


@EVERY_KIND
def test_an_entry_is_sound_and_names_the_source_of_each_number(kind: SensorKind) -> None:
    fields = {field.name: field for field in dataclasses.fields(kind)}
    sourced = [name for names in kind.sources for name in names.split()]
    assert set(sourced) <= set(fields)
    assert len(sourced) == len(set(sourced))
    also = {"mount", "invalid_m", "scan"}
    given = {name for name in also if getattr(kind, name) != fields[name].default}
    assert set(sourced) == MUST_HAVE_A_SOURCE | given
    assert all(kind.sources.values())
    assert 0.0 < kind.beam_width_deg <= 360.0
    assert 0.0 < kind.min_range_m < kind.max_range_m
    assert kind.model in SENSOR_MODELS
    reported = ReportedSensor("x", kind.radiation)
    config = load_config(settings=[f"sensors.x.kind={kind.name}"])
    sensor = resolve_sensor(reported, config, mounted=False)
    assert sensor.beam_width_rad == math.radians(kind.beam_width_deg)
    assert (sensor.range_error, sensor.max_range_m) == (kind.range_error, kind.max_range_m)
    assert {key: getattr(sensor, key) for key in kind.model_parameters} == kind.model_parameters
    assert sensor.update == kind.update


@EVERY_KIND
def test_every_kind_is_guessed_recorded_and_shown(kind: SensorKind) -> None:
    for name in (kind.name, f"{kind.name}_left", f"front_{kind.name}", kind.name.upper()):
        assert guess_kind(name) is kind
    for alias in kind.aliases:
        assert guess_kind(f"{alias}_2") is kind
    assert parse_sensor(f"left={kind.name}") == ("left", kind.parameters)
    assert f"#   {kind.name:<12}{kind.summary()}\n" in explained_toml(load_config())


def test_names_hold_their_kind() -> None:
    names = {
        "ping2": "ping", "HC-SR04": "hcsr04", "hc_sr04_left": "hcsr04", "vl53l1x_front": "vl53l1x",
        "rplidar/laser": "rplidar_a1", "DIRRS+": "dirrs", "ns/tfmini_link": "tfmini",
    }  # fmt: skip
    assert {name: kind and kind.name for name in names if (kind := guess_kind(name))} == names
    assert [guess_kind(name) for name in ("sonar", "pingu", "left", "2", "")] == [None] * 5
    assert kind_of("left", Radiation.INFRARED) is CATALOGUE["dirrs"]
    assert UNKNOWN_KIND.name == "ping"


@EVERY_KIND
def test_every_kind_is_simulated_within_its_limits(kind: SensorKind) -> None:
    name = f"{kind.name}_1"
    messages = simulate(load_room("room"), duration_s=20.0, seed=2, sensors=(name,))
    readings = [m for _, m in messages if isinstance(m, Range | Scan)]
    assert {reading.sensor for reading in readings} == {name}
    assert len(readings) == pytest.approx(20.0 * kind.rate_hz, abs=2.0)
    ranges_m = np.concatenate(
        [np.atleast_1d(m.range_m if isinstance(m, Range) else m.ranges_m) for m in readings]
    )
    finite_m = ranges_m[np.isfinite(ranges_m)]
    assert len(finite_m) > 20
    assert kind.min_range_m <= finite_m.min() <= finite_m.max() <= kind.max_range_m
    step_m = kind.faults.resolution_m
    if step_m:
        measured_m = finite_m[finite_m > kind.min_range_m]
        np.testing.assert_allclose(measured_m, step_m * np.round(measured_m / step_m), atol=1e-9)


def test_the_order_of_what_is_known() -> None:
    """Configuration, message, the name's kind, the radiation's."""

    def reach(name: str, *settings: str, own_m: float = math.nan) -> float:
        reported = ReportedSensor(name, Radiation.INFRARED, max_range_m=own_m)
        return resolve_sensor(reported, load_config(settings=settings), mounted=False).max_range_m

    assert reach("left") == 0.8
    assert reach("tfmini_left") == 12.0
    assert reach("tfmini_left", own_m=9.0) == 9.0
    assert reach("tfmini_left", "sensors.tfmini_left.max_range_m=5", own_m=9.0) == 5.0
    assert reach("left", "sensors.left.kind=tfluna") == 8.0


def rule_of(reported: ReportedSensor, *settings: str, preset: str | None = None) -> str:
    config = load_config(settings=settings, preset=preset)
    return resolve_sensor(reported, config, mounted=False).update


def test_the_rule_of_a_sensor_that_names_none() -> None:
    """It is the kind's, unless something is set that this rule does not go by."""
    ping = ReportedSensor("ping", Radiation.ULTRASOUND)
    assert rule_of(ping) == rule_of(ping, "sensors.ping.behind=0.03") == "pooled"
    assert rule_of(ping, "sensors.ping.model=fading") == "pooled"  # what it is anyway
    assert rule_of(ping, "sensors.*.regions=6") == "pooled"  # which the model does not go by either
    assert rule_of(ping, preset="chapter") == "bayes"
    for setting in ("model=peak", "model=regions", "rasteriser=arcs", "rasteriser=rays"):
        assert rule_of(ping, f"sensors.*.{setting}") == "bayes", setting
    for key in ("hit", "miss", "near", "fade_m"):
        assert rule_of(ping, f"sensors.ping.{key}=1") == "bayes", key
        assert rule_of(ping, f"sensors.ping.{key}=1", "sensors.ping.update=pooled") == "pooled"
    assert rule_of(ReportedSensor("sonar", Radiation.ULTRASOUND)) == "pooled"
    assert rule_of(ReportedSensor("ping", Radiation.LASER)) == "bayes"  # a scan, whatever its name


def test_only_sonars_take_pooled_unasked() -> None:
    """On real drives along walls it frees what a ranger of light saw."""
    chosen = {kind.name for kind in CATALOGUE.values() if kind.update == "pooled"}
    assert chosen == {"ping", "hcsr04", "jsnsr04t", "mb1010"}
    assert rule_of(ReportedSensor("tof", Radiation.INFRARED)) == "bayes"
    assert rule_of(ReportedSensor("ping", Radiation.INFRARED)) == "pooled"  # the name decides


def test_keys_that_the_chosen_rule_does_not_go_by_are_named() -> None:
    in_vain = load_config(settings=["sensors.ping.update=pooled", "sensors.ping.hit=1"])
    assert unused_keys(in_vain) == ["sensors.ping.hit"]
    assert not unused_keys(load_config(settings=["sensors.ping.hit=1"]))  # then the rule is bayes
    assert not unused_keys(load_config(settings=["sensors.ping.weights=sonar"]))


def test_a_layer_of_sensors_whose_rules_differ_takes_bayes() -> None:
    """Weights of one medium fit no other; a rule that somebody named is left alone."""

    def rules(*settings: str) -> dict[str, str]:
        readings = [
            CATALOGUE[kind].parameters.reading(0, name, 0.5)
            for name, kind in (("ping", "ping"), ("hcsr04", "hcsr04"), ("dirrs", "dirrs"))
        ]
        config = load_config(settings=settings)
        sensors = resolve_sensors(readings, lambda _: None, config)
        return {name: sensor.update for name, sensor in sensors.items()}

    alone = {"ping": "pooled", "hcsr04": "pooled", "dirrs": "bayes"}
    assert rules() == rules("sensors.hcsr04.layer=ping") == alone
    assert rules("sensors.dirrs.layer=ping") == {**alone, "ping": "bayes"}
    assert set(rules("sensors.*.layer=all").values()) == {"bayes"}
    assert set(rules("sensors.*.layer=all", "sensors.*.update=pooled").values()) == {"pooled"}
    assert rules("sensors.hcsr04.layer=ping", "sensors.hcsr04.hit=1") == {
        **alone, "ping": "bayes", "hcsr04": "bayes",
    }  # fmt: skip


def test_a_parameter_that_no_model_has_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = dataclasses.replace(CATALOGUE["ping"], name="pong", model_parameters={"hitt": 1.0})
    monkeypatch.setitem(CATALOGUE, "pong", wrong)
    with pytest.raises(BadInput, match=r"sensors.pong.hitt; the nearest known one is hit"):
        resolve_sensor(ReportedSensor("pong", Radiation.ULTRASOUND), MappingConfig(), mounted=False)


@pytest.mark.real_data
def test_a_tfmini_is_not_called_swapped(shared_cases: Path) -> None:
    text = "\n".join(summary_lines(SessionReader(shared_cases / "tfmini.mcap")))
    assert "2.41 to 3.00 m" in text
    assert "swapped" not in text
    assert "0.8 m" not in text


def test_a_new_sensor_is_one_entry(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Simulated, mapped and judged, and recorded from a serial line, by its name alone."""
    entry = dataclasses.replace(
        CATALOGUE["tfmini"], name="xr900", title="X-Ranger 900", aliases=(), beam_width_deg=4.0,
        max_range_m=1.2, rate_hz=40.0, invalid_m=(9.99,),
        model_parameters={**CATALOGUE["tfmini"].model_parameters, "hit": 1.5},
    )  # fmt: skip
    monkeypatch.setitem(CATALOGUE, entry.name, entry)
    run, out = tmp_path / "run.mcap", tmp_path / "maps"
    arguments = ["simulate", "room", "-o", str(run), "--sensors", "xr900_left", "--quiet"]
    assert main([*arguments, "--duration", "40"]) == 0
    ranges = [m for m in _messages(run) if isinstance(m, Range)]
    assert len(ranges) == pytest.approx(1600, abs=2)
    assert {(m.sensor, round(m.max_range_m, 6), m.radiation) for m in ranges} == {
        ("xr900_left", 1.2, Radiation.INFRARED)
    }
    mapped = ["map", str(run), "-o", "-", "--export", str(out), "--quiet"]
    assert main([*mapped, "--set", "grid.resolution_m=0.02"]) == 0
    with np.load(out / "xr900_left.npz") as layer:
        assert layer["values"].max() > 0.9
        assert layer["values"].min() < 0.1
    assert main(["info", str(run)]) == 0
    assert "odd" not in capsys.readouterr().out
    assert main(["config"]) == 0
    assert "X-Ranger 900: infrared, 4 degrees, 0.3 to 1.2 m" in capsys.readouterr().out
    _judged(entry, ranges, tmp_path)
    _recorded(entry, tmp_path)


def _messages(path: Path) -> list[object]:
    return [record.message for record in read_session(path).records]


def _judged(entry: SensorKind, ranges: list[Range], folder: Path) -> None:
    """``info`` goes by the entry: its limit where the messages name none, its invalid value."""
    from recorder.session import SessionWriter

    for number, (range_m, finding) in enumerate(
        (
            (2.0, "of its ranges lie beyond 1.2 m, which it does not reach"),
            (entry.invalid_m[0], "100% of its ranges are what a X-Ranger 900 reports for none"),
        )
    ):
        path = folder / f"judged{number}.mcap"
        with SessionWriter(path, metadata={}) as session:
            for k, reading in enumerate(islice(ranges, 100)):
                off = dataclasses.replace(reading, range_m=range_m + k * 1e-4, max_range_m=math.nan)
                session.write(off, log_ns=off.t_ns)
        assert finding in "\n".join(summary_lines(SessionReader(path)))


def _recorded(entry: SensorKind, folder: Path) -> None:
    """Its readings on a real serial line get the entry's beam and limits."""
    from recorder.simulator.serial_robot import SerialRobot

    path = folder / "recorded.mcap"
    with SerialRobot(load_room("room"), sensors=("xr900",), speed=4.0) as robot:
        assert main(["record", robot.device, "-o", str(path), "--duration", "1", "--quiet"]) == 0
    ranges = [m for m in _messages(path) if isinstance(m, Range)]
    assert len(ranges) > 20
    known = {(m.sensor, math.degrees(m.beam_width_rad), m.max_range_m) for m in ranges}
    assert {(name, *np.round(numbers, 4)) for name, *numbers in known} == {("xr900", 4.0, 1.2)}


def test_the_page_on_sensors_is_made_of_the_catalogue() -> None:
    path = ROOT / "docs" / "make_sensor_page.py"
    spec = importlib.util.spec_from_file_location("make_sensor_page", path)
    assert spec is not None
    assert spec.loader is not None
    maker = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(maker)
    assert (ROOT / "docs" / "sensors.md").read_text("utf-8") == maker.page()
