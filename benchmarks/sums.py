"""What rules of several sums cost beside Bayes: ``python -m benchmarks.sums [READINGS]``.

The kernels on made-up sonar readings of 38 degrees, once each reading somewhere else in the room
(what is added to is never in the cache) and once along a route; CPU time of one thread, medians of
7 rounds in turn, and their ratios to ``bayes`` with the model ``fading``. ``eight adds`` is what
bounds `pooled`: the same spans, and a constant added to eight arrays of float64.
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba import njit

from benchmarks.peers import rivals, sessions
from mapping.kernels.batch import fading, sums
from mapping.kernels.batch.cell_tables import POOLED, SATURATING
from mapping.kernels.batch.readings import Place, Readings
from mapping.kernels.batch.spans import beam_between, box_of, span_scratch, spans_of_rows, widths_of
from mapping.update_rules.pooled import LIMITS, Pooled
from mapping.update_rules.state import blank_stack

ROUNDS = 7


@njit(error_model="numpy")
def _eight_adds(
    cells: sums.Floats, cols: int, place: Place, readings: Readings, half: float
) -> None:
    (spans, doubt), widths = span_scratch(cells.shape[1]), widths_of(np.array([half]))
    xs, ys, headings, _, fronts, bands, _ = readings
    for i in range(xs.size):
        beam = beam_between(xs[i], ys[i], headings[i], fronts[i], bands[i], widths, 0)
        box = box_of(beam, place, cells.shape[1], cols)
        for k in range(spans_of_rows(beam, place, box, np.int64(1), spans, doubt)):
            first, count = np.uint64(spans[0, k]), spans[3, k] - spans[0, k]
            for array in range(8):
                for c in range(count):
                    cells[array, box[0] + k, first + np.uint64(c)] += 1.0


def on_a_route(session: sessions.Session) -> sessions.Session:
    """The same ranges, read 20 times a second by a robot that goes round in the room."""
    count = len(session.poses)
    around = np.arange(count) * 2e-3
    middle = (np.array(session.low_m) + session.high_m) / 2.0
    places = middle + 0.35 * np.array(session.high_m) * np.column_stack(
        [np.cos(around), np.sin(around)]
    )
    poses = np.column_stack([places, (np.arange(count) * 0.02) % (2.0 * np.pi)])
    return replace(session, name=f"{session.name}, a route", poses=poses)


def jobs(session: sessions.Session) -> dict[str, Callable[[], object]]:
    """The kernels on a session."""
    cells, observed, place = rivals._map_of(session)
    model, half = rivals.SONAR, session.beam_width_rad / 2.0
    readings = rivals._readings(session, model["before"], model["behind"])
    bayes = np.array([[half, model["hit"], model["miss"], model["near"], model["fade_m"]]])
    table, limits = np.array([[half, 0.75, 1.0, 4.74, 0.41, 30.0]]), np.array(LIMITS)
    two, eight = (blank_stack(count, *observed.shape) for count in (2, 8))
    for array, value in zip(eight, Pooled.start.values(), strict=True):
        array[...] = value
    bound = eight.copy()
    common = observed, place, readings, table, limits
    return {
        "bayes": lambda: fading.add_fading(
            cells, observed, place, readings, bayes, 0, len(observed)
        ),
        "saturating": lambda: sums.add_sums(two, *common, SATURATING, 0, len(observed)),
        "pooled": lambda: sums.add_sums(eight, *common, POOLED, 0, len(observed)),
        "eight adds": lambda: _eight_adds(bound, observed.shape[1], place, readings, half),
    }


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 4000
    chapter, room = sessions.sonar(count), replace(sessions.coarse_sonar(count), resolution_m=0.01)
    for session in (chapter, on_a_route(chapter), room, on_a_route(room)):
        tried = {name: rivals.cpu(job) for name, job in jobs(session).items()}
        times: dict[str, list[float]] = {name: [] for name in tried}
        for turn in range(ROUNDS + 1):
            for name, run in tried.items():
                seconds = run()
                if turn:  # the first one compiles
                    times[name].append(seconds)
        print(f"{session.name}, cells of {session.resolution_m * 100:.3g} cm")
        for name, each in times.items():
            ratios = [a / b for a, b in zip(each, times["bayes"], strict=True)]
            print(f"  {name:12} {statistics.median(each) / count * 1e6:8.2f} us a reading, "
                  f"{statistics.median(ratios):6.2f} times bayes "
                  f"({min(ratios):.2f} to {max(ratios):.2f})")  # fmt: skip


if __name__ == "__main__":
    main()
