"""Size and speed of recordings, as a table: ``python benchmarks/rrd.py [OPTIONS] [RUN...]``.

A run is READINGS:COLSxROWS:MB[:RULE], MB the budget; those of ``docs/recording-size.md``
by default. Each is written by a process of its own: a robot circles in an empty rectangle, a wide
sonar and a narrow infrared ranger read in turn, at 1 cm. With a RULE of the sonar's they are mapped
as any session is (the infrared sensor by its default); without one, by a plain model in log-odds
beside the mapping. ``written`` is the time spent in the writer alone (``processor``: in all its
threads), ``memory`` the most that the process took, ``grid`` how long the last whole grid takes to
be read back. With ``--viewer`` also how long the viewer takes, without a window, to its first
picture, and for a jump to a far step until nothing in its picture changes any more: it draws first
what it has loaded, and the rest follows. ``--small`` opens a window of 700 x 440 points instead of
1600 x 1000. ``picture`` is how long it takes just to draw the same picture again, which a processor
does slowly: it is part of each jump.

``--kinds`` adds what each kind of thing takes of each file.
"""

from __future__ import annotations

import json
import math
import re
import resource
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests")]

from made_run import FIRST_T_NS, MOUNT, MadeRun  # noqa: E402

from mapping.artifacts import Artifact  # noqa: E402
from mapping.config import validate  # noqa: E402
from mapping.grid import GridGeometry  # noqa: E402
from mapping.pipeline import build_maps  # noqa: E402
from recorder.messages import BASE_FRAME, Message, Pose, Range, Transform  # noqa: E402
from recorder.sensors import CATALOGUE  # noqa: E402
from replay.rrd.claims import varint  # noqa: E402
from replay.rrd.headless import HeadlessViewer  # noqa: E402
from replay.rrd.reader import read_rrd  # noqa: E402
from replay.rrd.run_drawer import RunDrawer  # noqa: E402
from replay.rrd.writer import RrdWriter  # noqa: E402

RUNS = (
    "1000:600x400:100", "10000:600x400:100", "10000:600x400:100:pooled", "10000:600x400:100:bayes",
    "10000:600x400:40", "2000:4000x4000:100",
)  # fmt: skip
LONGEST_M = 3.0
JUMPS = (0.9, 0.2, 0.6, 0.60001, 0.3, 0.75)  # parts of the recording, one after the other
LARGE, SMALL = (1600, 1000), (700, 440)  # windows
LONGEST_S = 60.0  # a jump, before it is given up
NOTICES_S = 8.0  # until those that the viewer greets with are gone


def measure(run: str, viewer: bool) -> dict[str, str]:
    """One row of the table."""
    readings, shape, budget, *rules = run.split(":")
    cols, rows = (int(number) for number in shape.split("x"))
    made = MadeRun(
        GridGeometry((0.0, 0.0), 0.01, rows, cols), readings=int(readings), longest_m=LONGEST_M
    )
    rule = rules[0] if rules else "made up"
    row = {"readings": readings, "cells": f"{cols} x {rows}", "rule": rule, "budget MB": budget}
    artifacts = mapped(made, rule) if rules else made.artifacts()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "benchmark.rrd"
        wall, processor, writer = write(artifacts, path, float(budget))
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        row["size MB"] = f"{path.stat().st_size / 1e6:.1f}"
        row["written s"] = f"{wall:.1f}"
        row["processor s"] = f"{processor:.1f}"
        row["memory MB"] = f"{memory_mb:.0f}"
        start = time.perf_counter()
        read_rrd(path).grid("ping")
        row["grid s"] = f"{time.perf_counter() - start:.2f}"
        if "--kinds" in sys.argv:
            print(kinds_table(path), file=sys.stderr)
        if viewer:
            row |= look(path, SMALL if "--small" in sys.argv else LARGE)
    row["left out"] = writer.left_out or "nothing"
    return row


def mapped(run: MadeRun, rule: str) -> Iterator[Artifact]:
    """The same readings as a session, mapped with a rule of the sonar's."""
    geometry = run.geometry
    settings = {
        "sensors": {"ping": {"update": rule}},
        "grid": {"origin_m": geometry.origin_m, "size_m": geometry.size_m,
                 "resolution_m": geometry.resolution_m},
    }  # fmt: skip
    return build_maps(list(messages(run)), validate(settings), walls_m=run.walls_m)


def messages(run: MadeRun) -> Iterator[Message]:
    """A pose and a reading at each step; both sensors sit where the run has them."""
    for name, _ in run.sensors:
        yield Transform(FIRST_T_NS, BASE_FRAME, name, MOUNT)
    widths_deg = dict(run.sensors)
    for number in range(run.readings):
        beam = run.beam(number)
        yield Pose(beam.t_ns, beam.world_from_base)
        kind = CATALOGUE[beam.sensor]
        yield Range(
            beam.t_ns, beam.sensor, float(beam.ranges_m[0]), math.radians(widths_deg[beam.sensor]),
            0.02, beam.reach_m, kind.radiation,
        )  # fmt: skip


def write(
    artifacts: Iterator[Artifact], path: Path, budget_mb: float
) -> tuple[float, float, RrdWriter[Artifact]]:
    """Write a run; seconds in the writer alone, by the clock and of the processor."""
    start, making = (time.perf_counter(), time.process_time()), [0.0, 0.0]
    with RrdWriter(path, RunDrawer(), name="benchmark", budget_mb=budget_mb) as writer:
        while True:
            before = time.perf_counter(), time.thread_time()
            artifact = next(artifacts, None)
            making[0] += time.perf_counter() - before[0]
            making[1] += time.thread_time() - before[1]
            if artifact is None:
                break
            writer(artifact)
    wall, processor = time.perf_counter() - start[0], time.process_time() - start[1]
    return wall - making[0], processor - making[1], writer


KINDS = (
    ("exact values, whole tiles", r"/merged/.*values"), ("the map", r"/(merged|classes|thresh)"),
    ("the evidence of a reading", r"/temp/"), ("what a reading changed", r"/what_changed/"),
    ("exact values, the log", r"^/histories"), ("explanations", r"^/explanation"),
    ("path and echoes", r"/(path|points)/"), ("beams, robot, ranges", r"/(beam|robot|ranges)"),
)  # fmt: skip


def kinds_table(path: Path) -> str:
    """What each kind of thing takes of a file, and of memory once it is unpacked, in megabytes."""
    sums: dict[str, list[float]] = {}
    for name, packed, unpacked in chunks_of(path):
        kind = next((kind for kind, pattern in KINDS if re.search(pattern, name)), "all else")
        entry = sums.setdefault(kind, [0.0, 0.0])
        entry[0] += packed / 1e6
        entry[1] += unpacked / 1e6
    rows = sorted(sums.items(), key=lambda each: -each[1][0])
    return "\n".join(f"| {kind} | {size:.1f} | {raw:.1f} |" for kind, (size, raw) in rows)


def chunks_of(path: Path) -> Iterator[tuple[str, int, int]]:
    """Entity and components of each chunk, its bytes in the file, and unpacked; see ``claims``."""
    data, at, codec = path.read_bytes(), 12, pa.Codec("lz4_raw")
    while at + 16 <= len(data):
        kind, length = struct.unpack_from("<QQ", data, at)
        message = data[at + 16 : at + 16 + length]
        at += 16 + length
        if kind != 2:
            continue
        fields = dict(fields_of(message))
        raw = codec.decompress(fields[5], decompressed_size=fields[3], asbytes=True)
        schema = pa.ipc.open_stream(raw).schema
        yield f"{schema.metadata[b'rerun:entity_path'].decode()} {schema.names}", length, len(raw)


def fields_of(message: bytes) -> Iterator[tuple[int, Any]]:
    """Number and value of the fields of a protobuf message: numbers and bytes."""
    at = 0
    while at < len(message):
        key, at = varint(message, at)
        value, at = varint(message, at)
        if key & 7 == 2:
            yield key >> 3, message[at : at + value]
            at += value
        else:
            yield key >> 3, value


def look(path: Path, size: tuple[int, int] = LARGE) -> dict[str, str]:
    """How long the real viewer takes, without a window."""
    start = time.perf_counter()
    with HeadlessViewer(path, size=size) as viewer:
        viewer.screenshot()
        first = time.perf_counter() - start
        time.sleep(NOTICES_S)
        last = viewer.steps[1]
        jumps = [jump(viewer, int(last * share)) for share in JUMPS]
        start = time.perf_counter()
        viewer.screenshot()
        again = time.perf_counter() - start
    return {
        "first picture s": f"{first:.1f}",
        "jump s": " ".join(f"{each:.1f}" for each in jumps),
        "picture s": f"{again:.1f}",
    }


def jump(viewer: HeadlessViewer, step: int) -> float:
    """Seconds until the picture of a step is there, all of it: the next one is no different."""
    start = time.perf_counter()
    viewer.go_to(step, paint_s=0.0)
    newest = viewer.screenshot()
    while time.perf_counter() - start < LONGEST_S:
        seconds = time.perf_counter() - start
        before, newest = newest, viewer.screenshot()
        if newest == before:
            return seconds
    return float("inf")


def main() -> None:
    """The table; or, as a process of its own, one row of it."""
    given = [argument for argument in sys.argv[1:] if not argument.startswith("--")]
    viewer = "--viewer" in sys.argv
    options = [argument for argument in sys.argv[1:] if argument.startswith("--")]
    if "--row" in sys.argv:
        print(json.dumps(measure(given[0], viewer)))
        return
    headed = False
    for run in given or RUNS:
        command = [sys.executable, __file__, run, "--row", *options]
        said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        row: dict[str, str] = json.loads(said.splitlines()[-1])
        if not headed:
            print(f"| {' | '.join(row)} |\n|{' --- |' * len(row)}")
            headed = True
        print(f"| {' | '.join(row.values())} |", flush=True)


if __name__ == "__main__":
    main()
