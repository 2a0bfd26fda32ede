"""Anything as values that JSON can hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


def json_value(value: object) -> Json:
    """Dataclasses as objects, arrays as lists; infinities, NaN and all else as text."""
    if is_dataclass(value) and not isinstance(value, type):
        return json_object(value)
    match value:
        case Mapping():
            return {str(key): json_value(inner) for key, inner in value.items()}
        case np.ndarray() | np.generic():
            return json_value(value.tolist())
        case float():
            return value if math.isfinite(value) else str(value)
        case None | bool() | int() | str():
            return value
        case Sequence():
            return [json_value(inner) for inner in value]
        case _:
            return str(value)


def json_object(value: DataclassInstance) -> dict[str, Json]:
    """A dataclass by the names of its fields."""
    return {each.name: json_value(getattr(value, each.name)) for each in fields(value)}
