"""The writer of a mapping run with all that its configuration asks to be shown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rerun.blueprint as rrb

from mapping.artifacts import Started
from mapping.config import MappingConfig
from mapping.probing import CellProbe
from replay.probe_words import name_of
from replay.rrd.blueprints import default_blueprint
from replay.rrd.companions import Companion
from replay.rrd.display_layers import DisplayCompanion
from replay.rrd.prediction import PredictionCompanion
from replay.rrd.probe import ProbeCompanion
from replay.rrd.thresholds import ThresholdsCompanion
from replay.rrd.writer import RrdWriter


class RunWriter(RrdWriter):
    """A writer with the foretold ranges, the other ways to draw the maps, and the watched cells.

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
            budget_mb=section.budget_mb, companions=_companions(config, probes),
        )  # fmt: skip
        self._watched = tuple(name_of(probe) for probe in probes)
        self._displays = section.display
        self._thresholds = config.borders.compare

    def _blueprint(self, started: Started) -> rrb.Blueprint:
        return default_blueprint(
            started, probes=self._watched, displays=self._displays, thresholds=self._thresholds
        )


def _companions(config: MappingConfig, probes: Sequence[CellProbe]) -> list[Companion]:
    """What this run draws beside its artifacts."""
    section = config.rerun
    companions: list[Companion] = [PredictionCompanion(config.borders.threshold)]
    if section.display:
        companions.append(
            DisplayCompanion(
                section.display, levels=section.display_levels, budget_mb=section.budget_mb
            )
        )
    if config.borders.compare:
        companions.append(ThresholdsCompanion(config.borders))
    if probes:
        companions.append(ProbeCompanion(probes))
    return companions
