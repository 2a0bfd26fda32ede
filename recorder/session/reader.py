"""A session read in one pass, record by record, in the memory of one chunk.

Every checksum is checked. What cannot be read is counted and reported; what is yielded is right.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.records import Message as McapMessage

from recorder.errors import BadInput
from recorder.messages import Message, Record
from recorder.ros_types import Decoder
from recorder.session.format import (
    METADATA,
    RECOVERED,
    UNREADABLE,
    Damage,
    plain_message,
    read_checked_json,
)
from recorder.session.opening import opened
from recorder.session.scan import SessionScan


@dataclass(frozen=True, slots=True)
class Session:
    """A session as it was read. Its records are kept: they can be gone through again."""

    path: Path
    records: tuple[Record, ...]
    metadata: Mapping[str, object]
    attachments: Mapping[str, bytes]
    damage: tuple[str, ...]
    notes: tuple[str, ...] = ()  # how several files became one

    def messages(self) -> Iterator[Message]:
        """The messages in the order in which they reached the host."""
        return (record.message for record in self.records)


@dataclass(slots=True)
class ChannelCount:
    """What came on one channel: ROS type, messages, and whether they are understood."""

    topic: str
    type_name: str
    messages: int = 0
    understood: bool = True
    why_not: str = ""


@dataclass(slots=True)
class SessionReader:
    """One pass over a session: go through :meth:`records`, then look at the rest.

    ``metadata`` and ``attachments`` come first in our own files; ``damage`` and ``channels`` are
    complete when the records are at their end.
    """

    path: Path
    metadata: dict[str, object] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, ChannelCount] = field(default_factory=dict)
    _damage: Damage = field(default_factory=Damage)
    _decoders: dict[int, Decoder | None] = field(default_factory=dict)
    _undecoded: Counter[str] = field(default_factory=Counter)
    _scan: SessionScan | None = None

    @property
    def damage(self) -> tuple[str, ...]:
        """What was lost, one line a reason."""
        return self._damage.lines

    @property
    def messages(self) -> int:
        """How many messages came, understood or not."""
        return sum(channel.messages for channel in self.channels.values())

    @property
    def unverified(self) -> int:
        """How many messages no checksum covers: files of other programs may have such."""
        return 0 if self._scan is None else self._scan.unverified

    @property
    def position(self) -> int:
        """How many bytes of the file are behind us."""
        return 0 if self._scan is None else self._scan.position

    def records(self) -> Iterator[Record]:
        """The messages that are understood, in file order, which is that of their arrival.

        Raises BadInput, in one line, where the file is none or nothing of it can be used.
        """
        try:
            with opened(self.path) as (file, size):
                self._scan = SessionScan(file, size, self._damage)
                yield from self._walk(self._scan)
        except OSError as error:
            raise BadInput(f"{self.path}: {error.strerror or error}") from None

    def _walk(self, scan: SessionScan) -> Iterator[Record]:
        try:
            for record in scan.records():
                match record:
                    case McapMessage():
                        yield from self._decode(record, scan)
                    case Metadata():
                        self._take_metadata(record)
                    case Attachment():
                        self.attachments[record.name] = record.data
        except BadInput as error:
            raise BadInput(f"{self.path}: {error}") from None
        if self._damage and not (self.channels or self.metadata or self.attachments):
            raise BadInput(f"{self.path}: nothing in it can be read ({self.damage[0]})")
        self._note_undecoded()

    def _note_undecoded(self) -> None:
        for channel in self.channels.values():
            if channel.why_not and channel.messages:
                self._damage.note(
                    f"{channel.topic}: {channel.messages} messages of "
                    f"{channel.type_name or 'no type'} cannot be decoded: {channel.why_not}"
                )
        for topic, count in self._undecoded.items():
            self._damage.note(f"{topic}: {count} messages cannot be decoded")

    def _decode(self, message: McapMessage, scan: SessionScan) -> Iterator[Record]:
        channel = scan.channels[message.channel_id]
        self._count(channel, scan).messages += 1
        decoder = self._decoders[channel.id]
        if decoder is None:
            return
        try:
            data = plain_message(message.data)
            decoded = decoder.decode(data, channel.topic, message.publish_time)
        except (BadInput, *UNREADABLE):
            self._undecoded[channel.topic] += 1
            return
        for each in decoded:
            yield Record(channel.topic, message.log_time, each)

    def _count(self, channel: Channel, scan: SessionScan) -> ChannelCount:
        """The count of a channel; one that cannot be decoded costs only itself."""
        if channel.id not in self.channels:
            schema = scan.schemas.get(channel.schema_id)
            count = ChannelCount(channel.topic, "" if schema is None else schema.name)
            self.channels[channel.id] = count
            count.why_not = _why_not(channel, schema)
            decoder = self._decoders[channel.id] = self._decoder(channel, schema)
            count.understood = decoder is not None and decoder.known
        return self.channels[channel.id]

    def _decoder(self, channel: Channel, schema: Schema | None) -> Decoder | None:
        if schema is None or _why_not(channel, schema):
            return None
        try:
            return _decoder_of(schema.name, schema.data)
        except BadInput as error:
            self._damage.note(f"{channel.topic}: {error}")
            return None

    def _take_metadata(self, record: Metadata) -> None:
        if record.name not in (METADATA, RECOVERED):
            return
        try:
            content = read_checked_json(record.metadata)
        except BadInput:
            self._damage.note("the session's metadata is damaged and was left out")
            return
        if record.name == METADATA:
            self.metadata.update(content)
        else:
            self.metadata["recovered"] = content


def _why_not(channel: Channel, schema: Schema | None) -> str:
    """Why the messages of a channel cannot be decoded; "" where they can."""
    if schema is None or not schema.name:
        return "the file does not hold its definition"
    if channel.message_encoding != "cdr":
        kind = f"{schema.encoding}, {channel.message_encoding or 'no encoding'}"
        return f"only ROS 2 messages (ros2msg, cdr) are read, not {kind}"
    if schema.encoding != "ros2msg":
        return f"its definition is in {schema.encoding or 'no known form'}, not in ros2msg"
    return ""


@lru_cache(64)
def _decoder_of(name: str, definition: bytes) -> Decoder:
    """Reading a definition takes longer than reading a hundred messages."""
    return Decoder(name, definition)
