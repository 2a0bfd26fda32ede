"""Bytes of a device ↔ reports: one small interface, and one table of the protocols that exist.

To add one, write its class in a file of its own and name it in ``PROTOCOLS``; or leave it in a file
outside and name that file where a protocol is asked for.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from pathlib import Path

from recorder.errors import BadInput
from recorder.names import did_you_mean
from recorder.plugin_files import one_line, run_file
from recorder.protocols.csv import CsvProtocol, parse_columns
from recorder.protocols.echogrid import EchogridProtocol
from recorder.protocols.interface import LineProtocol, Protocol
from recorder.protocols.rbc import RbcProtocol
from recorder.protocols.reports import Packet

__all__ = [
    "PROTOCOLS", "CsvProtocol", "EchogridProtocol", "LineProtocol", "Packet", "Protocol",
    "load_protocol", "make_protocol", "parse_columns",
]  # fmt: skip

PROTOCOLS: Mapping[str, type[Protocol]] = {
    EchogridProtocol.name: EchogridProtocol,
    RbcProtocol.name: RbcProtocol,
    CsvProtocol.name: CsvProtocol,
}


def make_protocol(name: str, columns: str | None = None) -> Protocol:
    """A protocol by its name, or from a Python file whose name ends in ``.py``.

    ``columns`` names the columns of ``csv``. Raises BadInput on an unknown name, columns that are
    missing or cannot be, and a file that cannot be used.
    """
    if name.endswith(".py"):
        return _made(load_protocol(Path(name)), name)
    if name not in PROTOCOLS:
        raise BadInput(f"unknown protocol {name!r}; {did_you_mean(name, PROTOCOLS)}")
    if name == CsvProtocol.name:
        if columns is None:
            raise BadInput("csv needs its columns named: --columns t_ms,ping:cm,dirrs:mm")
        return CsvProtocol(parse_columns(columns))
    if columns is not None:
        raise BadInput(f"{name} has no columns to name: --columns is for csv")
    return PROTOCOLS[name]()


def load_protocol(path: Path) -> type[Protocol]:
    """The one protocol that a Python file defines. Raises BadInput in one line."""
    module = run_file(path)
    own = [value for value in vars(module).values() if _is_protocol_of(value, module.__name__)]
    if len(own) != 1:
        raise BadInput(f"{path}: defines {len(own)} protocols instead of one")
    kind: type[Protocol] = own[0]
    if not isinstance(getattr(kind, "name", None), str) or not kind.name:
        raise BadInput(f'{path}: class {kind.__name__} needs a name, such as name = "mine"')
    if issubclass(kind, LineProtocol) and kind.packet is LineProtocol.packet:
        if kind.read is LineProtocol.read:
            raise BadInput(f"{path}: class {kind.__name__} needs a method read")
    elif abstract := sorted(kind.__abstractmethods__):
        raise BadInput(f"{path}: class {kind.__name__} needs a method {abstract[0]}")
    return kind


def _is_protocol_of(value: object, module: str) -> bool:
    """A protocol that the file itself defines; a leading underscore marks a mere base."""
    return (
        inspect.isclass(value)
        and issubclass(value, Protocol)
        and value.__module__ == module
        and not value.__name__.startswith("_")
    )


def _made(kind: type[Protocol], path: str) -> Protocol:
    try:
        return kind()
    except Exception as error:
        raise BadInput(f"{path}: {kind.__name__}() fails: {one_line(error)}") from error
