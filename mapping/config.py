"""The configuration: one frozen section a stage. The defaults and descriptions are the manual.

A configuration comes from TOML files, then ``--set a.b=c``; an unknown key is an error that names
the nearest known one. What a sensor *is* (:class:`Sensor`) is settled for each session from, first
found first taken: the configuration, the session's own message or mount, the built-in sensor of
that name, the built-in one of its radiation.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Radiation

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


Display = Literal["grey", "reduced", "odds", "two-colours", "three-colours"]


class Section(BaseModel):
    """Base of all sections: frozen, and closed to keys it does not know."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class PoseSection(Section):
    """Where the robot was at each reading's own time."""

    topic: str = Field("", description="topic of the poses; empty: /pose, or the only one there is")
    odom_start: Literal["own", "tracker"] = Field(
        "own", description="/odom as it is, or laid on the tracker's pose where both begin"
    )
    rides_on: Literal["base", "head"] = Field(
        "base", description="what the tracker's tag is fixed to"
    )
    max_gap_s: Positive = Field(
        0.5, description="readings in a longer gap between two poses are dropped"
    )
    fixed: tuple[Finite, Finite, Finite] | None = Field(
        None, description="x_m, y_m, heading_deg of a robot that stands still: no tracker needed"
    )


class GridSection(Section):
    """The cells of the map."""

    resolution_m: Positive = Field(0.01, description="side of a cell")
    origin_m: tuple[Finite, Finite] | None = Field(
        None, description="outer corner of cell (0, 0); default: what the session needs"
    )
    size_m: tuple[Positive, Positive] | None = Field(
        None, description="width and height; default: what the session needs"
    )
    max_cells: int = Field(100_000_000, gt=0, description="a larger grid is refused")


class SensorSection(Section):
    """One sensor, `[sensors.NAME]`. What is left out comes from the session or the built-ins."""

    topic: str | None = Field(None, description="topic of its readings; default /range/NAME")
    kind: str | None = Field(None, description="what the sensor is: ping, dirrs, lidar")
    beam_width_deg: Annotated[float, Field(gt=0, le=360)] | None = Field(
        None, description="full width of the beam"
    )
    range_error: Annotated[float, Field(ge=0, lt=1)] | None = Field(
        None, description="relative error of a range, +-"
    )
    mount: tuple[Finite, Finite, Finite] | None = Field(
        None, description="x_m, y_m, yaw_deg on the robot (or on the head)"
    )
    min_range_m: NonNegative | None = Field(None, description="readings below are dropped")
    max_range_m: Positive | None = Field(None, description="readings at or beyond saw nothing")
    layer: str | None = Field(None, description="map that the readings go into")
    model: str | None = Field(None, description="regions, peak or fading, or one of a plugin")
    regions: int | None = Field(None, description="regions over +-3 standard deviations: 6, 12 ...")
    gaussian: Literal["both", "angle", "distance", "none"] | None = Field(
        None, description="which of the two errors are Gaussian"
    )
    emptiness: Literal["none", "constant", "linear", "combined"] | None = Field(
        None, description="what is said of the cells in front of the band"
    )
    p_hit: Fraction | None = Field(None, description="peak: probability at the likeliest place")
    p_miss: Fraction | None = Field(None, description="peak: probability close to the sensor")
    hit: NonNegative | None = Field(None, description="fading: log-odds of the band, close by")
    miss: NonNegative | None = Field(None, description="fading: log-odds taken in front")
    near: NonNegative | None = Field(None, description="fading: how much surer close to the sensor")
    before: NonNegative | None = Field(None, description="fading: band before the range, relative")
    behind: NonNegative | None = Field(None, description="fading: band behind the range, relative")
    fade_m: Positive | None = Field(None, description="fading: range at which half is believed")
    update: str | None = Field(None, description="update rule: bayes, odds, count ...")
    rasteriser: Literal["cells", "arcs"] | None = Field(
        None, description="every cell at its centre, or the chapter's sampling along arcs"
    )
    second_grid: bool | None = Field(
        None, description="arcs: sample into a grid of its own, then merge"
    )
    no_echo: Literal["empties", "skipped"] | None = Field(
        None, description="what a reading that saw nothing does"
    )


class FusionSection(Section):
    """How the maps of several sensors become one."""

    rule: Literal["bayes", "weights"] = Field(
        "bayes", description="log-odds added, or weighted sum"
    )
    weights: Literal["angular", "range", "equal"] | dict[str, NonNegative] = Field(
        "angular", description="by angular resolution, by range error, equal, or given by layer"
    )


class BordersSection(Section):
    """From a grid to closed borders."""

    threshold: Fraction = Field(0.55, description="occupied where the probability is above it")
    tracer: Literal["closed", "chapter"] = Field(
        "closed", description="the right tracer, or the chapter's stop and start rules"
    )
    compare: tuple[Fraction, ...] = Field(
        (0.51, 0.55, 0.60), description="thresholds that the recording shows side by side"
    )


class SegmentsSection(Section):
    """From borders or raw points to straight lines."""

    source: Literal["borders", "ridge"] = Field(
        "borders", description="follow the border of a wall, or the centre line of its band"
    )
    method: str = Field("split-and-merge", description="how points become lines")
    epsilon_m: Positive = Field(0.06, description="farthest point from a chord before it is split")
    fit: Literal["total", "y-on-x"] = Field(
        "total", description="total least squares, or y = mx + b"
    )
    wrap: Literal["on", "off", "drop"] = Field(
        "on", description="first and last line are neighbours; not; or both are dropped"
    )
    merge: Literal["joint-fit", "angle", "collinear", "endpoints", "none"] = Field(
        "joint-fit", description="test by which neighbouring lines become one"
    )
    rms_m: Positive | None = Field(
        None, description="largest rms of a line that grows or is merged; default 0.4 epsilon_m"
    )
    merge_angle_deg: Positive = Field(10.0, description="merge by angle: neighbours that bend less")
    corner_angle_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        10.0, description="neighbours that bend less do not meet in a corner"
    )
    corner_reach_m: NonNegative = Field(
        0.25, description="a corner further from the points than this is none"
    )
    wall_m: NonNegative = Field(
        0.12,
        description="grids: the two faces of a wall this thin, or of a cell or two, are a line",
    )
    order: Literal["time", "bearing", "path"] = Field(
        "time", description="of raw points: as measured, around the robot, or nearest to nearest"
    )
    gap_m: Positive = Field(0.3, description="pieces of a line further apart are not joined")
    raw_gap_m: Positive = Field(0.15, description="nor are a ranger's neighbouring points")
    min_points: int = Field(5, ge=2, description="fewer points make no line")
    min_length_m: NonNegative = Field(0.2, description="shorter lines are left out")
    seed: int = Field(0, description="of the methods that draw at random")

    @property
    def largest_rms_m(self) -> float:
        """The bound on a line's rms in force, metres."""
        return 0.4 * self.epsilon_m if self.rms_m is None else self.rms_m


class RerunSection(Section):
    """What of a run is shown in the recording."""

    every: int = Field(1, ge=1, description="every k-th reading is shown; all of them are mapped")
    stages_every: int = Field(
        0, ge=0, description="borders, lines and fusion after every k readings; 0: at the end"
    )
    line_stages: Literal["together", "each", "none"] = Field(
        "together",
        description="splits, merges, fits and corners at the end: a step a kind, or one for each",
    )
    tracer_steps: int = Field(
        0, ge=0, description="so many steps of the tracer along each layer's longest border"
    )
    budget_mb: Positive = Field(100.0, description="size that the recording should stay under")
    display: tuple[Display, ...] = Field(
        ("grey", "reduced", "odds", "two-colours", "three-colours"),
        description="further ways to draw the maps at each snapshot, hidden at first",
    )
    display_levels: int = Field(5, ge=2, le=256, description="shades left at reduced depth")


class MappingConfig(Section):
    """All sections."""

    pose: PoseSection = PoseSection()
    grid: GridSection = GridSection()
    sensors: dict[str, SensorSection] = Field(default_factory=dict)
    fusion: FusionSection = FusionSection()
    borders: BordersSection = BordersSection()
    segments: SegmentsSection = SegmentsSection()
    rerun: RerunSection = RerunSection()


CHAPTER_PRESET: dict[str, Any] = {
    "sensors": {"*": {"model": "regions", "regions": 12, "gaussian": "both",
                      "emptiness": "combined", "update": "bayes", "rasteriser": "cells"}},
    "fusion": {"rule": "weights", "weights": "angular"},
}  # fmt: skip
PRESETS = {"chapter": CHAPTER_PRESET}


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor as one session's map sees it, everything settled. Units in the names."""

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


@dataclass(frozen=True, slots=True)
class Heard:
    """What a session itself says of a sensor (NaN: it says nothing)."""

    name: str
    radiation: Radiation
    beam_width_rad: float = math.nan
    min_range_m: float = math.nan
    max_range_m: float = math.nan


_COMMON: dict[str, Any] = {
    "model": "fading", "regions": 12, "gaussian": "both", "emptiness": "combined",
    "p_hit": 0.7, "p_miss": 0.4, "update": "bayes", "rasteriser": "cells", "second_grid": True,
}  # fmt: skip
_SONAR_FADING = {"hit": 0.8, "miss": 0.08, "near": 30.0, "before": 0.01, "behind": 0.1,
                 "fade_m": 0.75}  # fmt: skip
_SHARP_FADING = {"hit": 2.2, "miss": 0.85, "near": 0.0, "before": 0.075, "behind": 0.075,
                 "fade_m": 1e9}  # fmt: skip
# A laser's band is narrower than the infrared ranger's, by the ratio of their range errors.
_LASER_FADING = {**_SHARP_FADING, "before": 0.015, "behind": 0.015}

BUILT_IN_SENSORS: dict[str, dict[str, Any]] = {
    "ping": {**_COMMON, **_SONAR_FADING, "mount": (0.044, 0.0, 0.0), "beam_width_deg": 38.0,
             "range_error": 0.10, "min_range_m": 0.02, "max_range_m": 4.0, "no_echo": "skipped"},
    "dirrs": {**_COMMON, **_SHARP_FADING, "mount": (-0.0312, 0.0, 0.0), "beam_width_deg": 6.0,
              "range_error": 0.05, "min_range_m": 0.1, "max_range_m": 0.8, "no_echo": "empties"},
    "lidar": {**_COMMON, **_LASER_FADING, "mount": (0.0, 0.0, 0.0), "beam_width_deg": 1.0,
              "range_error": 0.01, "min_range_m": 0.05, "max_range_m": 30.0, "no_echo": "empties"},
}  # fmt: skip
KIND_OF_RADIATION = {
    Radiation.ULTRASOUND: "ping", Radiation.INFRARED: "dirrs", Radiation.LASER: "lidar",
}  # fmt: skip


def settle_sensor(heard: Heard, config: MappingConfig, *, mounted: bool) -> Sensor:
    """Everything about one sensor, each value from the first place that knows it.

    ``mounted`` tells that the session holds a transform for it; its mount then stays None.
    """
    asked = {**_set_keys(config.sensors.get("*")), **_set_keys(config.sensors.get(heard.name))}
    asked.pop("topic", None)
    kind = str(asked.pop("kind", None) or _kind_of(heard))
    base = BUILT_IN_SENSORS.get(kind) or BUILT_IN_SENSORS[KIND_OF_RADIATION[heard.radiation]]
    said = {
        "beam_width_deg": math.degrees(heard.beam_width_rad),
        "min_range_m": heard.min_range_m,
        "max_range_m": heard.max_range_m,
    }
    values = {**base, **{k: v for k, v in said.items() if math.isfinite(v) and v > 0}, **asked}
    mount = asked.get("mount", None if mounted else base["mount"])
    values.pop("mount")
    width_deg = values.pop("beam_width_deg")
    return Sensor(
        name=heard.name,
        kind=kind,
        radiation=heard.radiation,
        layer=values.pop("layer", None) or "",
        mount=None if mount is None else SE2(mount[0], mount[1], math.radians(mount[2])),
        beam_width_rad=math.radians(width_deg),
        **values,
    )


def _kind_of(heard: Heard) -> str:
    """``ping``, ``ping_left`` and ``ping2`` are pings; any other name goes by its radiation."""
    for kind in BUILT_IN_SENSORS:
        if heard.name == kind or heard.name.rstrip("0123456789").split("_")[0] == kind:
            return kind
    return KIND_OF_RADIATION[heard.radiation]


def _set_keys(section: SensorSection | None) -> dict[str, Any]:
    return {} if section is None else section.model_dump(exclude_none=True)


def load_config(
    files: Iterable[Path] = (), settings: Iterable[str] = (), preset: str | None = None
) -> MappingConfig:
    """Preset, then files in order, then ``a.b=c`` settings: the later ones win.

    Raises BadInput, in one line, for an unknown key (with the nearest known one) or a bad value.
    """
    data: dict[str, Any] = {}
    if preset is not None:
        if preset not in PRESETS:
            raise BadInput(f"unknown preset {preset!r}{_nearest(preset, PRESETS)}")
        data = _merged(data, PRESETS[preset])
    for file in files:
        data = _merged(data, _read_toml(file))
    for setting in settings:
        data = _merged(data, parse_setting(setting))
    return validate(data)


def validate(data: Mapping[str, Any]) -> MappingConfig:
    """A nested mapping → the configuration; BadInput names what is wrong with it."""
    try:
        return MappingConfig.model_validate(data)
    except ValidationError as error:
        raise BadInput(_in_one_line(error)) from None


def parse_setting(setting: str) -> dict[str, Any]:
    """``a.b=c`` → {"a": {"b": c}}; c is read as TOML where it is TOML, else as text."""
    path, equals, text = setting.partition("=")
    keys = [key.strip() for key in path.split(".")]
    if not equals or not all(keys):
        raise BadInput(f"--set takes section.key=value, not {setting!r}")
    try:
        value: Any = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    for key in reversed(keys):
        value = {key: value}
    return dict(value)


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{file}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{file}: not TOML: {error}") from None


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(below)
    for key, value in above.items():
        old = out.get(key)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        out[key] = _merged(old, value) if both else value  # type: ignore[arg-type]
    return out


def _in_one_line(error: ValidationError) -> str:
    first = error.errors()[0]
    path = [str(part) for part in first["loc"]]
    if first["type"] == "extra_forbidden":
        return f"unknown key {'.'.join(path)}{_nearest(path[-1], _known_keys(path[:-1]))}"
    return f"{'.'.join(path)}: {first['msg'].lower()} (not {first['input']!r})"


def _known_keys(path: list[str]) -> list[str]:
    section: type[BaseModel] = MappingConfig
    for key in path:
        if section is MappingConfig and key == "sensors":
            return list(SensorSection.model_fields)
        field = section.model_fields.get(key)
        if field is None or not isinstance(field.annotation, type):
            return []
        section = field.annotation
    return list(section.model_fields)


def _nearest(word: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.4)
    return f"; the nearest known one is {close[0]}" if close else ""
