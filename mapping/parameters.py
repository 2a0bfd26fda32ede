"""What can be set, and what a sensor is once everything is settled.

The keys that a sensor model or update rule has of its own are its ``Parameters``: they stand in
``[sensors.NAME]`` like all keys of a sensor, and are checked alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from recorder.geometry import SE2
from recorder.messages import Radiation

# Within these bounds nothing that is computed of settings runs over, or down to nothing.
MOST = 1e9
Positive = Annotated[float, Field(gt=0, ge=1e-9, le=MOST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=MOST, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
# No robot of ours is farther from its map's origin, in metres; nor has it turned so far.
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]


class Section(BaseModel):
    """Base of all sections: frozen, and closed to keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ParameterSection(Section):
    """The own keys of a sensor model or update rule, each with its type, default and description.

    A key without default has its value from the catalogue of sensors.
    """

    @classmethod
    def own_of(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """Those of ``values`` that are set for these keys."""
        return {key: values[key] for key in cls.model_fields if key in values}

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """The values of all keys that have one without being set."""
        return {
            key: known.get_default(call_default_factory=True)
            for key, known in cls.model_fields.items() if not known.is_required()
        }  # fmt: skip


class Table(dict[str, Any]):
    """A value that has keys itself; sensors with such a one can still be told apart and counted."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(repr(sorted(self.items())))


class Configurable:
    """Base of sensor models and update rules: a name, and the keys that are theirs alone.

    One that leaves ``Parameters`` as they are here does not state which keys it goes by.
    """

    name: ClassVar[str] = ""

    class Parameters(ParameterSection):
        """No keys."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor as one session's map sees it, everything settled. Units in the names.

    ``own`` holds the keys that models and rules of plugins have of their own, by name; they read
    as attributes, too. ``nearer`` are the models of shorter ranges, the shortest first, each for
    those ``up_to_m``; what is longer than all of them, and no echo, is the sensor's own.
    """

    name: str
    kind: str
    layer: str
    radiation: Radiation
    mount: SE2 | None  # None: the session's own transforms say it
    beam_width_rad: float
    range_error: float
    min_range_m: float
    max_range_m: float
    model: str
    regions: int
    gaussian: str
    emptiness: str
    p_hit: float
    p_miss: float
    hit: float
    miss: float
    near: float
    before: float
    behind: float
    fade_m: float
    update: str
    rasteriser: str
    second_grid: bool
    no_echo: str
    clear_to_m: float | None = None  # None: to the beam's end
    mark_to_m: float | None = None  # None: at any range
    forget_s: float | None = None  # None: never
    range_scale: float = 1.0
    range_bias_m: float = 0.0
    filter: str = "off"
    filter_of: int | None = None  # None: as many as the filter usually looks at
    filter_within_m: float = 0.1
    own: Mapping[str, Any] = field(default_factory=dict, hash=False)
    nearer: tuple[Sensor, ...] = ()
    up_to_m: float = math.inf

    @property
    def models(self) -> tuple[Sensor, ...]:
        """All of its models, that of the shortest ranges first; most have one."""
        return (*self.nearer, self)

    def at(self, range_m: float) -> Sensor:
        """The sensor as its model for a reading has it (+Inf: no echo)."""
        return next((each for each in self.nearer if range_m <= each.up_to_m), self)

    if not TYPE_CHECKING:  # in our own code a misspelt name stays an error

        def __getattr__(self, name: str) -> Any:
            if name != "own" and name in self.own:
                return self.own[name]
            raise AttributeError(f"a sensor has no setting {name!r}")
