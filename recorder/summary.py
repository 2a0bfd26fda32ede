"""What is in a session, in a few lines for people."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from recorder.messages import Radiation, Range, Record
from recorder.session import Session

_NS_PER_S = 1e9
_INFRARED_LIMIT_M = 0.8  # the infrared ranger of this robot never measures farther
_GAP_FACTOR = 5.0


def summary_lines(session: Session) -> Iterator[str]:
    """One line a topic: count, rate, gaps and ranges; then what is odd and what was lost."""
    yield f"{session.path.name}: {len(session.records)} messages"
    by_topic: dict[str, list[Record]] = {}
    for record in session.records:
        by_topic.setdefault(record.topic, []).append(record)
    for topic in sorted(by_topic):
        yield f"  {topic:20} {_describe(by_topic[topic])}"
    for key, value in session.metadata.items():
        yield f"  {key} = {value}"
    for name, data in session.attachments.items():
        yield f"  attachment {name}, {len(data)} bytes"
    yield from (f"  lost: {reason}" for reason in session.damage)


def _describe(records: list[Record]) -> str:
    times = [record.message.t_ns for record in records]
    span_s = (max(times) - min(times)) / _NS_PER_S
    text = f"{len(records):6}"
    if span_s > 0:
        text += f"  {(len(records) - 1) / span_s:6.1f}/s  {_gaps(times)}"
    readings = [r.message for r in records if isinstance(r.message, Range)]
    return text + _ranges(readings) if readings else text


def _gaps(times: list[int]) -> str:
    steps = [b - a for a, b in itertools.pairwise(times)]
    usual = sorted(steps)[len(steps) // 2]
    long = sum(step > _GAP_FACTOR * max(usual, 1) for step in steps)
    back = sum(step < 0 for step in steps)
    return f"gaps {long}" + (f"  clock back {back}" if back else "")


def _ranges(readings: list[Range]) -> str:
    seen = [r.range_m for r in readings if math.isfinite(r.range_m)]
    if not seen:
        return "  saw nothing"
    text = f"  {min(seen):.2f} to {max(seen):.2f} m, {len(readings) - len(seen)} saw nothing"
    infrared = readings[0].radiation is Radiation.INFRARED
    if infrared and max(seen) > _INFRARED_LIMIT_M:
        text += "  ODD: infrared beyond 0.8 m; are the columns swapped?"
    return text
