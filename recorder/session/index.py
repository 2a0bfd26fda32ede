"""The index of the chunks of a session that is being written, kept on the disk meanwhile.

The mcap library collects an entry for each chunk until the file is finished: about 1 kB of memory
each 0.8 s, 4 MB an hour. Here the entries go to a nameless file beside the session as the bytes
that they will be in it, about 100 each, and come back when the session is finished. The system
removes that file with the process, however it ends.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Self

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer

# The library offers no way to choose where it keeps its index, so its list is exchanged. This is
# the only private name of it that we use. Where a later version has none of this name, its files
# are the same and only its memory grows: a test notices.
LIST_OF_THE_LIBRARY = "_Writer__chunk_indices"
_PIECE_BYTES = 1 << 16


class ChunkIndexes:
    """What the library takes for its list of chunk indexes: it appends, and iterates once."""

    def __init__(self, folder: Path) -> None:
        try:
            self._file: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        except OSError:  # the session may be a file in a folder that takes no other
            self._file = io.BytesIO()

    def serve(self, writer: Writer) -> None:
        """Stand where ``writer``, which has written nothing yet, has its list."""
        if LIST_OF_THE_LIBRARY in vars(writer):
            vars(writer)[LIST_OF_THE_LIBRARY] = self

    def append(self, index: ChunkIndex) -> None:
        """Keep one entry. Raises OSError (disk full)."""
        record = RecordBuilder()
        index.write(record)
        self._file.write(record.end())  # type: ignore[no-untyped-call]

    def __iter__(self) -> Iterator[_Entries]:
        """All entries, many at a time."""
        self._file.seek(0)
        while data := self._file.read(_PIECE_BYTES):
            yield _Entries(data)

    def close(self) -> None:
        """Let go of the file, which is then gone."""
        with contextlib.suppress(OSError):  # a full disk: nobody needs what found no room
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@dataclass(frozen=True, slots=True)
class _Entries:
    """Entries as they stand in a file."""

    data: bytes

    def write(self, stream: RecordBuilder) -> None:
        """As the library's own records do."""
        stream.write(self.data)
