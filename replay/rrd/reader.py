"""A recording → its values again, exactly as they were: grids, beams, borders, segments.

Pictures in a recording are rounded; everything read here comes from the exact values beside them.
Grids are put together from their tiles, each in its newest version at the step asked for. A
recording that was cut off while it was written is read as far as it goes.
"""

from __future__ import annotations

import subprocess
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from mapping.artifacts import Border, Segment
from mapping.beams import Beam
from mapping.grid import GridGeometry
from recorder.errors import BadInput
from recorder.geometry import SE2
from replay.rrd import layout
from replay.rrd.layout import Tiling
from replay.rrd.program import viewer_environment, viewer_program

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """One step: when, which artifact, of which layer, and the layers that are exact at it."""

    step: int
    reading: int
    t_ns: int
    artifact: str
    layer: str
    exact: frozenset[str]


@dataclass(frozen=True, slots=True)
class _Row:
    """One row of one entity: when, and its component's numbers."""

    step: int
    numbers: NDArray[Any]


class RrdRecording:
    """What one recording holds. Made by :func:`read_rrd`."""

    def __init__(self, path: Path, file: Path, *, damaged: bool) -> None:
        self.path = path
        self.damaged = damaged
        self.folder: tempfile.TemporaryDirectory[str] | None = None
        self._file = file
        self._indexed = not damaged
        self.config_text = self._one_text(layout.CONFIG, "TextDocument:text")
        self.geometry, self.layers, self.walls_m = self._read_grid()
        self.steps = self._read_steps()
        self._by_number = {step.step: step for step in self.steps}

    def grid(self, layer: str, step: int | None = None) -> NDArray[np.float32]:
        """Values of a layer at a step (default: the last at which they are exact), (rows, cols).

        Raises BadInput for a layer or step that is not there, or not with exact values.
        """
        step = self._checked(layer, step)
        grid = np.zeros(self.geometry.shape, np.float32)
        for window, row in self._newest_tiles(layout.merged(layer), "values", step):
            grid[window] = row.numbers.reshape(grid[window].shape)
        return grid

    def grids(self, layer: str) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """The layer at each of its steps with exact values: step and a grid of its own, in order.

        Only as much of the file as was written together is in memory at a time.
        """
        grid = np.zeros(self.geometry.shape, np.float32)
        for step, tiles in self._tiles_by_step(layout.merged(layer), "values"):
            for window, numbers in tiles:
                grid[window] = numbers.reshape(grid[window].shape)
            if step in self._by_number and layer in self._by_number[step].exact:
                yield step, grid.copy()

    def kind_and_rule(self, layer: str) -> tuple[str, str]:
        """The unit of a layer's values and its update rule."""
        root = layout.layer_root(layer)
        return self._one_text(root, "kind"), self._one_text(root, "rule")

    def extra(self, layer: str) -> dict[str, NDArray[np.float32]]:
        """Further arrays of a layer's rule, at its last snapshot, by name."""
        newest = dict(self._rows(f"{layout.extra(layer, '')}**", "values"))
        return {
            self._one_text(entity, "name"): row.numbers.reshape(self.geometry.shape)
            for entity, row in newest.items()
        }

    def beams(self) -> Iterator[tuple[int, Beam]]:
        """Every reading that is shown, with its step, in order."""
        for batch in self._batches(layout.ROBOT, "ranges_m", whole=True):
            for i in range(batch.num_rows):
                yield _step_of(batch, i), self._beam(batch, i)

    def segments(self) -> list[tuple[int, Segment]]:
        """Every straight line, with the step at which it came."""
        found = []
        for entity, row in self._rows(f"{layout.MAP}/layers/**", "numbers"):
            source = entity.split("/")[-2]
            if "/segments/" in entity:
                found.append((row.step, _segment(self._layer_at(row.step), source, row.numbers)))
        return sorted(found, key=lambda each: each[0])

    def borders(self) -> list[tuple[int, Border]]:
        """Every border, with the step at which it came."""
        found = []
        for entity, row in self._rows(f"{layout.MAP}/layers/**", "numbers"):
            if "/borders/" in entity:
                layer, table = self._layer_at(row.step), row.numbers.reshape(-1, 4)
                number, outer = (int(table[0, 0]), bool(table[0, 1])) if len(table) else (0, True)
                border = Border(layer, number, outer, self.geometry, table[:, 2:].copy())
                found.append((row.step, border))
        return sorted(found, key=lambda each: each[0])

    def raw_points_m(self, layer: str) -> Floats:
        """All obstacle points of a layer, (N, 2), metres; none when there was no such step."""
        rows = [row for _, row in self._rows(layout.raw_points(layer), "numbers")]
        return rows[-1].numbers.reshape(-1, 2) if rows else np.zeros((0, 2))

    def thresholded(self, layer: str) -> tuple[float, NDArray[np.bool_]] | None:
        """The last threshold of a layer and the cells above it, (rows, cols)."""
        root = layout.thresholded(layer)
        thresholds = [row for _, row in self._rows(root, "numbers")]
        picture = self._newest_picture(root)
        if not thresholds or picture is None:
            return None
        return float(thresholds[-1].numbers[0]), picture.astype(bool)

    def classes(self) -> tuple[tuple[str, ...], NDArray[np.uint8]] | None:
        """Names and codes, (rows, cols), of the last class map."""
        picture = self._newest_picture(layout.CLASSES)
        if picture is None:
            return None
        (batch,) = self._batches(layout.CLASSES, "names")
        return tuple(batch.column("names")[0].as_py()), picture

    def _layer_at(self, step: int) -> str:
        """The layer of a step; empty when the end of the file, with its record, was lost."""
        return self._by_number[step].layer if step in self._by_number else ""

    def _checked(self, layer: str, step: int | None) -> int:
        exact = [each.step for each in self.steps if layer in each.exact]
        if not exact:
            known = ", ".join(self.layers)
            raise BadInput(f"{self.path}: no values of a layer {layer!r}; there are {known}")
        if step is None:
            return exact[-1]
        if step not in self._by_number:
            raise BadInput(f"{self.path}: there is no step {step}")
        if layer not in self._by_number[step].exact:
            before = max((each for each in exact if each < step), default=None)
            hint = "" if before is None else f"; the nearest before it that does is {before}"
            raise BadInput(f"{self.path}: step {step} holds no exact values of {layer}{hint}")
        return step

    def _newest_picture(self, root: str) -> NDArray[np.uint8] | None:
        picture = np.zeros(self.geometry.shape, np.uint8)
        found = False
        for window, row in self._newest_tiles(root, "SegmentationImage:buffer", None):
            picture[window] = row.numbers.reshape(picture[window].shape)
            found = True
        return picture if found else None

    def _newest_tiles(
        self, root: str, component: str, step: int | None
    ) -> Iterator[tuple[tuple[slice, slice], _Row]]:
        """The newest version of each tile up to a step, with where it lies in the grid."""
        windows = self._windows(root)
        newest: dict[str, _Row] = {}
        for batch_entity, batch in self._batches_by_entity(f"{root}/**", component):
            if batch_entity not in windows:
                continue
            steps = batch.column(layout.STEP).to_numpy()
            upto = len(steps) if step is None else int(np.searchsorted(steps, step, side="right"))
            old = newest.get(batch_entity)
            if upto and (old is None or old.step <= steps[upto - 1]):
                numbers = _numbers(batch, component, upto - 1)
                newest[batch_entity] = _Row(int(steps[upto - 1]), numbers)
        for entity, row in newest.items():
            yield windows[entity], row

    def _tiles_by_step(
        self, root: str, component: str
    ) -> Iterator[tuple[int, list[tuple[tuple[slice, slice], NDArray[Any]]]]]:
        """The tiles that each step wrote, in the order of the steps."""
        windows = self._windows(root)
        firsts = [
            int(batch.column(layout.STEP)[0].as_py())
            for _, batch in self._batches_by_entity(f"{root}/**", component)
        ]
        # From which step on nothing more can come: the earliest of all chunks still to be read.
        earliest = np.minimum.accumulate([*firsts, np.iinfo(np.int64).max][::-1])[::-1]
        waiting: dict[int, list[tuple[tuple[slice, slice], NDArray[Any]]]] = {}
        batches = self._batches_by_entity(f"{root}/**", component)
        for (entity, batch), horizon in zip(batches, earliest[1:], strict=True):
            for i, step in enumerate(batch.column(layout.STEP).to_numpy()):
                tile = (windows[entity], _numbers(batch, component, i))
                waiting.setdefault(int(step), []).append(tile)
            for step in sorted(each for each in waiting if each < horizon):
                yield step, waiting.pop(step)

    def _windows(self, root: str) -> dict[str, tuple[slice, slice]]:
        tiling = self._tiling()
        return {layout.tile(root, *at): tiling.window(*at).slices for at in tiling}

    def _tiling(self) -> Tiling:
        return layout.tiling_for(self.geometry)

    def _beam(self, batch: pa.RecordBatch, i: int) -> Beam:
        base, sensor = (_numbers(batch, n, i) for n in ("world_from_base", "world_from_sensor"))
        width, reach = _numbers(batch, "width_rad_reach_m", i)
        return Beam(
            number=int(batch.column(layout.READING)[i].as_py()),
            t_ns=int(batch.column(layout.TIME)[i].value),
            sensor=batch.column("sensor")[i].as_py()[0],
            layer=batch.column("layer")[i].as_py()[0],
            world_from_base=SE2(*map(float, base)),
            world_from_sensor=SE2(*map(float, sensor)),
            bearings_rad=_numbers(batch, "bearings_rad", i),
            ranges_m=_numbers(batch, "ranges_m", i),
            beam_width_rad=float(width),
            reach_m=float(reach),
        )

    def _read_grid(self) -> tuple[GridGeometry, tuple[str, ...], Floats]:
        batches = self._batches(layout.GRID, "where_m", whole=True)
        if not batches:
            raise BadInput(f"{self.path}: not a recording of echogrid")
        x, y, cell = (float(v) for v in _numbers(batches[0], "where_m", 0))
        rows, cols = (int(v) for v in _numbers(batches[0], "shape", 0))
        layers = tuple(batches[0].column("layers")[0].as_py())
        walls = np.zeros((0, 2, 2))
        if "walls_m" in batches[0].schema.names:
            walls = _numbers(batches[0], "walls_m", 0).reshape(-1, 2, 2)
        return GridGeometry((x, y), cell, rows, cols), layers, walls

    def _read_steps(self) -> list[Step]:
        steps = []
        for batch in self._batches(layout.STEPS, "artifact", whole=True):
            columns = [batch.column(name).to_pylist() for name in ("artifact", "layer", "exact")]
            numbers = [batch.column(name).to_numpy() for name in (layout.STEP, layout.READING)]
            times = batch.column(layout.TIME).cast(pa.int64()).to_numpy()
            for (artifact,), (layer,), exact, step, reading, t_ns in zip(
                *columns, *numbers, times, strict=True
            ):
                names = frozenset(exact or ())
                steps.append(Step(int(step), int(reading), int(t_ns), artifact, layer, names))
        return sorted(steps, key=lambda each: each.step)

    def _one_text(self, entity: str, component: str) -> str:
        for batch in self._batches(entity, component):
            return str(batch.column(component)[0].as_py()[0])
        return ""

    def _rows(self, content: str, component: str) -> Iterator[tuple[str, _Row]]:
        """All rows of a component, in the order of the file: entity, and when and what."""
        for entity, batch in self._batches_by_entity(content, component):
            for i, step in enumerate(batch.column(layout.STEP).to_numpy()):
                yield entity, _Row(int(step), _numbers(batch, component, i))

    def _batches(self, entity: str, component: str, *, whole: bool = False) -> list[pa.RecordBatch]:
        """Chunks of one entity that hold a component, alone or with what stands beside it."""
        return [batch for _, batch in self._batches_by_entity(entity, component, whole=whole)]

    def _batches_by_entity(
        self, content: str, component: str, *, whole: bool = False
    ) -> Iterator[tuple[str, pa.RecordBatch]]:
        reader = _quiet_reader(self._file)
        stream = reader.store().stream() if self._indexed else reader.stream()
        stream = stream.filter(content=content)
        if not whole:
            stream = stream.filter(components=component)
        for chunk in stream:
            batch = chunk.to_record_batch()
            if batch.num_rows and component in batch.schema.names:
                yield chunk.entity_path, batch


def read_rrd(path: str | Path) -> RrdRecording:
    """Open a recording for reading.

    ``damaged`` tells that it was not ended properly and may lack its last part. Raises BadInput
    for a file that cannot be read, or that holds no recording of ours.
    """
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"{path}: no such file")
    damaged = not _has_footer(path)
    try:
        return RrdRecording(path, path, damaged=damaged)
    except (RuntimeError, ValueError, OSError) as error:
        if isinstance(error, BadInput) or not damaged:
            raise
    return _salvaged(path)


def _salvaged(path: Path) -> RrdRecording:
    """A recording cut off in the middle of a record: the whole records before the cut."""
    folder = tempfile.TemporaryDirectory(prefix="echogrid-")
    file = Path(folder.name) / "salvaged.rrd"
    command = [str(viewer_program()), "rrd", "merge", "--continue-on-error", str(path), "-o"]
    subprocess.run(
        [*command, str(file)], env=viewer_environment(), capture_output=True, check=False
    )
    try:
        recording = RrdRecording(path, file, damaged=True)
    except (RuntimeError, OSError, ValueError):
        raise BadInput(f"{path}: cannot be read as a Rerun recording") from None
    recording.folder = folder  # removed with the recording
    return recording


def _has_footer(path: Path) -> bool:
    try:
        _quiet_reader(path).store()
    except (RuntimeError, ValueError, OSError):
        return False
    return True


def _quiet_reader(path: Path) -> RrdReader:
    """Rerun warns of a file that was not ended; ``damaged`` says it instead."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)
        return RrdReader(path)


def _step_of(batch: pa.RecordBatch, i: int) -> int:
    return int(batch.column(layout.STEP)[i].as_py())


def _numbers(batch: pa.RecordBatch, component: str, i: int) -> NDArray[Any]:
    """The numbers of one row; of a picture, its bytes."""
    values = batch.column(component)[i].values
    if pa.types.is_list(values.type):
        values = values.flatten()
    array: NDArray[Any] = values.to_numpy(zero_copy_only=False).copy()
    return array


def _segment(layer: str, source: str, numbers: Floats) -> Segment:
    x0, y0, x1, y1, rho, alpha, c00, c01, c10, c11, rms, points, border = map(float, numbers)
    return Segment(
        layer, source, None if np.isnan(border) else int(border), (x0, y0), (x1, y1), rho, alpha,
        np.array([[c00, c01], [c10, c11]]), rms, int(points),
    )  # fmt: skip
