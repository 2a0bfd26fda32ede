"""Which echogrid made a file: noted in every session and every export."""

from __future__ import annotations

import importlib.metadata


def own_version() -> str:
    """The version that is installed; ``not installed`` in a bare checkout."""
    try:
        return importlib.metadata.version("echogrid")
    except importlib.metadata.PackageNotFoundError:
        return "not installed"
