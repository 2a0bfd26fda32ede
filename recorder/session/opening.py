"""From what people have to the bytes of an MCAP file: folders, compressed files, other containers.

A bag of rosbag2 is a folder with a ``metadata.yaml``, which names its files in their order. A
compressed file is unpacked, and a ``.db3`` or a ROS 1 ``.bag`` copied, into a file without a name.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import zstandard

from recorder.errors import BadInput
from recorder.session.format import ZSTD_MAGIC

_METADATA = "metadata.yaml"
_LISTED = re.compile(
    r"^[ \t]*-[ \t]+['\"]?([^'\"#:\n]+?\.(?:mcap|db3)(?:\.zstd)?)['\"]?[ \t\r]*$", re.MULTILINE
)
_SQLITE, _ROS1 = b"SQLite format 3\0", b"#ROSBAG V"
_PIECE = 1 << 20


def session_files(*paths: Path) -> list[Path]:
    """The files of what is named: each file itself, of a folder those of the bag that it is."""
    return [file for path in paths for file in (_files_in(path) if path.is_dir() else [path])]


def _files_in(folder: Path) -> list[Path]:
    metadata = folder / _METADATA
    if metadata.is_file():
        text = metadata.read_text("utf-8", errors="replace")
        listed = dict.fromkeys(folder / Path(name).name for name in _LISTED.findall(text))
        found = [path if path.exists() else _compressed(path) for path in listed]
        missing = [path.name for path in found if not path.exists()]
        if missing:
            raise BadInput(f"{folder}: {_METADATA} names {', '.join(missing)}, which is not there")
        if found:
            return found
    kinds = ("*.mcap", "*.mcap.zstd", "*.db3")
    found = sorted(path for kind in kinds for path in folder.glob(kind))
    if not found:
        raise BadInput(f"{folder}: a folder without a bag in it (no .mcap, no .db3)")
    if not metadata.is_file() and len(found) > 1:
        raise BadInput(
            f"{folder}: a folder of {len(found)} sessions and no {_METADATA}, which would make "
            "them one: name the files"
        )
    return found


def _compressed(path: Path) -> Path:
    packed = path.with_name(f"{path.name}.zstd")
    return packed if packed.exists() else path


@contextmanager
def opened(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """The bytes of an MCAP file and how many they are. Raises BadInput, OSError."""
    if path.is_dir():
        raise BadInput(f"{path}: a folder, not a file")
    size = path.stat().st_size
    if size == 0:
        raise BadInput(f"{path}: an empty file, not a session")
    with path.open("rb") as file:
        begin = file.read(len(_SQLITE))
        file.seek(0)
        if begin.startswith(ZSTD_MAGIC):
            with tempfile.TemporaryFile() as plain:
                _unpack(path, file, plain)
                yield plain, _rewound(plain)
        elif begin == _SQLITE or begin.startswith(_ROS1):
            from recorder.session.other_bags import copy_bag

            with tempfile.TemporaryFile() as copy:
                copy_bag(path, copy)
                yield copy, _rewound(copy)
        else:
            yield file, size


def _rewound(file: BinaryIO) -> int:
    size = file.tell()
    file.seek(0)
    return size


def _unpack(path: Path, file: BinaryIO, plain: BinaryIO) -> None:
    try:
        with zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True) as pieces:
            while piece := pieces.read(_PIECE):
                plain.write(piece)
    except zstandard.ZstdError as error:
        if plain.tell() == 0:
            raise BadInput(f"{path}: it cannot be unpacked (zstd: {error})") from None
