"""What two ways of reading a session came to, in a form that compares to the bit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

import numpy as np

from recorder.errors import BadInput
from recorder.messages import Message, Record
from recorder.session import SessionReader
from recorder.session.columns import ColumnReader


def exactly(value: object) -> object:
    """A value that equals another one only where all its bits do (but those of NaN)."""
    if isinstance(value, np.ndarray):
        return (value.shape, [repr(float(each)) for each in value.ravel()])
    return repr(value)


def _values(message: Message) -> list[object]:
    return [exactly(getattr(message, field.name)) for field in fields(message)]


def plain(records: Iterable[Record]) -> list[tuple[object, ...]]:
    """Records that compare to the bit, arrays included."""
    return [(r.topic, r.log_ns, type(r.message).__name__, *_values(r.message)) for r in records]


def everything(reader: SessionReader) -> dict[str, object]:
    """All that a reader gives away: one by one, or, of a ColumnReader, by columns."""
    refused = ""
    records: list[Record] = []
    try:
        if isinstance(reader, ColumnReader):
            records += (record for block in reader.blocks() for record in block.records())
        else:
            records += reader.records()
    except BadInput as error:
        refused = str(error)
    counts = [
        (i, c.topic, c.type_name, c.messages, c.understood) for i, c in reader.channels.items()
    ]
    return {
        "records": [] if refused else plain(records),
        "refused": refused,
        "damage": reader.damage,
        "metadata": reader.metadata,
        "attachments": reader.attachments,
        "channels": counts,
        "unverified": reader.unverified,
        "position": reader.position,
    }


def assert_same_either_way(path: Path, where: object = None) -> dict[str, object]:
    """Read a file in both ways, compare all, and give what was found."""
    one_by_one = everything(SessionReader(path))
    in_bulk = everything(ColumnReader(path))
    for name, value in one_by_one.items():
        assert in_bulk[name] == value, (name, where)
    return one_by_one
