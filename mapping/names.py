"""Look a name up in one of the tables of models, rules and rasterisers."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import TypeVar

from recorder.errors import BadInput

Member = TypeVar("Member")


def choose(table: Mapping[str, Member], name: str, what: str) -> Member:
    """The member of that name; BadInput names the nearest one, or all there are."""
    if name in table:
        return table[name]
    close = difflib.get_close_matches(name, list(table), n=1, cutoff=0.4)
    hint = f"the nearest known one is {close[0]}" if close else f"there are {', '.join(table)}"
    raise BadInput(f"unknown {what} {name!r}; {hint}")
