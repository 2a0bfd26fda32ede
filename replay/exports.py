"""A directory of plain files from one mapping run: grids, map_server maps, borders and lines.

The exporter is handed every artifact, keeps what belongs into a file and writes all at the end.
Each file is written beside its target and renamed, so no half file ever bears the final name; the
same run gives the same bytes.
"""

from __future__ import annotations

import importlib.metadata
import io
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from mapping.artifacts import Artifact, Border, Finished, RawPoints, Segment, Snapshot
from mapping.grid import Layer
from recorder.errors import BadInput, OutputExists
from replay.vector_files import segments_geojson, vector_dxf, vector_svg

OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.25
_UNKNOWN = 0.5  # its grey, 128, lies between the two thresholds


class Exporter:
    """Call it with each artifact of a run, then :meth:`close` it to write the files.

    ``config_text`` (TOML) and ``config`` (the same as a dict) are the configuration in force; both
    go into ``summary.json``. Raises OutputExists at once when ``directory`` holds something and
    ``force`` is not given, BadInput when it cannot be made. With ``force``, files of the same name
    are replaced and others stay.
    """

    def __init__(
        self, directory: Path, *, config_text: str, config: Mapping[str, Any], force: bool
    ) -> None:
        self._directory = directory
        self._config_text = config_text
        self._config = config
        self._snapshots: dict[str, Snapshot] = {}
        self._borders: list[Border] = []
        self._segments: list[Segment] = []
        self._points: list[RawPoints] = []
        self._finished: Finished | None = None
        _make_directory(directory, force=force)

    def __call__(self, artifact: Artifact) -> None:
        """Keep what a file needs. Raises BadInput for a layer's name that no file can have."""
        match artifact:
            case Snapshot():
                self._begin_layer(artifact)
            case Border():
                self._borders.append(artifact)
            case Segment():
                self._segments.append(artifact)
            case RawPoints():
                self._points.append(artifact)
            case Finished():
                self._finished = artifact
            case _:
                pass

    def _begin_layer(self, snapshot: Snapshot) -> None:
        """Keep the last map; the borders and lines of an earlier one are no results."""
        name = snapshot.layer.name
        self._borders = [b for b in self._borders if b.layer != name]
        self._segments = [s for s in self._segments if s.layer != name or s.source != "grid"]
        if snapshot.final:
            _check_name(name)
            self._snapshots[name] = snapshot

    def close(self) -> None:
        """Write every file. Raises BadInput when the directory cannot be written."""
        try:
            for name, content in self._files():
                _write(self._directory / name, content)
        except OSError as error:
            reason = error.strerror or error
            raise BadInput(f"cannot write into {self._directory}: {reason}") from error

    def _files(self) -> Iterator[tuple[str, bytes]]:
        for name, snapshot in self._snapshots.items():
            layer = snapshot.layer
            borders = [b for b in self._borders if b.layer == name]
            segments = [s for s in self._segments if s.layer == name]
            on_grid = [s for s in segments if s.source == "grid"]
            raw = [s for s in segments if s.source == "raw"]
            yield f"{name}.npz", layer_npz(layer)
            yield f"{name}.pgm", layer_pgm(layer)
            yield f"{name}.yaml", map_server_yaml(layer).encode()
            yield f"{name}.borders.json", borders_json(borders).encode()
            yield f"{name}.segments.geojson", segments_geojson(on_grid).encode()
            yield f"{name}.raw-segments.geojson", segments_geojson(raw).encode()
            yield f"{name}.dxf", vector_dxf(on_grid, borders).encode()
            yield f"{name}.svg", vector_svg(on_grid, borders).encode()
            points = [p for p in self._points if p.layer == name]
            yield f"{name}.points.csv", points_csv(points).encode()
        yield "summary.json", self._summary().encode()

    def _summary(self) -> str:
        """``readings`` is null when the run ended before it was finished."""
        done = self._finished
        layers = {n: {"kind": s.layer.kind, "rule": s.rule} for n, s in self._snapshots.items()}
        summary = {
            "readings": done.readings if done else None,
            "used": dict(done.used) if done else {},
            "dropped": dict(done.dropped) if done else {},
            "layers": layers,
            "versions": versions(),
            "config": _plain(self._config),
            "config_toml": self._config_text,
        }
        return json.dumps(summary, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def layer_npz(layer: Layer) -> bytes:
    """NumPy archive: ``values`` float32 [row, col], ``origin_m`` (2,), ``resolution_m``, names.

    The rule's further arrays are added under their own names.
    """
    arrays: dict[str, NDArray[Any]] = {
        **layer.extra,
        "values": layer.values.astype(np.float32, copy=False),
        "origin_m": np.array(layer.geometry.origin_m, np.float64),
        "resolution_m": np.float64(layer.geometry.resolution_m),  # type: ignore[dict-item]
        "kind": np.array(layer.kind),
        "layer": np.array(layer.name),
    }
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def layer_pgm(layer: Layer) -> bytes:
    """Binary PGM for map_server: its first row is the highest y, grey is 255 (1 - probability).

    A cell that no reading touched is written as 0.5, whatever its rule holds there: a count of 0
    would otherwise read as free.
    """
    known = layer.observed & np.isfinite(layer.probability)
    probability = np.where(known, layer.probability.astype(np.float64), _UNKNOWN)
    grey = np.round(255.0 * (1.0 - np.clip(probability, 0.0, 1.0))).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(grey[::-1])).save(file, format="PPM")
    return file.getvalue()


def map_server_yaml(layer: Layer) -> str:
    """What nav2's map_server reads beside the picture; the origin is the lower left corner."""
    x, y = layer.geometry.origin_m
    said = {
        "image": f"{layer.name}.pgm",
        "mode": "trinary",
        "resolution": float(layer.geometry.resolution_m),
        "origin": [float(x), float(y), 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESHOLD,
        "free_thresh": FREE_THRESHOLD,
    }
    text: str = yaml.safe_dump(said, sort_keys=False, default_flow_style=None, allow_unicode=True)
    return text


def borders_json(borders: Sequence[Border]) -> str:
    """A list of ``{"outer": bool, "cells": [[row, col], ...]}``, cells in trace order."""
    said = [{"outer": bool(b.outer), "cells": b.cells.tolist()} for b in borders]
    return json.dumps(said) + "\n"


def points_csv(points: Sequence[RawPoints]) -> str:
    """One line a point: nanoseconds, then x and y in metres in the map frame, exact to a float."""
    lines = ["t_ns,x_m,y_m"]
    for some in points:
        rows = zip(some.t_ns.tolist(), some.points_m.tolist(), strict=True)
        lines += [f"{t},{x!r},{y!r}" for t, (x, y) in rows]
    return "\n".join(lines) + "\n"


def versions() -> dict[str, str]:
    """What made the files: echogrid (``not installed`` in a bare checkout), NumPy and Python."""
    try:
        own = importlib.metadata.version("echogrid")
    except importlib.metadata.PackageNotFoundError:
        own = "not installed"
    return {"echogrid": own, "numpy": np.__version__, "python": platform.python_version()}


def _make_directory(directory: Path, *, force: bool) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        filled = any(directory.iterdir())
    except OSError as error:
        raise BadInput(f"cannot use {directory} as a directory: {error.strerror}") from error
    if filled and not force:
        raise OutputExists(directory)


def _check_name(name: str) -> None:
    if not name or name.startswith(".") or any(c in "/\\:\0" for c in name):
        raise BadInput(f"the layer's name {name!r} cannot be the name of a file")


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _plain(value: Any) -> Any:
    """What JSON can say: infinities and other types as text."""
    match value:
        case Mapping():
            return {str(key): _plain(inner) for key, inner in value.items()}
        case list() | tuple():
            return [_plain(inner) for inner in value]
        case float():
            return value if math.isfinite(value) else str(value)
        case None | bool() | int() | str():
            return value
        case _:
            return str(value)
