"""map_server maps (.yaml and a picture): cells are free, occupied or neither."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from replay.diff.layers import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Codes,
    MapLayer,
    Source,
    never_seen,
)

_NEEDED = ("image", "resolution", "origin")
_RAW_MOST = 100  # in the mode raw, a larger grey is unknown


@dataclass(frozen=True, slots=True)
class MapFile:
    """The contents of the .yaml."""

    image: Path
    geometry_m: tuple[float, float, float]  # x, y of the origin, and the side of a cell
    mode: str
    negate: bool
    occupied: float
    free: float

    def classes(self, grey: NDArray[np.uint8]) -> Codes:
        """Greys 0 .. 255 → classes, by map_server's own rule."""
        if self.mode == "raw":
            occupancy = grey.astype(np.float64) / _RAW_MOST
            known = grey <= _RAW_MOST
        else:
            lightness = grey.astype(np.float64) / 255.0
            occupancy = lightness if self.negate else 1.0 - lightness
            known = np.ones(grey.shape, np.bool_)
        codes = np.full(grey.shape, UNKNOWN, np.uint8)
        codes[known & (occupancy < self.free)] = FREE
        codes[known & (occupancy > self.occupied)] = OCCUPIED
        return codes

    def reclass(self, layer: MapLayer) -> Codes:
        """The classes that a layer of values would have if it were written as such a map."""
        if layer.values is None:
            return layer.classes
        probability = layer.probability
        unseen = never_seen(layer) | ~np.isfinite(probability)
        # Rounded to a grey as the file's are, or a cell next to a threshold would seem to differ.
        grey = np.round(255.0 * (1.0 - np.clip(np.where(unseen, 0.5, probability), 0.0, 1.0)))
        occupancy = 1.0 - grey / 255.0
        codes = np.full(probability.shape, UNKNOWN, np.uint8)
        codes[occupancy < self.free] = FREE
        codes[occupancy > self.occupied] = OCCUPIED
        codes[unseen] = UNKNOWN
        return codes


def read_map(path: Path) -> Source:
    """A map by its .yaml (or by its picture, when the .yaml lies beside). Raises BadInput."""
    file = path.with_suffix(".yaml") if path.suffix.lower() == ".pgm" else path
    if not file.is_file():
        raise BadInput(f"{path}: the file {file.name} that holds where the map lies is missing")
    map_file = _described(file)
    try:
        with Image.open(map_file.image) as picture:
            rgba = picture.convert("RGBA")
            grey = np.asarray(rgba.convert("L"), np.uint8)[::-1]
            opaque = np.asarray(rgba, np.uint8)[::-1, :, 3] == 255
    except (OSError, UnidentifiedImageError, ValueError, Image.DecompressionBombError):
        raise BadInput(f"{map_file.image}: cannot be read as a picture") from None
    x, y, size = map_file.geometry_m
    codes = map_file.classes(grey)
    if map_file.mode == "scale":
        codes[~opaque] = UNKNOWN
    layer = MapLayer(
        file.stem, "classes", GridGeometry((x, y), size, *grey.shape), None, codes, UNKNOWN,
        reclass=map_file.reclass,
    )  # fmt: skip
    note = (
        f"{file.name} holds classes only (occupied above {map_file.occupied:g}, free below "
        f"{map_file.free:g}): classes are compared"
    )
    return Source(path, "map_server map", {layer.name: layer}, single=True, notes=(note,))


def _described(file: Path) -> MapFile:
    try:
        content = yaml.safe_load(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        raise BadInput(f"{file}: cannot be read as YAML") from None
    if not isinstance(content, dict) or any(key not in content for key in _NEEDED):
        raise BadInput(f"{file}: no map of map_server (it needs {', '.join(_NEEDED)})")
    try:
        x, y, yaw = (float(v) for v in content["origin"])
        size = float(content["resolution"])
        occupied = float(content.get("occupied_thresh", 0.65))
        free = float(content.get("free_thresh", 0.25))
    except (TypeError, ValueError):
        raise BadInput(f"{file}: its origin, resolution or thresholds are no numbers") from None
    if not all(map(math.isfinite, (x, y, size))) or size <= 0.0:
        raise BadInput(f"{file}: its origin and resolution give no place")
    if abs(yaw) > 1e-9:
        raise BadInput(f"{file}: the map is turned by {yaw:g} rad, which cannot be compared")
    image = file.parent / str(content["image"])
    mode = _mode(content.get("mode", "trinary"))
    return MapFile(image, (x, y, size), mode, bool(content.get("negate", 0)), occupied, free)


def _mode(mode: Any) -> str:
    name = str(mode).lower()
    return name if name in ("trinary", "scale", "raw") else "trinary"
