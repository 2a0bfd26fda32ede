"""Other people's logs → messages: one file a format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from recorder.errors import BadInput
from recorder.importers.comp4807 import Imported, import_comp4807, looks_like_comp4807

__all__ = ["IMPORTERS", "Imported", "guess_format", "import_comp4807"]

IMPORTERS: Mapping[str, Callable[..., Imported]] = MappingProxyType({"comp4807": import_comp4807})
_LOOKS_LIKE: Mapping[str, Callable[[bytes], bool]] = MappingProxyType(
    {"comp4807": looks_like_comp4807}
)
_HEAD_BYTES = 4096


def guess_format(path: Path) -> str:
    """The name of the format that the file begins like; BadInput when it is none of ours."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror})") from error
    for name, looks_like in _LOOKS_LIKE.items():
        if looks_like(head):
            return name
    raise BadInput(f"{path}: no format known here (known: {', '.join(IMPORTERS)})")
