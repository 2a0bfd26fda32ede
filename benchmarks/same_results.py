"""Do two commits give the same maps? ``python -m benchmarks.same_results BEFORE [AFTER]``.

Checks both commits out, maps every session in ``logs/`` with every update rule and every sensor
model of BEFORE, and compares each exported file and, with the default model, everything that reads
back from the recording: the grid after each of its steps, beams, borders and segments. What people
read (versions in ``summary.json``, texts in the recording) may differ. Exit 1 where numbers do.

Where a commit is meant to round otherwise, ``--within 1e-5`` allows so much in probability.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np

from replay.rrd.reader import RrdRecording, read_rrd

ROOT = Path(__file__).resolve().parent.parent
RULES = ("bayes", "odds", "count", "sum", "binary", "dempster-shafer", "himm")
MODELS = ("fading", "regions", "peak")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before")
    parser.add_argument("after", nargs="?", default="HEAD")
    parser.add_argument("--within", type=float, default=0.0, help="difference allowed in values")
    options = parser.parse_args()
    compared = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        trees = [_checkout(rev, Path(folder) / side) for rev, side in
                 ((options.before, "before"), (options.after, "after"))]  # fmt: skip
        try:
            for name, one, two in _runs(*trees, Path(folder)):
                lines = list(_differences(one, two, options.within))
                compared += 1
                failed += bool(lines)
                print(f"{name}: {'; '.join(lines[:3]) if lines else 'equal'}", flush=True)
        finally:
            for tree in trees:
                _git("worktree", "remove", "--force", str(tree))
    print(f"{compared} runs compared, {failed} differ")
    return 1 if failed or not compared else 0


def _git(*words: str) -> None:
    subprocess.run(["git", *words], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


def _checkout(rev: str, place: Path) -> Path:
    _git("worktree", "add", "--quiet", "--detach", str(place), rev)
    return place


def _runs(before: Path, after: Path, folder: Path) -> Iterator[tuple[str, Path, Path]]:
    """Each way to map each session, run by both commits: its name and the two export folders."""
    for session, rule, model in product(sorted((ROOT / "logs").glob("*.mcap")), RULES, MODELS):
        outs = []
        for tree in (before, after):
            out = folder / f"{tree.name}-{session.stem}-{rule}-{model}"
            recording = str(out) + ".rrd" if model == MODELS[0] else "-"
            subprocess.run(
                [
                    sys.executable, "-m", "echogrid", "map", str(session), "-o", recording,
                    "--export", str(out), "--quiet", "--set", f"sensors.*.update={rule}",
                    "--set", f"sensors.*.model={model}",
                ],
                cwd=tree, env={"PYTHONPATH": str(tree)}, check=True, stdout=subprocess.DEVNULL,
            )  # fmt: skip
            outs.append(out)
        yield f"{session.stem}, {rule}, {model}", outs[0], outs[1]


def _differences(one: Path, two: Path, within: float) -> Iterator[str]:
    """What differs between two export folders, and the recordings beside them."""
    names = sorted(file.name for file in one.iterdir())
    if names != sorted(file.name for file in two.iterdir()):
        yield "other files"
        return
    for name in names:
        a, b = one / name, two / name
        if name == "summary.json":
            first, second = (json.loads(file.read_text()) for file in (a, b))
            yield from (
                f"{name}: {key}" for key in ("readings", "used", "dropped")
                if first.get(key) != second.get(key)
            )  # fmt: skip
        elif name.endswith(".npz"):
            yield from (f"{name}: {what}" for what in _arrays_differ(a, b, within))
        elif within == 0.0 and a.read_bytes() != b.read_bytes():
            yield name
    recordings = [Path(f"{out}.rrd") for out in (one, two)]
    if recordings[0].exists():
        yield from _recordings_differ(*map(read_rrd, recordings), within)


def _arrays_differ(a: Path, b: Path, within: float) -> Iterator[str]:
    with np.load(a) as first, np.load(b) as second:
        if sorted(first) != sorted(second):
            yield "other arrays"
            return
        for name in first:
            if not _same(first[name], second[name], within):
                yield name


def _recordings_differ(a: RrdRecording, b: RrdRecording, within: float) -> Iterator[str]:
    if a.layers != b.layers or a.geometry != b.geometry:
        yield "recording: other layers or grid"
        return
    for layer in a.layers:
        grids = zip(a.grids(layer), b.grids(layer), strict=True)
        if not all(s == t and _same(g, h, within) for (s, g), (t, h) in grids):
            yield f"recording: steps of {layer}"
    if repr(list(a.beams())) != repr(list(b.beams())):
        yield "recording: beams"
    if within == 0.0 and (
        repr(a.segments()) != repr(b.segments()) or repr(a.borders()) != repr(b.borders())
    ):
        yield "recording: segments or borders"


def _same(a: np.ndarray, b: np.ndarray, within: float) -> bool:
    if a.shape != b.shape or a.dtype != b.dtype:
        return False
    if within == 0.0 or a.dtype.kind not in "f":
        return a.tobytes() == b.tobytes()
    return bool(np.allclose(a, b, rtol=within, atol=within, equal_nan=True))


if __name__ == "__main__":
    sys.exit(main())
