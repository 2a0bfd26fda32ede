"""The table of the methods that turn points into lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mapping.config import SegmentsSection
from mapping.segments.chains import Chains
from mapping.segments.least_squares import FittedLine
from mapping.segments.ordered import incremental, line_regression, split_and_merge
from mapping.segments.stages import Observer
from mapping.segments.unordered import expectation_maximisation, hough, ransac
from recorder.errors import BadInput
from recorder.names import nearest, printable


@dataclass(frozen=True, slots=True)
class LineMethod:
    """One way from points to lines: ``lines(chains, config, observe)``.

    ``ordered`` methods need the points in order along the walls; the others take them in any.
    """

    name: str
    ordered: bool
    summary: str
    lines: Callable[[Chains, SegmentsSection, Observer | None], list[FittedLine]]


_METHODS = (
    LineMethod("split-and-merge", True, "cut where a point is far from the chord", split_and_merge),
    LineMethod("incremental", True, "add points while the fit stays good", incremental),
    LineMethod("line-regression", True, "cut where a sliding window's line turns", line_regression),
    LineMethod("ransac", False, "of lines through two points, the best supported", ransac),
    LineMethod("hough", False, "every point votes for the lines through it", hough),
    LineMethod(
        "em", False, "many lines at once, points shared by weight", expectation_maximisation
    ),
)
LINE_METHODS: Mapping[str, LineMethod] = MappingProxyType({m.name: m for m in _METHODS})


def line_method(name: str) -> LineMethod:
    """The method of that name; BadInput names the nearest known one."""
    if name in LINE_METHODS:
        return LINE_METHODS[name]
    near = nearest(name, LINE_METHODS, least_likeness=0.0)
    raise BadInput(
        f"unknown segments.method {printable(repr(name), most=80)}; the nearest known one is {near}"
    )
