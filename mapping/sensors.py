"""The sensors of a session, all settled: what they report, the catalogue, the configuration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

from mapping.config import MappingConfig, ReportedSensor, Sensor, resolve_sensor
from mapping.filters import OFF
from mapping.fusion import check_layers
from mapping.update_rules.rules import Bayes
from recorder.errors import BadInput
from recorder.messages import Radiation, Range, Scan


def resolve_sensors(
    readings: Iterable[Range | Scan],
    parent_of: Callable[[str], str | None],
    config: MappingConfig,
    known: Mapping[str, Sensor] = MappingProxyType({}),
) -> dict[str, Sensor]:
    """The sensors of these readings, by name, each from its first reading and the configuration.

    ``parent_of(frame)`` is what a frame is fixed to or turns on, None where that is not known. Each
    sensor has its own layer, unless there are several of one kind: these share one. Where some are
    ``known`` already, they stay as they are, and another of a kind that has a layer joins it.
    """
    first: dict[str, Range | Scan] = {}
    for reading in readings:
        if reading.sensor not in known:
            first.setdefault(reading.sensor, reading)
    if not first:
        return dict(known)
    found = {
        name: _resolved(reading, config, mounted=parent_of(name) is not None)
        for name, reading in first.items()
    }
    of_kind = Counter(sensor.kind for sensor in found.values())
    of_kind.update(sensor.layer for sensor in known.values())
    resolved = {**known} | {
        name: replace(s, layer=s.layer or (name if of_kind[s.kind] == 1 else s.kind))
        for name, s in found.items()
    }
    for name, reading in first.items():
        if isinstance(reading, Scan) and resolved[name].nearer:
            raise BadInput(f"sensors.{name}.ranges: the beams of a scan share one model")
    check_layers(resolved.values())
    return with_one_rule_a_layer(resolved, config)


def with_one_rule_a_layer(
    sensors: Mapping[str, Sensor], config: MappingConfig
) -> dict[str, Sensor]:
    """A layer has one rule, that of its last sensor. Where its sensors differ in it, or in what it
    was learned of, those for which none was named take ``bayes``, which suits any mixture."""
    found: dict[str, set[tuple[str, str]]] = {}
    for each in sensors.values():
        found.setdefault(each.layer, set()).add((each.update, repr(each.own.get("weights"))))
    return {
        name: each
        if len(found[each.layer]) == 1 or _rule_is_named(name, config)
        else replace(each, update=Bayes.name, own={**each.own, "weights": ""})
        for name, each in sensors.items()
    }


def _rule_is_named(sensor: str, config: MappingConfig) -> bool:
    sections = (config.sensors.get("*"), config.sensors.get(sensor))
    return any(each is not None and getattr(each, "update", None) for each in sections)


def _resolved(reading: Range | Scan, config: MappingConfig, *, mounted: bool) -> Sensor:
    """One sensor. A filter for all passes scans over; one for a scanner alone is a mistake."""
    sensor = resolve_sensor(_reported(reading), config, mounted=mounted)
    if isinstance(reading, Range) or sensor.filter == OFF:
        return sensor
    own = config.sensors.get(reading.sensor)
    if getattr(own, "filter", None) is not None:
        raise BadInput(
            f"sensors.{reading.sensor}.filter: scans are not filtered, only sensors of one range"
        )
    return replace(sensor, filter=OFF)


def _reported(reading: Range | Scan) -> ReportedSensor:
    if isinstance(reading, Range):
        return ReportedSensor(
            reading.sensor, reading.radiation, reading.beam_width_rad,
            reading.min_range_m, reading.max_range_m,
        )  # fmt: skip
    return ReportedSensor(
        reading.sensor, Radiation.LASER, abs(reading.angle_increment_rad),
        reading.min_range_m, reading.max_range_m,
    )  # fmt: skip
