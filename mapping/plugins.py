"""A student's own sensor models and update rules, from one short Python file.

Every subclass of ``SensorModel`` and ``UpdateRule`` that the file defines goes into the tables that
name them, so that configuration, command line and laws know it like the built-in ones. The file is
run as Python: load only files that you trust.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from mapping.sensor_model import SENSOR_MODELS, SensorModel
from mapping.update_rules import UPDATE_RULES, UpdateRule
from recorder.errors import BadInput
from recorder.plugin_files import one_line, run_file

Member = TypeVar("Member", SensorModel, UpdateRule)

_BUILT_IN = frozenset({*SENSOR_MODELS, *UPDATE_RULES})


@dataclass(frozen=True, slots=True)
class Plugin:
    """What a file defines."""

    models: tuple[SensorModel, ...]
    rules: tuple[UpdateRule, ...]


def load_plugin(path: Path | str) -> Plugin:
    """Run a Python file and register the models and rules that it defines.

    Loading a file again replaces what it registered before. Raises BadInput, in one line, when the
    file cannot be read or run, defines nothing, or a class of it cannot be used; then nothing of it
    is registered.
    """
    path = Path(path)
    module = run_file(path)
    own = [value for value in vars(module).values() if _defined_in(value, module)]
    models = tuple(_made(c, path) for c in own if issubclass(c, SensorModel))
    rules = tuple(_made(c, path) for c in own if issubclass(c, UpdateRule))
    if not models and not rules:
        raise BadInput(f"{path}: defines no class derived from SensorModel or UpdateRule")
    for rule in rules:
        _check_rule(rule, path)
    for model in models:
        _check_overridden(model, SensorModel, ("occupied",), path)
    SENSOR_MODELS.update({model.name: model for model in models})
    UPDATE_RULES.update({rule.name: rule for rule in rules})
    return Plugin(models, rules)


def _defined_in(value: object, module: ModuleType) -> bool:
    """A model or rule of the file itself; a leading underscore marks one that is only a base."""
    if not isinstance(value, type):
        return False
    wanted = issubclass(value, SensorModel | UpdateRule)
    if not wanted or value.__name__.startswith("_"):
        return False
    return value.__module__ == module.__name__


def _made(kind: type[Member], path: Path) -> Member:
    """An instance of a plugin's class, once its name is known to be usable."""
    name = kind.name
    if not isinstance(name, str) or not name:
        raise BadInput(f'{path}: class {kind.__name__} needs a name, such as name = "mine"')
    if name in _BUILT_IN:
        raise BadInput(f"{path}: class {kind.__name__} takes the name {name!r}, which is built in")
    try:
        return kind()
    except Exception as error:
        raise BadInput(f"{path}: {kind.__name__}() fails: {one_line(error)}") from error


def _check_rule(rule: UpdateRule, path: Path) -> None:
    if not isinstance(rule.start, dict) or not rule.start:
        raise BadInput(
            f"{path}: class {type(rule).__name__} needs start, "
            'the arrays it keeps and what they begin with, such as start = {"score": 0.0}'
        )
    _check_overridden(rule, UpdateRule, ("merge", "values"), path)


def _check_overridden(member: object, base: type, methods: tuple[str, ...], path: Path) -> None:
    for method in methods:
        if getattr(type(member), method) is getattr(base, method):
            raise BadInput(f"{path}: class {type(member).__name__} needs a method {method}")
