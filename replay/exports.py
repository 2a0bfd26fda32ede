"""A directory of plain files from one mapping run: grids, map_server maps, borders and lines.

The exporter is handed every artifact, keeps what belongs into a file and writes all at the end.
Each file is written beside its target and renamed, so no half file ever bears the final name; the
same run gives the same bytes.
"""

from __future__ import annotations

import io
import json
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from mapping.artifacts import Artifact, Border, RawPoints, Snapshot
from mapping.config import MappingConfig
from mapping.config_sections import ExportSection
from mapping.config_text import commented_toml
from mapping.grid import Layer
from mapping.readings import Readings, raw_points
from mapping.update_rules import rule_of, unit_gives_start
from recorder.errors import BadInput, OutputExists
from recorder.messages import Pose
from recorder.names import unusable_name
from recorder.outputs import written_beside
from recorder.versions import own_version
from replay.collector import Collector
from replay.json_values import json_value
from replay.pictures.map_svg import map_svg
from replay.pictures.parts import Floats
from replay.trajectory import tum_lines
from replay.vector_files import segments_geojson, vector_dxf

_UNKNOWN = 0.5  # its grey lies between the two thresholds, whatever these are set to
_MOST_OF_PATH = 20_000  # poses in a drawing: all of a robot that drove for some hours
_DEFAULTS = ExportSection()


class Exporter:
    """Call it with each artifact of a run, then :meth:`close` it to write the files.

    ``config_text`` (TOML) and ``config`` (the same as a dict) are the configuration in force; both
    go into ``summary.json``. Raises OutputExists at once when ``directory`` holds something and
    ``force`` is not given, BadInput when it cannot be made. With ``force``, files of the same name
    are replaced and others stay.
    """

    def __init__(
        self, directory: Path, *, config_text: str, config: Mapping[str, Any], force: bool,
        section: ExportSection = _DEFAULTS,
    ) -> None:  # fmt: skip
        self._directory = directory
        self._config_text = config_text
        self._config = config
        self._section = section
        self._results = Collector()
        _make_directory(directory, force=force)

    def __call__(self, artifact: Artifact) -> None:
        """Keep what a file needs. Raises BadInput for a layer's name that no file can have."""
        if isinstance(artifact, Snapshot) and artifact.final:
            _check_name(artifact.layer.name)
        self._results(artifact)

    def close(self, poses: Sequence[Pose] = (), placed: Iterable[Readings] | None = None) -> None:
        """Write every file. ``poses``: where the robot was.

        Of a long session the artifacts hold but some of the raw points; ``placed``, its readings,
        have all of them. Raises BadInput when the directory cannot be written.
        """
        try:
            every = max(-(-len(poses) // _MOST_OF_PATH), 1)
            where = [(p.world_from_base.x_m, p.world_from_base.y_m) for p in poses[::every]]
            path_m = np.array(where, np.float64).reshape(-1, 2)
            for name, content in self._files(path_m):
                with written_beside(self._directory / name) as part:
                    part.write_bytes(content)
            with (
                written_beside(self._directory / "trajectory.tum") as part,
                part.open("w", encoding="utf-8", newline="") as file,
            ):
                file.writelines(tum_lines(poses))
            self._write_points(placed)
        except OSError as error:
            reason = error.strerror or error
            raise BadInput(f"cannot write into {self._directory}: {reason}") from error

    def _files(self, path_m: Floats) -> Iterator[tuple[str, bytes]]:
        results = self._results
        for name, snapshot in results.snapshots.items():
            layer = snapshot.layer
            borders = [b for b in results.borders if b.layer == name]
            segments = [s for s in results.segments if s.layer == name]
            on_grid = [s for s in segments if s.source == "grid"]
            raw = [s for s in segments if s.source == "raw"]
            yield f"{name}.npz", layer_npz(layer, snapshot.rule)
            yield f"{name}.pgm", layer_pgm(layer, self._section)
            yield f"{name}.yaml", map_server_yaml(layer, self._section).encode()
            yield f"{name}.png", layer_png(layer, self._section)
            yield f"{name}.pgw", world_file(layer).encode()
            yield f"{name}.borders.json", borders_json(borders).encode()
            yield f"{name}.segments.geojson", segments_geojson(on_grid).encode()
            yield f"{name}.raw-segments.geojson", segments_geojson(raw).encode()
            yield f"{name}.dxf", vector_dxf(on_grid, borders).encode()
            svg = map_svg(on_grid, borders, layer=layer, path_m=path_m)
            yield f"{name}.svg", svg.encode()
            if self._section.pictures:
                from replay.pictures.layer_picture import layer_picture

                picture = layer_picture(layer, snapshot.rule, on_grid, path_m)
                yield f"{name}.picture.png", picture
        yield "summary.json", self._summary().encode()

    def _write_points(self, placed: Iterable[Readings] | None) -> None:
        """All raw points of the sensors that are layers of their own, without holding them all."""
        with ExitStack() as stack:
            files: dict[str, TextIO] = {}
            for name in self._results.snapshots:
                part = stack.enter_context(written_beside(self._directory / f"{name}.points.csv"))
                file = stack.enter_context(part.open("w", encoding="utf-8", newline=""))
                file.write("t_ns,x_m,y_m\n")
                files[name] = file
            for points in self._results.points if placed is None else points_of(placed):
                if points.layer in files:
                    files[points.layer].writelines(points_lines(points))

    def _summary(self) -> str:
        """``readings`` is null when the run ended before it was finished."""
        done, snapshots = self._results.finished, self._results.snapshots
        layers = {n: {"kind": s.layer.kind, "rule": s.rule} for n, s in snapshots.items()}
        summary = {
            "readings": done.readings if done else None,
            "used": dict(done.used) if done else {},
            "dropped": dict(done.dropped) if done else {},
            "layers": layers,
            "sensors": {
                s.name: {"kind": s.kind, "layer": s.layer, "model": s.model, "update": s.update}
                for s in self._results.sensors
            },
            "versions": versions(),
            "config": json_value(self._config),
            "config_toml": self._config_text,
        }
        return json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def exporter_for(directory: Path, config: MappingConfig, *, force: bool) -> Exporter:
    """An exporter of a run with a configuration; raises what :class:`Exporter` raises."""
    return Exporter(
        directory, config_text=commented_toml(config), config=config.model_dump(mode="json"),
        force=force, section=config.export,
    )  # fmt: skip


def layer_npz(layer: Layer, rule: str = "") -> bytes:
    """NumPy archive: ``values`` float32 [row, col], ``origin_m`` (2,), ``resolution_m``, names.

    The rule's further arrays are added under their own names, and what a cell began with where a
    reader does not know it from the unit.
    """
    arrays: dict[str, NDArray[Any]] = {
        **layer.extra,
        "values": layer.values.astype(np.float32, copy=False),
        "origin_m": np.array(layer.geometry.origin_m, np.float64),
        "resolution_m": np.array(layer.geometry.resolution_m, np.float64),
        "kind": np.array(layer.kind),
        "layer": np.array(layer.name),
    }
    start = rule_of(layer.kind, rule).start_value
    if not unit_gives_start(layer.kind, start):
        arrays["start"] = np.array(start, np.float32)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def layer_pgm(layer: Layer, section: ExportSection = _DEFAULTS) -> bytes:
    """Binary PGM for map_server: its first row is the highest y, grey is 255 (1 - probability).

    A cell that no reading touched lies half way between the thresholds, whatever its rule holds
    there: a count of 0 would otherwise read as free.
    """
    unknown = (section.free_thresh + section.occupied_thresh) / 2.0
    inside = section.free_thresh < _UNKNOWN < section.occupied_thresh
    return _picture(layer, "PPM", 8, _UNKNOWN if inside else unknown)


def layer_png(layer: Layer, section: ExportSection = _DEFAULTS) -> bytes:
    """The same picture as PNG, 8 or 16 bits deep, unknown at half grey: for GIS and documents."""
    return _picture(layer, "PNG", section.png_bits, _UNKNOWN)


def _picture(layer: Layer, form: str, bits: int, unknown: float) -> bytes:
    known = layer.observed & np.isfinite(layer.probability)
    probability = np.where(known, layer.probability.astype(np.float64), unknown)
    grey = np.round((2**bits - 1) * (1.0 - np.clip(probability, 0.0, 1.0)))
    file = io.BytesIO()
    pixels = np.ascontiguousarray(grey[::-1].astype(np.uint8 if bits == 8 else np.uint16))
    Image.fromarray(pixels).save(file, format=form)
    return file.getvalue()


def world_file(layer: Layer) -> str:
    """Where a picture's pixels lie, as GIS and CAD read it beside the picture (ESRI's world file).

    Size of a pixel along x, two turns, size along y (downwards), then the centre of the picture's
    first pixel, its upper left one; metres, map frame.
    """
    (x, y), size = layer.geometry.origin_m, layer.geometry.resolution_m
    top = y + (layer.geometry.rows - 0.5) * size
    numbers = (size, 0.0, 0.0, -size, x + 0.5 * size, top)
    return "".join(f"{float(number):.12g}\n" for number in numbers)


def map_server_yaml(layer: Layer, section: ExportSection = _DEFAULTS) -> str:
    """What nav2's map_server reads beside the picture; the origin is the lower left corner."""
    x, y = layer.geometry.origin_m
    fields = {
        "image": f"{layer.name}.pgm",
        "mode": "trinary",
        "resolution": float(layer.geometry.resolution_m),
        "origin": [float(x), float(y), 0.0],
        "negate": 0,
        "occupied_thresh": section.occupied_thresh,
        "free_thresh": section.free_thresh,
    }
    text: str = yaml.safe_dump(fields, sort_keys=False, default_flow_style=None, allow_unicode=True)
    return text


def borders_json(borders: Sequence[Border]) -> str:
    """A list of ``{"outer": bool, "cells": [[row, col], ...]}``, cells in trace order."""
    content = [{"outer": bool(b.outer), "cells": b.cells.tolist()} for b in borders]
    return json.dumps(content) + "\n"


def points_lines(points: RawPoints) -> Iterator[str]:
    """One line a point: nanoseconds, then x and y in metres in the map frame, exact to a float."""
    for t, (x, y) in zip(points.t_ns.tolist(), points.points_m.tolist(), strict=True):
        yield f"{t},{x!r},{y!r}\n"


def points_of(placed: Iterable[Readings]) -> Iterator[RawPoints]:
    """The raw points of readings, block by block."""
    for readings in placed:
        for sensor, points_m, t_ns, _ in raw_points([readings]):
            yield RawPoints(sensor.name, points_m, t_ns)


def versions() -> dict[str, str]:
    """What made the files: echogrid, NumPy and Python."""
    return {"echogrid": own_version(), "numpy": np.__version__, "python": platform.python_version()}


def _make_directory(directory: Path, *, force: bool) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        filled = any(directory.iterdir())
    except OSError as error:
        raise BadInput(f"cannot use {directory} as a directory: {error.strerror}") from error
    if filled and not force:
        raise OutputExists(directory)


def _check_name(name: str) -> None:
    if why := unusable_name(name):
        raise BadInput(f"the layer's name {name!r} cannot be the name of a file: {why}")
