"""A file → the maps in it that a picture shows: of a recording, a session or an exported map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mapping.config import MappingConfig
from recorder.errors import BadInput
from recorder.names import did_you_mean
from replay.pictures.views import MapView

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Asked:
    """Which moment (a step or a reading; neither: the end) and which view; empty: the clearest."""

    step: int | None = None
    reading: int | None = None
    view: str = ""

    @property
    def at_end(self) -> bool:
        """Whether no moment was asked for."""
        return self.step is None and self.reading is None


def open_views(
    path: Path, asked: Asked, config: MappingConfig, progress: Progress | None = None
) -> list[MapView]:
    """The maps of a file, several where a recording compares some. Raises BadInput in one line."""
    suffix = path.suffix.lower()
    if suffix == ".mcap":
        from replay.pictures.from_session import view_of_session

        return [view_of_session(path, asked, config, progress)]
    if suffix == ".rrd" or ".rrd#" in path.name.lower():
        from replay.pictures.from_recording import views_of_recording

        return views_of_recording(path, asked)
    if not asked.at_end:
        raise BadInput(f"{path}: a map has no steps or readings; a recording or a session has")
    from replay.pictures.from_maps import view_of_map

    return [view_of_map(path, asked)]


def check_reading(path: Path, reading: int, readings: int) -> None:
    """Raises BadInput where there is no reading of that number, counted from 0."""
    if not 0 <= reading < readings:
        raise BadInput(f"{path}: no reading {reading}; they are 0 to {readings - 1}")


def chosen_layer(path: Path, wanted: str, layers: list[str], usual: str) -> str:
    """The layer asked for, or the usual one. Raises BadInput with the names that there are."""
    if not wanted:
        return usual
    if wanted not in layers:
        raise BadInput(f"{path}: no view {wanted!r}; {did_you_mean(wanted, layers)}")
    return wanted
