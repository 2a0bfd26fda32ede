"""What is in a session, in a few lines for people."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterator, Mapping

from recorder.anomalies import anomalies
from recorder.columns import block_of
from recorder.errors import BadInput
from recorder.messages import Record
from recorder.session import SessionReader
from recorder.session.part_names import PART, parts_beside
from recorder.session.stats import Readings, SessionStats, Times, Track
from recorder.sources import TF, Asked, Survey, choose

_LONGEST_VALUE = 100
_PROGRESS_EVERY = 2000
_TOGETHER = 1000  # records that are looked at as columns
_FOR_OTHERS = (
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Path",
)  # what a map becomes, written as ROS
_FIRST_PLAUSIBLE_S = 86_400 * 365  # earlier times are not counted from 1970


def summary_lines(
    reader: SessionReader, progress: Callable[[int], None] | None = None
) -> Iterator[str]:
    """One line a topic: count, rate, gaps and values; then what is odd and what was lost.

    The session is gone through once, in constant memory; ``progress(bytes)`` is called now and
    then. Raises BadInput, before the first line, where nothing of the file can be used.
    """
    session_stats, survey = SessionStats(), Survey()
    batch: list[Record] = []
    for number, record in enumerate(reader.records()):
        session_stats.take(record)
        batch.append(record)
        if len(batch) == _TOGETHER:
            survey.take(block_of(batch, number))
            batch = []
        if progress is not None and number % _PROGRESS_EVERY == 0:
            progress(reader.position)
    survey.take(block_of(batch, session_stats.understood))
    yield f"{reader.path.name}: {counted(reader.messages, 'message')}{_when(session_stats)}"
    for channel in sorted(reader.channels.values(), key=lambda c: c.topic):
        text = f"{channel.messages:7}"
        if channel.understood:
            yield f"  {channel.topic:20} {text}  {_describe(channel.topic, session_stats)}".rstrip()
        else:
            kind = channel.type_name or "no type"
            why = f": {channel.why_not}" if channel.why_not else ""
            what = "for other programs" if kind in _FOR_OTHERS else "not understood"
            yield f"  {channel.topic:20} {text}  {what} ({kind}{why})"
    yield from _sources(survey)
    yield from _metadata(reader.metadata)
    for name, data in reader.attachments.items():
        yield f"  attachment {name}, {counted(len(data), 'byte')}"
    yield from _parts(reader)
    by_tf = _posed_by_tf(survey)
    for finding in anomalies(session_stats, reader.metadata, posed_by_tf=by_tf):
        yield f"  odd: {finding}"
    if reader.unverified:
        unverified = counted(reader.unverified, "message")
        yield f"  odd: no checksum covers {unverified} (another program's file)"
    yield from (f"  lost: {reason}" for reason in reader.damage)


def _sources(survey: Survey) -> Iterator[str]:
    """What a map would be made of, and why; what could not be without a choice."""
    if not survey.readings:
        return
    try:
        sources = choose(survey, Asked())
    except BadInput as error:
        yield f"  odd: it cannot be mapped without a choice: {error}"
        return
    yield from (f"  mapped from {line}" for line in sources.lines())
    yield from (f"  not mapped: {line}" for line in sources.left_out)
    yield from (f"  odd: {note}" for note in sources.notes)


def _posed_by_tf(survey: Survey) -> bool:
    """Whether a map would take its poses from transforms."""
    try:
        return bool(survey.readings) and choose(survey, Asked()).pose == TF
    except BadInput:
        return False


def counted(number: int, thing: str) -> str:
    """``1 message``, ``2 messages``."""
    return f"{number} {thing}{'s' * (number != 1)}"


def _when(session_stats: SessionStats) -> str:
    """Begin and length of a session."""
    measured = [
        times for topic, times in session_stats.times.items() if not topic.endswith("tf_static")
    ]
    if not measured:
        return ""
    # a channel without stamps would make a length of half a century
    stamped = [times for times in measured if times.first_ns / 1e9 > _FIRST_PLAUSIBLE_S]
    measured = stamped or measured
    first_ns = min(times.first_ns for times in measured)
    last_ns = max(times.newest_ns for times in measured)
    text = f", {(last_ns - first_ns) / 1e9:.1f} s"
    if first_ns / 1e9 > _FIRST_PLAUSIBLE_S:
        begin = datetime.datetime.fromtimestamp(first_ns / 1e9, datetime.UTC)
        text += f", from {begin:%Y-%m-%d %H:%M:%S} UTC"
    return text


def _describe(topic: str, session_stats: SessionStats) -> str:
    times = session_stats.times.get(topic)
    if times is None:
        return ""
    pieces = []
    if times.span_s > 0.0:
        pieces += [f"{times.rate_hz:7.1f}/s", _gaps(times, session_stats)]
    if topic in session_stats.readings:
        pieces.append(_ranges(session_stats.readings[topic]))
    if topic in session_stats.tracks:
        pieces.append(_extent(session_stats.tracks[topic]))
    if topic in session_stats.sweeps:
        sweeps = session_stats.sweeps[topic]
        pieces.append(f"{sweeps.seen / max(sweeps.beams, 1):.0%} of {sweeps.beams} beams saw")
    return "  ".join(piece for piece in pieces if piece)


def _gaps(times: Times, session_stats: SessionStats) -> str:
    if not times.gaps:
        return "no gaps"
    at_s = session_stats.seconds_at(times.longest_at_ns)
    return f"gaps {times.gaps} (longest {times.longest_ns / 1e9:.2f} s, at {at_s:.1f} s)"


def _ranges(readings: Readings) -> str:
    kind = readings.radiation.name.lower()
    if not readings.finite:
        return f"{kind}, saw nothing"
    text = f"{kind} {readings.least_m:.2f} to {readings.most_m:.2f} m, {readings.nothing} saw none"
    return text + (f", {readings.too_close} too close" if readings.too_close else "")


def _extent(track: Track) -> str:
    if track.count == track.unusable:
        return ""
    (x0, y0), (x1, y1) = track.least_m, track.most_m
    return f"x {x0:.2f} to {x1:.2f} m, y {y0:.2f} to {y1:.2f} m"


def _metadata(metadata: Mapping[str, object]) -> Iterator[str]:
    for key, value in metadata.items():
        if key == "recovered" and isinstance(value, Mapping):
            yield f"  recovered from {value.get('from')}, where was lost:"
            lost = value.get("lost", [])
            yield from (f"    {line}" for line in (lost if isinstance(lost, list) else [lost]))
        elif isinstance(value, Mapping) and any(isinstance(v, Mapping) for v in value.values()):
            yield from (f"  {key}.{name} = {_value_text(inner)}" for name, inner in value.items())
        elif key != PART:
            yield f"  {key} = {_value_text(value)}"


def _value_text(value: object) -> str:
    """A value of the metadata for people: ``echogrid 0.1.0, python 3.11``; nothing is ``none``."""
    match value:
        case Mapping():
            text = ", ".join(f"{name} {_value_text(inner)}" for name, inner in value.items())
        case list() | tuple():
            text = ", ".join(_value_text(inner) for inner in value)
        case bool():
            text = "yes" if value else "no"
        case None:
            text = ""
        case _:
            text = str(value)
    shown = text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."
    return shown or "none"


def _parts(reader: SessionReader) -> Iterator[str]:
    match reader.metadata.get(PART):
        case {"number": int(number)}:
            others = ", ".join(part.name for part in parts_beside(reader.path, number)) or "none"
            yield f"  part {number} of a recording; other parts beside it: {others}"
