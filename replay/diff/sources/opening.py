"""Which kind of source a path is, and the module that reads it."""

from __future__ import annotations

from pathlib import Path

from recorder.errors import BadInput
from recorder.foreign import reading
from recorder.names import unusable_name
from replay.diff.layers import Source

SESSION = ".mcap"
_KINDS = "a session (.mcap), a recording (.rrd), arrays (.npz), a map (.yaml) or an export folder"


def is_session(path: Path) -> bool:
    """Whether a path is mapped before it is compared. A folder of session parts is none."""
    return path.suffix.lower() == SESSION


def open_map(path: Path) -> Source:
    """A source that is a map already: a path, or FILE.rrd#NAME for one of several maps in a file.

    Raises BadInput, in one line, for all else.
    """
    source = _open(path)
    for name, layer in source.layers.items():
        for text in (name, layer.kind):
            if why := unusable_name(text):
                raise BadInput(f"{path}: it holds a layer {text!r}: {why}")
    return source


def _open(path: Path) -> Source:
    with reading(path, "a map"):
        there = path.exists()
    if not there:
        file, name = _one_of_several(path)
        if not name:
            raise BadInput(f"{file}: no such file")
        from replay.diff.sources.recordings import read_recording

        return read_recording(file, name)
    if path.is_dir():
        from replay.diff.sources.folders import read_folder

        return read_folder(path)
    match path.suffix.lower():
        case ".npz":
            from replay.diff.sources.arrays import read_npz

            return read_npz(path)
        case ".yaml" | ".yml" | ".pgm":
            from replay.diff.sources.map_server import read_map

            return read_map(path)
        case ".rrd":
            from replay.diff.sources.recordings import read_recording

            return read_recording(path)
        case _:
            raise BadInput(f"{path}: not a map; it takes {_KINDS}")


def _one_of_several(path: Path) -> tuple[Path, str]:
    """FILE.rrd#NAME as file and name; the name is empty where this is nothing such."""
    file, mark, name = path.name.rpartition("#")
    if not mark or not file.lower().endswith(".rrd") or not path.with_name(file).is_file():
        return path, ""
    return path.with_name(file), name
