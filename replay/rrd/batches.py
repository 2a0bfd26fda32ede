"""The chunks of a recording's file, as tables: the reader's way in.

A file that was not ended has no index, and is read from its beginning to where it ends.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from replay.rrd import layout


@dataclass(frozen=True, slots=True)
class Row:
    """One row of one entity: when, and its component's numbers."""

    step: int
    numbers: NDArray[Any]


class Batches:
    """The tables of one file, or of what lies below ``root`` in it."""

    def __init__(self, file: Path, root: str, *, indexed: bool) -> None:
        self.file, self.root, self._indexed = file, root, indexed

    def one_text(self, entity: str, component: str) -> str:
        """A text that was logged once; empty where it was not."""
        for batch in self.batches(entity, component):
            return str(batch.column(component)[0].as_py()[0])
        return ""

    def rows(self, content: str, component: str) -> Iterator[tuple[str, Row]]:
        """All rows of a component, in the order of the file: entity, and when and what."""
        for entity, batch in self.batches_by_entity(content, component):
            for i, step in enumerate(batch.column(layout.STEP).to_numpy()):
                yield entity, Row(int(step), numbers_of(batch, component, i))

    def batches(self, entity: str, component: str, *, whole: bool = False) -> list[pa.RecordBatch]:
        """Chunks of one entity that hold a component, alone or with what stands beside it."""
        return [batch for _, batch in self.batches_by_entity(entity, component, whole=whole)]

    def batches_by_entity(
        self, content: str, component: str, *, whole: bool = False
    ) -> Iterator[tuple[str, pa.RecordBatch]]:
        """The same of all entities that ``content`` names, with the entity of each."""
        reader = quiet_reader(self.file)
        stream = reader.store().stream() if self._indexed else reader.stream()
        stream = stream.filter(content=f"{self.root}{content}")
        if not whole:
            stream = stream.filter(components=component)
        for chunk in stream:
            batch = chunk.to_record_batch()
            if batch.num_rows and component in batch.schema.names:
                yield chunk.entity_path.removeprefix(self.root), batch


def numbers_of(batch: pa.RecordBatch, component: str, i: int) -> NDArray[Any]:
    """The numbers of one row; of a picture, its bytes."""
    values = batch.column(component)[i].values
    if pa.types.is_list(values.type):
        values = values.flatten()
    array: NDArray[Any] = values.to_numpy(zero_copy_only=False).copy()
    return array


def quiet_reader(path: Path) -> RrdReader:
    """Rerun warns of a file that was not ended; ``damaged`` reports it instead."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)
        return RrdReader(path)
