"""Several files read as one session: the parts of one recording, or several recordings.

Parts are put in their order, without what a part repeats of the one before. Recordings that would
overlap in time are moved apart, so that no reading meets a pose of another drive.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from recorder.clock import NS_PER_S
from recorder.errors import BadInput
from recorder.messages import BASE_FRAME, Record, Transform
from recorder.session.parts import PART, repeated_as
from recorder.session.reader import Session

_APART_NS = 60 * NS_PER_S  # longer than any gap between poses that is bridged
_Key = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Part:
    recording: str
    number: int
    repeated: int
    session: Session


def join_sessions(sessions: Sequence[Session]) -> Session:
    """One session out of several, in the order of their times.

    Metadata are those of the first, with the names of all in ``files``; attachments are joined,
    but for those that differ. Raises BadInput where two recordings mount a sensor differently.
    """
    if len(sessions) == 1:
        return sessions[0]
    parts = [_part_of(session, number) for number, session in enumerate(sessions)]
    _check_twice(parts)
    in_order = sorted(parts, key=lambda part: (part.recording, part.number))
    recordings = [
        _recording(list(group)) for _, group in groupby(in_order, key=lambda part: part.recording)
    ]
    recordings.sort(key=_first_ns)
    _check_mounts(recordings)
    records = tuple(_in_time(recordings))
    first = recordings[0]
    metadata = {**first.metadata, "files": [session.path.name for session in sessions]}
    metadata.pop(PART, None)
    damage = [f"{_names(r)}{reason}" for r in recordings for reason in r.damage]
    return Session(first.path, records, metadata, _attachments(sessions), tuple(damage))


def _names(session: Session) -> str:
    return "" if PART in session.metadata else f"{session.path.name}: "


def _part_of(session: Session, place: int) -> _Part:
    match session.metadata.get(PART):
        case {"recording": str(recording), "number": int(number), "repeated": int(repeated)}:
            return _Part(recording, number, repeated, session)
        case _:
            return _Part(f"file {place:06}", 1, 0, session)


def _check_twice(parts: Sequence[_Part]) -> None:
    seen: dict[tuple[str, int], Session] = {}
    for part in parts:
        other = seen.setdefault((part.recording, part.number), part.session)
        if other is not part.session:
            raise BadInput(f"{part.session.path} and {other.path} are the same part of a recording")


def _recording(parts: Sequence[_Part]) -> Session:
    """The parts of one recording, in order, as one session."""
    if len(parts) == 1:
        return parts[0].session
    records: list[Record] = []
    damage: list[str] = []
    latest: dict[_Key, Record] = {}
    previous = parts[0].number - 1
    for part in parts:
        if part.number > previous + 1:
            damage.append(f"between parts {previous} and {part.number} there are missing ones")
        previous = part.number
        damage += [f"{part.session.path.name}: {reason}" for reason in part.session.damage]
        for record in _without_repeats(part, latest):
            records.append(record)
            key = repeated_as(record.message)
            if key is not None:
                latest[key] = record
    first = parts[0].session
    return Session(first.path, tuple(records), first.metadata, {}, tuple(damage))


def _without_repeats(part: _Part, latest: Mapping[_Key, Record]) -> Iterator[Record]:
    for number, record in enumerate(part.session.records):
        key = repeated_as(record.message)
        before = None if key is None else latest.get(key)
        is_repeat = before is not None and before.message == record.message
        if not (is_repeat and number < part.repeated):
            yield record


def _first_ns(session: Session) -> int:
    return min((record.message.t_ns for record in session.records), default=0)


def _in_time(recordings: Iterable[Session]) -> Iterator[Record]:
    """All records, each recording moved behind the one before where they would overlap."""
    end_ns: int | None = None
    for session in recordings:
        shift_ns = 0
        if end_ns is not None and session.records:
            shift_ns = max(0, end_ns + _APART_NS - _first_ns(session))
        for record in session.records:
            moved = _moved(record, shift_ns)
            end_ns = max(end_ns or 0, moved.message.t_ns)
            yield moved


def _moved(record: Record, shift_ns: int) -> Record:
    if shift_ns == 0:
        return record
    message = replace(record.message, t_ns=record.message.t_ns + shift_ns)
    return Record(record.topic, record.log_ns + shift_ns, message)


def _check_mounts(recordings: Iterable[Session]) -> None:
    known: dict[str, tuple[Transform, Session]] = {}
    for session in recordings:
        for record in session.records:
            message = record.message
            if not isinstance(message, Transform) or not message.static:
                continue
            other, where = known.setdefault(message.child, (message, session))
            same = (other.parent, other.parent_from_child) == (
                message.parent, message.parent_from_child,
            )  # fmt: skip
            if not same and where is not session and message.child != BASE_FRAME:
                raise BadInput(
                    f"{session.path} mounts {message.child} elsewhere than {where.path}: "
                    "they cannot be one session"
                )


def _attachments(sessions: Iterable[Session]) -> dict[str, bytes]:
    """Those that do not contradict each other."""
    found: dict[str, bytes] = {}
    contradicted: set[str] = set()
    for session in sessions:
        for name, data in session.attachments.items():
            if found.setdefault(name, data) != data:
                contradicted.add(name)
    return {name: data for name, data in found.items() if name not in contradicted}
