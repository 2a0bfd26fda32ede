"""A session in, what its map is bad for out: looks first, then the search, then what mends it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mapping.config import MappingConfig, validate
from mapping.diagnosis.case import Case, case_of
from mapping.diagnosis.causes.channels import Channels, exchanged, swaps
from mapping.diagnosis.causes.interface import Evidence, Plot, Suspect
from mapping.diagnosis.causes.silence import Silence, stuck_readings
from mapping.diagnosis.causes.table import CAUSES
from mapping.diagnosis.hypothesis import Hypothesis, Session
from mapping.diagnosis.patches import NO_FAULT
from mapping.diagnosis.pose_quality import relocations
from mapping.diagnosis.search import Found, search
from mapping.placed_session import HasBlocks, place_session
from mapping.readings import Readings
from mapping.scoring.held_out import Gain

_SEEN_TO_MOVE_M = 0.01  # in a picture


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The suspects in the order of what they cost, and what mends them all together.

    ``score`` and ``mended`` are the session's score without truth, as it is and by ``hypothesis``;
    ``gain`` is the difference, None where nothing numeric was found. ``fix`` are the settings,
    nested as a configuration; ``config`` is the whole configuration with them. ``plots`` show
    where the echoes of thin beams lie, as the session has them and by ``hypothesis``, where that
    moves some.
    """

    suspects: tuple[Suspect, ...]
    hypothesis: Hypothesis
    score: float
    mended: float
    gain: Gain | None
    fix: Mapping[str, Any]
    config: MappingConfig
    readings: int
    notes: tuple[str, ...]
    plots: tuple[Plot, ...] = ()


def diagnose(
    session: HasBlocks,
    config: MappingConfig,
    *,
    threads: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Diagnosis:
    """What is wrong with a session. Raises BadInput where it cannot be mapped at all."""
    placed = place_session(session, config)
    evidence = Evidence.of(placed, config)
    exchange = Channels()
    found = list(exchange.suspects(evidence))
    # What follows is about the session as it should have been.
    for swap in swaps(evidence):
        if (mended := exchanged(session, placed, swap)) is not None:
            placed = place_session(mended, config)
            evidence = Evidence.of(placed, config)
    others = [cause for cause in CAUSES if cause.name != exchange.name]
    found += [suspect for cause in others for suspect in cause.suspects(evidence)]
    case = case_of(placed, config, without=stuck_readings(evidence), threads=threads)
    candidates = [each for cause in CAUSES for each in cause.candidates(case)]
    tried = _Counter(progress, len(candidates) + 1)
    hypothesis, taken = NO_FAULT, list[Found]()
    if case.thin:
        hypothesis, taken = search(case, candidates, advance=tried)
    if taken:
        found = [each for each in found if each.cause != Silence.name]
        found += Silence().suspects(_mended(evidence, hypothesis))
    for each in taken:
        explained = (c.explained(case, each.number, each, hypothesis) for c in CAUSES)
        found += [suspect for suspect in explained if suspect is not None]
    walls = bool(case.thin) and not case.rough
    looking = [cause for cause in CAUSES if walls or not cause.needs_walls]
    found += [s for cause in looking for s in cause.examine(case, hypothesis)]
    # What was examined last knows of all that the search found: its whole mounts count.
    fix = merged(suspect.settings for suspect in found if suspect.settings)
    found.sort(key=lambda suspect: -suspect.cost)
    before, after = case.score(NO_FAULT), case.score(hypothesis)
    gain = after.gain_over(before) if taken else None
    progress(1, 1)
    return Diagnosis(
        tuple(found), hypothesis, before.scores.mean, after.scores.mean, gain, fix,
        validate(merged([_set(config), fix])), len(case.readings), _notes(case),
        tuple(_echoes(case, hypothesis)) if taken else (),
    )  # fmt: skip


def _mended(evidence: Evidence, hypothesis: Hypothesis) -> Evidence:
    """The same, placed as was found: of poses that come late the walls are torn, and where an echo
    should have come is not seen."""
    every = Session(Readings.joined(list(evidence.placed)), evidence.placed.placement)
    return replace(evidence, stuck={}, mended=every.under(hypothesis))


def _echoes(case: Case, hypothesis: Hypothesis) -> Iterator[Plot]:
    before_m, after_m = (case.beams(case.thin).points(each).at_m for each in (NO_FAULT, hypothesis))
    if np.abs(after_m - before_m).max(initial=0.0) < _SEEN_TO_MOVE_M:
        return
    for title, at_m in (("as recorded", before_m), ("mended", after_m)):
        yield Plot(f"echoes of {' and '.join(case.thin)}, {title}", "x (m)", "y (m)", at_m,
                   is_map=True)  # fmt: skip


def _notes(case: Case) -> tuple[str, ...]:
    notes, track = list(case.placed.notes), case.placed.placement.track
    if len(moved := relocations(track, case.config.pose.max_gap_s)):
        first_s = (int(track.t_ns[moved[0]]) - case.start_ns) * 1e-9
        times = "once" if len(moved) == 1 else f"{len(moved)} times"
        notes.append(
            f"the robot is set down elsewhere {times}, first at {first_s:.1f} s: it was carried, "
            "or the recording is cut there"
        )
    if not case.thin:
        notes.append(
            "no sensor with a thin beam: pose time and mounts cannot be told from cones of sound"
        )
    return tuple(notes)


class _Counter:
    """Counts candidates that were tried."""

    def __init__(self, progress: Callable[[int, int], None], total: int) -> None:
        self._progress, self._done, self._total = progress, 0, max(total, 1)

    def __call__(self) -> None:
        self._done += 1
        self._progress(min(self._done, self._total - 1), self._total)


def _set(config: MappingConfig) -> dict[str, Any]:
    """What a configuration sets, as it could be written."""
    return config.model_dump(exclude_unset=True, exclude_none=True)


def merged(parts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Nested settings laid over each other; the later ones win."""
    out: dict[str, Any] = {}
    for part in parts:
        for key, value in part.items():
            old = out.get(key)
            both = isinstance(old, Mapping) and isinstance(value, Mapping)
            out[key] = merged([old, value]) if both else value  # type: ignore[list-item]
    return out
