"""What a figure is: one entry of the table, and what it comes to for a session."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from replay.pictures.parts import Chart, Panel, Words

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

    def drawn(self, bench: Bench) -> Drawing:
        """The figure of a session. Raises LeftOut also where nothing would be seen in it."""
        drawing = self.draw(bench)
        if all(_is_blank(panel) for panel in drawing.panels):
            raise LeftOut("nothing would be seen in it")
        return drawing

    def title_for(self, *, laser: bool) -> str:
        """The title for a session whose narrow sensor is a ``laser``, no infrared."""
        if not laser:
            return self.title
        return self.title.replace("infrared", "laser").replace("Infrared", "Laser")


def _is_blank(panel: Panel | Chart) -> bool:
    """Whether its cells are of one colour and nothing that the legend names lies over them.

    The true walls alone are no figure: they are no result of the session.
    """
    if isinstance(panel, Chart):
        return not panel.parts
    if any(not isinstance(m, Words) and m.label not in ("", "true walls") for m in panel.marks):
        return False
    if panel.cells is None:
        return True
    shown = panel.cells.within(panel.frame).pixels
    return bool((shown == shown[0, 0]).all(axis=(0, 1)).all()) if np.size(shown) else True
