"""The configuration: one frozen section a stage. The defaults and descriptions are the manual.

A configuration comes from TOML files, then ``--set a.b=c``; an unknown key is an error that names
the nearest known one. What a sensor *is* (:class:`Sensor`) is settled for each session from, first
found first taken: the configuration, the session's own message or mount, the catalogue's sensor of
that name, its usual one of that radiation.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
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
from mapping.parameters import Configurable, ParameterSection, Section, Sensor, Table
from mapping.sensor_model.models import SENSOR_MODELS
from mapping.update_rules.rules import UPDATE_RULES, Bayes
from recorder.errors import BadInput
from recorder.foreign import read_text, reading, reason_of
from recorder.geometry import SE2
from recorder.messages import Radiation
from recorder.names import nearest, printable, unusable_name
from recorder.sensors import CATALOGUE, SensorKind, kind_of, kind_of_radiation

__all__ = [
    "PRESETS", "BordersSection", "FusionSection", "MappingConfig", "ReportedSensor",
    "SegmentsSection", "Sensor", "load_config", "resolve_sensor", "sensor_defaults", "unused_keys",
    "unused_note",
]  # fmt: skip

CHAPTER_PRESET: dict[str, Any] = {
    "sensors": {"*": {"model": "regions", "regions": 12, "gaussian": "both",
                      "emptiness": "combined", "update": "bayes", "rasteriser": "cells"}},
    "fusion": {"rule": "weights", "weights": "angular"},
    "segments": {"refit": "none"},
}  # fmt: skip
PRESETS = {"chapter": CHAPTER_PRESET}


_DEEPEST = 8  # sensors, a name, a key, a list in it: four are used
_LONGEST_SHOWN = 80
_MOST_DOTS = 100
_LEAST, _MOST = 1e-9, 1e9  # of what a session reports of a sensor: anything else is a fault


@dataclass(frozen=True, slots=True)
class ReportedSensor:
    """What a session itself reports of a sensor (NaN: nothing)."""

    name: str
    radiation: Radiation
    beam_width_rad: float = math.nan
    min_range_m: float = math.nan
    max_range_m: float = math.nan


_COMMON: dict[str, Any] = {"rasteriser": "cells", "second_grid": True}


def sensor_defaults(kind: SensorKind) -> dict[str, Any]:
    """The keys of a sensor of this kind that nobody configured, all but ``layer``.

    BadInput where the catalogue gives its model a parameter that there is not, or a bad value.
    """
    keys = {
        **_COMMON, "model": kind.model, **kind.model_parameters, "update": kind.update,
        "no_echo": kind.no_echo,
        "mount": (kind.mount.x_m, kind.mount.y_m, math.degrees(kind.mount.heading_rad)),
        "beam_width_deg": kind.beam_width_deg, "range_error": kind.range_error,
        "min_range_m": kind.min_range_m, "max_range_m": kind.max_range_m,
    }  # fmt: skip
    return _set_keys(validate({"sensors": {kind.name: keys}}).sensors[kind.name])


def resolve_sensor(reported: ReportedSensor, config: MappingConfig, *, mounted: bool) -> Sensor:
    """Everything about one sensor, each value from the first place that knows it.

    ``mounted``: the session holds a transform for it; its mount then stays None.
    """
    asked = {**_set_keys(config.sensors.get("*")), **_set_keys(config.sensors.get(reported.name))}
    asked.pop("topic", None)
    ranges = asked.pop("ranges", ())
    _check_names(reported.name, asked.get("layer"))
    kind = str(asked.pop("kind", None) or kind_of(reported.name, reported.radiation).name)
    entry = CATALOGUE.get(kind) or kind_of_radiation(reported.radiation)
    base = sensor_defaults(entry)
    own = {
        "beam_width_deg": math.degrees(reported.beam_width_rad),
        "min_range_m": reported.min_range_m,
        "max_range_m": reported.max_range_m,
    }
    reported_values = {k: v for k, v in own.items() if _LEAST <= v <= _MOST}
    if reported_values.get("beam_width_deg", 0.0) > 360.0:
        del reported_values["beam_width_deg"]
    values = {**base, **reported_values, **asked}
    set_keys = {*asked, *(key for each in ranges for key in each)}
    if "update" not in asked and not _suits(entry, reported, values, set_keys):
        values["update"] = Bayes.name
    rule = choose(UPDATE_RULES, values["update"], "update rule")
    values = {**parameter_defaults(), **values, **rule.usual(entry), **asked}
    mount = asked.get("mount", None if mounted else base["mount"])
    values.pop("mount")
    width_deg = values.pop("beam_width_deg")
    model = choose(SENSOR_MODELS, values["model"], "sensor model")
    for each in ({}, *ranges):
        _check(reported.name, model, {**values, **each})
    _check(reported.name, rule, values)
    sensor = Sensor(
        name=reported.name,
        kind=kind,
        radiation=reported.radiation,
        layer=values.pop("layer", None) or "",
        mount=None if mount is None else SE2(mount[0], mount[1], math.radians(mount[2])),
        beam_width_rad=math.radians(width_deg),
        own={
            key: _settled(values.pop(key)) for key in parameter_keys() if key not in _SENSOR_FIELDS
        },
        **values,
    )
    return replace(sensor, nearer=tuple(_changed(sensor, each) for each in ranges))


def _changed(sensor: Sensor, keys: Mapping[str, Any]) -> Sensor:
    """The sensor with other values of some keys, its own and those of plugins."""
    own = {key: _settled(value) for key, value in keys.items() if key not in _SENSOR_FIELDS}
    of_all = {key: value for key, value in keys.items() if key in _SENSOR_FIELDS}
    return replace(sensor, own={**sensor.own, **own}, **of_all)


def _settled(value: Any) -> Any:
    return Table(value) if isinstance(value, dict) else value


def _suits(
    kind: SensorKind, reported: ReportedSensor, known: Mapping[str, Any], asked: set[str]
) -> bool:
    """Whether the kind's own rule can be that of a sensor as it is configured, without naming one.

    It was chosen with the kind's model and all cells of its beams. Keys by which the rule does not
    go would be set in vain; who sets them wants them to count. Scans, whatever their name, have no
    fast way.
    """
    rule, model = UPDATE_RULES[kind.update], SENSOR_MODELS[kind.model]
    return (
        known["model"] == kind.model
        and known["rasteriser"] == _COMMON["rasteriser"]
        and reported.radiation is not Radiation.LASER
        and not rule.ignores & asked & model.Parameters.model_fields.keys()
    )


def _check_names(sensor: str, layer: str | None) -> None:
    """Names go into files, the viewer and terminals. Raises BadInput with the way out."""
    if why := unusable_name(sensor):
        raise BadInput(f"a sensor cannot be called {_short(sensor)}: {why}")
    if layer and (why := unusable_name(layer)):
        raise BadInput(f"sensors.{sensor}.layer: a layer cannot be called {_short(layer)}: {why}")


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
        for key in _keys_in(section) if key in owned and key not in used[name]
    ]  # fmt: skip


def _keys_in(section: Section | None) -> dict[str, None]:
    """The keys that are set in a section of a sensor, those of its nearer ranges among them."""
    keys = _set_keys(section)
    return dict.fromkeys([*keys, *(key for each in keys.get("ranges", ()) for key in each)])


def unused_note(config: MappingConfig) -> str:
    """The same as a sentence; empty where all keys are used."""
    keys = unused_keys(config)
    if not keys:
        return ""
    verb = "is" if len(keys) == 1 else "are"
    return f"{', '.join(keys)} {verb} set, but the chosen model or rule has no use for it"


def _used_keys(asked: Mapping[str, Any]) -> set[str]:
    """The keys that the model and the rule of a sensor go by, which is asked to be so."""
    used = {"gaussian"} if asked.get("rasteriser") == "arcs" else set()
    tables: dict[str, Mapping[str, Configurable]]
    tables = {"model": SENSOR_MODELS, "update": UPDATE_RULES}
    for key, table in tables.items():
        defaults = {entry[key] for entry in map(sensor_defaults, CATALOGUE.values())}
        for name in [asked[key]] if key in asked else sorted(defaults):
            known = table[name].Parameters if name in table else Configurable.Parameters
            if key == "model" and known is Configurable.Parameters:
                return set(parameter_keys())
            used |= set(known.model_fields)
    rule = UPDATE_RULES.get(asked.get("update", ""))
    return used - rule.ignores if rule is not None else used


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
    if not equals or not all(keys) or len(keys) > _DEEPEST:
        raise BadInput(f"--set takes section.key=value, not {_short(setting)}")
    try:
        value: Any = _toml(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    except (ValueError, RecursionError) as error:
        raise BadInput(f"--set {path}: {reason_of(error)}") from None
    for key in reversed(keys):
        value = {key: value}
    _check_plain(value, f"--set {path}")
    return dict(value)


def parse_toml(text: str, subject: object) -> dict[str, Any]:
    """A configuration as TOML. Raises BadInput, with ``subject``, for what nobody writes by hand:
    what is no TOML, nested deeper than sections and keys are, or holds numbers of over 64 bits."""
    with reading(subject, "TOML"):
        values = _toml(text)
    _check_plain(values, subject)
    return values


def _toml(text: str) -> dict[str, Any]:
    """What tomllib reads, which takes time with the square of a key's dots: refused beforehand."""
    pieces = (piece for line in text.splitlines() for piece in re.split("[=,]", line))
    if any(piece.count(".") > _MOST_DOTS for piece in pieces):
        raise ValueError("a key of too many parts")
    return tomllib.loads(text)


def _check_plain(values: Any, subject: object) -> None:
    """What follows goes through the values by recursion: they may not be nested deeply."""
    level = [values]
    for _ in range(_DEEPEST):
        if any(isinstance(v, int) and abs(v) >= 1 << 63 for v in level):
            raise BadInput(f"{subject}: a number is too large")
        level = [
            inner
            for each in level if isinstance(each, dict | list)
            for inner in (each.values() if isinstance(each, dict) else each)
        ]  # fmt: skip
    if level:
        raise BadInput(f"{subject}: nested more than {_DEEPEST} deep")


def _short(value: Any) -> str:
    """A value as it would be written, cut where it is long."""
    return printable(repr(value), most=_LONGEST_SHOWN)


def _read_toml(file: Path) -> dict[str, Any]:
    return parse_toml(read_text(file, "TOML", may_be_empty=True), file)


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
        return f"unknown key {_key(path)}{_nearest_key(path)}"
    if first["type"] == "tuple_type":
        reason = "numbers in square brackets are wanted, as in [1.5, 2]"
    elif first["type"] == "missing":  # of a list of numbers; keys all have a default
        reason = "a number is missing"
    else:
        reason = first["msg"].lower()
    return f"{_key(path)}: {reason} (not {_short(first['input'])})"


def _key(path: list[str]) -> str:
    return printable(".".join(path), most=_LONGEST_SHOWN)


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
