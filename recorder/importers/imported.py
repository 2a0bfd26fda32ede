"""What every importer returns."""

from __future__ import annotations

from dataclasses import dataclass

from recorder.messages import Message


@dataclass(frozen=True, slots=True)
class Imported:
    """A log as messages: (log_ns, message) in time order, what is known of it, what was dropped."""

    records: list[tuple[int, Message]]
    metadata: dict[str, str]
    dropped: dict[str, int]
