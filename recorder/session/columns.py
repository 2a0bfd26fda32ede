"""A session read as columns: whole chunks at a time, in the memory of a few, again and again.

The frames of the file are walked by :class:`~recorder.session.scan.SessionScan`, so that damage is
met, counted and reported as it always is. Only what is inside a chunk whose checksum is right is
taken apart in bulk: where its messages begin, of which channel they are, and what is in them.
Whatever is out of the ordinary goes, message by message, the way of
:class:`~recorder.session.reader.SessionReader`, with the same result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.records import Message as McapMessage
from numpy.typing import NDArray

from recorder.columns import (
    ALL,
    LAST_NS,
    Block,
    Choice,
    Columns,
    Ints,
    OtherColumns,
    blocks_of,
    columns_of,
)
from recorder.errors import BadInput
from recorder.messages import Record
from recorder.ros_columns import KIND_OF_TYPE, ChannelColumns, Rows, gathered
from recorder.session import Session, read_session
from recorder.session.chunks import FIXED_BYTES, ChunkScan, Stretch
from recorder.session.frames import FRAME
from recorder.session.opening import opened, session_files
from recorder.session.reader import SessionReader

_BATCH_BYTES = 1 << 18  # small chunks are decoded together: arrays of a few rows cost too much
_LOOSE_RECORDS = 1000
_HEAD = np.dtype(
    {
        "names": ["length", "channel", "sequence", "log", "publish"],
        "formats": ["<u8", "<u2", "<u4", "<u8", "<u8"],
        "offsets": [1, 9, 11, 15, 23],
        "itemsize": FRAME.size + FIXED_BYTES,
    }
)


@dataclass(slots=True)
class ColumnReader(SessionReader):
    """One pass over a session by columns: :meth:`blocks` in place of :meth:`records`.

    What else a reader knows (metadata, attachments, damage, counts) is the same.
    """

    _columns: dict[tuple[int, str], ChannelColumns] = field(default_factory=dict)
    _rows: int = 0

    def blocks(self, choice: Choice = ALL) -> Iterator[Block]:
        """The messages that are understood and wanted, a few chunks at a time, in file order.

        All is counted and checked, wanted or not; what is not wanted is not decoded, so that it is
        not known whether it could be. Raises BadInput as :meth:`records` does.
        """
        try:
            with opened(self.path) as (file, size):
                yield from self._through(file, size, choice)
        except OSError as error:
            raise BadInput(f"{self.path}: {error.strerror or error}") from None

    def _through(self, file: BinaryIO, size: int, choice: Choice) -> Iterator[Block]:
        self._scan = scan = ChunkScan(file, size, self._damage)
        try:
            yield from self._batches(scan, choice)
            scan.end()
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from None
        if self._damage and not (self.channels or self.metadata or self.attachments):
            raise BadInput(f"{self.path}: nothing in it can be read ({self.damage[0]})")
        self._note_undecoded()

    def _batches(self, scan: ChunkScan, choice: Choice) -> Iterator[Block]:
        pending: list[Stretch] = []
        size = 0
        loose: list[tuple[int, Record]] = []
        for record in scan.everything():
            changes = isinstance(record, Schema | Channel) and not _is_known(record, scan)
            if pending and (changes or isinstance(record, McapMessage)):
                yield self._decoded(pending, scan, choice)
                pending, size = [], 0
            if loose and (isinstance(record, Stretch) or len(loose) >= _LOOSE_RECORDS):
                yield choice.of(Block(tuple(columns_of(loose))))
                loose = []
            match record:
                case Stretch():
                    pending.append(record)
                    size += len(record.data)
                    if size >= _BATCH_BYTES or self._may_note_damage(scan):
                        yield self._decoded(pending, scan, choice)
                        pending, size = [], 0
                case Schema():
                    scan.schemas[record.id] = record
                case Channel():
                    scan.channels[record.id] = record
                case McapMessage():
                    loose += self._loose(record, scan, choice)
                case Metadata():
                    self._take_metadata(record)
                case Attachment():
                    self.attachments[record.name] = record.data
        if pending:
            yield self._decoded(pending, scan, choice)
        if loose:
            yield choice.of(Block(tuple(columns_of(loose))))

    def _may_note_damage(self, scan: ChunkScan) -> bool:
        """Whether messages may not wait to be decoded: damage is noted in its order.

        So it is while there are channels of which no message has come yet.
        """
        return bool(self._damage) or not scan.channels.keys() <= self.channels.keys()

    def _decoded(self, pending: list[Stretch], scan: ChunkScan, choice: Choice) -> Block:
        batch = _Batch.of(pending, self._rows)
        self._rows += len(batch.starts)
        columns: list[Columns] = []
        left: list[int] = []
        for channel_id, chosen in _by_channel(batch.head["channel"]):
            if channel_id in scan.channels:
                scan.count(channel_id, batch.head["sequence"][chosen].astype(np.int64))
            else:
                kept = [scan.count_one(batch.message(int(at))) for at in chosen]
                chosen = chosen[kept]
            if len(chosen):
                more, rest = self._in_bulk(batch.rows(chosen), scan.channels[channel_id], choice)
                columns += more
                left += rest
        loose: list[tuple[int, Record]] = []
        for row in sorted(left):
            message = batch.message(row - batch.first_row)
            loose += ((row, record) for record in self._decode(message, scan))
        return choice.of(Block((*columns, *columns_of(loose))))

    def _in_bulk(
        self, rows: Rows, channel: Channel, choice: Choice
    ) -> tuple[list[Columns], list[int]]:
        """The columns of messages of one channel, and the rows that are to be decoded one by one.

        Those are not counted yet.
        """
        assert isinstance(self._scan, ChunkScan)
        count = self._count(channel, self._scan)
        decoder = self._decoders[channel.id]
        wanted = _is_wanted(channel.topic, count.type_name, choice)
        if decoder is None or not decoder.known or not wanted:
            count.messages += len(rows)
            return [], []
        key = channel.id, channel.topic
        if key not in self._columns:
            definition = self._scan.schemas[channel.schema_id].data
            self._columns[key] = ChannelColumns(count.type_name, definition, channel.topic)
        columns, rest = self._columns[key].take(rows)
        count.messages += len(rows) - len(rest)
        return columns, rest.row.tolist()

    def _loose(
        self, message: McapMessage, scan: ChunkScan, choice: Choice
    ) -> Iterator[tuple[int, Record]]:
        """What a message brings that stands alone."""
        row = self._rows
        self._rows += 1
        if not scan.count_one(message):
            return
        channel = scan.channels[message.channel_id]
        count = self._count(channel, scan)
        if not _is_wanted(channel.topic, count.type_name, choice):
            count.messages += 1
            return
        for record in self._decode(message, scan):
            yield row, record


class OpenSession:
    """A session file that is read when it is gone through, and again as often as wanted.

    ``reader`` is that of the last pass over everything, from its begin on: how far it is, and in
    the end metadata, attachments, counts and damage.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.reader = ColumnReader(path)

    def blocks(self, choice: Choice = ALL) -> Iterator[Block]:
        """See :meth:`ColumnReader.blocks`; each call begins anew."""
        reader = ColumnReader(self.path)
        if choice == ALL:
            self.reader = reader
        return reader.blocks(choice)

    def records(self, choice: Choice = ALL) -> Iterator[Record]:
        """The messages one by one, for who wants them so."""
        return chain.from_iterable(block.records() for block in self.blocks(choice))

    @property
    def notes(self) -> tuple[str, ...]:
        """How several files became one: this is one."""
        return ()

    @property
    def metadata(self) -> Mapping[str, object]:
        """What was noted of the recording."""
        return self.reader.metadata

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """The files that came with it, by name."""
        return self.reader.attachments

    @property
    def damage(self) -> tuple[str, ...]:
        """What was lost, one line a reason."""
        return self.reader.damage


class KeptSession:
    """Several files as one session, which has to be kept: gone through as an OpenSession is."""

    def __init__(self, session: Session) -> None:
        self.path, self.metadata = session.path, session.metadata
        self.attachments, self.damage = session.attachments, session.damage
        self.notes = session.notes
        self._records = session.records

    def blocks(self, choice: Choice = ALL) -> Iterator[Block]:
        """See :meth:`OpenSession.blocks`."""
        return map(choice.of, blocks_of(self._records))

    def records(self, choice: Choice = ALL) -> Iterator[Record]:
        """The messages one by one."""
        return chain.from_iterable(block.records() for block in self.blocks(choice))


def open_session(path: Path, *more: Path) -> OpenSession | KeptSession:
    """A session of one file, read when it is gone through; or of several, which are read now."""
    files = session_files(path, *more)
    return KeptSession(read_session(*files)) if len(files) > 1 else OpenSession(files[0])


@dataclass(frozen=True, slots=True)
class _Batch:
    """Messages of a few chunks in one piece of memory; ``head`` (N,) is what stands before each."""

    data: bytes
    starts: Ints
    head: NDArray[np.void]
    first_row: int

    @classmethod
    def of(cls, pending: list[Stretch], first_row: int) -> _Batch:
        """Stretches one behind the other."""
        data, starts = pending[0].data, pending[0].starts
        if len(pending) > 1:
            sizes = [len(stretch.data) for stretch in pending]
            shifts = np.cumsum([0, *sizes[:-1]])
            data = b"".join(stretch.data for stretch in pending)
            starts = np.concatenate([s.starts + by for s, by in zip(pending, shifts, strict=True)])
        return cls(data, starts, gathered(data, starts, _HEAD), first_row)

    def rows(self, chosen: Ints) -> Rows:
        """The messages numbered ``chosen`` (M,) within the batch."""
        starts, head = self.starts[chosen], self.head[chosen]
        ends = starts + FRAME.size + head["length"].astype(np.int64)
        log_ns, publish_ns = (_signed(head[name]) for name in ("log", "publish"))
        return Rows(
            self.data, starts + _HEAD.itemsize, ends, chosen + self.first_row, log_ns, publish_ns
        )

    def message(self, at: int) -> McapMessage:
        """One message as the library has it."""
        head, start = self.head[at], int(self.starts[at])
        end = start + FRAME.size + int(head["length"])
        return McapMessage(
            channel_id=int(head["channel"]), log_time=int(head["log"]),
            data=self.data[start + _HEAD.itemsize : end], publish_time=int(head["publish"]),
            sequence=int(head["sequence"]),
        )  # fmt: skip


def _by_channel(ids: NDArray[np.uint16]) -> list[tuple[int, Ints]]:
    """The channels in the order in which they come, and the places (M,) of each one's messages."""
    present = np.flatnonzero(np.bincount(ids))
    places = [(int(each), np.flatnonzero(ids == each)) for each in present]
    return sorted(places, key=lambda found: int(found[1][0]))


def _signed(times: NDArray[np.uint64]) -> Ints:
    """Nanoseconds that fit; what lies behind the year 2262 is held as its last moment."""
    return np.minimum(times, np.uint64(LAST_NS)).astype(np.int64)


def _is_wanted(topic: str, type_name: str, choice: Choice) -> bool:
    return choice.takes(topic, KIND_OF_TYPE.get(type_name, OtherColumns))


def _is_known(record: Schema | Channel, scan: ChunkScan) -> bool:
    known = scan.schemas if isinstance(record, Schema) else scan.channels
    return known.get(record.id) == record
