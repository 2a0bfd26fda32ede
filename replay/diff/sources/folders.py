"""A folder that ``map --export`` filled: the arrays of each layer with its borders and lines."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay.diff.layers import Line, MapLayer, Outline, Source
from replay.diff.sources.arrays import load_arrays, one_layer

_LINE_FILES = (("grid", "segments.geojson"), ("raw", "raw-segments.geojson"))


def read_folder(folder: Path) -> Source:
    """Every layer of an export folder, or the map_server maps of another one. Raises BadInput."""
    layers: dict[str, MapLayer] = {}
    for file in sorted(folder.glob("*.npz")):
        layer = one_layer(file, load_arrays(file))
        layers[layer.name] = replace(
            layer,
            lines=_lines(folder, file.stem),
            borders=_borders(folder / f"{file.stem}.borders.json", layer.geometry),
        )
    if not layers:
        return _maps(folder)
    return Source(folder, "export folder", layers, config_toml=_config(folder / "summary.json"))


def _maps(folder: Path) -> Source:
    from replay.diff.sources.map_server import read_map

    found = [read_map(file) for file in sorted(folder.glob("*.yaml"))]
    if not found:
        raise BadInput(f"{folder}: a folder without maps (.npz or .yaml)")
    layers = {name: layer for source in found for name, layer in source.layers.items()}
    notes = tuple(note for source in found for note in source.notes)
    return Source(folder, "map_server maps", layers, notes=notes)


def _config(file: Path) -> str:
    """The configuration in force; empty where the folder does not hold it."""
    if not file.is_file():
        return ""
    summary = _json(file)
    return str(summary.get("config_toml", "")) if isinstance(summary, dict) else ""


def _lines(folder: Path, name: str) -> tuple[Line, ...] | None:
    files = [(source, folder / f"{name}.{ending}") for source, ending in _LINE_FILES]
    if not any(file.is_file() for _, file in files):
        return None
    lines: list[Line] = []
    for source, file in files:
        if file.is_file():
            try:
                for feature in _json(file)["features"]:
                    (x0, y0), (x1, y1) = feature["geometry"]["coordinates"]
                    lines.append(Line(source, (float(x0), float(y0)), (float(x1), float(y1))))
            except (KeyError, TypeError, ValueError):
                raise BadInput(f"{file}: not the lines of a layer") from None
    return tuple(lines)


def _borders(file: Path, geometry: GridGeometry) -> tuple[Outline, ...] | None:
    if not file.is_file():
        return None
    try:
        return tuple(
            Outline(
                bool(each["outer"]),
                geometry.centres_of(np.array(each["cells"], np.int64).reshape(-1, 2)),
            )
            for each in _json(file)
        )
    except (KeyError, TypeError, ValueError):
        raise BadInput(f"{file}: not the borders of a layer") from None


def _json(file: Path) -> Any:
    try:
        return json.loads(file.read_text("utf-8"))
    except (OSError, ValueError):
        raise BadInput(f"{file}: cannot be read as JSON") from None
