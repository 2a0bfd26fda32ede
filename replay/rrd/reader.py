"""A recording → its values again, exactly as they were: grids, beams, borders, segments.

Pictures in a recording are rounded; everything read here comes from the exact values beside them.
Grids are put together from their tiles, each in its newest version at the step asked for. A
recording that was cut off while it was written is read as far as it goes.
"""

from __future__ import annotations

import contextlib
import itertools
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from mapping.artifacts import Border, Segment, Snapshot
from mapping.beams import Beam, reach_of_axes
from mapping.fusion import FUSED
from mapping.grid import GridGeometry, Window
from recorder.errors import BadInput
from recorder.foreign import reading
from recorder.geometry import SE2
from replay.rrd import layout
from replay.rrd.batches import Batches, Row, numbers_of, quiet_reader
from replay.rrd.claims import check_claims
from replay.rrd.layout import Tiling
from replay.rrd.program import viewer_environment, viewer_program
from replay.rrd.steps import Step as Step
from replay.rrd.steps import read_steps
from replay.rrd.tiles import is_made_whole, stored_tilings
from replay.rrd.value_log.playback import Playback, Tiles
from replay.rrd.value_log.records import ValueLogError
from replay.rrd.value_log.track import Track

Floats = NDArray[np.float64]
MOST_CELLS = 100_000_000  # of all layers, to be read exactly
_WHAT = "a Rerun recording"


class RrdRecording:
    """What one recording holds. Made by :func:`read_rrd`."""

    def __init__(self, path: Path, file: Path, *, damaged: bool, root: str = "") -> None:
        self.path = path
        self.damaged = damaged
        self.folder: tempfile.TemporaryDirectory[str] | None = None
        self._file = Batches(file, root, indexed=not damaged)
        self._playing: dict[str, Playback] = {}
        self.config_text = self._file.one_text(layout.CONFIG, "TextDocument:text")
        self.geometry, self.layers, self.walls_m, self._tilings = self._read_grid()
        self.steps = read_steps(self._file)
        self._by_number = {step.step: step for step in self.steps}

    def grid(self, layer: str, step: int | None = None) -> NDArray[np.float32]:
        """Values of a layer at a step (default: the last at which they are exact), (rows, cols).

        Raises BadInput for a layer or step that is not there, or not with exact values.
        """
        step = self._checked(layer, step)
        begin = max((each for each in self._whole_maps(layer) if each <= step), default=-1)
        playback = self._playing.pop(layer, None)
        with self._damage_reported(layer):
            if playback is None or playback.begin != begin or playback.step > step:
                playback = self._played_from(layer, begin)
            grid = playback.at(step).copy()
        self._playing[layer] = playback
        return grid

    def grids(self, layer: str) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """The layer at each of its steps with exact values: step and a grid of its own, in order.

        Of whole tiles only as much as was written together is in memory at a time.
        """
        tiles = self._tiles_by_step(layout.merged(layer), "values")
        whole = self._whole_maps(layer)
        with self._damage_reported(layer):
            playback = Playback(self._start(layer), tiles, self._records(layer), whole)
            for step, values in playback.steps():
                if step in self._by_number and layer in self._by_number[step].exact:
                    yield step, values.copy()

    def kind_and_rule(self, layer: str) -> tuple[str, str]:
        """The unit of a layer's values and its update rule."""
        root = layout.layer_root(layer)
        return self._file.one_text(root, "kind"), self._file.one_text(root, "rule")

    def start_value(self, layer: str) -> float | None:
        """What a cell of a layer held before any reading; None for a layer without readings."""
        for batch in self._file.batches(layout.layer_root(layer), "start", whole=True):
            return float(numbers_of(batch, "start", 0)[0])
        return None

    def extra(self, layer: str) -> dict[str, NDArray[np.float32]]:
        """Further arrays of a layer's rule, at its last snapshot, by name."""
        newest = dict(self._file.rows(f"{layout.extra(layer, '')}**", "values"))
        return {
            self._file.one_text(entity, "name"): row.numbers.reshape(self.geometry.shape)
            for entity, row in newest.items()
        }

    def beams(self) -> Iterator[tuple[int, Beam]]:
        """Every reading that is shown, with its step, in order."""
        return self._beams_below(layout.ROBOT)

    def rejected(self) -> list[tuple[int, Beam]]:
        """Every reading that a filter left out, with its step, in order."""
        each = (self._beams_below(layout.rejected(layer)) for layer in self.layers)
        return sorted(itertools.chain(*each), key=lambda found: found[0])

    def _beams_below(self, entity: str) -> Iterator[tuple[int, Beam]]:
        for batch in self._file.batches(entity, "ranges_m", whole=True):
            for i in range(batch.num_rows):
                yield _step_of(batch, i), self._beam(batch, i)

    def segments(self) -> list[tuple[int, Segment]]:
        """Every straight line, with the step at which it came."""
        found = []
        for entity, row in self._file.rows(f"{layout.MAP}/layers/**", "numbers"):
            source = entity.split("/")[-2]
            if "/segments/" in entity:
                found.append((row.step, _segment(self._layer_at(row.step), source, row.numbers)))
        return sorted(found, key=lambda each: each[0])

    def borders(self) -> list[tuple[int, Border]]:
        """Every border, with the step at which it came."""
        found = []
        for entity, row in self._file.rows(f"{layout.MAP}/layers/**", "numbers"):
            if "/borders/" in entity:
                layer, table = self._layer_at(row.step), row.numbers.reshape(-1, 4)
                number, outer = (int(table[0, 0]), bool(table[0, 1])) if len(table) else (0, True)
                border = Border(layer, number, outer, self.geometry, table[:, 2:].copy())
                found.append((row.step, border))
        return sorted(found, key=lambda each: each[0])

    def raw_points_m(self, layer: str) -> Floats:
        """All obstacle points of a layer, (N, 2), metres; none when there was no such step."""
        rows = [row for _, row in self._file.rows(layout.raw_points(layer), "numbers")]
        return rows[-1].numbers.reshape(-1, 2) if rows else np.zeros((0, 2))

    def thresholded(self, layer: str) -> tuple[float, NDArray[np.bool_]] | None:
        """The last threshold of a layer and the cells above it, (rows, cols)."""
        root = layout.thresholded(layer)
        thresholds = [row for _, row in self._file.rows(root, "numbers")]
        if not thresholds:
            return None
        last = thresholds[-1]  # the end clears the picture
        return float(last.numbers[0]), self._newest_picture(root, last.step).astype(bool)

    def classes(self) -> tuple[tuple[str, ...], NDArray[np.uint8]] | None:
        """Names and codes, (rows, cols), of the last class map."""
        for batch in self._file.batches(layout.CLASSES, "names"):
            return tuple(batch.column("names")[0].as_py()), self._newest_picture(layout.CLASSES)
        return None

    def _start(self, layer: str) -> Track:
        """What a layer was before any reading."""
        kind, _ = self.kind_and_rule(layer)
        return Track(self.geometry, kind, self.start_value(layer) or 0.0)

    def _played_from(self, layer: str, begin: int) -> Playback:
        """A layer, ready to be followed from a whole map on (-1: from the start)."""
        root = layout.merged(layer)
        newest = self._newest_tiles(root, "values", begin) if begin >= 0 else ()
        whole = [(window, row.numbers.reshape(window.rows, window.cols)) for window, row in newest]
        later = self._tiles_by_step(root, "values", after=begin)
        return Playback(
            self._start(layer), itertools.chain([(begin, whole)], later), self._records(layer),
            [each for each in self._whole_maps(layer) if each >= begin], begin=begin,
        )  # fmt: skip

    def _whole_maps(self, layer: str) -> list[int]:
        """The steps at which the file holds all of a layer."""
        whole = Snapshot.__name__, layer
        return [each.step for each in self.steps if (each.artifact, each.layer) == whole]

    def _records(self, layer: str) -> list[tuple[int, bytes]]:
        """What readings did to a layer, in the order of the steps."""
        rows = self._file.rows(layout.value_log(layer), "history")
        return sorted(((row.step, row.numbers.tobytes()) for _, row in rows), key=lambda r: r[0])

    @contextlib.contextmanager
    def _damage_reported(self, layer: str) -> Iterator[None]:
        try:
            yield
        except ValueLogError as error:
            raise BadInput(f"{self.path}: values of {layer} are damaged: {error}") from None

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

    def _newest_picture(self, root: str, step: int | None = None) -> NDArray[np.uint8]:
        """Tiles that were never drawn hold class 0."""
        picture = np.zeros(self.geometry.shape, np.uint8)
        for window, row in self._newest_tiles(root, "SegmentationImage:buffer", step):
            picture[window.slices] = row.numbers.reshape(window.rows, window.cols)
        return picture

    def _newest_tiles(
        self, root: str, component: str, step: int | None
    ) -> Iterator[tuple[Window, Row]]:
        """The newest version of each tile up to a step, with where it lies in the grid."""
        windows = self._windows(root, component)
        newest: dict[str, Row] = {}
        for batch_entity, batch in self._file.batches_by_entity(f"{root}/**", component):
            if batch_entity not in windows:
                continue
            steps = batch.column(layout.STEP).to_numpy()
            upto = len(steps) if step is None else int(np.searchsorted(steps, step, side="right"))
            old = newest.get(batch_entity)
            if upto and (old is None or old.step <= steps[upto - 1]):
                numbers = numbers_of(batch, component, upto - 1)
                newest[batch_entity] = Row(int(steps[upto - 1]), numbers)
        for entity, row in newest.items():
            yield windows[entity], row

    def _tiles_by_step(
        self, root: str, component: str, *, after: int = -1
    ) -> Iterator[tuple[int, Tiles]]:
        """The tiles that each step wrote, in the order of the steps."""
        windows = self._windows(root, component)
        firsts = [
            int(batch.column(layout.STEP)[0].as_py())
            for _, batch in self._file.batches_by_entity(f"{root}/**", component)
        ]
        # From which step on nothing more can come: the earliest of all chunks still to be read.
        earliest = np.minimum.accumulate([*firsts, np.iinfo(np.int64).max][::-1])[::-1]
        waiting: dict[int, Tiles] = {}
        batches = self._file.batches_by_entity(f"{root}/**", component)
        for (entity, batch), horizon in zip(batches, earliest[1:], strict=True):
            for i, step in enumerate(batch.column(layout.STEP).to_numpy()):
                if step <= after:
                    continue
                window = windows[entity]
                values = numbers_of(batch, component, i).reshape(window.rows, window.cols)
                waiting.setdefault(int(step), []).append((window, values))
            for step in sorted(each for each in waiting if each < horizon):
                yield step, waiting.pop(step)

    def _windows(self, root: str, component: str) -> dict[str, Window]:
        """Where the tiles of exact ``values`` lie, or those of pictures."""
        whole = root == layout.merged(FUSED) and is_made_whole(FUSED, self.layers)
        tiling = self._tilings[whole or component != "values"]
        return {layout.tile(root, *at): tiling.window(*at) for at in tiling}

    def _beam(self, batch: pa.RecordBatch, i: int) -> Beam:
        base, sensor = (numbers_of(batch, n, i) for n in ("world_from_base", "world_from_sensor"))
        width, *reach_m = numbers_of(batch, "width_rad_reach_m", i)
        return Beam(
            number=int(batch.column(layout.READING)[i].as_py()),
            t_ns=int(batch.column(layout.TIME)[i].value),
            sensor=batch.column("sensor")[i].as_py()[0],
            layer=batch.column("layer")[i].as_py()[0],
            world_from_base=SE2(*map(float, base)),
            world_from_sensor=SE2(*map(float, sensor)),
            bearings_rad=numbers_of(batch, "bearings_rad", i),
            ranges_m=numbers_of(batch, "ranges_m", i),
            beam_width_rad=float(width),
            reach_m=reach_of_axes(np.array(reach_m, np.float64)),
        )

    def _read_grid(
        self,
    ) -> tuple[GridGeometry, tuple[str, ...], Floats, tuple[Tiling, Tiling]]:
        batches = self._file.batches(layout.GRID, "where_m", whole=True)
        if not batches:
            several = ", ".join(_map_names(self._file.file)) if not self._file.root else ""
            what = f"holds several maps: {several}" if several else "not a recording of echogrid"
            raise BadInput(f"{self.path}: {what}")
        x, y, cell = (float(v) for v in numbers_of(batches[0], "where_m", 0))
        rows, cols = (int(v) for v in numbers_of(batches[0], "shape", 0))
        layers = tuple(batches[0].column("layers")[0].as_py())
        if min(rows, cols) < 1 or rows * cols * len(layers) > MOST_CELLS:
            raise BadInput(f"{self.path}: {cols} x {rows} cells in {len(layers)} layers: too many")
        walls = np.zeros((0, 2, 2))
        if "walls_m" in batches[0].schema.names:
            walls = numbers_of(batches[0], "walls_m", 0).reshape(-1, 2, 2)
        geometry = GridGeometry((x, y), cell, rows, cols)
        sides: list[int] = []
        if "tile_cells" in batches[0].schema.names:
            sides = batches[0].column("tile_cells")[0].as_py()
        return geometry, layers, walls, stored_tilings(geometry, sides)


def read_rrd(path: str | Path, name: str = "") -> RrdRecording:
    """Open a recording for reading; ``name`` is that of one of several maps in it.

    ``damaged`` is true of one that was not ended properly and may lack its last part. Raises
    BadInput for a file that cannot be read, or that holds no recording of ours.
    """
    path, root = Path(path), layout.root_of(name)
    check_claims(path)
    damaged = not _has_footer(path)
    try:
        with reading(path, _WHAT):
            return RrdRecording(path, path, damaged=damaged, root=root)
    except BadInput:
        if not damaged:
            raise
    return _salvaged(path, root)


def is_whole(path: Path) -> bool:
    """Whether a recording, ours or another program's, was ended properly.

    Raises BadInput for a file that holds nothing which the viewer could show.
    """
    check_claims(path)
    if _has_footer(path):
        return True
    with reading(path, _WHAT):
        if next(iter(quiet_reader(path).stream()), None) is None:
            raise BadInput(f"{path}: a recording without anything in it")
    return False


def read_maps(path: str | Path) -> dict[str, RrdRecording]:
    """All maps of a recording that compares some, each to be read like one of its own, by name.

    Raises BadInput for a file that holds no such recording.
    """
    names = map_names(path)
    if not names:
        raise BadInput(f"{path}: holds one map, not several side by side")
    return {name: read_rrd(path, name) for name in names}


def map_names(path: str | Path) -> tuple[str, ...]:
    """The names of the maps that a recording compares; none where it holds a single one.

    Raises BadInput for a file that cannot be read.
    """
    path = Path(path)
    check_claims(path)
    with reading(path, _WHAT):
        return _map_names(path)


def _map_names(file: Path) -> tuple[str, ...]:
    for chunk in quiet_reader(file).stream().filter(content=layout.MAPS):
        batch = chunk.to_record_batch()
        if batch.num_rows and "names" in batch.schema.names:
            return tuple(batch.column("names")[0].as_py())
    return ()


def _salvaged(path: Path, root: str) -> RrdRecording:
    """A recording cut off in the middle of a record: the whole records before the cut."""
    folder = tempfile.TemporaryDirectory(prefix="echogrid-")
    file = Path(folder.name) / "salvaged.rrd"
    command = [str(viewer_program()), "rrd", "merge", "--continue-on-error", str(path), "-o"]
    subprocess.run(
        [*command, str(file)], env=viewer_environment(), capture_output=True, check=False
    )
    try:
        with reading(path, _WHAT):
            recording = RrdRecording(path, file, damaged=True, root=root)
    except BadInput:
        folder.cleanup()
        raise
    recording.folder = folder  # removed with the recording
    return recording


def _has_footer(path: Path) -> bool:
    try:
        with reading(path, _WHAT):
            quiet_reader(path).store()
    except BadInput:
        return False
    return True


def _step_of(batch: pa.RecordBatch, i: int) -> int:
    return int(batch.column(layout.STEP)[i].as_py())


def _segment(layer: str, source: str, numbers: Floats) -> Segment:
    x0, y0, x1, y1, rho, alpha, c00, c01, c10, c11, rms, points, border = map(float, numbers)
    return Segment(
        layer, source, None if np.isnan(border) else int(border), (x0, y0), (x1, y1), rho, alpha,
        np.array([[c00, c01], [c10, c11]]), rms, int(points),
    )  # fmt: skip
