"""NumPy archives: one layer as the exports write it, or all layers of a map in one golden file.

A golden file holds ``origin_m`` and ``resolution_m`` once, and for each layer ``NAME/values``,
``NAME/kind``, ``NAME/lines_m`` (K, 2, 2), ``NAME/line_sources`` (K,), ``NAME/border_points_m``
(N, 2) of all borders one after the other, ``NAME/border_lengths`` and ``NAME/border_outer``.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping.grid import GridGeometry
from mapping.update_rules import unit_gives_start
from recorder.errors import BadInput
from recorder.outputs import written_beside
from replay.diff.layers import Line, MapLayer, Outline, Source, Values, value_layer

Arrays = Mapping[str, NDArray[Any]]

_NOT_EXTRA = {"values", "origin_m", "resolution_m", "kind", "layer"}
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of every entry, so that the same map gives the same bytes


def read_npz(path: Path) -> Source:
    """An archive of one layer or of many. Raises BadInput for a file that is neither."""
    arrays = load_arrays(path)
    if "values" in arrays:
        layer = one_layer(path, arrays)
        return Source(path, "arrays", {layer.name: layer}, single=True)
    layers = {
        key.removesuffix("/values"): _of_many(path, arrays, key.removesuffix("/values"))
        for key in arrays
        if key.endswith("/values")
    }
    if not layers:
        raise BadInput(f"{path}: holds no layer (an array named values)")
    config = str(arrays["config_toml"]) if "config_toml" in arrays else ""
    return Source(path, "arrays", layers, config_toml=config)


def load_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Everything in an archive, by name. Raises BadInput where it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {key: stored[key] for key in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, AttributeError) as error:
        reason = getattr(error, "strerror", None) or "not a NumPy archive (.npz) of numbers"
        raise BadInput(f"{path}: {reason}") from None


def one_layer(path: Path, arrays: Arrays) -> MapLayer:
    """The layer of an archive as the exports write it; its name falls back to the file's."""
    values = _grid(path, arrays, "values")
    geometry = _geometry(path, arrays, values)
    extra = {
        key: np.asarray(array)
        for key, array in arrays.items()
        if key not in _NOT_EXTRA and array.shape == values.shape and array.dtype.kind == "f"
    }
    name = str(arrays["layer"]) if "layer" in arrays else path.stem
    return value_layer(
        name, _kind(arrays, "kind"), geometry, values, start=_start(arrays, "start"), extra=extra
    )


def _of_many(path: Path, arrays: Arrays, name: str) -> MapLayer:
    values = _grid(path, arrays, f"{name}/values")
    lines = borders = None
    if {f"{name}/lines_m", f"{name}/line_sources"} <= set(arrays):
        ends = arrays[f"{name}/lines_m"].tolist()
        sources = arrays[f"{name}/line_sources"].tolist()
        lines = tuple(
            Line(str(s), (p[0], p[1]), (q[0], q[1]))
            for s, (p, q) in zip(sources, ends, strict=True)
        )
    if {f"{name}/border_points_m", f"{name}/border_lengths"} <= set(arrays):
        cuts = np.cumsum(arrays[f"{name}/border_lengths"])[:-1]
        pieces = np.split(arrays[f"{name}/border_points_m"], cuts)
        outer = arrays[f"{name}/border_outer"].tolist()
        borders = tuple(Outline(bool(o), p) for o, p in zip(outer, pieces, strict=False))
    extra = {
        key.removeprefix(f"{name}/extra/"): array
        for key, array in arrays.items()
        if key.startswith(f"{name}/extra/")
    }
    return value_layer(
        name, _kind(arrays, f"{name}/kind"), _geometry(path, arrays, values), values,
        start=_start(arrays, f"{name}/start"), extra=extra, lines=lines, borders=borders,
    )  # fmt: skip


def write_npz(path: Path, source: Source) -> None:
    """All layers of a source as one golden file; the same map gives the same bytes.

    The file is written beside its target and renamed. Raises BadInput where it cannot be written,
    or the layers hold no values or lie on different grids.
    """
    arrays: dict[str, NDArray[Any]] = {"config_toml": np.array(source.config_toml)}
    for name, layer in source.layers.items():
        arrays |= _layer_arrays(name, layer, path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with (
            written_beside(path) as part,
            zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive,
        ):
            for key, array in arrays.items():
                content = io.BytesIO()
                np.lib.format.write_array(content, np.asarray(array), allow_pickle=False)
                entry = zipfile.ZipInfo(f"{key}.npy", _EPOCH)
                entry.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(entry, content.getvalue())
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror or error}") from error


def _layer_arrays(name: str, layer: MapLayer, path: Path) -> dict[str, NDArray[Any]]:
    if layer.values is None:
        raise BadInput(f"cannot write {path}: layer {name} holds classes, not values")
    arrays: dict[str, NDArray[Any]] = {
        "origin_m": np.array(layer.geometry.origin_m),
        "resolution_m": np.array(layer.geometry.resolution_m),
        f"{name}/values": layer.values,
        f"{name}/kind": np.array(layer.kind),
        **{f"{name}/extra/{key}": array for key, array in layer.extra.items()},
    }
    if not unit_gives_start(layer.kind, layer.start):
        arrays[f"{name}/start"] = np.array(layer.start, np.float32)
    if layer.lines is not None:
        ends = [(line.start_m, line.end_m) for line in layer.lines]
        arrays[f"{name}/lines_m"] = np.array(ends, np.float64).reshape(-1, 2, 2)
        arrays[f"{name}/line_sources"] = np.array([x.source for x in layer.lines], np.str_)
    if layer.borders is not None:
        points = np.concatenate([np.zeros((0, 2)), *(b.points_m for b in layer.borders)])
        lengths = [len(b.points_m) for b in layer.borders]
        arrays[f"{name}/border_points_m"] = points
        arrays[f"{name}/border_lengths"] = np.array(lengths, np.int64)
        arrays[f"{name}/border_outer"] = np.array([b.outer for b in layer.borders], np.bool_)
    return arrays


def _grid(path: Path, arrays: Arrays, key: str) -> Values:
    if key not in arrays:
        raise BadInput(f"{path}: holds no layer (an array named {key})")
    values = arrays[key]
    if values.ndim != 2 or values.dtype.kind not in "fiub" or not values.size:
        raise BadInput(f"{path}: {key} is no grid of numbers (rows, cols)")
    floats: Values = values if values.dtype.kind == "f" else values.astype(np.float64)
    return floats


def _kind(arrays: Arrays, key: str) -> str:
    return str(arrays[key]) if key in arrays else "probability"


def _start(arrays: Arrays, key: str) -> float | None:
    """What a cell began with, which the file of a rule that is not built in holds."""
    start = arrays.get(key)
    return (
        float(start) if start is not None and not start.ndim and start.dtype.kind == "f" else None
    )


def _geometry(path: Path, arrays: Arrays, values: Values) -> GridGeometry:
    missing = [key for key in ("origin_m", "resolution_m") if key not in arrays]
    if missing:
        raise BadInput(f"{path}: holds no {missing[0]}, so its cells have no place")
    try:
        x, y = (float(v) for v in arrays["origin_m"].ravel())
        resolution_m = float(arrays["resolution_m"])
    except (TypeError, ValueError):
        raise BadInput(f"{path}: its origin_m or resolution_m are no numbers") from None
    if not (np.isfinite([x, y, resolution_m]).all() and resolution_m > 0.0):
        raise BadInput(f"{path}: its origin_m or resolution_m give no place")
    return GridGeometry((x, y), resolution_m, *values.shape)
