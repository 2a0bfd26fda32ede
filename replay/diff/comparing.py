"""Two sources → everything about how they differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mapping.config import MappingConfig
from recorder.errors import BadInput
from replay.diff.alignment import Aligned, align
from replay.diff.cells import CellFigures, ExtraFigures, cell_figures, extra_figures
from replay.diff.divergence import Divergence, StepDivergence, part_at_step
from replay.diff.layers import MapLayer, Moment, Source
from replay.diff.lines import BorderFigures, LineFigures, border_figures, line_figures
from replay.diff.sources.opening import is_session, open_map
from replay.diff.verdict import LayerVerdict, Verdict, layer_verdict, overall

LINE_TOLERANCE_M = 1e-6
Progress = Callable[[int, int], None]
Pairs = dict[str, tuple[MapLayer, MapLayer]]


@dataclass(frozen=True, slots=True)
class LayerReport:
    """One layer of both sides. ``lines`` and ``borders`` are None where a side does not hold them.

    ``written_a`` and ``written_b``: the step at which the worst cell was last written, of sides
    that are recordings.
    """

    name: str
    kind: str
    pair: Aligned
    by_class: bool
    cells: CellFigures
    extras: tuple[ExtraFigures, ...]
    lines: LineFigures | None
    borders: BorderFigures | None
    verdict: LayerVerdict
    written_a: Moment | None
    written_b: Moment | None

    @property
    def differs(self) -> bool:
        """Whether a cell, a line or a border of the layer differs."""
        lines = self.lines is not None and self.lines.differ
        borders = self.borders is not None and self.borders.differ
        extras = any(extra.differ for extra in self.extras)
        return bool(self.cells.differ) or extras or lines or borders


@dataclass(frozen=True, slots=True)
class Report:
    """A comparison of two sources; ``only_a`` and ``only_b`` are layers that the other lacks."""

    a: Source
    b: Source
    layers: tuple[LayerReport, ...]
    only_a: tuple[str, ...]
    only_b: tuple[str, ...]
    divergence: Divergence | None
    step_divergence: StepDivergence | None
    verdict: Verdict
    notes: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Whether anything at all differs."""
        return bool(self.only_a or self.only_b) or any(layer.differs for layer in self.layers)


def compare(
    a: Path,
    b: Path,
    config: MappingConfig | None = None,
    *,
    tolerance: float = 0.0,
    line_tolerance_m: float = LINE_TOLERANCE_M,
    only: Sequence[str] = (),
    progress: Progress | None = None,
) -> Report:
    """Compare two paths of any kind; sessions are mapped with ``config`` first.

    Without ``config``, a session beside a source that holds its configuration is mapped with that.
    Cells differ beyond ``tolerance``, lines when an end moved further than ``line_tolerance_m``.
    Raises an EchogridError, in one line, for what cannot be read or compared.
    """
    if tolerance < 0.0 or line_tolerance_m < 0.0:
        raise BadInput("a tolerance is not negative")
    left, right, divergence = _opened(a, b, config, tolerance, progress)
    return report(
        left, right, divergence, tolerance=tolerance, line_tolerance_m=line_tolerance_m, only=only
    )


def report(
    a: Source,
    b: Source,
    divergence: Divergence | None = None,
    *,
    tolerance: float = 0.0,
    line_tolerance_m: float = LINE_TOLERANCE_M,
    only: Sequence[str] = (),
) -> Report:
    """The same for two sources that are open already."""
    pairs, only_a, only_b, notes = paired(a, b, only)
    layers = tuple(
        _layer_report(name, a, b, *pair, tolerance, line_tolerance_m)
        for name, pair in pairs.items()
    )
    step_divergence = None
    if a.history is not None and b.history is not None and any(x.cells.differ for x in layers):
        step_divergence = part_at_step(a.history, b.history, pairs, tolerance)
    any_differs = bool(only_a or only_b) or any(layer.differs for layer in layers)
    verdict = overall(
        {layer.name: layer.verdict for layer in layers},
        any_differs=any_differs,
        pairs={layer.name: layer.pair for layer in layers},
    )
    notes = (*a.notes, *b.notes, *notes, *_class_notes(pairs))
    return Report(a, b, layers, only_a, only_b, divergence, step_divergence, verdict, notes)


def _opened(
    a: Path, b: Path, config: MappingConfig | None, tolerance: float, progress: Progress | None
) -> tuple[Source, Source, Divergence | None]:
    if is_session(a) and is_session(b):
        from replay.diff.sources.sessions import map_two

        return map_two(a, b, config or MappingConfig(), tolerance=tolerance, progress=progress)
    if not is_session(a) and not is_session(b):
        return open_map(a), open_map(b), None
    if is_session(a):
        other = open_map(b)
        return _mapped(a, config, other, progress), other, None
    other = open_map(a)
    return other, _mapped(b, config, other, progress), None


def _mapped(
    path: Path, config: MappingConfig | None, other: Source, progress: Progress | None
) -> Source:
    """A session, mapped as asked for, or as the other side was when nothing is asked for."""
    from replay.diff.sources.sessions import map_one

    return map_one(path, config or config_of(other), progress)


def config_of(source: Source) -> MappingConfig:
    """The configuration that made a source; the default one where it does not hold it."""
    import tomllib

    from mapping.config import validate

    if not source.config_toml:
        return MappingConfig()
    try:
        return validate(tomllib.loads(source.config_toml))
    except (tomllib.TOMLDecodeError, BadInput) as error:
        raise BadInput(
            f"{source.path}: its configuration cannot be used (give one with --config): {error}"
        ) from None


def paired(
    a: Source, b: Source, only: Sequence[str] = ()
) -> tuple[Pairs, tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Layers of one name; those that one side alone has; and notes.

    A file of a single layer is compared with the layer of its name alone, or with the other side's
    only one. Raises BadInput where there is nothing to compare.
    """
    notes: tuple[str, ...] = ()
    names = [name for name in a.layers if name in b.layers]
    only_a = tuple(name for name in a.layers if name not in b.layers)
    only_b = tuple(name for name in b.layers if name not in a.layers)
    pairs = {name: (a.layers[name], b.layers[name]) for name in names}
    if a.single or b.single:
        if not names and len(a.layers) == len(b.layers) == 1:
            (left,), (right,) = a.layers.values(), b.layers.values()
            pairs = {left.name: (left, right)}
            notes = (f"layer {left.name} of A is compared with layer {right.name} of B",)
            names = [left.name]
        only_a = only_b = ()
    for name in only:
        if name not in pairs:
            raise BadInput(f"no layer {name!r} in both: A has {_names(a)}, B has {_names(b)}")
    if only:
        pairs = {name: pairs[name] for name in only}
        only_a = only_b = ()
    if not pairs:
        raise BadInput(f"no layer in common: A has {_names(a)}, B has {_names(b)}")
    return pairs, only_a, only_b, notes


def _names(source: Source) -> str:
    return ", ".join(source.layers)


def _layer_report(
    name: str, a: Source, b: Source, left: MapLayer, right: MapLayer, tolerance: float,
    line_tolerance_m: float,
) -> LayerReport:  # fmt: skip
    pair = align(left, right)
    cells = cell_figures(pair, tolerance)
    lines = borders = None
    if left.lines is not None and right.lines is not None:
        lines = line_figures(left.lines, right.lines, line_tolerance_m)
    if left.borders is not None and right.borders is not None:
        borders = border_figures(left.borders, right.borders, left.geometry.resolution_m)
    on_one_grid = pair.a_offset == pair.b_offset
    extras = extra_figures(left.extra, right.extra, tolerance) if on_one_grid else ()
    written_a = _written(a, left, cells, (0, 0))
    shift = (pair.a_offset[0] - pair.b_offset[0], pair.a_offset[1] - pair.b_offset[1])
    written_b = _written(b, right, cells, shift)
    return LayerReport(
        name, left.kind, pair, pair.by_class, cells, extras, lines, borders,
        layer_verdict(name, pair, left.beam_width_rad or right.beam_width_rad), written_a,
        written_b,
    )  # fmt: skip


def _written(
    source: Source, layer: MapLayer, cells: CellFigures, shift: tuple[int, int]
) -> Moment | None:
    """When the worst cell was last written, where the source is a recording that holds it."""
    if source.history is None or not cells.worst:
        return None
    row, col = cells.worst[0].row + shift[0], cells.worst[0].col + shift[1]
    if not (0 <= row < layer.geometry.rows and 0 <= col < layer.geometry.cols):
        return None
    return source.history.last_written(layer.name, row, col)


def _class_notes(pairs: Mapping[str, tuple[MapLayer, MapLayer]]) -> tuple[str, ...]:
    """A note where classes are compared for want of a common unit."""
    return tuple(
        f"layer {name}: A holds {a.kind}, B {b.kind}, so classes are compared"
        for name, (a, b) in pairs.items()
        if a.values is not None and b.values is not None and a.kind != b.kind
    )
