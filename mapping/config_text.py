"""The configuration as commented TOML: for people, and for every output."""

from __future__ import annotations

from typing import Any

import tomlkit
from pydantic import BaseModel

from mapping.config import MappingConfig


def commented_toml(config: MappingConfig) -> str:
    """All keys in force with what each means; keys that are not set stand as comments."""
    document = tomlkit.document()
    for name in MappingConfig.model_fields:
        section = getattr(config, name)
        if isinstance(section, BaseModel):
            document.add(name, _table(section))
    sensors = tomlkit.table(is_super_table=True)
    for name, section in config.sensors.items():
        sensors.add(name, _table(section))
    if config.sensors:
        document.add("sensors", sensors)
    return tomlkit.dumps(document)


def _table(section: BaseModel) -> Any:
    table = tomlkit.table()
    for key, field in type(section).model_fields.items():
        value = getattr(section, key)
        if value is None:
            table.add(tomlkit.comment(f"{key} =    # {field.description}"))
            continue
        item = tomlkit.item(list(value) if isinstance(value, tuple) else value)
        if field.description and not isinstance(value, dict):
            item.comment(field.description)
        table.add(key, item)
    return table
