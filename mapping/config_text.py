"""The configuration as commented TOML: for people, and for every output."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args, get_origin

import tomlkit
from pydantic import BaseModel

from mapping.config import MappingConfig, parameter_defaults, sensor_defaults
from mapping.config_sections import sensor_section
from recorder.messages import Radiation
from recorder.sensors import CATALOGUE, kind_of_radiation

_SENSORS = """\

# A sensor is configured in a section of its name, [sensors.ping], all of them in [sensors."*"].
# Its keys, and what they are for a sonar (ping), an infrared ranger (dirrs) and a laser (lidar)
# when neither the configuration nor the session says otherwise:
"""
_KINDS = """
# The kinds that there are; a sensor is of the one that its name holds (tfmini_left), or that its
# key kind names (docs/sensors.md has all that is known of each):
"""


def commented_toml(config: MappingConfig) -> str:
    """All keys in force with what each means; keys that are not set stand as comments."""
    return _toml(config, choices=False)


def explained_toml(config: MappingConfig) -> str:
    """The same for somebody who wants to change it: with the words to choose from, where a key
    takes one of a few, and with all keys of a sensor as comments."""
    usual = {
        k.name: {**parameter_defaults(), **sensor_defaults(k)}
        for k in map(kind_of_radiation, Radiation)
    }
    lines = [_sensor_line(usual, key, field.description or "", field.annotation)
             for key, field in sensor_section().model_fields.items()]  # fmt: skip
    kinds = [f"#   {kind.name:<12}{kind.summary()}\n" for kind in CATALOGUE.values()]
    return _toml(config, choices=True) + _SENSORS + "".join(lines) + _KINDS + "".join(kinds)


def _sensor_line(
    usual: Mapping[str, Mapping[str, Any]], key: str, description: str, annotation: Any
) -> str:
    of_each = {name: _shown(keys[key]) for name, keys in usual.items() if key in keys}
    defaults = ", ".join(f"{name} {value}" for name, value in of_each.items())
    if len(set(of_each.values())) == 1:
        defaults = f"default {next(iter(of_each.values()))}"
    defaults = f" ({defaults})" if defaults else ""
    return f"# {key} =    # {_with_choices(key, description, annotation)}{defaults}\n"


def _shown(value: Any) -> str:
    """A default as short as it can be read."""
    if isinstance(value, tuple):
        return f"[{', '.join(f'{each:g}' for each in value)}]"
    if isinstance(value, float):
        return f"{value:g}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _with_choices(key: str, description: str, annotation: Any) -> str:
    words = _named(key) or list(dict.fromkeys(_literals(annotation)))
    return f"{description}; one of {', '.join(words)}" if words else description


def _named(key: str) -> list[str]:
    """What the program knows by name: line methods, sensor models, update rules."""
    from mapping.segments.methods import LINE_METHODS
    from mapping.sensor_model import SENSOR_MODELS
    from mapping.update_rules import UPDATE_RULES

    tables: dict[str, Iterable[str]] = {
        "method": LINE_METHODS, "model": SENSOR_MODELS, "update": UPDATE_RULES,
    }  # fmt: skip
    return list(tables.get(key, ()))


def _literals(annotation: Any) -> list[str]:
    """The words that a type names, however deep they lie in it."""
    inner = get_args(annotation)
    if get_origin(annotation) is Literal:
        return [word for word in inner if isinstance(word, str)]
    return [word for each in inner for word in _literals(each)]


def _toml(config: MappingConfig, *, choices: bool) -> str:
    document = tomlkit.document()
    for name in MappingConfig.model_fields:
        section = getattr(config, name)
        if isinstance(section, BaseModel):
            document.add(name, _table(section, choices))
    sensors = tomlkit.table(is_super_table=True)
    for name, section in config.sensors.items():
        sensors.add(name, _table(section, choices))
    if config.sensors:
        document.add("sensors", sensors)
    return tomlkit.dumps(document)


def _item(value: Any) -> Any:
    """A value of a key, what has keys itself in one line: a table would take the keys after it."""
    if isinstance(value, BaseModel):
        value = value.model_dump(exclude_none=True)
    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update({key: _item(each) for key, each in value.items()})
        return inline
    if isinstance(value, tuple) and value and isinstance(value[0], BaseModel):
        several = tomlkit.array()
        several.extend(map(_item, value))
        return several
    return tomlkit.item(list(value) if isinstance(value, tuple) else value)


def _table(section: BaseModel, choices: bool) -> Any:
    table = tomlkit.table()
    for key, field in type(section).model_fields.items():
        value = getattr(section, key)
        description = field.description or ""
        if choices:
            description = _with_choices(key, description, field.annotation)
        if value is None:
            table.add(tomlkit.comment(f"{key} =    # {description}"))
            continue
        item = _item(value)
        if description and not isinstance(value, dict):
            item.comment(description)
        table.add(key, item)
    return table
