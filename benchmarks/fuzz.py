"""Every reader of a foreign format fed with damaged files: ``python -m benchmarks.fuzz``.

Good files of each kind are cut, flipped, spliced and filled with numbers that formats stumble over;
each result must be read, or refused with BadInput in one line. What raises anything else, warns, or
takes too long is kept beside, with its seed. ``--minutes`` is for each reader; the seed is fresh
each time and printed; ``--seed`` repeats a run.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import echogrid
from mapping.config import load_config
from recorder.errors import BadInput
from recorder.session import SessionReader
from recorder.summary import summary_lines
from recorder.truth import read_walls, walls_to_geojson
from replay.diff.sources.opening import open_map

LONGEST_S = 10.0
_SMALL = "grid.resolution_m=0.1"
_EXTREMES = (b"\0", b"\xff", b"\xff" * 8, b"\x80", b"9" * 5000, b"[" * 20_000, b"nan", b"-1")
_ROOM = np.array([[[0.0, 0.0], [3.0, 0.0]], [[3.0, 0.0], [3.0, 2.0]], [[3.0, 2.0], [0.0, 0.0]]])
Generator = np.random.Generator
Read = Callable[[Path], object]


@dataclass(frozen=True, slots=True)
class Reader:
    """One reader: the good file it is tried on, and how the damaged one is read."""

    name: str
    good: Path
    read: Read
    beside: tuple[str, ...] = ()  # further files of the folder that it needs


@dataclass(frozen=True, slots=True)
class Failure:
    """A damaged file that was neither read nor refused as it should be."""

    reader: str
    what: str
    data: bytes


def make_readers(folder: Path) -> tuple[Reader, ...]:
    """Good files of every kind, made in ``folder``, each with its reader."""
    session, rrd, export = folder / "s.mcap", folder / "s.rrd", folder / "export"
    _run("simulate", "room", "-o", str(session), "--duration", "3", "--seed", "1")
    _run("map", str(session), "-o", str(rrd), "--export", str(export), "--set", _SMALL)
    room, config = folder / "room.geojson", folder / "c.toml"
    room.write_bytes(walls_to_geojson(_ROOM, "r"))
    config.write_text('[grid]\nresolution_m = 0.1\n[sensors."*"]\nupdate = "bayes"\n')
    whole = ("fused.npz", "fused.segments.geojson", "fused.borders.json", "summary.json")
    return (
        Reader("npz", export / "fused.npz", open_map),
        Reader("map yaml", export / "fused.yaml", open_map, ("fused.pgm",)),
        Reader("map picture", export / "fused.pgm", open_map, ("fused.yaml",)),
        Reader("lines", export / "fused.segments.geojson", _read_folder, whole),
        Reader("borders", export / "fused.borders.json", _read_folder, whole),
        Reader("summary", export / "summary.json", _read_folder, whole),
        Reader("rrd", rrd, open_map),
        Reader("mcap", session, _read_session),
        Reader("toml", config, lambda path: load_config([path])),
        Reader("room", room, read_walls),
    )


def damaged(data: bytes, random: Generator) -> bytes:
    """The bytes cut, flipped, filled or repeated at some place."""
    at = int(random.integers(len(data)))
    match int(random.integers(5)):
        case 0:
            return data[:at]
        case 1:
            several = bytearray(data)
            for _ in range(int(random.integers(1, 8))):
                several[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
            return bytes(several)
        case 2:
            extreme = _EXTREMES[int(random.integers(len(_EXTREMES)))]
            return data[:at] + extreme + data[at + len(extreme) :]
        case 3:
            extreme = _EXTREMES[int(random.integers(len(_EXTREMES)))]
            return data[:at] + extreme + data[at:]
        case _:
            end = at + int(random.integers(1, 200))
            return data[:end] + data[at:]


def failures(
    reader: Reader, random: Generator, folder: Path, seconds: float, at_most: int
) -> Iterator[Failure | None]:
    """Try damaged files until the time is over: a Failure for each that fails, else None."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / reader.good.name
    for name in reader.beside:
        if name != path.name:
            shutil.copyfile(reader.good.with_name(name), folder / name)
    good, end = reader.good.read_bytes(), time.monotonic() + seconds
    for _ in range(at_most):
        if time.monotonic() > end:
            return
        data = damaged(good, random)
        path.write_bytes(data)
        what = tried(reader.read, path)
        yield Failure(reader.name, what, data) if what else None


def tried(read: Read, path: Path) -> str:
    """What is wrong with how a file is read; empty: it is read, or refused in one line."""
    begin = time.monotonic()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ResourceWarning)  # of a recording that is let go of
        try:
            read(path)
        except BadInput as error:
            if "\n" in str(error):
                return f"refused in several lines: {error}"[:300]
        except Exception as error:
            return f"{type(error).__name__}: {error}"[:300]
    taken_s = time.monotonic() - begin
    return f"it takes {taken_s:.1f} s" if taken_s > LONGEST_S else ""


def _read_folder(path: Path) -> object:
    return open_map(path.parent)


def _read_session(path: Path) -> object:
    return list(summary_lines(SessionReader(path)))


def _run(*arguments: str) -> None:
    if echogrid.main([*arguments, "--quiet"]):
        raise SystemExit(f"echogrid {' '.join(arguments)} failed")


def main() -> int:
    """Try all readers, or one; 1 where any failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=1.0, help="for each reader")
    parser.add_argument("--reader", help="only this one")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    asked = parser.parse_args()
    seed = np.random.SeedSequence(asked.seed).entropy
    print(f"seed {seed}")
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        for reader in make_readers(Path(scratch)):
            if asked.reader not in (None, reader.name):
                continue
            random, count, bad = np.random.default_rng(seed), 0, 0
            folder = Path(scratch) / "bad" / reader.name
            for failure in failures(reader, random, folder, 60.0 * asked.minutes, sys.maxsize):
                count += 1
                if failure is not None:
                    bad += 1
                    asked.keep.mkdir(exist_ok=True)
                    kept = asked.keep / f"{reader.name.replace(' ', '-')}-{seed}-{count}"
                    kept.write_bytes(failure.data)
                    print(f"  {kept}: {failure.what}")
            print(f"{reader.name:12} {count:8} files, {bad} failed")
            failed += bad
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
