"""The writer of a mapping run with all that its configuration asks to be shown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun.blueprint as rrb

from mapping.artifacts import Started
from mapping.config import MappingConfig
from mapping.probing import CellProbe
from replay.probe_text import name_of
from replay.rrd.blueprints import default_blueprint
from replay.rrd.display_layers import DisplayOverlay
from replay.rrd.overlays import Overlay
from replay.rrd.prediction import PredictionOverlay
from replay.rrd.probe import ProbeOverlay
from replay.rrd.thresholds import ThresholdsOverlay
from replay.rrd.writer import RrdWriter


class RunWriter(RrdWriter):
    """A writer with the predicted ranges, the other ways to draw the maps, and the watched cells.

    Each probe must take an artifact before the writer does.
    """

    def __init__(
        self,
        path: Path,
        config: MappingConfig,
        *,
        config_text: str,
        name: str,
        probes: Sequence[CellProbe] = (),
    ) -> None:
        section = config.rerun
        super().__init__(
            path, config_text=config_text, name=name, every=section.every,
            budget_mb=section.budget_mb, overlays=_overlays(config, probes),
        )  # fmt: skip
        self._watched = tuple(name_of(probe) for probe in probes)
        self._displays = section.display
        self._thresholds = config.borders.compare

    def _blueprint(self, started: Started) -> rrb.Blueprint:
        return default_blueprint(
            started, probes=self._watched, displays=self._displays, thresholds=self._thresholds
        )


def _overlays(config: MappingConfig, probes: Sequence[CellProbe]) -> list[Overlay]:
    """What this run draws beside its artifacts."""
    section = config.rerun
    overlays: list[Overlay] = [PredictionOverlay(config.borders.threshold)]
    if section.display:
        overlays.append(
            DisplayOverlay(
                section.display, levels=section.display_levels, budget_mb=section.budget_mb
            )
        )
    if config.borders.compare:
        overlays.append(ThresholdsOverlay(config.borders))
    if probes:
        overlays.append(ProbeOverlay(probes))
    return overlays
