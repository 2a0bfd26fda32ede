"""A student's own sensor models and update rules, from one short Python file.

Every subclass of ``SensorModel`` and ``UpdateRule`` that the file defines goes into the tables that
name them, so that configuration, command line and laws know it, and the keys that it has of its
own, like the built-in ones. The file is run as Python: load only files that you trust.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from pydantic import ValidationError
from pydantic.fields import FieldInfo

from mapping.config_sections import SensorSection
from mapping.parameters import Configurable, ParameterSection, Sensor
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
    _check_keys((*models, *rules), path)
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


def _check_keys(members: Sequence[Configurable], path: Path) -> None:
    """Whether the own keys of models and rules can stand in a sensor's section beside all others.

    A key of another model or rule may be used, too, where it is taken over as it is (by deriving
    from its Parameters).
    """
    replaced = {member.name for member in members}
    taken: dict[str, FieldInfo] = {}
    for other in (*SENSOR_MODELS.values(), *UPDATE_RULES.values()):
        if other.name not in replaced:
            taken |= other.Parameters.model_fields
    of_all = {*SensorSection.model_fields, *(each.name for each in fields(Sensor))}
    for member in members:
        own, whose = member.Parameters, f"{path}: class {type(member).__name__}"
        if not (isinstance(own, type) and issubclass(own, ParameterSection)):
            raise BadInput(f"{whose}: its Parameters must derive from those of its base class")
        for key, field in own.model_fields.items():
            if key in of_all and key not in taken:
                raise BadInput(f"{whose} names a parameter {key!r}, as every sensor has one")
            if key in taken and not _same(field, taken[key]):
                raise BadInput(f"{whose} names a parameter {key!r}, which another one has already")
            if key not in taken and field.is_required():
                raise BadInput(f"{whose}: its parameter {key!r} needs a default")
            taken[key] = field
        _check_defaults(own, whose)


def _same(one: FieldInfo, other: FieldInfo) -> bool:
    return all(
        getattr(one, part) == getattr(other, part) for part in ("annotation", "metadata", "default")
    )


def _check_defaults(own: type[ParameterSection], whose: str) -> None:
    try:
        own.model_validate(own.defaults())
    except ValidationError as error:
        wrong = [each for each in error.errors() if each["type"] != "missing"]  # see the catalogue
        if wrong:
            key = ".".join(str(part) for part in wrong[0]["loc"])
            raise BadInput(f"{whose}: default of {key}: {wrong[0]['msg'].lower()}") from None


def _check_overridden(member: object, base: type, methods: tuple[str, ...], path: Path) -> None:
    for method in methods:
        if getattr(type(member), method) is getattr(base, method):
            raise BadInput(f"{path}: class {type(member).__name__} needs a method {method}")
