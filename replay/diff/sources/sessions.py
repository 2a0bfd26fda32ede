"""Sessions (.mcap): mapped first, with one configuration; two of them on one grid and in step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from mapping.artifacts import Artifact, Snapshot, Started
from mapping.config import MappingConfig
from mapping.config_text import commented_toml
from mapping.grid import GridGeometry
from mapping.pipeline import build_maps
from mapping.placed_session import place_session
from recorder.session import Session, read_session
from recorder.session.columns import open_session
from replay.collector import Collector
from replay.diff.alignment import common_grid
from replay.diff.divergence import Divergence, Readings, readings_of, walk_in_step
from replay.diff.layers import MapLayer, Source, line_of, outline_of, value_layer

Progress = Callable[[int, int], None]


def map_one(path: Path, config: MappingConfig, progress: Progress | None = None) -> Source:
    """One session as a map on its own grid. Raises an EchogridError in one line."""
    session = open_session(path)
    placed = place_session(session, config)
    total, results = placed.counts.readings, Collector()

    def merged(count: int) -> None:
        if progress is not None:
            progress(count, total)

    for artifact in build_maps(placed, config, watched=False, merged=merged):
        results(artifact)
    return _source(session.damage, path, results, config)


def map_two(
    a: Path,
    b: Path,
    config: MappingConfig,
    *,
    tolerance: float,
    progress: Progress | None = None,
) -> tuple[Source, Source, Divergence | None]:
    """Two sessions on one grid, and the first reading after which their maps part.

    The grid is the one that holds both, unless the configuration sets it. Raises an EchogridError
    in one line.
    """
    sessions = [read_session(path) for path in (a, b)]
    config = _on_one_grid(sessions, config)
    collected = [Collector(), Collector()]
    streams = [
        _watched(build_maps(session.records, config), results)
        for session, results in zip(sessions, collected, strict=True)
    ]
    sides: tuple[Iterator[Readings], Iterator[Readings]] = (
        readings_of(streams[0]),
        readings_of(streams[1]),
    )
    total = max(len(session.records) for session in sessions)
    divergence = walk_in_step(*sides, tolerance, progress=progress, total=total)
    left, right = (
        _source(session.damage, path, results, config)
        for session, path, results in zip(sessions, (a, b), collected, strict=True)
    )
    return left, right, divergence


def _watched(artifacts: Iterable[Artifact], results: Collector) -> Iterator[Artifact]:
    for artifact in artifacts:
        results(artifact)
        yield artifact


def _source(damage: Sequence[str], path: Path, results: Collector, config: MappingConfig) -> Source:
    notes = tuple(f"{path.name}: {reason}" for reason in damage)
    layers = {name: _layer(each, results) for name, each in results.snapshots.items()}
    return Source(
        path, "session", layers, config_toml=commented_toml(config), notes=notes,
        damaged=bool(damage),
    )  # fmt: skip


def _layer(snapshot: Snapshot, results: Collector) -> MapLayer:
    layer = snapshot.layer
    return value_layer(
        layer.name, layer.kind, layer.geometry, layer.values, rule=snapshot.rule, extra=layer.extra,
        lines=tuple(line_of(s) for s in results.segments if s.layer == layer.name),
        borders=tuple(outline_of(b) for b in results.borders if b.layer == layer.name),
        beam_width_rad=results.beam_widths_rad.get(layer.name),
    )  # fmt: skip


def _on_one_grid(sessions: list[Session], config: MappingConfig) -> MappingConfig:
    """The configuration with the grid that holds both sessions' beams.

    Cells then have the same centres to the last bit, so that the same readings give the same map.
    """
    if config.grid.origin_m is not None and config.grid.size_m is not None:
        return config
    grids = [_grid_of(session, config) for session in sessions]
    union, _, _ = common_grid(grids[0], grids[1], "the two sessions")
    if grids[0] == grids[1]:
        return config
    # A size of a hair less than whole cells: rounding must not add a cell.
    size = tuple(v - 0.25 * union.resolution_m for v in union.size_m)
    grid = config.grid.model_copy(update={"origin_m": _inside(union), "size_m": size})
    return config.model_copy(update={"grid": grid})


def _inside(grid: GridGeometry) -> tuple[float, float]:
    """The origin as the nearest multiple of the resolution, which is what it is rounded to."""
    x, y = (round(v / grid.resolution_m) * grid.resolution_m for v in grid.origin_m)
    return x, y


def _grid_of(session: Session, config: MappingConfig) -> GridGeometry:
    first = next(iter(build_maps(session.records, config)))
    assert isinstance(first, Started)
    return first.geometry
