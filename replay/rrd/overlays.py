"""What may be drawn beside the artifacts themselves: a watched cell, a predicted range, a picture.

The writer offers each artifact to every overlay before it draws the artifact itself, so a
overlay sees the map as it was before. What a overlay returns is said below the words of the
step.
"""

from __future__ import annotations

from typing import Protocol

from mapping.artifacts import Artifact, Started
from replay.rrd.canvas import Canvas


class Overlay(Protocol):
    """Something that follows a run and draws on its canvas."""

    def start(self, canvas: Canvas, started: Started) -> None:
        """Draw what never changes; called once, when the empty map is laid out."""

    def draw(self, canvas: Canvas, artifact: Artifact, *, shown: bool) -> str:
        """Follow one artifact, and draw if the step is ``shown``; markdown to say, or nothing."""
