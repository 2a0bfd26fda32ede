"""Other people's logs → messages: one file a format, each an entry of one table, found by content.

To add one, write its reader in a file of its own and enter it in ``IMPORTERS``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from recorder.errors import BadInput
from recorder.importers.carmen import import_carmen, looks_like_carmen
from recorder.importers.comp4807 import import_comp4807, looks_like_comp4807
from recorder.importers.imported import Imported
from recorder.importers.sonar_ring import import_sonar_ring, looks_like_sonar_ring
from recorder.importers.text import import_text, looks_like_text

__all__ = ["IMPORTERS", "Imported", "Importer", "guess_format", "import_log"]

_HEAD_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Importer:
    """How a format is read: from one file (or, ``several``, from a list), and known by its head."""

    read: Callable[..., Imported]
    looks_like: Callable[[bytes], bool]
    several: bool = False

    @property
    def options(self) -> set[str]:
        """The options that it takes, by the names of its keywords."""
        return set(list(inspect.signature(self.read).parameters)[1:])


# In the order in which they are tried: text with numbers in it fits much.
IMPORTERS: Mapping[str, Importer] = MappingProxyType(
    {
        "comp4807": Importer(import_comp4807, looks_like_comp4807),
        "carmen": Importer(import_carmen, looks_like_carmen),
        "sonar-ring": Importer(import_sonar_ring, looks_like_sonar_ring, several=True),
        "csv": Importer(import_text, looks_like_text),
    }
)


def guess_format(path: Path) -> str:
    """The name of the format that the file begins like; BadInput when it is none of ours."""
    try:
        if path.exists() and not path.is_file():  # a pipe would never end
            raise BadInput(f"{path}: cannot be read (no regular file)")
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror})") from error
    for name, importer in IMPORTERS.items():
        if importer.looks_like(head):
            return name
    raise BadInput(f"{path}: no format known here (known: {', '.join(IMPORTERS)})")


def import_log(name: str, files: Sequence[Path], options: Mapping[str, Any]) -> Imported:
    """Files of one format → messages; ``options`` are keywords of its reader.

    Raises BadInput, in one line, as the format's reader does.
    """
    if name not in IMPORTERS:
        raise BadInput(f"unknown format {name!r} (known: {', '.join(IMPORTERS)})")
    importer = IMPORTERS[name]
    if len(files) > 1 and not importer.several:
        raise BadInput("one file at a time for this format")
    for option in sorted(set(options) - importer.options):
        raise BadInput(f"{name} takes no --{option.removesuffix('_s').replace('_hz', '')}")
    return importer.read(files if importer.several else files[0], **options)
