"""Does what ``diagnose`` sets make the walls of a real run sharper?

    python -m benchmarks.mended_trace TRACE.trc [--sensor dirrs]

Nobody surveyed the walls of such a trace: each map is held against the four walls of the rectangle
that fits its own points best, so that neither is favoured. Of the points that the sensor measured,
the share within 4 and within 2 cm of those walls, and how far those within 15 cm lie off them: as
recorded and as mended, and what blocks of the points drawn anew (95 %) leave of the difference.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.arena import NEAR_M, fit_arena
from benchmarks.trace_halves import BESIDE_M, sessions
from mapping.config import MappingConfig, load_config
from mapping.diagnosis.diagnosing import diagnose
from mapping.placed_session import place_session
from mapping.readings import Readings
from mapping.scoring.lines import nearest
from recorder.columns import Floats
from recorder.session.columns import open_session
from replay.tables import text_table

BLOCKS, DRAWS = 40, 2000


def points_of(file: Path, config: MappingConfig, sensor: str) -> tuple[Floats, Floats]:
    """Where a ranger's echoes lie, (N, 2), and when, (N,) seconds."""
    readings = Readings.joined(list(place_session(open_session(file), config)))
    names = [each.name for each in readings.sensors]
    mine = readings.chosen(readings.sensor == names.index(sensor))
    points_m, row = mine.points_m()
    return points_m, mine.t_ns[row] * 1e-9


def off_own_walls_m(points_m: Floats) -> Floats:
    """How far each point (N, 2) lies off the rectangle that fits them best."""
    return nearest(points_m, None, fit_arena(points_m[::3]).walls_m)[0]


def rows(file: Path, sensor: str) -> Iterator[list[str]]:
    """The table: as recorded, and as mended."""
    found = diagnose(open_session(file), load_config())
    for suspect in found.suspects:
        print(f"{suspect.text}: {suspect.sure}")
    yield ["", "points", "within 4 cm", "within 2 cm", "median off", "rms off"]
    near = []
    for name, config in (("as recorded", load_config()), ("mended", found.config)):
        points_m, t_s = points_of(file, config, sensor)
        off_m = off_own_walls_m(points_m)
        near.append((t_s, off_m <= 0.5 * NEAR_M))
        beside_m = off_m[off_m <= BESIDE_M]
        yield [
            name, str(len(off_m)), f"{np.mean(off_m <= NEAR_M):.1%}",
            f"{np.mean(off_m <= 0.5 * NEAR_M):.1%}", f"{100 * np.median(beside_m):.1f} cm",
            f"{100 * np.sqrt(np.mean(np.square(beside_m))):.1f} cm",
        ]  # fmt: skip
    low, high = _interval(near[0], near[1])
    print(f"more points within 2 cm: {low:+.1%} to {high:+.1%} (95 %)")


def _interval(before: tuple[Floats, Floats], after: tuple[Floats, Floats]) -> tuple[float, float]:
    """Of the difference of two shares, by blocks of time drawn anew."""
    edges = np.quantile(before[0], np.linspace(0.0, 1.0, BLOCKS + 1)[1:-1])
    counts = []
    for t_s, is_near in (before, after):
        of = np.digitize(t_s, edges)
        counts.append((np.bincount(of, is_near, BLOCKS), np.bincount(of, minlength=BLOCKS)))
    drawn = np.random.default_rng(0).integers(BLOCKS, size=(DRAWS, BLOCKS))
    shares = [hits[drawn].sum(axis=1) / count[drawn].sum(axis=1) for hits, count in counts]
    low, high = np.percentile(shares[1] - shares[0], [2.5, 97.5])
    return float(low), float(high)


def main() -> None:
    """Print it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("trace", type=Path)
    parser.add_argument("--sensor", default="dirrs")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        _, _, whole = sessions(asked.trace, Path(folder))
        print("\n".join(text_table(list(rows(whole, asked.sensor)))))


if __name__ == "__main__":
    main()
