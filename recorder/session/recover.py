"""A damaged or unfinished session into a new, whole one: all that can be trusted, byte for byte.

Messages, metadata and attachments are copied without being decoded, so that the channels that
echogrid does not understand come along. What was lost is written into the new file as well.
"""

from __future__ import annotations

import itertools
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Metadata
from mcap.records import Message as McapMessage
from mcap.writer import Writer

from recorder.errors import BadInput
from recorder.foreign import check_file
from recorder.outputs import check_output, written_beside
from recorder.session.format import (
    ATTACHED,
    METADATA,
    RECOVERED,
    Damage,
    checked_json,
    read_checked_json,
)
from recorder.session.index import ChunkIndexes
from recorder.session.scan import SessionScan
from recorder.session.writer import new_writer

Progress = Callable[[int, int], None]
_Record = McapMessage | Metadata | Attachment


@dataclass(frozen=True, slots=True)
class Recovery:
    """What came through, and what did not, one line a reason."""

    messages: int
    attachments: int
    lost: tuple[str, ...]


def recover(
    bad: Path, good: Path, *, force: bool = False, progress: Progress | None = None
) -> Recovery:
    """Write what can be trusted of ``bad`` to ``good``.

    ``progress(bytes read, bytes in all)`` is called now and then. Raises BadInput where nothing can
    be used or ``good`` cannot be written, OutputExists. ``bad`` is never changed.
    """
    if good.exists() and bad.exists() and good.samefile(bad):
        raise BadInput(f"{good}: a session is never mended in place, name another output")
    check_output(good, force=force)
    damage = Damage()
    try:
        size = check_file(bad)
        with bad.open("rb") as source:
            scan = SessionScan(source, size, damage)
            records = _counted(scan, bad, size, progress)
            first = next(records, None)  # what is no session makes no file
            if first is None:
                reason = damage.lines[0] if damage else "it is empty"
                raise BadInput(f"{bad}: nothing in it can be read ({reason})")
            if not good.parent.is_dir():
                raise BadInput(f"{good}: there is no folder {good.parent}")
            with (
                written_beside(good) as part,
                part.open("wb") as file,
                ChunkIndexes(good.parent) as indexes,
            ):
                copy = _Copy(new_writer(file, indexes), scan)
                copy.write(itertools.chain([first], records), damage, bad.name)
                file.flush()
                os.fsync(file.fileno())
    except OSError as error:
        raise BadInput(f"{error.filename or good}: {error.strerror or error}") from None
    return Recovery(copy.messages, copy.attachments, damage.lines)


def _counted(
    scan: SessionScan, bad: Path, size: int, progress: Progress | None
) -> Iterator[_Record]:
    try:
        for number, record in enumerate(scan.records()):
            if progress is not None and number % 1000 == 0:
                progress(scan.position, size)
            yield record
    except BadInput as error:
        raise BadInput(f"{bad}: {error}") from None


class _Copy:
    """A new file that takes the records of a scan, with ids of its own."""

    def __init__(self, writer: Writer, scan: SessionScan) -> None:
        self._writer = writer
        self._scan = scan
        self._schema_ids: dict[int, int] = {}
        self._channel_ids: dict[int, int] = {}
        self._sequence: Counter[int] = Counter()
        self.messages = self.attachments = 0

    def write(self, records: Iterable[_Record], damage: Damage, origin: str) -> None:
        """All records, and what was lost, which is known in the end."""
        # only under our name are the numbers of the messages counted, and then from 1 on
        library = self._scan.library if self._scan.ours else "recovered"
        self._writer.start(profile=self._scan.profile, library=library)
        for record in records:
            self._take(record, damage)
        if damage:
            lost = {"from": origin, "lost": list(damage.lines)}
            self._writer.add_metadata(RECOVERED, checked_json(lost))
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _take(self, record: _Record, damage: Damage) -> None:
        match record:
            case McapMessage():
                self._take_message(record)
            case Metadata():
                if _is_sound(record):
                    self._writer.add_metadata(record.name, record.metadata)
                elif record.name != ATTACHED:
                    damage.note("the session's metadata is damaged and was left out")
            case Attachment():
                self.attachments += 1
                self._writer.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )

    def _take_message(self, message: McapMessage) -> None:
        self.messages += 1
        self._sequence[message.channel_id] += 1
        number = self._sequence[message.channel_id] if self._scan.ours else message.sequence
        self._writer.add_message(
            channel_id=self._channel(self._scan.channels[message.channel_id]),
            log_time=message.log_time,
            publish_time=message.publish_time,
            sequence=number,
            data=message.data,
        )

    def _channel(self, channel: Channel) -> int:
        if channel.id not in self._channel_ids:
            self._channel_ids[channel.id] = self._writer.register_channel(
                channel.topic, channel.message_encoding, self._schema(channel.schema_id),
                channel.metadata,
            )  # fmt: skip
        return self._channel_ids[channel.id]

    def _schema(self, schema_id: int) -> int:
        schema = self._scan.schemas.get(schema_id)
        if schema is None:
            return 0
        if schema_id not in self._schema_ids:
            self._schema_ids[schema_id] = self._writer.register_schema(
                schema.name, schema.encoding, schema.data
            )
        return self._schema_ids[schema_id]


def _is_sound(record: Metadata) -> bool:
    """Whether a metadata record may be copied: ours carry a checksum, others' none."""
    if record.name == ATTACHED:
        return False
    if record.name not in (METADATA, RECOVERED):
        return True
    try:
        read_checked_json(record.metadata)
    except BadInput:
        return False
    return True
