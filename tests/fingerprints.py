"""A few numbers that stand for a heap of results, so that golden data stay small.

Everything numeric in a result is laid out in one row per field; kept are how many numbers there
are, the root of their squares, and a weighted sum with fixed weights of either sign. A change of a
single cell moves the weighted sum by far more than rounding does.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import math
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from recorder.errors import EchogridError

RTOL = 1e-6  # of the root of squares: float32 results of other machines differ by less
ATOL = 1e-12
_EPOCH_NS = 1_700_000_000_000_000_000  # times are told from here on, in seconds
_NAN, _INF = -7.25, 1e4
# Told by others already: a beam by itself, the grid by the first artifact of a run.
_SKIPPED = {
    ("TempGrid", "beam"), ("TempGrid", "geometry"), ("MergedGrid", "beam"),
    ("MergedGrid", "geometry"), ("Border", "geometry"), ("Thresholded", "geometry"),
    ("Started", "beam_widths_rad"),
    ("Sums", "rule"),
    # Of sensors with several models, which have tests of their own.
    ("Beam", "model"), ("Sensor", "nearer"), ("Sensor", "up_to_m"),
}  # fmt: skip

Fingerprint = tuple[int, float, float]
Fingerprints = dict[str, Fingerprint]


def fingerprints(results: Mapping[str, object]) -> Fingerprints:
    """One fingerprint for each field of each kind of result."""
    heap = _Heap()
    for name, value in results.items():
        heap.add(name, value)
    return {name: _fingerprint(heap.numbers(name)) for name in sorted(heap.small)}


def by_kind(artifacts: Iterable[object]) -> dict[str, object]:
    """Results by the names of their classes."""
    kinds: dict[str, object] = {}
    for artifact in artifacts:
        kinds.setdefault(type(artifact).__name__, []).append(artifact)  # type: ignore[attr-defined]
    return kinds


def outcome(run: Callable[[], object]) -> object:
    """What a call returns, or in words why it refuses."""
    try:
        result = run()
        return list(result) if isinstance(result, Iterator) else result
    except (EchogridError, ValueError) as error:
        return f"{type(error).__name__}: {error}"


class _Heap:
    """All numbers of a heap of results, by field: single ones, and arrays behind them."""

    def __init__(self) -> None:
        self.small: defaultdict[str, list[float]] = defaultdict(list)
        self.arrays: defaultdict[str, list[np.ndarray]] = defaultdict(list)

    def numbers(self, name: str) -> np.ndarray:
        """Everything under a name, finite, in one row."""
        row = np.concatenate([self.small[name], *self.arrays[name]])
        return np.nan_to_num(row, nan=_NAN, posinf=_INF, neginf=-_INF)

    def add(self, path: str, value: object) -> None:
        """Lay a result out."""
        small = self.small[path]
        match value:
            case np.ndarray():
                small += [math.pi, *value.shape]
                self.arrays[path].append(_times(value.ravel()))
            case str() | bytes():
                data = value.encode() if isinstance(value, str) else value
                small.append(zlib.crc32(data) / 2.0**32)
            case bool() | float() | np.floating() | np.bool_():
                small.append(float(value))
            case int() | np.integer():
                small.append((value - _EPOCH_NS) * 1e-9 if value > 10**17 else float(value))
            case None:
                small.append(-3.5)
            case enum.Enum():
                self.add(path, value.value)
            case Mapping():
                for key, inner in value.items():
                    self.add(path, str(key))
                    self.add(path, inner)
            case list() | tuple() | set() | frozenset():
                small.append(len(value) + 0.5)
                for inner in sorted(value) if isinstance(value, set | frozenset) else value:
                    self.add(path, inner)
            case _:
                for name in _fields(type(value)):
                    self.add(f"{path}.{name}", getattr(value, name))


@cache
def _fields(kind: type) -> tuple[str, ...]:
    names = (field.name for field in dataclasses.fields(kind))
    return tuple(name for name in names if (kind.__name__, name) not in _SKIPPED)


def _times(values: np.ndarray) -> np.ndarray:
    if values.dtype.kind in "iu" and values.size and int(values[0]) > 10**17:
        return np.asarray(values - _EPOCH_NS, np.float64) * 1e-9
    return np.asarray(values, np.float64)


def _fingerprint(numbers: np.ndarray) -> Fingerprint:
    k = np.arange(numbers.size, dtype=np.int64)
    weights = (k * 48_271 + 11_939) % 65_537 / 32_768.0 - 1.0
    norm = float(np.sqrt((numbers**2).sum()))
    return numbers.size, float(f"{norm:.10g}"), float(f"{numbers @ weights:.10g}")


def differences(found: Fingerprints, golden: Mapping[str, list[float]]) -> list[str]:
    """A line for each field that differs; empty where all agree."""
    lines = [f"{name}: only now" for name in found if name not in golden]
    lines += [f"{name}: only before" for name in golden if name not in found]
    for name in set(found) & set(golden):
        (count, norm, total), (count_0, norm_0, total_0) = found[name], golden[name]
        most = RTOL * norm_0 + ATOL
        if count != count_0:
            lines.append(f"{name}: {count} numbers, were {count_0:g}")
        elif abs(norm - norm_0) > most or abs(total - total_0) > most:
            lines.append(f"{name}: {norm:.10g} {total:.10g}, was {norm_0:.10g} {total_0:.10g}")
    return sorted(lines)


class Golden:
    """The fingerprints kept in a JSON file, by the name of the case."""

    def __init__(self, file: Path) -> None:
        self.update = False
        self._file = file
        self._kept = json.loads(file.read_text()) if file.exists() else {}

    def check(self, name: str, results: Mapping[str, object]) -> None:
        """Fail where a case came out otherwise than it did; or keep how it came out now."""
        found = fingerprints(results)
        assert found
        if self.update:
            self._kept[name] = found
            rows = (
                f"{json.dumps(key)}: {json.dumps(self._kept[key])}" for key in sorted(self._kept)
            )
            self._file.write_text("{\n" + ",\n".join(rows) + "\n}\n")
            return
        if name not in self._kept:
            pytest.fail(f"{name} is new: {HOW_TO_ACCEPT}")
        lines = differences(found, self._kept[name])
        if lines:
            shown = [*lines[:12], *(["..."] if len(lines) > 12 else [])]
            pytest.fail("\n".join([f"{name} differs ({HOW_TO_ACCEPT}):", *shown]), pytrace=False)


HOW_TO_ACCEPT = "pytest -n0 --update-golden accepts"
