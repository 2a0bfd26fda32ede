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


def json_value(value: object, *, nulls: bool = False) -> Json:
    """Dataclasses as objects, arrays as lists; all that is not known as text.

    So are infinities and NaN, for which JSON has no number, unless they are to be ``nulls``.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return json_object(value, nulls=nulls)
    match value:
        case Mapping():
            return {str(key): json_value(inner, nulls=nulls) for key, inner in value.items()}
        case np.ndarray() | np.generic():
            return json_value(value.tolist(), nulls=nulls)
        case float() if not math.isfinite(value):
            return None if nulls else str(value)
        case None | bool() | int() | float() | str():
            return value
        case Sequence():
            return [json_value(inner, nulls=nulls) for inner in value]
        case _:
            return str(value)


def json_object(value: DataclassInstance, *, nulls: bool = False) -> dict[str, Json]:
    """A dataclass by the names of its fields, as :func:`json_value` has them."""
    return {f.name: json_value(getattr(value, f.name), nulls=nulls) for f in fields(value)}
