"""The configuration: one frozen section a stage. The defaults and descriptions are the manual.

A configuration comes from TOML files, then ``--set a.b=c``; an unknown key is an error that names
the nearest known one. What a sensor *is* (:class:`Sensor`) is settled for each session from, first
found first taken: the configuration, the session's own message or mount, the built-in sensor of
that name, the built-in one of its radiation.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from mapping.config_sections import (
    BordersSection,
    FusionSection,
    MappingConfig,
    SegmentsSection,
    sensor_section,
)
from mapping.names import choose
from mapping.parameters import Configurable, ParameterSection, Section, Sensor
from mapping.sensor_model.models import SENSOR_MODELS
from mapping.update_rules.rules import UPDATE_RULES
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Radiation
from recorder.names import nearest

__all__ = [
    "BUILT_IN_SENSORS", "PRESETS", "BordersSection", "FusionSection", "Heard", "MappingConfig",
    "SegmentsSection", "Sensor", "load_config", "resolve_sensor", "unused_keys",
]  # fmt: skip

CHAPTER_PRESET: dict[str, Any] = {
    "sensors": {"*": {"model": "regions", "regions": 12, "gaussian": "both",
                      "emptiness": "combined", "update": "bayes", "rasteriser": "cells"}},
    "fusion": {"rule": "weights", "weights": "angular"},
}  # fmt: skip
PRESETS = {"chapter": CHAPTER_PRESET}


@dataclass(frozen=True, slots=True)
class Heard:
    """What a session itself says of a sensor (NaN: it says nothing)."""

    name: str
    radiation: Radiation
    beam_width_rad: float = math.nan
    min_range_m: float = math.nan
    max_range_m: float = math.nan


_COMMON: dict[str, Any] = {
    "model": "fading", "update": "bayes", "rasteriser": "cells", "second_grid": True,
}  # fmt: skip
_SONAR_FADING = {"hit": 0.8, "miss": 0.08, "near": 30.0, "before": 0.01, "behind": 0.1,
                 "fade_m": 0.75}  # fmt: skip
_SHARP_FADING = {"hit": 2.2, "miss": 0.85, "near": 0.0, "before": 0.075, "behind": 0.075,
                 "fade_m": 1e9}  # fmt: skip
# A laser's band is narrower than the infrared ranger's, by the ratio of their range errors.
_LASER_FADING = {**_SHARP_FADING, "before": 0.015, "behind": 0.015}

BUILT_IN_SENSORS: dict[str, dict[str, Any]] = {
    "ping": {**_COMMON, **_SONAR_FADING, "mount": (0.044, 0.0, 0.0), "beam_width_deg": 38.0,
             "range_error": 0.10, "min_range_m": 0.02, "max_range_m": 4.0, "no_echo": "skipped"},
    "dirrs": {**_COMMON, **_SHARP_FADING, "mount": (-0.0312, 0.0, 0.0), "beam_width_deg": 6.0,
              "range_error": 0.05, "min_range_m": 0.1, "max_range_m": 0.8, "no_echo": "empties"},
    "lidar": {**_COMMON, **_LASER_FADING, "mount": (0.0, 0.0, 0.0), "beam_width_deg": 1.0,
              "range_error": 0.01, "min_range_m": 0.05, "max_range_m": 30.0, "no_echo": "empties"},
}  # fmt: skip
KIND_OF_RADIATION = {
    Radiation.ULTRASOUND: "ping", Radiation.INFRARED: "dirrs", Radiation.LASER: "lidar",
}  # fmt: skip


def resolve_sensor(heard: Heard, config: MappingConfig, *, mounted: bool) -> Sensor:
    """Everything about one sensor, each value from the first place that knows it.

    ``mounted`` tells that the session holds a transform for it; its mount then stays None.
    """
    asked = {**_set_keys(config.sensors.get("*")), **_set_keys(config.sensors.get(heard.name))}
    asked.pop("topic", None)
    kind = str(asked.pop("kind", None) or _kind_of(heard))
    base = BUILT_IN_SENSORS.get(kind) or BUILT_IN_SENSORS[KIND_OF_RADIATION[heard.radiation]]
    said = {
        "beam_width_deg": math.degrees(heard.beam_width_rad),
        "min_range_m": heard.min_range_m,
        "max_range_m": heard.max_range_m,
    }
    said = {key: value for key, value in said.items() if math.isfinite(value) and value > 0}
    values = {**parameter_defaults(), **base, **said, **asked}
    mount = asked.get("mount", None if mounted else base["mount"])
    values.pop("mount")
    width_deg = values.pop("beam_width_deg")
    _check(heard.name, choose(SENSOR_MODELS, values["model"], "sensor model"), values)
    _check(heard.name, choose(UPDATE_RULES, values["update"], "update rule"), values)
    return Sensor(
        name=heard.name,
        kind=kind,
        radiation=heard.radiation,
        layer=values.pop("layer", None) or "",
        mount=None if mount is None else SE2(mount[0], mount[1], math.radians(mount[2])),
        beam_width_rad=math.radians(width_deg),
        own={key: values.pop(key) for key in parameter_keys() if key not in _SENSOR_FIELDS},
        **values,
    )


_SENSOR_FIELDS = frozenset(each.name for each in fields(Sensor))


def parameter_keys() -> dict[str, None]:
    """The keys that any model or rule has of its own, in order."""
    return dict.fromkeys(key for each in _parameters() for key in each.model_fields)


def parameter_defaults() -> dict[str, Any]:
    """What those keys are where nothing sets them."""
    return {key: value for each in _parameters() for key, value in each.defaults().items()}


def _parameters() -> Iterator[type[ParameterSection]]:
    members: Iterable[Configurable] = (*SENSOR_MODELS.values(), *UPDATE_RULES.values())
    return (member.Parameters for member in members)


def _check(sensor: str, member: Configurable, values: Mapping[str, Any]) -> None:
    """Whether a model or rule can go by the values together. Raises BadInput, in one line."""
    try:
        member.Parameters.model_validate(member.Parameters.own_of(values))
    except ValidationError as error:
        raise BadInput(f"sensors.{sensor}.{_in_one_line(error)}") from None


def unused_keys(config: MappingConfig) -> list[str]:
    """Keys that are set, as ``sensors.NAME.key``, though the model and rule do not go by them.

    A key of all sensors (``*``) is used when any of them goes by it. A model of a plugin that does
    not state its parameters may use every key.
    """
    of_all = _set_keys(config.sensors.get("*"))
    used = {
        name: _used_keys({**of_all, **_set_keys(section)})
        for name, section in config.sensors.items()
    }
    used["*"] = set().union(*used.values(), _used_keys(of_all))
    owned = parameter_keys()
    return [
        f"sensors.{name}.{key}"
        for name, section in config.sensors.items()
        for key in _set_keys(section) if key in owned and key not in used[name]
    ]  # fmt: skip


def _used_keys(asked: Mapping[str, Any]) -> set[str]:
    """The keys that the model and the rule of a sensor go by, which is asked to be so."""
    used = {"gaussian"} if asked.get("rasteriser") == "arcs" else set()
    tables: dict[str, Mapping[str, Configurable]]
    tables = {"model": SENSOR_MODELS, "update": UPDATE_RULES}
    for key, table in tables.items():
        defaults = {entry[key] for entry in BUILT_IN_SENSORS.values()}
        for name in [asked[key]] if key in asked else sorted(defaults):
            known = table[name].Parameters if name in table else Configurable.Parameters
            if key == "model" and known is Configurable.Parameters:
                return set(parameter_keys())
            used |= set(known.model_fields)
    return used


def _kind_of(heard: Heard) -> str:
    """``ping``, ``ping_left`` and ``ping2`` are pings; any other name goes by its radiation."""
    for kind in BUILT_IN_SENSORS:
        if heard.name == kind or heard.name.rstrip("0123456789").split("_")[0] == kind:
            return kind
    return KIND_OF_RADIATION[heard.radiation]


def _set_keys(section: Section | None) -> dict[str, Any]:
    return {} if section is None else section.model_dump(exclude_none=True)


def load_config(
    files: Iterable[Path] = (), settings: Iterable[str] = (), preset: str | None = None
) -> MappingConfig:
    """Preset, then files in order, then ``a.b=c`` settings: the later ones win.

    Raises BadInput, in one line, for an unknown key (with the nearest known one) or a bad value.
    """
    data: dict[str, Any] = {}
    if preset is not None:
        if preset not in PRESETS:
            raise BadInput(f"unknown preset {preset!r}; known: {', '.join(PRESETS)}")
        data = _merged(data, PRESETS[preset])
    for file in files:
        data = _merged(data, _read_toml(file))
    for setting in settings:
        data = _merged(data, parse_setting(setting))
    return validate(data)


def validate(data: Mapping[str, Any]) -> MappingConfig:
    """A nested mapping → the configuration; BadInput names what is wrong with it."""
    try:
        return MappingConfig.model_validate(data)
    except ValidationError as error:
        raise BadInput(_in_one_line(error)) from None


def parse_setting(setting: str) -> dict[str, Any]:
    """``a.b=c`` → {"a": {"b": c}}; c is read as TOML where it is TOML, else as text."""
    path, equals, text = setting.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not equals or not all(keys):
        raise BadInput(f"--set takes section.key=value, not {setting!r}")
    try:
        value: Any = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    for key in reversed(keys):
        value = {key: value}
    return dict(value)


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{file}: not TOML: {error}") from None


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(below)
    for key, value in above.items():
        old = out.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            out[key] = _merged(old, value)
        else:
            out[key] = value
    return out


def _in_one_line(error: ValidationError) -> str:
    first = error.errors()[0]
    path = [str(part) for part in first["loc"]]
    if first["type"] == "extra_forbidden":
        return f"unknown key {'.'.join(path)}{_nearest_key(path)}"
    if first["type"] == "tuple_type":
        reason = "numbers in square brackets are wanted, as in [1.5, 2]"
    elif first["type"] == "missing":  # of a list of numbers; keys all have a default
        reason = "a number is missing"
    else:
        reason = first["msg"].lower()
    return f"{'.'.join(path)}: {reason} (not {first['input']!r})"


def _nearest_key(path: list[str]) -> str:
    """A key of another section, where the name is right and its section was left out."""
    if len(path) == 1:
        sections = {name: _known_keys([name]) for name in MappingConfig.model_fields}
        sections["sensors.*"] = sections.pop("sensors")
        homes = [f"{name}.{path[0]}" for name, keys in sections.items() if path[0] in keys]
        if homes:
            return f"; did you mean {' or '.join(homes)}?"
    near = nearest(path[-1], _known_keys(path[:-1]))
    return "" if near is None else f"; the nearest known one is {near}"


def _known_keys(path: list[str]) -> list[str]:
    section: type[BaseModel] = MappingConfig
    for key in path:
        if section is MappingConfig and key == "sensors":
            return list(sensor_section().model_fields)
        field = section.model_fields.get(key)
        if field is None or not isinstance(field.annotation, type):
            return []
        section = field.annotation
    return list(section.model_fields)
