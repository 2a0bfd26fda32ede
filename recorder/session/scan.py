"""The records of an MCAP file, one after the other, whatever state the file is in.

The framing of MCAP carries no checksum: a flipped bit in a length leads a reader astray. So the
frames are walked here, each is checked for sense, and where one makes none the walk goes on at the
next chunk whose checksum is right. The mcap library parses what is inside the frames. At any time
one record is in memory.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import breakup_chunk

from recorder.errors import BadInput
from recorder.session.format import LIBRARY, UNREADABLE, Damage, short_reason
from recorder.session.frames import (
    FRAME,
    LONGEST_CHUNK_HEAD,
    LONGEST_RECORD,
    PARSERS,
    SKIPPED,
    Frame,
    InvalidFrame,
    attachment_is_sound,
    chunk_length,
    chunk_size,
    is_message_index,
    parsed,
)

MAGIC = b"\x89MCAP0\r\n"
_RECORDING = b"RRF"  # what a recording of a mapping begins with
_MAGIC_BYTES_TO_BELIEVE = 6  # of 8: one that is damaged does not make the file another's
_FIRST_PRIVATE_OPCODE = 0x80
_CHUNK_MAY_BEGIN = re.compile(rb"\x06(?=.{4}\x00{4})", re.DOTALL)
_SEARCH_BYTES = 1 << 20


class SessionScan:
    """One walk over a file: :meth:`records` yields Message, Metadata and Attachment.

    What is lost goes to ``damage``. ``schemas`` and ``channels`` are those met so far, ``counts``
    the messages of each channel, ``position`` how far the walk is. ``unverified`` counts messages
    that no checksum covers (files of other programs).
    """

    def __init__(self, file: BinaryIO, size: int, damage: Damage) -> None:
        self._file, self._size, self._damage = file, size, damage
        self._sure = 0  # all before this offset has been taken
        self._data_crc: int | None = 0  # of all bytes so far; None after a jump
        self._summary_crc: int | None = None
        self._footer: Footer | None = None
        self._expected: int | None = None  # messages, by the statistics of the file
        self._summary_was_read = False
        self._last_number: dict[int, int] = {}
        self._missing: Counter[int] = Counter()
        self.profile = ""
        self.library = ""
        self.position = 0
        self.unverified = 0
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.counts: Counter[int] = Counter()

    @property
    def ours(self) -> bool:
        """Whether echogrid wrote the file, by its header."""
        return self.library.startswith(LIBRARY)

    def records(self) -> Iterator[Message | Metadata | Attachment]:
        """All that can be trusted, in file order. Raises BadInput on what is no MCAP file."""
        for record in self._walk():
            match record:
                case Schema():
                    self.schemas[record.id] = record
                case Channel():
                    self.channels[record.id] = record
                case Message():
                    if self._count(record):
                        yield record
                case Metadata() | Attachment():
                    yield record
        self._note_missing()

    def _walk(self) -> Iterator[McapRecord]:
        self._check_magic()
        position = len(MAGIC)
        while position < self._size and self._footer is None:
            try:
                frame = self._frame(position)
                yield from self._unpack(frame, position)
                self.position = position = frame.end
            except InvalidFrame as error:
                found = self._next_chunk(self._sure)
                self._note_skipped(position, found, error)
                if found is None:
                    return
                # never twice to the same place; and the bytes are no longer all counted
                position, self._sure, self._data_crc = found, found + 1, None
        self._check_end(position)

    def _count(self, message: Message) -> bool:
        """Whether the message may be taken, which it may not without its channel."""
        channel_id = message.channel_id
        if channel_id not in self.channels and not self._summary_was_read:
            self._summary_was_read = True
            self._define_from_summary()
        if channel_id not in self.channels:
            self._damage.note("a message was left out: what defines its channel is lost")
            return False
        self.counts[channel_id] += 1
        if self.ours:
            last = self._last_number.get(channel_id, 0)
            self._missing[channel_id] += max(message.sequence - last - 1, 0)
            self._last_number[channel_id] = message.sequence
        return True

    def _define_from_summary(self) -> None:
        """The chunk that defined a channel is lost: the end of a finished file repeats it."""
        here = self._file.tell()
        try:
            for definition in self._definitions():
                if isinstance(definition, Schema):
                    self.schemas.setdefault(definition.id, definition)
                else:
                    self.channels.setdefault(definition.id, definition)
        except (InvalidFrame, *UNREADABLE):
            pass
        finally:
            self._file.seek(here)

    def _note_missing(self) -> None:
        """As far as it can be known: by the numbers of its messages, or by their count."""
        for channel_id, missing in self._missing.items():
            if missing:
                topic = self.channels[channel_id].topic
                self._damage.note(f"{topic}: {missing} messages are missing")
        missing = (self._expected or 0) - self.counts.total()
        if missing > 0:
            self._damage.note(f"{missing} of {self._expected} messages are missing")

    def _check_magic(self) -> None:
        magic = self._file.read(len(MAGIC))
        if not magic:
            raise BadInput("an empty file, not a session")
        self._data_crc = zlib.crc32(magic)
        self._sure = len(MAGIC)
        if magic == MAGIC:
            return
        alike = sum(a == b for a, b in zip(magic, MAGIC, strict=False))
        if alike < _MAGIC_BYTES_TO_BELIEVE or self._size <= len(MAGIC):
            if magic.startswith(_RECORDING):
                raise BadInput("not an MCAP file but a recording: look at it with echogrid view")
            raise BadInput(
                "not an MCAP file (it begins with other bytes); logs of other programs become one "
                "with echogrid import"
            )
        self._damage.note("the first bytes of the file are damaged")

    def _frame(self, position: int) -> Frame:
        """The frame at ``position``, which is where the file stands."""
        head = self._file.read(FRAME.size)
        if len(head) < FRAME.size:
            raise InvalidFrame("it ends within a record")
        opcode, length = FRAME.unpack(head)
        known = opcode in PARSERS or opcode in SKIPPED or opcode == Opcode.MESSAGE
        if not known and opcode < _FIRST_PRIVATE_OPCODE:
            raise InvalidFrame("no record begins there")
        end = position + FRAME.size + length
        if end > self._size or length > LONGEST_RECORD:
            raise InvalidFrame("a record is longer than the rest of the file")
        content = self._file.read(length)
        if opcode == Opcode.MESSAGE_INDEX and not is_message_index(content):
            raise InvalidFrame("an index makes no sense")
        self._follow_checksums(opcode, head + content)
        return Frame(opcode, content, end)

    def _follow_checksums(self, opcode: int, data: bytes) -> None:
        if opcode == Opcode.DATA_END:
            self._check_data_end(data)
            self._summary_crc = 0
        elif self._summary_crc is not None:
            covered = data if opcode != Opcode.FOOTER else data[: FRAME.size + 16]
            self._summary_crc = zlib.crc32(covered, self._summary_crc)
        elif self._data_crc is not None:
            self._data_crc = zlib.crc32(data, self._data_crc)

    def _check_data_end(self, data: bytes) -> None:
        if len(data) != FRAME.size + 4:
            raise InvalidFrame("the end of the data makes no sense")
        [written] = struct.unpack("<I", data[FRAME.size :])
        if written and self._data_crc is not None and written != self._data_crc:
            self._damage.note("the checksum over the whole file does not match")

    def _unpack(self, frame: Frame, position: int) -> Iterator[McapRecord]:
        """What one frame brings."""
        if frame.opcode == Opcode.MESSAGE:
            if self.ours:
                raise InvalidFrame("a message stands outside of the chunks")
            message = parsed(lambda s: Message.read(s, len(frame.content)), frame.content, False)
            self.unverified += 1
            yield message
            return
        parser = PARSERS.get(frame.opcode)
        if parser is None:
            return
        record = parsed(parser, frame.content, self.ours)
        match record:
            case Chunk():
                yield from self._unpack_chunk(record, frame)
            case Attachment():
                if attachment_is_sound(frame.content):
                    self._sure = frame.end  # a recording within an attachment is no part of it
                    yield record
                else:
                    self._damage.note(f"attachment {record.name!r} is damaged and was left out")
            case Header():
                self.profile, self.library = record.profile, record.library
            case Statistics():
                self._expected = record.message_count
            case Footer():
                self._footer = record
            case Schema() | Channel():
                if self.ours and self._summary_crc is None:
                    raise InvalidFrame("a definition stands outside of the chunks")
                if self._summary_crc is None:
                    yield record
            case Metadata():
                yield record

    def _unpack_chunk(self, chunk: Chunk, frame: Frame) -> Iterator[McapRecord]:
        if chunk_size(chunk) != len(frame.content):
            raise InvalidFrame("the length of a chunk is wrong")
        try:
            inner = breakup_chunk(chunk, validate_crc=True)
        except UNREADABLE as error:
            self._damage.note(f"a damaged chunk was left out ({short_reason(error)})")
            return
        self._sure = frame.end
        if chunk.uncompressed_crc == 0:
            self.unverified += sum(isinstance(record, Message) for record in inner)
        yield from inner

    def _next_chunk(self, start: int) -> int | None:
        """Offset of the first whole chunk at or behind ``start``; the file stands there then."""
        while start < self._size:
            self._file.seek(start)
            window = self._file.read(_SEARCH_BYTES + FRAME.size - 1)
            for match in _CHUNK_MAY_BEGIN.finditer(window):
                if self._is_chunk(start + match.start()):
                    self._file.seek(start + match.start())
                    return start + match.start()
            start += _SEARCH_BYTES
        return None

    def _is_chunk(self, position: int) -> bool:
        self._file.seek(position)
        head = self._file.read(LONGEST_CHUNK_HEAD)
        length = chunk_length(head)
        if length is None or position + FRAME.size + length > self._size:
            return False
        self._file.seek(position + FRAME.size)
        try:
            chunk = parsed(Chunk.read, self._file.read(length), True)
            assert isinstance(chunk, Chunk)
            return bool(breakup_chunk(chunk, validate_crc=True))
        except (InvalidFrame, *UNREADABLE):
            return False

    def _note_skipped(self, position: int, found: int | None, why: InvalidFrame) -> None:
        if found is not None:
            skipped = found - self._sure
            self._damage.note(f"{skipped} damaged bytes from byte {position} on ({why})")
        elif self._summary_crc is not None:
            self._damage.note(f"the index at the end of the file is damaged ({why})")
        elif self._ends_properly():
            self._damage.note(f"nothing can be read from byte {position} on ({why})")
        else:
            self._damage.note(
                f"the recording was not finished or was cut at byte {position}: its end is lost"
            )

    def _ends_properly(self) -> bool:
        self._file.seek(max(self._size - len(MAGIC), 0))
        return self._file.read() == MAGIC

    def _check_end(self, position: int) -> None:
        if self._footer is None:
            if self._summary_crc is None:
                self._damage.note("the recording was not finished: its end is lost")
            else:
                self._damage.note("the index at the end of the file is cut")
            return
        if self._file.read(len(MAGIC)) != MAGIC or position + len(MAGIC) != self._size:
            self._damage.note("the last bytes of the file are damaged")
        written = self._footer.summary_crc
        if written and self._summary_crc is not None and written != self._summary_crc:
            self._expected = None
            self._damage.note("the index at the end of the file is damaged")

    def _definitions(self) -> list[Schema | Channel]:
        footer_bytes = FRAME.size + 20 + len(MAGIC)
        self._file.seek(self._size - footer_bytes)
        tail = self._file.read()
        footer = parsed(Footer.read, tail[FRAME.size : -len(MAGIC)], True)
        assert isinstance(footer, Footer)
        length = self._size - footer_bytes - footer.summary_start
        if tail[-len(MAGIC) :] != MAGIC or not 0 < length < LONGEST_RECORD:
            return []
        self._file.seek(footer.summary_start)
        summary = self._file.read(length)
        if zlib.crc32(tail[: FRAME.size + 16], zlib.crc32(summary)) != footer.summary_crc:
            return []
        found: list[Schema | Channel] = []
        offset = 0
        while offset + FRAME.size <= len(summary):
            opcode, length = FRAME.unpack_from(summary, offset)
            offset += FRAME.size
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                content = summary[offset : offset + length]
                record = parsed(PARSERS[opcode], content, False)
                assert isinstance(record, Schema | Channel)
                found.append(record)
            offset += length
        return found
