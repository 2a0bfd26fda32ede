"""An exported map (.npz, a folder, map_server's .yaml) → what a picture shows of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mapping.fusion import FUSED
from recorder.foreign import read_text, reading
from replay.diff.layers import FREE, OCCUPIED, UNKNOWN, never_seen
from replay.diff.sources.opening import open_map
from replay.pictures.opening import Asked, chosen_layer
from replay.pictures.parts import Floats
from replay.pictures.views import MapView, Overlaid, view_of_grid

_MOST_TRAJECTORY_BYTES = 1 << 28
_SHADES = {UNKNOWN: 0.5, FREE: 0.0, OCCUPIED: 1.0}


def view_of_map(path: Path, asked: Asked) -> MapView:
    """A layer of a map, with what lies beside it in its folder. Raises BadInput in one line."""
    source = open_map(path)
    names = list(source.layers)
    usual = FUSED if FUSED in names else names[0]
    name = chosen_layer(path, asked.view, names, usual)
    layer = source.layers[name]
    found = [(x.start_m, x.end_m) for x in layer.lines or () if x.source == "grid"]
    folder = path if path.is_dir() else path.parent
    over = Overlaid(
        np.array(found, np.float64).reshape(-1, 2, 2), path_m=_trajectory(folder / "trajectory.tum")
    )
    if layer.values is None:
        shades = np.array([_SHADES[code] for code in range(len(_SHADES))])
        probability, seen = shades[layer.classes], layer.classes != UNKNOWN
    else:
        probability, seen = layer.probability, ~never_seen(layer)
    return view_of_grid(
        layer.geometry, probability, seen, over, file=path.name or str(path), layer=name,
        when="as exported", rule=layer.rule,
    )  # fmt: skip


def _trajectory(file: Path) -> Floats:
    """The positions of a TUM file; none where there is no such file."""
    if not file.is_file():
        return np.zeros((0, 2))
    text = read_text(file, "a trajectory", most_bytes=_MOST_TRAJECTORY_BYTES, may_be_empty=True)
    with reading(file, "a trajectory"):
        rows = [line.split() for line in text.splitlines() if line and not line.startswith("#")]
        points = np.array([(float(row[1]), float(row[2])) for row in rows]).reshape(-1, 2)
        if not np.isfinite(points).all():
            raise ValueError("a position is no number")
        return points
