"""Names: which ones sensors and frames may have, and what somebody meant who misspelt one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

FRAME_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
LEAST_LIKENESS = 0.4  # of 1; below it the nearest name is a guess that helps nobody


def nearest(
    name: str, known: Iterable[str], *, least_likeness: float = LEAST_LIKENESS
) -> str | None:
    """The known name that is most like this one; None where none is."""
    close = difflib.get_close_matches(name, list(known), n=1, cutoff=least_likeness)
    return close[0] if close else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """``did you mean 'ping'?``, or all the names there are."""
    names = list(known)
    near = nearest(name, names)
    return f"there are {', '.join(names)}" if near is None else f"did you mean {near!r}?"
