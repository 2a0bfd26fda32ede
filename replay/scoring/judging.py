"""What is judged, and against what: a session or a map, true walls or none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.config import MappingConfig
from mapping.grid import GridGeometry
from mapping.pipeline import geometry_of
from mapping.placed_session import PlacedSession, place_session
from mapping.scoring.held_out import Judged, held_out
from mapping.scoring.layers import LayerScore, score_layer
from mapping.scoring.observable import observable_cells, with_silent_readings
from mapping.scoring.truth import TrueMap, TrueWalls, Truth
from recorder.errors import BadInput
from recorder.session.columns import open_session
from recorder.truth import true_surfaces, true_walls
from replay.diff.comparing import config_of
from replay.diff.layers import FREE, OCCUPIED, MapLayer, Source
from replay.diff.sources.opening import open_map

Progress = Callable[[int, int], None]
Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]

_MAPS = (".yaml", ".yml", ".pgm")
_CLASS_PROBABILITY = {FREE: 0.0, OCCUPIED: 1.0}


@dataclass(frozen=True, slots=True)
class HeldOut:
    """The score without truth of some readings: log-likelihood a reading, and its 95 % interval."""

    of: str
    readings: int
    log_likelihood: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class JudgedLayer:
    """A layer with its score, and what a picture of it needs; arrays are (rows, cols)."""

    score: LayerScore
    geometry: GridGeometry
    probability: Floats
    seen: Flags
    lines_m: Mapping[str, Floats]


@dataclass(frozen=True, slots=True)
class ScoreReport:
    """Everything that judging one map came to. ``layers`` is empty without known walls."""

    path: Path
    truth: Truth | None
    truth_name: str
    basis: str
    layers: tuple[JudgedLayer, ...]
    held_out: tuple[HeldOut, ...]
    notes: tuple[str, ...]
    damaged: bool

    @property
    def scores(self) -> dict[str, LayerScore]:
        """The scores by layer."""
        return {each.score.layer: each.score for each in self.layers}


def open_truth(given: str) -> Truth:
    """A room by its name, a GeoJSON file of walls, or a map_server map that is taken for true.

    Raises BadInput, in one line, for all else.
    """
    from recorder.simulator.rooms import named_walls

    file = Path(given)
    if file.suffix.lower() in _MAPS:
        (layer,) = open_map(file).layers.values()
        return TrueMap(layer.geometry, layer.classes == OCCUPIED, layer.classes == FREE)
    return _surfaced(file, *named_walls(given))


def _surfaced(file: Path, walls_m: Floats, surfaces: Sequence[str]) -> TrueWalls:
    try:
        return TrueWalls.of(walls_m, surfaces)
    except BadInput as error:
        raise BadInput(f"{file}: {error}") from None


def judge_map(
    path: Path,
    *,
    walls: str | None = None,
    session: Path | None = None,
    config: MappingConfig | None = None,
    only: Sequence[str] = (),
    progress: Progress | None = None,
) -> ScoreReport:
    """Judge a session (which is mapped first) or a map.

    ``walls`` is what :func:`open_truth` takes; without it the session's own attachment counts.
    ``session`` gives the poses from which an exported map was observed, and its true walls.
    ``only`` are names of layers. Raises BadInput, in one line, where nothing can be judged.
    """
    if not holds_session(path):
        source = open_map(path)
        config = config or config_of(source)
    elif session is not None:
        raise BadInput(f"{path} is a session itself: --session is for maps")
    else:
        config, session = config or MappingConfig(), path
        source = _mapped(path, config, progress)
    return score_source(source, walls=walls, session=session, config=config, only=only)


def score_source(
    source: Source,
    *,
    walls: str | None,
    session: Path | None,
    config: MappingConfig,
    only: Sequence[str] = (),
) -> ScoreReport:
    """Judge a map that is there, as :func:`judge_map` does; ``config`` made it."""
    truth, truth_name = None, walls or ""
    if walls is not None:
        truth = open_truth(walls)
    opened = None if session is None else open_session(session)
    placed = None if opened is None else place_session(opened, config)  # which reads attachments
    if opened is not None and truth is None:
        own_m = true_walls(opened.attachments)
        if own_m is not None:
            truth = _surfaced(opened.path, own_m, true_surfaces(opened.attachments))
            truth_name = f"the walls that {opened.path.name} carries"
    made_here = source.path == session
    if truth is None and not made_here:
        raise BadInput(f"{source.path}: what is true? --walls ROOM, GEOJSON or MAP.yaml")
    judged: tuple[JudgedLayer, ...] = ()
    layers, basis = _chosen(source, only), ""
    if truth is not None:
        looking = None
        if opened is not None:
            looking = place_session(opened, with_silent_readings(config))
        basis = _basis(truth, session)
        judged = tuple(_judged(each, truth, looking) for each in layers.values())
    kept_out = _held_out(placed, config) if placed is not None and made_here else ()
    return ScoreReport(
        source.path, truth, truth_name, basis, judged, kept_out, source.notes, source.damaged
    )


def holds_session(path: Path) -> bool:
    """Whether a path is a session, or a folder of one, and no map."""
    if path.is_dir():
        return any(path.glob("*.mcap*")) and not any(path.glob("*.npz"))
    return path.suffix.lower() in (".mcap", ".zstd", ".db3", ".bag")


def _mapped(path: Path, config: MappingConfig, progress: Progress | None) -> Source:
    from replay.diff.sources.sessions import map_one

    return map_one(path, config, progress)


def _chosen(source: Source, only: Sequence[str]) -> dict[str, MapLayer]:
    for name in only:
        if name not in source.layers:
            known = ", ".join(source.layers)
            raise BadInput(f"{source.path}: no layer {name!r}, only {known}")
    return {name: source.layers[name] for name in only or source.layers}


def _judged(layer: MapLayer, truth: Truth, looking: PlacedSession | None) -> JudgedLayer:
    geometry = layer.geometry
    if looking is None:
        seen = truth.open_cells(geometry) | truth.wall_cells(geometry)
    else:
        cells = observable_cells(looking, truth, geometry)
        every: Flags = np.logical_or.reduce(list(cells.values()))
        seen = cells.get(layer.name, every)
    if layer.values is not None:
        probability = layer.probability
    else:
        probability = np.full(geometry.shape, 0.5)
        for code, value in _CLASS_PROBABILITY.items():
            probability[layer.classes == code] = value
    lines_m = _ends_by_source(layer)
    score = score_layer(layer.name, probability, geometry, lines_m, truth, seen)
    return JudgedLayer(score, geometry, probability, seen, lines_m)


def _ends_by_source(layer: MapLayer) -> dict[str, Floats]:
    """The lines of a layer, (L, 2, 2) by source; those of the grid even where there are none."""
    if layer.lines is None:
        return {}
    ends = {"grid": np.zeros((0, 2, 2))}
    for source in dict.fromkeys(line.source for line in layer.lines):
        mine = [(line.start_m, line.end_m) for line in layer.lines if line.source == source]
        ends[source] = np.array(mine, np.float64)
    return ends


def _basis(truth: Truth, session: Path | None) -> str:
    if session is not None:
        return f"the cells that the sensors could see from the poses of {session.name}"
    if truth.directed:
        return "all cells within the walls: --session would give what could be seen"
    return "all cells that the true map knows: --session would give what could be seen"


def _held_out(placed: PlacedSession, config: MappingConfig) -> tuple[HeldOut, ...]:
    """The score without truth, of all sensors and of each; none of too few readings."""
    try:
        judged = held_out(placed, config, geometry_of(placed, config))
    except BadInput:
        return ()
    names = [sensor.name for sensor in judged.readings.sensors]
    several = [("all sensors", names)] if len(names) > 1 else []
    return tuple(
        _scored(of, judged, chosen)
        for of, chosen in [*several, *((name, [name]) for name in names)]
        if judged.of_sensors(chosen).count.sum()
    )


def _scored(of: str, judged: Judged, names: Sequence[str]) -> HeldOut:
    scores = judged.of_sensors(names)
    low, high = scores.interval()
    return HeldOut(of, int(scores.count.sum()), scores.mean, low, high)
