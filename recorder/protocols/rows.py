"""A row of text that is nearly CSV → its fields: what each is called, its number, its unit.

Sketches print in many ways what means the same: ``12, 52``, ``(12, 52)``, ``12;52,5``,
``t:12 ping:52cm``, ``"52 cm"``, with a comma at the end. What each field is must be plain; a row
that could mean two things is none.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

UNITS = ("mm", "cm", "m", "in", "deg", "rad", "ms", "us", "s")
_OTHER_UNITS = {"°": "deg", "inch": "in", "inches": "in", '"': "in", "sec": "s", "degrees": "deg"}
NUMBER = r"[+-]?(?:[0-9]{1,15}(?:\.[0-9]{0,15})?|\.[0-9]{1,15})(?:[eE][+-]?[0-9]{1,2})?"
_NO_NUMBER = r"|nan|inf|-inf|\+inf"
_UNIT = "|".join(sorted((*UNITS, *map(re.escape, _OTHER_UNITS)), key=len, reverse=True))
_FIELD = re.compile(
    rf"(?:(?P<name>[A-Za-z_][A-Za-z0-9_ ]*?)\s*[:=]\s*)?(?P<number>{NUMBER}{_NO_NUMBER})"
    rf"(?:\s*(?P<unit>{_UNIT}))?",
    re.IGNORECASE,
)
_NAMED = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\s*[:=]")
_SEPARATOR = re.compile(r"\s*[,;]\s*|\s+")
_UNIT_APART = re.compile(rf"(?<=[0-9.])\s+(?=(?:{_UNIT})(?:$|[\s,;]))", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"(?<=[0-9]),(?=[0-9])")


@dataclass(frozen=True, slots=True)
class RowField:
    """One field: its number as it stands (empty, ``nan``: not measured); name and unit if given."""

    number: str
    name: str = ""
    unit: str = ""


def plain_fields(text: str) -> list[str]:
    """The row cut at every comma, semicolon, tab or blank, as strict CSV of numbers wants it."""
    return _SEPARATOR.split(text.strip())


def fields_of(text: str, count: int | None = None) -> list[RowField]:
    """The fields of a row that is nearly CSV; ``count`` is how many there should be, if known.

    Raises ValueError where a field is no number, or where it is not clear what is meant.
    """
    text = _unwrapped(text)
    if _NAMED.match(text):
        return _named(text)
    for words in _cuts(text):
        if count is None or len(words) == count:
            return [_field(word) for word in words]
    raise ValueError(f"{text!r} has not {count} fields")


def _unwrapped(text: str) -> str:
    """Without brackets or quotes around it all, quotes around fields, separators at the end."""
    text = text.strip().removesuffix(".").strip()
    while text[:1] in "([{<" and text[-1:] in ")]}>" and len(text) > 1:
        text = text[1:-1].strip()
    text = text.replace('"', " ").replace("'", " ").strip()
    return _UNIT_APART.sub("", text.rstrip(",; \t"))


def _cuts(text: str) -> list[list[str]]:
    """Ways to cut a row, the plainest first; with a decimal comma where another mark separates."""
    if ";" in text or "\t" in text:
        mark = ";" if ";" in text else "\t"
        words = [word.strip() for word in text.split(mark)]
        return [[_DECIMAL_COMMA.sub(".", word) for word in words], plain_fields(text)]
    spaced = text.split()
    if "," in text and len(spaced) > 1 and not any(word.endswith(",") for word in spaced):
        return [[_DECIMAL_COMMA.sub(".", word) for word in spaced], plain_fields(text)]
    return [[word.strip() for word in text.split(",")] if "," in text else spaced]


def _named(text: str) -> list[RowField]:
    """``ping: 52 cm, dirrs=300mm`` → fields with their names."""
    starts = [match.start() for match in _NAMED.finditer(text)]
    words = [text[a:b].strip(" ,;\t") for a, b in zip(starts, [*starts[1:], None], strict=True)]
    return [_field(word) for word in words]


def _field(word: str) -> RowField:
    match = _FIELD.fullmatch(word)
    if match is None:
        raise ValueError(f"{word!r} is no number")
    unit = (match["unit"] or "").lower()
    return RowField(match["number"].lower(), match["name"] or "", _OTHER_UNITS.get(unit, unit))
