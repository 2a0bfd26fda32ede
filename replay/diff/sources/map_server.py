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
from recorder.inputs import note_input
from replay.diff.layers import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Codes,
    MapLayer,
    Source,
    never_seen,
)

_NEEDED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_TRUTH = {"0": False, "1": True, "false": False, "true": True, "no": False, "yes": True}
MOST_YAML_BYTES = 1 << 16
MOST_PIXELS = 100_000_000
Pixels = NDArray[np.float64]
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

    def classes(self, pixels: Pixels) -> Codes:
        """Pixels (rows, cols, 3 or 4 channels) 0 .. 1 → classes, as nav2's ``map_io`` makes them.

        The shade is the mean of the colours; in the mode trinary with the opacity among them where
        the picture has any, while in the mode scale a pixel that is not opaque is unknown.
        """
        shade = pixels[..., : 4 if self.mode == "trinary" else 3].mean(axis=-1)
        opaque = np.ones(shade.shape, np.bool_) if pixels.shape[2] < 4 else pixels[..., 3] == 1.0
        if self.mode == "raw":
            occupancy = np.round(shade * 255.0) / _RAW_MOST
            known = occupancy <= 1.0
        else:
            occupancy = shade if self.negate else 1.0 - shade
            known = opaque if self.mode == "scale" else np.ones(shade.shape, np.bool_)
        codes = np.full(shade.shape, UNKNOWN, np.uint8)
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
    described = _described(file)
    codes = described.classes(_pixels(described.image))
    x, y, size = described.geometry_m
    layer = MapLayer(
        file.stem, "classes", GridGeometry((x, y), size, *codes.shape), None, codes, UNKNOWN,
        reclass=described.reclass,
    )  # fmt: skip
    note = (
        f"{file.name} holds classes only (occupied above {described.occupied:g}, free below "
        f"{described.free:g}): classes are compared"
    )
    return Source(path, "map_server map", {layer.name: layer}, single=True, notes=(note,))


def _pixels(image: Path) -> Pixels:
    """Red, green, blue, and opacity if there is any, 0 .. 1; row 0 at the lowest y."""
    if not note_input(image).is_file():
        raise BadInput(f"{image}: the picture of the map is missing")
    try:
        with Image.open(image) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise BadInput(
                    f"{image}: {picture.width} x {picture.height} pixels, at most {MOST_PIXELS:,}"
                )
            if picture.mode.startswith("I") or picture.mode == "F":
                grey = np.asarray(picture, np.float64) / 65535.0  # 16 bits a pixel
                return np.repeat(grey[::-1, :, np.newaxis], 3, axis=2)
            see_through = picture.has_transparency_data
            pixels = np.asarray(picture.convert("RGBA" if see_through else "RGB"), np.float64)
            return pixels[::-1] / 255.0
    except BadInput:
        raise
    except (OSError, UnidentifiedImageError, ValueError, SyntaxError, Image.DecompressionBombError):
        raise BadInput(f"{image}: cannot be read as a picture") from None


class _PlainLoader(yaml.BaseLoader):  # type: ignore[misc]
    """YAML in which every value is text and nothing refers to another place: no bombs, no dates."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("an alias")
        return super().compose_node(parent, index)


def _described(file: Path) -> MapFile:
    try:
        if file.stat().st_size > MOST_YAML_BYTES:
            raise BadInput(f"{file}: no map of map_server (over {MOST_YAML_BYTES >> 10} kB)")
        values = yaml.load(file.read_text("utf-8"), Loader=_PlainLoader)
    except BadInput:
        raise
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        raise BadInput(f"{file}: cannot be read as YAML") from None
    if not isinstance(values, dict):
        raise BadInput(f"{file}: no map of map_server (it needs {', '.join(_NEEDED)})")
    missing = [key for key in _NEEDED if key not in values]
    if missing:
        raise BadInput(f"{file}: {', '.join(missing)} is missing: map_server refuses such a map")
    try:
        x, y, yaw = (float(v) for v in values["origin"])
        size, occupied, free = (
            float(values[key]) for key in ("resolution", "occupied_thresh", "free_thresh")
        )
        negate = _TRUTH[str(values["negate"]).lower()]
    except (TypeError, ValueError, KeyError):
        raise BadInput(
            f"{file}: its origin, resolution, thresholds or negate are no numbers"
        ) from None
    if not all(map(math.isfinite, (x, y, size, yaw, occupied, free))) or not 0.0 < size < 1e6:
        raise BadInput(f"{file}: its origin and resolution are no place")
    if abs(yaw) > 1e-9:
        raise BadInput(f"{file}: the map is turned by {yaw:g} rad, which cannot be compared")
    mode = str(values.get("mode", "trinary")).lower()
    if mode not in ("trinary", "scale", "raw"):
        raise BadInput(f"{file}: unknown mode (trinary, scale or raw)")
    image = file.parent / str(values["image"])
    return MapFile(image, (x, y, size), mode, negate, occupied, free)
