"""The weights of `pooled`: those that are shipped, one set a medium, or a file of one's own."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from recorder.errors import BadInput
from recorder.foreign import read_text, reading
from recorder.messages import Radiation
from recorder.names import printable

SHIPPED = Path(__file__).with_name("pooled_weights.toml")
MEDIUM = {
    Radiation.ULTRASOUND: "sonar", Radiation.INFRARED: "infrared", Radiation.LASER: "laser",
}  # fmt: skip
SIGNS = {
    "hits": 1, "misses": -1, "on_arc": 1, "before_arc": -1, "misses_near": -1, "misses_middle": -1,
    "nearest_miss_m": 1, "nearest_hit_m": -1,
}  # fmt: skip
"""Which way each sum may move a cell."""
_MOST = 1e9


@dataclass(frozen=True, slots=True)
class Weights:
    """What a kind of sensor's sums are worth: log-odds = bias + the sum of weight x term.

    ``fade_m`` is the range at which a reading counts half in the sums ``hits`` and ``misses``.
    ``most_unpassed`` is the most log-odds of a cell that no beam passed through: wide beams pass
    through nearly every wall's cells on their way past it, but not through what lies behind walls.
    """

    fade_m: float
    most_unpassed: float
    bias: float
    of: Mapping[str, float]


@lru_cache(maxsize=16)
def weights_of(name: str) -> Weights:
    """Those of a medium, or of a file (``F.toml#TABLE`` of several). BadInput where none are."""
    if name in MEDIUM.values():
        return _checked(_tables(SHIPPED)[name], f"{SHIPPED.name}: {name}")
    path, _, table = name.partition("#")
    if not path.endswith(".toml"):
        media = ", ".join(MEDIUM.values())
        raise BadInput(
            f"no weights {printable(name, most=60)!r}: {media}, or a TOML file are wanted"
        )
    tables = _tables(Path(path))
    if "bias" in tables:
        return _checked(tables, name)
    if not table and len(tables) == 1:
        table = next(iter(tables))
    if table not in tables:
        raise BadInput(f"{path}: weights of which table? {path}#{' or #'.join(tables) or 'NAME'}")
    return _checked(tables[table], name)


def given_weights(table: Mapping[str, Any]) -> Weights:
    """Those of a table of a configuration. BadInput where it cannot be used."""
    return _checked(table, "weights")


def as_table(weights: Weights) -> dict[str, Any]:
    """The same as a table, in six digits: what a file or a configuration holds."""

    def rounded(values: Mapping[str, float]) -> dict[str, float]:
        return {name: float(f"{value:.6g}") for name, value in values.items()}

    own = {name: getattr(weights, name) for name in ("fade_m", "most_unpassed", "bias")}
    return {**rounded(own), "weights": rounded(weights.of)}


def _tables(file: Path) -> dict[str, Any]:
    with reading(file, "TOML"):
        return tomllib.loads(read_text(file, "TOML"))


def _checked(table: Any, subject: str) -> Weights:
    """A table of a file as weights. A weight whose sign makes evidence count the wrong way is
    refused: more hits can only make a cell more occupied, more misses more free."""
    if not isinstance(table, dict) or not isinstance(table.get("weights"), dict):
        raise BadInput(
            f"{subject}: weights of `pooled` are fade_m, most_unpassed, bias, and a table weights"
        )
    of = {name: table["weights"].get(name) for name in SIGNS}
    numbers = {**of, **{name: table.get(name) for name in ("fade_m", "most_unpassed", "bias")}}
    for name, value in numbers.items():
        if not isinstance(value, int | float) or not abs(value) <= _MOST:
            raise BadInput(f"{subject}: {name} must be a number up to {_MOST:g}")
        if name in SIGNS and value * SIGNS[name] < 0.0:
            wanted = "negative" if SIGNS[name] > 0 else "positive"
            raise BadInput(f"{subject}: the weight of {name} must not be {wanted}")
    for name in ("fade_m", "most_unpassed"):
        if numbers[name] <= 0.0:
            raise BadInput(f"{subject}: {name} must be above 0")
    values = {name: float(value) for name, value in numbers.items()}
    fade_m, most_unpassed, bias = (values.pop(k) for k in ("fade_m", "most_unpassed", "bias"))
    return Weights(fade_m, most_unpassed, bias, values)
