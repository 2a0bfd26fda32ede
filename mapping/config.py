"""The configuration: one frozen section a stage. The defaults and descriptions are the manual.

A configuration comes from TOML files, then ``--set a.b=c``; an unknown key is an error that names
the nearest known one. What a sensor *is* (:class:`Sensor`) is settled for each session from, first
found first taken: the configuration, the session's own message or mount, the built-in sensor of
that name, the built-in one of its radiation.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from mapping.config_sections import (
    BordersSection,
    FusionSection,
    MappingConfig,
    SegmentsSection,
    SensorSection,
)
from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Radiation
from recorder.names import nearest

__all__ = [
    "BUILT_IN_SENSORS",
    "PRESETS",
    "BordersSection",
    "FusionSection",
    "MappingConfig",
    "ReportedSensor",
    "SegmentsSection",
    "Sensor",
    "load_config",
    "resolve_sensor",
]  # fmt: skip

CHAPTER_PRESET: dict[str, Any] = {
    "sensors": {"*": {"model": "regions", "regions": 12, "gaussian": "both",
                      "emptiness": "combined", "update": "bayes", "rasteriser": "cells"}},
    "fusion": {"rule": "weights", "weights": "angular"},
}  # fmt: skip
PRESETS = {"chapter": CHAPTER_PRESET}


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor as one session's map sees it, everything settled. Units in the names."""

    name: str
    kind: str
    layer: str
    radiation: Radiation
    mount: SE2 | None  # None: the session's own transforms say it
    beam_width_rad: float
    range_error: float
    min_range_m: float
    max_range_m: float
    model: str
    regions: int
    gaussian: str
    emptiness: str
    p_hit: float
    p_miss: float
    hit: float
    miss: float
    near: float
    before: float
    behind: float
    fade_m: float
    update: str
    rasteriser: str
    second_grid: bool
    no_echo: str


@dataclass(frozen=True, slots=True)
class ReportedSensor:
    """What a session itself says of a sensor (NaN: it says nothing)."""

    name: str
    radiation: Radiation
    beam_width_rad: float = math.nan
    min_range_m: float = math.nan
    max_range_m: float = math.nan


_COMMON: dict[str, Any] = {
    "model": "fading", "regions": 12, "gaussian": "both", "emptiness": "combined",
    "p_hit": 0.7, "p_miss": 0.4, "update": "bayes", "rasteriser": "cells", "second_grid": True,
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


def resolve_sensor(reported: ReportedSensor, config: MappingConfig, *, mounted: bool) -> Sensor:
    """Everything about one sensor, each value from the first place that knows it.

    ``mounted`` tells that the session holds a transform for it; its mount then stays None.
    """
    asked = {**_set_keys(config.sensors.get("*")), **_set_keys(config.sensors.get(reported.name))}
    asked.pop("topic", None)
    kind = str(asked.pop("kind", None) or _kind_of(reported))
    base = BUILT_IN_SENSORS.get(kind) or BUILT_IN_SENSORS[KIND_OF_RADIATION[reported.radiation]]
    said = {
        "beam_width_deg": math.degrees(reported.beam_width_rad),
        "min_range_m": reported.min_range_m,
        "max_range_m": reported.max_range_m,
    }
    values = {**base, **{k: v for k, v in said.items() if math.isfinite(v) and v > 0}, **asked}
    mount = asked.get("mount", None if mounted else base["mount"])
    values.pop("mount")
    width_deg = values.pop("beam_width_deg")
    return Sensor(
        name=reported.name,
        kind=kind,
        radiation=reported.radiation,
        layer=values.pop("layer", None) or "",
        mount=None if mount is None else SE2(mount[0], mount[1], math.radians(mount[2])),
        beam_width_rad=math.radians(width_deg),
        **values,
    )


def _kind_of(reported: ReportedSensor) -> str:
    """``ping``, ``ping_left`` and ``ping2`` are pings; any other name goes by its radiation."""
    for kind in BUILT_IN_SENSORS:
        if reported.name == kind or reported.name.rstrip("0123456789").split("_")[0] == kind:
            return kind
    return KIND_OF_RADIATION[reported.radiation]


def _set_keys(section: SensorSection | None) -> dict[str, Any]:
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
        said = "numbers in square brackets are wanted, as in [1.5, 2]"
    elif first["type"] == "missing":  # of a list of numbers; keys all have a default
        said = "a number is missing"
    else:
        said = first["msg"].lower()
    return f"{'.'.join(path)}: {said} (not {first['input']!r})"


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
            return list(SensorSection.model_fields)
        field = section.model_fields.get(key)
        if field is None or not isinstance(field.annotation, type):
            return []
        section = field.annotation
    return list(section.model_fields)
