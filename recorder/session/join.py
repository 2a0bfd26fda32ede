"""Several files read as one session: the parts of one recording, or several recordings.

Parts are put in their order, without what a part repeats of the one before. Files that follow each
other in time, and those of several recorders of one run, keep their times. Recordings that have the
same topics at the same time are of several drives: they are moved apart, so that no reading meets a
pose of another drive.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from itertools import groupby

from recorder.clock import NS_PER_S
from recorder.errors import BadInput
from recorder.messages import BASE_FRAME, Odometry, Pose, Range, Record, Scan, Transform
from recorder.session.part_names import PART, repeated_as
from recorder.session.reader import Session

_APART_NS = 60 * NS_PER_S  # longer than any gap between poses that is bridged
_SEAM_NS = 2 * NS_PER_S  # so long a message may be on its way when a recorder begins its next file
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
    recordings.sort(key=lambda session: _Span.of(session).first_ns)
    _check_mounts(recordings)
    shifted = list(_shifts(recordings))
    records = tuple(_merged(shifted))
    notes = tuple(_shift_note(*each) for each in shifted if each[1])
    first = recordings[0]
    metadata = {**first.metadata, "files": [session.path.name for session in sessions]}
    metadata.pop(PART, None)
    damage = [f"{_names(r)}{reason}" for r in recordings for reason in r.damage]
    return Session(first.path, records, metadata, _attachments(sessions), tuple(damage), notes)


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


@dataclass(frozen=True, slots=True)
class _Span:
    """When something was measured and when it arrived, and on which topics."""

    first_ns: int
    last_ns: int
    arrived_first_ns: int
    arrived_last_ns: int
    topics: frozenset[str]

    @classmethod
    def of(cls, session: Session) -> _Span:
        """A mount has no time; nor has a message without a stamp, but for its arrival."""
        timed = [
            (record.message.t_ns or record.log_ns, record.log_ns)
            for record in session.records if not _is_mount(record)
        ] or [(0, 0)]  # fmt: skip
        measured, arrived = zip(*timed, strict=True)
        topics = frozenset(
            record.topic for record in session.records
            if isinstance(record.message, Pose | Odometry | Range | Scan)
        )  # fmt: skip
        return cls(min(measured), max(measured), min(arrived), max(arrived), topics)

    def later(self, shift_ns: int) -> _Span:
        """The same, moved."""
        return _Span(
            self.first_ns + shift_ns, self.last_ns + shift_ns, self.arrived_first_ns + shift_ns,
            self.arrived_last_ns + shift_ns, self.topics,
        )  # fmt: skip

    def beside(self, other: _Span) -> bool:
        """Whether the two may share a time line as they are.

        One follows the other, but for what is on its way where a recorder begins its next file; or
        they are two recorders of one run, of which none has a topic of the other.
        """
        together_ns = min(self.last_ns, other.last_ns) - max(self.first_ns, other.first_ns)
        arrived_ns = min(self.arrived_last_ns, other.arrived_last_ns) - max(
            self.arrived_first_ns, other.arrived_first_ns
        )
        if together_ns < 0 or (arrived_ns < 0 and together_ns <= _SEAM_NS):
            return True
        return not self.topics & other.topics


def _is_mount(record: Record) -> bool:
    return isinstance(record.message, Transform) and record.message.static


def _shifts(recordings: Sequence[Session]) -> Iterator[tuple[Session, int]]:
    """How far each recording is moved: behind all before it, where it cannot lie beside them."""
    placed: list[_Span] = []
    for session in recordings:
        span, shift_ns = _Span.of(session), 0
        if session.records and not all(span.beside(other) for other in placed):
            shift_ns = max(other.last_ns for other in placed) + _APART_NS - span.first_ns
        placed.append(span.later(shift_ns))
        yield session, shift_ns


def _shift_note(session: Session, shift_ns: int) -> str:
    return (
        f"{session.path.name} is of the time of another file and has the same topics: taken as "
        f"another drive, and moved {shift_ns / NS_PER_S:.3f} s behind"
    )


def _moved(record: Record, shift_ns: int) -> Record:
    if shift_ns == 0 or _is_mount(record):
        return record
    message = replace(record.message, t_ns=record.message.t_ns + shift_ns)
    return Record(record.topic, record.log_ns + shift_ns, message)


def _merged(shifted: Sequence[tuple[Session, int]]) -> Iterator[Record]:
    """All records in the order of their arrival; those of one file in their own."""
    streams = [_stream(place, *each) for place, each in enumerate(shifted)]
    return (record for _, _, record in merge(*streams, key=lambda found: found[:2]))


def _stream(place: int, session: Session, shift_ns: int) -> Iterator[tuple[int, int, Record]]:
    for record in session.records:
        moved = _moved(record, shift_ns)
        yield moved.log_ns, place, moved


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
