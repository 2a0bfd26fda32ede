"""What walls are made of: what they do to sound and to light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput
from recorder.names import did_you_mean
from recorder.truth import SMOOTH


@dataclass(frozen=True, slots=True)
class Surface:
    """One kind: met at more than ``mirror_deg`` it sends most of the sound away as a mirror does.

    Light passes through what is not ``opaque``, as if it were not there.
    """

    name: str
    mirror_deg: float
    opaque: bool = True


SURFACES: Mapping[str, Surface] = MappingProxyType({
    each.name: each
    for each in (
        Surface(SMOOTH, 25.0),  # painted walls, boards
        Surface("rough", 60.0),  # brick, shelves, cloth: sound is scattered
        Surface("glass", 12.0, opaque=False),
    )
})  # fmt: skip
MIRROR_DEG = SURFACES[SMOOTH].mirror_deg


@dataclass(frozen=True, slots=True, eq=False)
class WallSurfaces:
    """Of each wall (K,): from which angle it mirrors sound, and whether light stops at it."""

    mirror_deg: NDArray[np.float64]
    opaque: NDArray[np.bool_]


def wall_surfaces(names: Sequence[str]) -> WallSurfaces | None:
    """The surfaces of walls by name; None where all are smooth.

    Raises BadInput for a surface that there is not.
    """
    for name in names:
        if name not in SURFACES:
            raise BadInput(f"no surface {name!r} of walls; {did_you_mean(name, SURFACES)}")
    if set(names) <= {SMOOTH}:
        return None
    known = [SURFACES[name] for name in names]
    return WallSurfaces(
        np.array([each.mirror_deg for each in known]), np.array([each.opaque for each in known])
    )
