"""Look a name up in one of the tables of models, rules and rasterisers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from recorder.errors import BadInput
from recorder.names import nearest, printable

Member = TypeVar("Member")


def choose(table: Mapping[str, Member], name: str, what: str) -> Member:
    """The member of that name; BadInput names the nearest one, or all there are."""
    if name in table:
        return table[name]
    near = nearest(name, table)
    hint = f"there are {', '.join(table)}" if near is None else f"the nearest known one is {near}"
    raise BadInput(f"unknown {what} {printable(repr(name), most=80)}; {hint}")
