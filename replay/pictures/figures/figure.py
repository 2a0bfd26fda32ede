"""What a figure is: one entry of the table, and what it comes to for a session."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from replay.pictures.parts import Chart, Panel

if TYPE_CHECKING:
    from replay.pictures.figures.bench import Bench

SONAR, NARROW, BOTH = "a sonar", "an infrared or laser sensor", "two kinds of sensors"


class LeftOut(Exception):
    """A figure that this session cannot have; the text is why."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """What is drawn, and in words what is to be seen."""

    panels: tuple[Panel | Chart, ...]
    caption: str
    columns: int = 3


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of the chapter.

    ``slug`` is its part of the file's name, ``passage`` the chapter's heading that it stands under,
    ``draw`` makes it from a session, and raises LeftOut where it cannot. Where one map is shown,
    ``settings`` are the keys of ``[sensors.*]`` with which ``echogrid map`` makes it, and ``role``
    is whose it is: ``any`` or ``narrow``.
    """

    slug: str
    passage: str
    title: str
    draw: Callable[[Bench], Drawing]
    settings: Mapping[str, Any] = field(default_factory=dict)
    role: str = ""
