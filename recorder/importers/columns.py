"""What the columns of a text file are, guessed from the words above them or from their numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from recorder.errors import BadInput
from recorder.protocols.csv import SKIPPED, Column, parse_columns
from recorder.protocols.rows import RowField

_UNIT_IN_NAME = re.compile(
    r"^(.*?)[\s_]*[\[(/_:\s]\s*(mm|cm|m|in|inch|deg|degrees|rad|ms|us|s|sec)\s*[\])]?$"
)
_TIMES = {"t", "time", "timestamp", "millis", "micros", "stamp", "ms", "sec", "seconds", "zeit"}
_ANGLES = {"angle", "servo", "head", "bearing", "pan", "deg", "degrees", "azimuth", "winkel"}
_RANGES = {
    "ping", "sonar", "ultrasonic", "ultrasound", "distance", "dist", "range", "echo", "d", "r",
    "cm", "mm", "hcsr04", "us", "abstand", "distanz", "entfernung",
}  # fmt: skip
_INFRARED = {"ir", "dirrs", "infrared", "sharp"}
_HEADINGS = {"heading", "theta", "yaw", "phi", "th"}
_LENGTHS = ("mm", "cm", "m", "in")
FARTHEST_MM = 15_000.0  # no ranger of those that print plain numbers measures farther


def columns_of_names(line: str) -> tuple[Column, ...] | None:
    """A header's words → columns; what is not known is skipped; None without a range or a pose."""
    words = re.split(r"[,;\t]", line.rstrip(",;"))
    return _columns_of_words(line.split() if len(words) == 1 else words)


def _columns_of_words(words: Sequence[str]) -> tuple[Column, ...] | None:
    words = [word.strip().strip('"').lower() for word in words]
    texts: list[str] = []
    for word in words:
        text = _column_text(word)
        texts.append(
            SKIPPED if text.partition(":")[0] in {t.partition(":")[0] for t in texts} else text
        )
    if {"x", "y"} <= {t.partition(":")[0] for t in texts} and not any(
        t.startswith("heading") for t in texts
    ):
        texts = [SKIPPED if t.partition(":")[0] in ("x", "y") else t for t in texts]
    return _parsed(texts)


def _column_text(word: str) -> str:
    match = _UNIT_IN_NAME.match(word)
    name, unit = (match[1], match[2]) if match else (word, "")
    name = re.sub(r"[^a-z0-9_]+", "_", name).strip("_")
    unit = {"inch": "in", "degrees": "deg", "sec": "s"}.get(unit, unit)
    if word in ("t_ms", "t_s", "t_us", "seq", "left", "right"):
        return word
    if name in _TIMES or (not name and unit in ("ms", "us", "s")):
        return {"us": "t_us", "s": "t_s", "ms": "t_ms"}.get(
            unit, {"micros": "t_us", "sec": "t_s", "seconds": "t_s"}.get(name, "t_ms")
        )
    if name in ("x", "y"):
        return f"{name}:{unit if unit in _LENGTHS else 'm'}"
    if name in _HEADINGS:
        return f"heading:{unit if unit in ('deg', 'rad') else 'deg'}"
    if name in _ANGLES or (not name and unit in ("deg", "rad")):
        return f"head:{unit if unit in ('deg', 'rad') else 'deg'}"
    if not name:
        return f"ping:{unit}" if unit in _LENGTHS else SKIPPED
    first = re.split(r"[_0-9]", name)[0]
    if unit in _LENGTHS or first in _RANGES or first in _INFRARED:
        generic = name in _RANGES - {"sonar", "ping", "hcsr04", "us"}
        sensor = "ping" if generic else name
        known_unit = unit if unit in _LENGTHS else name if name in ("cm", "mm") else "cm"
        return f"{sensor if sensor[:1].isalpha() else 'ping'}:{known_unit}"
    return SKIPPED


def columns_of_numbers(rows: Sequence[Sequence[RowField]]) -> tuple[Column, ...] | None:
    """Rows of numbers alone → columns: a time that rises, an angle, ranges; None where unclear.

    Names and units that stand in the rows themselves come first.
    """
    widths = [len(row) for row in rows]
    if not widths:
        return None
    width = max(set(widths), key=widths.count)
    rows = [row for row in rows if len(row) == width]
    named = rows[0]
    if any(field.name for field in named):
        words = [f"{f.name.strip()} ({f.unit})" if f.unit else f.name.strip() for f in named]
        return _columns_of_words(words)
    table = np.array([[_value(field) for field in row] for row in rows])
    texts: list[str] = []
    names = iter(("ping", "dirrs", *(f"ping_{i}" for i in range(2, width + 2))))
    plain = [k for k in range(width) if width > 1 and not named[k].unit]
    times = [k for k in plain if _is_time(table[:, k][np.isfinite(table[:, k])])]
    for k in range(width):
        values, unit = table[:, k], named[k].unit
        values = values[np.isfinite(values)]
        if not values.size:
            return None
        if k in times[:1]:
            texts.append(_time_name(values))
        elif unit == "deg" or (not unit and k <= 1 and width > k + 1 and _is_sweep(values)):
            texts.append("head:deg")
        elif not unit and np.median(np.abs(values)) > FARTHEST_MM:
            return None  # counts of wheels, or something else that only its owner knows
        else:
            texts.append(_range_text(next(names), values, unit))
    return _parsed(texts)


def _range_text(name: str, values: np.ndarray, unit: str) -> str:
    """A range in its unit, or in the one that its numbers look like."""
    typical = float(np.median(values[values > 0.0])) if (values > 0.0).any() else 1.0
    least_mm = 80.0 if name == "dirrs" else 400.0  # infrared rangers of 80 cm, sonars of 4 m
    guessed = "mm" if typical > least_mm else "cm" if typical > 5.0 else "m"
    return f"{name}:{unit if unit in _LENGTHS else guessed}"


def _value(field: RowField) -> float:
    try:
        return float(field.number or "nan")
    except ValueError:
        return float("nan")


def _is_time(values: np.ndarray) -> bool:
    """Rises nearly always, by steps that are alike, and is no sweep of a head."""
    steps = np.diff(values)
    if len(steps) < 2 or (steps >= 0.0).mean() <= 0.95 or not (steps > 0.0).any():
        return False
    rises = steps[steps > 0.0]
    alike = float((rises <= 5.0 * np.median(rises)).mean())
    return alike > 0.8 and not (_is_sweep(values) and (steps < 0.0).any())


def _time_name(values: np.ndarray) -> str:
    """Milliseconds where whole, seconds where they have a fraction or are UNIX seconds."""
    if (values != np.round(values)).any() or 1e9 < values[0] < 2.2e9:
        return "t_s"
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0.0]))
    many_alike = (steps == 0.0).mean() > 0.5  # whole seconds, many rows in each
    return "t_us" if usual > 5000.0 else "t_s" if many_alike and usual <= 2.0 else "t_ms"


def _is_sweep(values: np.ndarray) -> bool:
    """Angles of a turning head: within a turn, in steps of some degrees."""
    if values.min() < -180.0 or values.max() > 360.0 or np.ptp(values) < 20.0:
        return False
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    even = bool(moving.size and (np.abs(moving - np.median(moving)) < 1e-6).mean() > 0.8)
    return even and float(np.median(moving)) <= 30.0


def _parsed(texts: Sequence[str]) -> tuple[Column, ...] | None:
    try:
        columns = parse_columns(",".join(texts))
    except BadInput:
        return None
    return columns
