"""Times of rivals, taken in turn in one run: on a busy machine only their ratio means anything."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping


def best_times_s(
    rivals: Mapping[str, Callable[[], object]], *, rounds: int = 15
) -> dict[str, float]:
    """The shortest time of each in seconds, after a warm-up; every round runs all of them."""
    for run in rivals.values():
        run()
    best = dict.fromkeys(rivals, float("inf"))
    for _ in range(rounds):
        for name, run in rivals.items():
            start = time.perf_counter()
            run()
            best[name] = min(best[name], time.perf_counter() - start)
    return best
