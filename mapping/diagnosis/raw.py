"""The readings of single rangers as they came, before any was dropped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapping.diagnosis.causes.interface import Evidence
from recorder.columns import Floats, Ints, RangeColumns
from recorder.messages import Radiation


@dataclass(frozen=True, slots=True)
class Channel:
    """One ranger: times and ranges (N,), in the order of time; its limits by its own messages."""

    sensor: str
    radiation: Radiation
    start_ns: int
    t_ns: Ints
    range_m: Floats
    min_range_m: float
    max_range_m: float

    def seconds(self, at: int) -> float:
        """When, since the session's first reading."""
        return float(self.t_ns[at] - self.start_ns) * 1e-9


def channels(evidence: Evidence) -> list[Channel]:
    """All rangers of a session."""
    parts: dict[str, list[RangeColumns]] = {}
    for block in evidence.columns:
        for each in block.of(RangeColumns):
            if len(each):
                parts.setdefault(each.sensor, []).append(each)
    if not parts:
        return []
    start_ns = min(int(each.t_ns.min()) for found in parts.values() for each in found)
    out = []
    for sensor, found in parts.items():
        t_ns = np.concatenate([each.t_ns for each in found])
        range_m = np.concatenate([each.range_m for each in found])
        order = np.argsort(t_ns, kind="stable")
        known = evidence.placed.sensors.get(sensor)
        low, high = float(found[0].min_range_m[0]), float(found[0].max_range_m[0])
        if known is not None:
            low, high = known.min_range_m, known.max_range_m
        out.append(
            Channel(sensor, Radiation(int(found[0].radiation[0])), start_ns, t_ns[order],
                    range_m[order], low, high)
        )  # fmt: skip
    return out
