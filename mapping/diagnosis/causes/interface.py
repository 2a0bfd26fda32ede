"""What a cause of bad maps is: one file each, on these types, named in ``table``.

A cause that is a number (a pose late by so much) offers candidates: the search tries them, and the
cause turns what was found into a suspect. One that shows in the readings themselves (a sensor that
repeats itself) is looked for straight away.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from mapping.config import MappingConfig
from mapping.placed_session import PlacedSession
from mapping.readings import Readings
from recorder.columns import Block, Floats

if TYPE_CHECKING:  # the search, which a look at first sight does without
    from mapping.diagnosis.case import Case
    from mapping.diagnosis.hypothesis import Hypothesis, Number
    from mapping.diagnosis.search import Candidate, Found
    from mapping.scoring.held_out import Gain

Settings = Mapping[str, Any]  # as a configuration nests them


@dataclass(frozen=True, slots=True)
class Plot:
    """A picture of the evidence: points (N, 2) and lines (M, 2), with what the axes are.

    ``is_map``: a metre is as long on both axes.
    """

    title: str
    x: str
    y: str
    points: Floats | None = None
    line: Floats | None = None
    mark: float | None = None  # where on the x axis the finding lies
    is_map: bool = False


@dataclass(frozen=True, slots=True)
class Suspect:
    """What a map is probably bad for.

    ``cost`` puts suspects in order: what they cost in log-likelihood a reading, about. ``value``
    and ``unit`` are the amount, where there is one, ``error`` its standard error.
    ``settings`` mend it; None: no setting does, and ``advice`` tells what does. ``seconds`` are
    stretches of the session that show it.
    """

    cause: str
    subject: str
    text: str
    evidence: tuple[str, ...]
    cost: float
    sure: str
    settings: Settings | None = None
    advice: str = ""
    value: float | None = None
    unit: str = ""
    error: float | None = None
    gain: Gain | None = None
    seconds: tuple[tuple[float, float], ...] = ()
    plots: tuple[Plot, ...] = ()


@dataclass(frozen=True, slots=True)
class Evidence:
    """What can be looked at without a search: the session as placed, and its readings as they
    came, before any was dropped.

    ``stuck`` remembers by sensor where it was found stuck. ``mended`` are the placed readings as
    what was found has them, once something was.
    """

    placed: PlacedSession
    config: MappingConfig
    columns: Sequence[Block] = field(repr=False, default=())
    stuck: dict[str, list[tuple[int, int]]] = field(repr=False, default_factory=dict)
    mended: Readings | None = field(repr=False, default=None)

    def readings(self) -> Readings:
        """All that are placed."""
        return Readings.joined(list(self.placed)) if self.mended is None else self.mended

    @classmethod
    def of(cls, placed: PlacedSession, config: MappingConfig) -> Evidence:
        """That of a session."""
        return cls(placed, config, list(placed.columns()))


class Cause:
    """Base of all causes: what is not overridden finds nothing."""

    name: ClassVar[str]
    title: ClassVar[str]
    needs_walls: ClassVar[bool] = True  # to examine: walls that thin beams can draw

    def candidates(self, case: Case) -> Iterator[Candidate]:
        """The numbers that the search may free."""
        yield from ()

    def suspects(self, evidence: Evidence) -> Iterator[Suspect]:
        """What can be seen without a search."""
        yield from ()

    def examine(self, case: Case, hypothesis: Hypothesis) -> Iterator[Suspect]:
        """What can be seen once the search is done, with all that it found mended."""
        yield from ()

    def explained(
        self, case: Case, number: Number, found: Found, hypothesis: Hypothesis
    ) -> Suspect | None:
        """The suspect that a number comes to, which the search has found; None: not this cause."""
        return None


def how_sure(gain: Gain | None, errors: float) -> str:
    """In a word, by how many of its stated errors a number stands out, and by the interval of the
    gain.

    NaN errors: only the score speaks.
    """
    scored = gain is not None and gain.low > 0.0
    if errors >= 5.3 and scored:
        return "almost certain"
    if errors >= 3.3 or (scored and gain is not None and gain.low > 0.3 * gain.mean):
        return "likely"
    return "possible"


def walls_text(found: Found) -> Iterator[str]:
    """How well echoes fit walls with it mended, where that is better."""
    before, after = found.on_walls or (0.0, 0.0)
    if after - before >= 0.01:
        yield (
            f"the thin beams' echoes fit straight pieces of wall to {after:.0%} with it mended, to "
            f"{before:.0%} without (noise alone leaves 84%)"
        )


def profile(case: Case, number: Number, hypothesis: Hypothesis, values: Sequence[float]) -> Plot:
    """The score over a number, all else as the hypothesis has it."""
    rows = [
        (value, case.score(hypothesis.with_number(number, value)).scores.mean) for value in values
    ]
    import numpy as np

    shown, unit = np.array(rows), _UNITS[number.key]
    shown[:, 0] *= unit[1]
    return Plot(
        f"score without truth over {unit[2]}", f"{unit[2]} ({unit[0]})", "log-likelihood a reading",
        line=shown, mark=hypothesis.number(number) * unit[1],
    )  # fmt: skip


_UNITS = {
    "offset_s": ("ms", 1e3, "time added to the poses"), "yaw_rad": ("degrees", 57.29577951, "yaw"),
    "x_m": ("cm", 100.0, "shift forward"), "y_m": ("cm", 100.0, "shift to the left"),
    "bias_m": ("cm", 100.0, "bias"), "scale": ("times", 1.0, "scale"),
    "heading_rad": ("degrees", 57.29577951, "angle added to the headings"),
    "heading_radps": ("degrees a minute", 60.0 * 57.29577951, "turn added to the headings"),
    "x_mps": ("cm a minute", 6000.0, "way added to the poses along x"),
    "y_mps": ("cm a minute", 6000.0, "way added to the poses along y"),
    "widened": ("times", 1.0, "beam width"),
}  # fmt: skip
