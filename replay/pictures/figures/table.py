"""All figures in the chapter's order: a new one is an entry of its section's table.

A figure's number is its place here, whether or not a session can have it, so that the same figure
has the same file name everywhere.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from replay.pictures.figures import fusing, grid_lines, raw_data, raw_lines, realistic_models
from replay.pictures.figures import simple_models as simple
from replay.pictures.figures.figure import Figure

FIGURES: tuple[Figure, ...] = (
    *raw_data.FIGURES, *simple.FIGURES, *realistic_models.FIGURES, *fusing.FIGURES,
    *raw_lines.FIGURES, *grid_lines.FIGURES,
)  # fmt: skip
NUMBERED: Mapping[int, Figure] = MappingProxyType(dict(enumerate(FIGURES, start=1)))


def stem_of(number: int) -> str:
    """The name of a figure's files without their endings: ``07-counts``."""
    return f"{number:02d}-{NUMBERED[number].slug}"


def command_of(number: int, session: str, folder: str = "figures") -> str:
    """The command that makes one figure alone."""
    return f"echogrid figures {shlex.quote(session)} -o {folder} --only {number}"


def map_command_of(number: int, session: str, layer: str) -> str:
    """The command that draws the map of a figure as it is, by itself; empty where it shows none."""
    figure = NUMBERED[number]
    if not figure.settings or not layer:
        return ""
    words = [f"--set {shlex.quote(f'sensors.*.{key}={_toml(value)}')}"
             for key, value in figure.settings.items()]  # fmt: skip
    where = f"--view {shlex.quote(layer)} -o {stem_of(number)}-map.png"
    return f"echogrid picture {shlex.quote(session)} {' '.join(words)} {where}"


def _toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
