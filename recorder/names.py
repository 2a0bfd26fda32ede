"""Names: which ones sensors and frames may have, and what somebody meant who misspelt one."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable

FRAME_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")
LEAST_LIKENESS = 0.4  # of 1; below it the nearest name is a guess that helps nobody
LONGEST_NAME = 64
_ESCAPED = ("Cc", "Cf", "Co", "Cn", "Cs", "Zl", "Zp")  # controls, directions, no characters


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


def printable(text: str, *, most: int | None = None) -> str:
    """Text that a terminal shows as it stands: what it would obey is escaped, the end cut."""
    shown = "".join(repr(c)[1:-1] if unicodedata.category(c) in _ESCAPED else c for c in text)
    return shown if most is None or len(shown) <= most else f"{shown[: most - 3]}..."


def unusable_name(name: str) -> str:
    """Why no sensor, layer or frame may have this name, as part of a sentence; empty: it may.

    Names become names of files, of entities in the viewer and of settings, and stand in terminals.
    """
    if not name.strip():
        return "it is empty"
    if len(name) > LONGEST_NAME:
        return f"it has {len(name)} characters, at most {LONGEST_NAME}"
    if printable(name) != name:
        return "it holds characters that cannot be printed"
    if name.startswith(".") or any(c in '/\\:*?"<>|' for c in name):
        return 'it may not begin with a dot, nor hold any of / \\ : * ? " < > |'
    return ""
