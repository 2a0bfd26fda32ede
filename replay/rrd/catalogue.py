"""Recordings as a catalogue that the viewer reads from: of each only what it shows.

A viewer that is handed a file in a browser takes in all of it, many times its size. From a
catalogue it fetches what the current step needs. Of several recordings, the catalogue is also their
table: a row a run, with its properties and a picture of its map. It is served on 127.0.0.1 only.
"""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun.blueprint as rrb
import rerun_bindings as bindings
from rerun.blueprint import table
from rerun.server import Server

from mapping.artifacts import Started
from mapping.fusion import FUSED
from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay.rrd import layout
from replay.rrd.batches import quiet_reader
from replay.rrd.blueprints import default_blueprint
from replay.rrd.program import LOCAL
from replay.rrd.properties import COLUMN
from replay.rrd.reader import RrdRecording, is_whole, read_rrd
from replay.rrd.sink import APPLICATION

_DATASET = "runs"
_LAST = 1.0  # of a recording's steps: where its picture in the table is from
_NAME, _LINK = "property:RecordingInfo:name", "recording link"
_COLUMNS = {"readings": "readings", "duration_s": "seconds", "sensors": "sensors",
            "layers": "layers", "cells": "cells", "dropped": "dropped"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Runs:
    """The recordings of a folder that can be shown, and of the others why not."""

    files: tuple[Path, ...]
    left_out: tuple[str, ...]


def runs_in(folder: Path) -> Runs:
    """Look through a folder, not those in it. Raises BadInput where it holds no recording."""
    files: dict[str, Path] = {}
    left_out = []
    for path in sorted(folder.glob("*.rrd")):
        try:
            if not is_whole(path):
                left_out.append(f"{path.name} was not ended properly")
                continue
            (run,) = quiet_reader(path).recordings()
        except (BadInput, ValueError) as error:
            left_out.append(f"{path.name}: {error}")
            continue
        if run.recording_id in files:
            left_out.append(f"{path.name} is a copy of {files[run.recording_id].name}")
        else:
            files[run.recording_id] = path
    if not files:
        raise BadInput(f"{folder}: no recording (.rrd) in this folder. {'; '.join(left_out)}")
    return Runs(tuple(files.values()), tuple(left_out))


def can_be_served(path: Path) -> bool:
    """Whether a file holds one recording, as a whole: a catalogue takes nothing else."""
    return is_whole(path) and len(quiet_reader(path).recordings()) == 1


class Catalogue(contextlib.AbstractContextManager["Catalogue"]):
    """Serve recordings; ``url`` is their table, ``first_url`` the first of them. A context.

    Each must be whole, and none a copy of another. Raises BadInput when the server does not start.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        paths = [str(file.resolve()) for file in files]
        try:
            self._server = Server(host=LOCAL, datasets={_DATASET: list(paths)})
            # The client of the package would need a database for what is asked here.
            client = bindings.CatalogClientInternal(self._server.url())
            self._runs = client.get_dataset(client._entry_id_from_entry_name(_DATASET))
        except (RuntimeError, ValueError, OSError) as error:
            raise BadInput(f"{files[0]}: the viewer's server does not take it: {error}") from None
        self._folder = tempfile.TemporaryDirectory(prefix="echogrid-")
        self.url = f"{self._server.url()}/entry/{self._runs.entry_details().id}"
        self.first_url = str(self._runs.segment_url(self._runs.segment_ids()[0]))

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._folder.cleanup()

    def lay_out_as(self, file: Path) -> None:
        """Show each run as one of them was meant to be shown; if it states how."""
        with contextlib.suppress(RuntimeError, ValueError):
            self._runs.set_default_blueprint_segment_id(self._registered(file))

    def lay_out_table(self, files: Sequence[Path]) -> None:
        """Show a row with a picture for each run; and each run so that all can be compared."""
        runs = [run for run in map(_opened, files) if run is not None]
        if not runs:
            return
        start = _one_for_all(runs)
        of_one, of_table = (Path(self._folder.name) / f"{name}.rbl" for name in ("run", "table"))
        default_blueprint(start).save(APPLICATION, of_one)
        _table(start, runs).save(APPLICATION, of_table)
        self._runs.set_default_blueprint_segment_id(self._registered(of_one))
        self._runs.set_default_segment_table_blueprint_segment_id(self._registered(of_table))

    def _registered(self, file: Path) -> str:
        """The name of the blueprint that a file holds, once the server knows it."""
        uris = [file.resolve().as_uri()]
        blueprints = self._runs.blueprint_dataset()
        assert blueprints is not None  # the local server keeps some of each dataset
        (name,) = blueprints.register(uris, ["base"], "replace").wait()
        return str(name)


def _opened(file: Path) -> RrdRecording | None:
    """A recording of one map; None of anything else."""
    try:
        return read_rrd(file)
    except BadInput:
        return None


def _one_for_all(runs: Sequence[RrdRecording]) -> Started:
    """A run with all their layers, on a grid around all of theirs."""
    geometry = _around([run.geometry for run in runs])
    layers = tuple(dict.fromkeys(layer for run in runs for layer in run.layers if layer != FUSED))
    if any(FUSED in run.layers for run in runs):
        layers = (*layers, FUSED)
    return Started(geometry, layers, runs[0].walls_m[:0], 0, 0)


def _around(geometries: Sequence[GridGeometry]) -> GridGeometry:
    """A grid around all of them."""
    low = np.min([each.origin_m for each in geometries], axis=0)
    high = np.max([np.add(each.origin_m, each.size_m) for each in geometries], axis=0)
    cell_m = min(each.resolution_m for each in geometries)
    cols, rows = (max(math.ceil(size / cell_m), 1) for size in high - low)
    return GridGeometry((float(low[0]), float(low[1])), cell_m, rows, cols)


def _bounds(geometry: GridGeometry) -> rrb.VisualBounds2D:
    """The part of the viewer's plane, y down, that a grid takes."""
    (x, y), (width, height) = geometry.origin_m, geometry.size_m
    return rrb.VisualBounds2D(x_range=[x, x + width], y_range=[-(y + height), -y])


def _table(start: Started, runs: Sequence[RrdRecording]) -> table.TableBlueprint:
    """A card for each run, with the map that it ends with; or rows and columns."""
    shown = {FUSED if FUSED in run.layers else run.layers[-1] for run in runs}
    view = rrb.Spatial2DView(
        origin="/", name="map", visual_bounds=_bounds(start.geometry),
        contents=[layout.MAP, *(f"{layout.merged(name)}/**" for name in sorted(shown)),
                  layout.WALLS],
    )  # fmt: skip
    picture = table.Column(_LINK, name="map", column_type=table.PreviewCell(view))
    columns = [table.Column(COLUMN + source, name=name) for source, name in _COLUMNS.items()]
    name = table.Column(_NAME, name="run")
    return table.TableBlueprint(
        table_layout=table.TableLayout(columns=[name, picture, *columns]),
        card_layout=table.CardLayout(title=_NAME, link=_LINK, fields=[picture, *columns]),
        default_layout="cards",
        previews_config=table.PreviewsConfig(timeline=layout.STEP, start_point=_LAST),
        sort_by=_NAME,
    )
