"""The sections of the configuration, one a stage; each key with its default and what it means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    SerializeAsAny,
    create_model,
    model_validator,
)
from pydantic.fields import FieldInfo

from mapping.parameters import (
    MOST,
    Configurable,
    Coordinate,
    Fraction,
    NonNegative,
    Positive,
    Section,
)
from mapping.sensor_model.models import SENSOR_MODELS
from mapping.update_rules.rules import UPDATE_RULES

Display = Literal["grey", "reduced", "odds", "two-colours", "three-colours"]


class PoseSection(Section):
    """Where the robot was at each reading's own time."""

    topic: str = Field(
        "", description="topic of the poses, or /tf; empty: /pose, or the only one there is"
    )
    offset_s: Coordinate = Field(0.0, description="added to the times of the poses")
    heading_offset_deg: Annotated[float, Field(ge=-360, le=360)] = Field(
        0.0, description="added to the headings of the poses"
    )
    drift_per_min: tuple[Coordinate, Coordinate, Annotated[float, Field(ge=-360, le=360)]] = Field(
        (0.0, 0.0, 0.0),
        description="what the poses drift a minute, x_m, y_m, heading_deg: it is taken off, from "
        "the first pose on",
    )
    stamps: Literal["header", "arrival"] = Field(
        "header", description="times of measurement, or those at which the messages arrived"
    )
    odom_start: Literal["own", "tracker"] = Field(
        "own", description="/odom as it is, or laid on the tracker's pose where both begin"
    )
    rides_on: Literal["base", "head"] = Field(
        "base", description="what the tracker's tag is fixed to"
    )
    max_gap_s: Positive = Field(
        0.5, description="readings in a longer gap between two poses are dropped"
    )
    smooth: bool = Field(
        False, description="each pose by those before and after it, with odometry where there is"
    )
    smooth_m: Positive | None = Field(
        None, description="how much positions scatter (+-); default: estimated from the poses"
    )
    smooth_deg: Positive | None = Field(None, description="so do headings; default: estimated")
    fixed: tuple[Coordinate, Coordinate, Coordinate] | None = Field(
        None, description="x_m, y_m, heading_deg of a robot that stands still: no tracker needed"
    )


class GridSection(Section):
    """The cells of the map."""

    resolution_m: Positive = Field(0.01, description="side of a cell")
    origin_m: tuple[Coordinate, Coordinate] | None = Field(
        None, description="outer corner of cell (0, 0); default: what the session needs"
    )
    size_m: tuple[Positive, Positive] | None = Field(
        None, description="width and height; default: what the session needs"
    )
    max_cells: int = Field(100_000_000, gt=0, le=1 << 40, description="a larger grid is refused")
    max_memory_mb: Annotated[float, Field(ge=1, le=MOST)] = Field(
        1000.0, description="so are maps that would take more memory, all layers together"
    )


class RangeSection(Section):
    """What is otherwise in the shorter ranges of a sensor; :func:`sensor_section` adds the keys of
    the models."""

    up_to_m: Positive = Field(description="the longest range that this model is for")
    range_error: Annotated[float, Field(ge=0, lt=1)] | None = Field(
        None, description="relative error of such a range, +-"
    )


class SensorSection(Section):
    """One sensor, `[sensors.NAME]`. What is left out comes from the session or the built-ins.

    These are the keys that every sensor has; :func:`sensor_section` adds those of the models and
    rules.
    """

    topic: str | None = Field(None, description="topic of its readings; default: by type")
    kind: str | None = Field(None, description="what the sensor is: ping, dirrs, lidar")
    beam_width_deg: Annotated[float, Field(gt=0, ge=1e-9, le=360)] | None = Field(
        None, description="full width of the beam"
    )
    range_error: Annotated[float, Field(ge=0, lt=1)] | None = Field(
        None, description="relative error of a range, +-"
    )
    mount: tuple[Coordinate, Coordinate, Coordinate] | None = Field(
        None, description="x_m, y_m, yaw_deg on the robot (or on the head)"
    )
    min_range_m: NonNegative | None = Field(None, description="readings below are dropped")
    max_range_m: Positive | None = Field(None, description="readings at or beyond saw nothing")
    range_scale: Annotated[float, Field(ge=0.1, le=10)] | None = Field(
        None, description="what its ranges are times too long: they are divided by it (1)"
    )
    range_bias_m: Coordinate | None = Field(
        None, description="what its ranges are too long besides: it is taken off first (0)"
    )
    filter: Literal["off", "median", "agree", "predicted"] | None = Field(
        None,
        description="single wrong ranges are left out: far from the median of the last ones, not "
        "in agreement with the ones before, or against what the map so far predicts (off)",
    )
    filter_of: Annotated[int, Field(ge=1, le=99)] | None = Field(
        None,
        description="how many readings the filter looks at, the newest among them; default: 3 "
        "(median), 2 (agree); predicted: so many in a row that agree are taken for a change, 3",
    )
    filter_within_m: NonNegative | None = Field(
        None,
        description="what the filter lets a range differ by, or the sensor's range_error where "
        "that is more (0.1)",
    )
    layer: str | None = Field(None, description="map that the readings go into")
    model: str | None = Field(None, description="regions, peak or fading, or one of a plugin")
    ranges: tuple[RangeSection, ...] | None = Field(
        None,
        description="models of shorter ranges: up_to_m, and what is other there (docs/learn.md)",
    )
    update: str | None = Field(None, description="update rule: bayes, odds, count ...")
    rasteriser: Literal["cells", "arcs", "rays"] | None = Field(
        None, description="every cell at its centre, the chapter's arcs, or a thin line each axis"
    )
    second_grid: bool | None = Field(
        None, description="arcs: sample into a grid of its own, then merge"
    )
    no_echo: Literal["empties", "skipped"] | None = Field(
        None, description="what a reading that saw nothing does"
    )
    clear_to_m: Positive | None = Field(
        None,
        description="how far a beam clears; by default to its end, and a scan's beam without "
        "return as far as others nearby came back from",
    )
    mark_to_m: Positive | None = Field(
        None,
        description="obstacles beyond are not marked, only what lies before them is cleared; "
        "default: at any range",
    )
    forget_s: Positive | None = Field(
        None,
        description="evidence halves in that time, for what moves (of a layer's last sensor); "
        "default: never",
    )


class _AllKeys(Section):
    """Base of the sections with all keys: made while the program runs, so pickled by their keys."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _section_of, (self.model_dump(exclude_none=True),)


def sensor_section() -> type[Section]:
    """The section of one sensor with the keys of every model and rule that there is.

    A model's keys stand after ``model``, a rule's after ``update``.
    """
    return _with_keys_of(tuple(SENSOR_MODELS.values()), tuple(UPDATE_RULES.values()))


@lru_cache(maxsize=8)
def _with_keys_of(
    models: tuple[Configurable, ...], rules: tuple[Configurable, ...]
) -> type[Section]:
    of_range = create_model(
        "RangeSection", __base__=RangeSection, __module__=__name__, **dict(_own_keys(models))
    )
    fields: dict[str, Any] = {}
    owners = {"model": models, "update": rules}
    for key, known in SensorSection.model_fields.items():
        fields[key] = (known.annotation, known)
        fields |= dict(_own_keys(owners.get(key, ())))
    several = Annotated[tuple[of_range, ...], AfterValidator(_ascending)]
    fields["ranges"] = (several | None, SensorSection.model_fields["ranges"])
    return create_model("SensorSection", __base__=_AllKeys, __module__=__name__, **fields)


def _ascending(ranges: tuple[RangeSection, ...]) -> tuple[RangeSection, ...]:
    ends = [each.up_to_m for each in ranges]
    if any(later <= end for end, later in pairwise(ends)):
        raise ValueError("up_to_m must grow from one to the next")
    return ranges


def _own_keys(members: tuple[Configurable, ...]) -> Iterator[tuple[str, Any]]:
    """Each key with its type, None where it is not set; one of a single owner names it."""
    known: dict[str, FieldInfo] = {}
    owners: dict[str, list[str]] = {}
    for member in members:
        for key, of_member in member.Parameters.model_fields.items():
            known.setdefault(key, of_member)
            owners.setdefault(key, []).append(member.name)
    for key, field in known.items():
        meaning = field.description or ""
        if len(owners[key]) == 1:
            meaning = f"{owners[key][0]}: {meaning or key}"
        checked: Any = Annotated[(field.annotation, *field.metadata, Field())]
        yield key, (checked | None, Field(None, description=meaning))


def _section_of(keys: Any) -> Any:
    return sensor_section().model_validate(keys) if isinstance(keys, Mapping) else keys


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

    source: Literal["auto", "borders", "ridge"] = Field(
        "auto",
        description="follow the border of a wall, or the centre line of its band; auto: ridge "
        "for lidars, borders for others",
    )
    refit: Literal["points", "none"] = Field(
        "points",
        description="grids: each line moves to the raw points that it explains, or stays; lines of "
        "lasers alone, and those by y-on-x, stay",
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
    corner_angle_deg: Annotated[float, Field(gt=0, ge=1e-9, le=90)] = Field(
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
    min_points: int = Field(5, ge=2, le=MOST, description="fewer points make no line")
    min_length_m: NonNegative = Field(0.2, description="shorter lines are left out")
    seed: int = Field(0, ge=0, lt=1 << 32, description="of the methods that draw at random")

    @property
    def refits(self) -> bool:
        """Whether lines of grids move to the raw points: total least squares, as those are."""
        return self.refit == "points" and self.fit == "total"

    @property
    def largest_rms_m(self) -> float:
        """The bound on a line's rms in force, metres."""
        return 0.4 * self.epsilon_m if self.rms_m is None else self.rms_m


class RerunSection(Section):
    """What of a run is shown in the recording."""

    every: int = Field(
        1, ge=1, le=MOST, description="every k-th reading is shown; all of them are mapped"
    )
    stages_every: int = Field(
        0,
        ge=0,
        le=MOST,
        description="borders, lines and fusion after every k readings; 0: at the end",
    )
    line_stages: Literal["together", "each", "none"] = Field(
        "together",
        description="splits, merges, fits and corners at the end: a step a kind, or one for each",
    )
    tracer_steps: int = Field(
        0,
        ge=0,
        le=MOST,
        description="so many steps of the tracer along each layer's longest border",
    )
    budget_mb: Positive = Field(100.0, description="size that the recording should stay under")
    display: tuple[Display, ...] = Field(
        ("grey", "reduced", "odds", "two-colours", "three-colours"),
        description="further ways to draw the maps at each snapshot, hidden at first",
    )
    display_levels: int = Field(5, ge=2, le=256, description="shades left at reduced depth")


class ExportSection(Section):
    """The pictures that ``map --export`` writes."""

    occupied_thresh: Fraction = Field(
        0.65, description="map_server maps: a wall where the probability is above it"
    )
    free_thresh: Fraction = Field(
        0.25, description="map_server maps: free where the probability is below it"
    )
    png_bits: Literal[8, 16] = Field(8, description="depth of the grey in LAYER.png")
    pictures: bool = Field(
        False, description="also LAYER.picture.png, with walls, path, axes and scale: a second more"
    )

    @model_validator(mode="after")
    def _in_order(self) -> ExportSection:
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError("free_thresh must lie below occupied_thresh")
        return self


class MappingConfig(Section):
    """All sections."""

    pose: PoseSection = PoseSection()
    grid: GridSection = GridSection()
    sensors: dict[str, Annotated[SerializeAsAny[Section], BeforeValidator(_section_of)]] = Field(
        default_factory=dict
    )
    fusion: FusionSection = FusionSection()
    borders: BordersSection = BordersSection()
    segments: SegmentsSection = SegmentsSection()
    rerun: RerunSection = RerunSection()
    export: ExportSection = ExportSection()
