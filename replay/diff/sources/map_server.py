"""map_server maps (.yaml and a picture): cells are free, occupied or neither."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image

from mapping.grid import GridGeometry
from recorder.errors import BadInput
from recorder.foreign import check_file, read_text, reading
from recorder.inputs import note_input
from replay.diff.layers import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Codes,
    MapLayer,
    Source,
    check_cells,
    check_place,
    never_seen,
)

_NEEDED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
_TRUTH = {"0": False, "1": True, "false": False, "true": True, "no": False, "yes": True}
MOST_YAML_BYTES = 1 << 16
_ROWS_AT_ONCE = 256  # the picture as numbers takes 32 bytes a pixel
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
    if not file.exists():
        raise BadInput(f"{path}: the file {file.name} that holds where the map lies is missing")
    described = _described(file)
    codes = np.concatenate([described.classes(rows) for rows in _pixels(described.image)])
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


def _pixels(image: Path) -> Iterator[Pixels]:
    """Red, green, blue, and opacity if there is any, 0 .. 1; a few rows at a time, lowest first."""
    with reading(image, "a picture"):
        missing = not note_input(image).exists()
    if missing:
        raise BadInput(f"{image}: the picture of the map is missing")
    check_file(image)
    with reading(image, "a picture"), Image.open(image) as picture:
        check_cells(image, picture.height, picture.width)
        most = 255.0
        if picture.mode.startswith("I") or picture.mode == "F":  # 16 bits a pixel
            most = 65535.0
            shades = np.asarray(picture)[::-1, :, np.newaxis]
        else:
            see_through = picture.has_transparency_data
            shades = np.asarray(picture.convert("RGBA" if see_through else "RGB"))[::-1]
    channels = max(shades.shape[2], 3)
    for row in range(0, len(shades), _ROWS_AT_ONCE):
        some = shades[row : row + _ROWS_AT_ONCE] / most
        yield np.broadcast_to(some, (*some.shape[:2], channels))


class _PlainLoader(yaml.BaseLoader):  # type: ignore[misc]
    """YAML in which every value is text and nothing refers to another place: no bombs, no dates."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("an alias")
        return super().compose_node(parent, index)


def _described(file: Path) -> MapFile:
    text = read_text(file, "YAML", most_bytes=MOST_YAML_BYTES)
    with reading(file, "YAML"):
        values = yaml.load(text, Loader=_PlainLoader)
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
    check_place(file, x, y, size)
    if not all(map(math.isfinite, (occupied, free))):
        raise BadInput(f"{file}: its thresholds are no numbers")
    if not abs(yaw) <= 1e-9:
        raise BadInput(f"{file}: the map is turned by {yaw:g} rad, which cannot be compared")
    mode = str(values.get("mode", "trinary")).lower()
    if mode not in ("trinary", "scale", "raw"):
        raise BadInput(f"{file}: unknown mode (trinary, scale or raw)")
    image = file.parent / str(values["image"])
    return MapFile(image, (x, y, size), mode, negate, occupied, free)
