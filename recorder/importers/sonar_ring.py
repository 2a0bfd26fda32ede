"""A ring of eight sonars, as two files of rows → messages: ranges, and poses of the same times.

``t r0 .. r7`` (ms, mm) and ``t x y theta`` (ms, mm, tenths of a degree, counter-clockwise); 5110 mm
and more: nothing seen. Each file may be given alone when the other lies beside it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from recorder.errors import BadInput
from recorder.geometry import SE2, wrap_angle
from recorder.importers.imported import Imported
from recorder.messages import BASE_FRAME, Message, Pose, Radiation, Range, Transform

FORMAT = "sonar-ring"
BEARINGS_DEG = (-90.0, -37.5, -22.5, -7.5, 7.5, 22.5, 37.5, 90.0)
NOTHING_SEEN_M = 5.11
BEAM_WIDTH_DEG = 30.0  # an assumption: the usual ring transducers'; the files do not say
MOST_BYTES = 1 << 28
_NAMES = ("measurement", "poses")


def looks_like_sonar_ring(head: bytes) -> bool:
    """Whether rows of nine (ranges) or four (poses) whole numbers come first."""
    lines = [line.split() for line in head.split(b"\n")[:3]]
    whole = all(word.lstrip(b"-").isdigit() for line in lines for word in line)
    return (
        bool(lines[0]) and whole and len(lines) > 2 and {len(line) for line in lines[:2]} <= {4, 9}
    )


def import_sonar_ring(paths: Sequence[Path], *, start_s: float = 0.0) -> Imported:
    """Both files, in any order, or one of them beside the other; times are UNIX seconds from
    ``start_s`` plus the file's own.

    Raises BadInput: cannot be read, not such rows, no range with a pose.
    """
    dropped: Counter[str] = Counter()
    tables = [_rows(path, dropped) for path in _both(paths)]
    ranges = next((rows for rows in tables if rows and len(rows[0]) == 9), None)
    poses = next((rows for rows in tables if rows and len(rows[0]) == 4), None)
    if ranges is None or poses is None:
        raise BadInput(f"{paths[0]}: one file of rows 't r0 .. r7' and one of 't x y theta' wanted")
    names = [f"sonar_{i}" for i in range(len(BEARINGS_DEG))]
    first_ns = _t_ns(min(ranges[0][0], poses[0][0]), start_s)
    records: list[tuple[int, Message]] = [
        (first_ns, Transform(first_ns, BASE_FRAME, name, SE2(0.0, 0.0, math.radians(bearing))))
        for name, bearing in zip(names, BEARINGS_DEG, strict=True)
    ]
    timed: list[tuple[int, Message]] = []
    for t_ms, x_mm, y_mm, tenths in poses:
        t_ns = _t_ns(t_ms, start_s)
        heading_rad = wrap_angle(math.radians(tenths / 10.0))
        timed.append((t_ns, Pose(t_ns, SE2(x_mm / 1000.0, y_mm / 1000.0, heading_rad))))
    for row in ranges:
        t_ns = _t_ns(row[0], start_s)
        timed += [(t_ns, _reading(t_ns, *each)) for each in zip(names, row[1:], strict=True)]
    records += sorted(timed, key=lambda record: record[0])
    metadata = {
        "format": FORMAT, "start_s": f"{start_s!r}",
        "beam_note": f"{BEAM_WIDTH_DEG:g} degrees, an assumption: the files do not say",
    }  # fmt: skip
    return Imported(records, metadata, dict(dropped))


def _reading(t_ns: int, name: str, range_mm: float) -> Range:
    range_m = range_mm / 1000.0
    return Range(
        t_ns, name, math.inf if range_m >= NOTHING_SEEN_M else range_m,
        math.radians(BEAM_WIDTH_DEG), 0.1, NOTHING_SEEN_M, Radiation.ULTRASOUND,
    )  # fmt: skip


def _t_ns(t_ms: float, start_s: float) -> int:
    return round(start_s * 1e9) + round(t_ms * 1e6)


def _both(paths: Sequence[Path]) -> tuple[Path, Path]:
    """The two files: as given, or the other one found beside a single one by its name."""
    if len(paths) == 2:
        return paths[0], paths[1]
    if len(paths) == 1:
        (path,) = paths
        for own, other in (_NAMES, _NAMES[::-1]):
            beside = path.with_name(path.name.replace(own, other))
            if beside != path and beside.exists():
                return path, beside
    raise BadInput(f"{paths[0]}: sonar-ring takes two files, the ranges and the poses")


def _rows(path: Path, dropped: Counter[str]) -> list[list[float]]:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise BadInput(f"{path}: over {MOST_BYTES >> 20} MB: split it first")
        lines = path.read_bytes().decode("latin-1").splitlines()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror or error})") from error
    rows: list[list[float]] = []
    for line in lines:
        if not line.strip():
            continue
        try:
            row = [float(word) for word in line.split()]
        except ValueError:
            row = []
        if (
            len(row) in (4, 9)
            and all(math.isfinite(v) and abs(v) < 1e12 for v in row)
            and (not rows or len(row) == len(rows[0]))
        ):
            rows.append(row)
        else:
            dropped["malformed line"] += 1
    return rows
