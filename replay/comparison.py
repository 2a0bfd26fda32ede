"""Which maps are compared: several configurations of one session, each with a name.

They come from several configuration files, or from one setting that takes several values in turn
(``--compare sensors.*.update=bayes,count``); shorthands name the comparisons that everyone wants.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mapping.config import MappingConfig, load_config
from mapping.names import choose
from mapping.sensor_model import SENSOR_MODELS
from mapping.update_rules import UPDATE_RULES
from mapping.update_rules.rules import Bayes
from recorder.errors import BadInput

_OF_ALL_SENSORS = "sensors.*."
_AT_THE_TRACKER = "pose.odom_start=tracker"
_COMMAS = re.compile(r",(?![^\[{\"']*[\]}\"'])")  # not those inside a list, a table or a text


@dataclass(frozen=True, slots=True)
class Variant:
    """One of the maps to be compared: its name, all its settings, and a note on it."""

    name: str
    config: MappingConfig
    note: str = ""


def from_files(
    files: Sequence[Path], settings: Sequence[str] = (), preset: str | None = None
) -> list[Variant]:
    """One variant for each configuration file, named by its stem; the settings apply to all.

    Raises BadInput for two files of one stem, or a file that is no configuration.
    """
    variants = []
    for file in files:
        try:
            config = load_config([file], settings, preset)
        except BadInput as error:
            reason = str(error)
            raise BadInput(reason if str(file) in reason else f"{file}: {reason}") from None
        variants.append(Variant(_name(file.stem), config))
    return _distinct(variants)


def from_values(
    compare: str,
    files: Sequence[Path] = (),
    settings: Sequence[str] = (),
    preset: str | None = None,
) -> list[Variant]:
    """One variant for each value of a setting: ``section.key=a,b,c``, or a shorthand of it.

    ``rules`` are all update rules, ``models`` all sensor models, ``pose`` the tracker's poses and
    dead reckoning. A sensor that has the key itself takes the values too. Raises BadInput for an
    unknown shorthand, key or value, or a single one.
    """
    base = load_config(files, settings, preset)
    key, values = _key_and_values(compare)
    if len(values) < 2:
        raise BadInput(f"--compare {compare}: name two values or more, with commas between them")
    variants = []
    for value in values:
        chosen = [f"{each}={value}" for each in _keys(key, base)]
        note = ""
        if key == "pose.topic" and value == "/odom":
            chosen.append(_AT_THE_TRACKER)
            note = "dead reckoning from the wheels, laid on the tracker's pose at its start"
        if key.endswith(".model") and not any(map(_names_a_rule, base.sensors.values())):
            keys = [each.removesuffix("model") for each in _keys(key, base)]
            chosen += [f"{each}update={Bayes.name}" for each in keys]
            note = f"models differ, the rule does not: {Bayes.name}"
        config = load_config(files, [*settings, *chosen], preset)
        variants.append(Variant(_name(_label(key, value)), config, note))
    return _distinct(variants)


def _names_a_rule(section: object) -> bool:
    return getattr(section, "update", None) is not None


def _key_and_values(compare: str) -> tuple[str, list[str]]:
    known = {
        "rules": ("sensors.*.update", list(UPDATE_RULES)),
        "models": ("sensors.*.model", list(SENSOR_MODELS)),
        "pose": ("pose.topic", ["/pose", "/odom"]),
    }
    key, equals, text = compare.partition("=")
    if not equals:
        return _shorthand(known, compare)
    values = [value.strip() for value in _COMMAS.split(text) if value.strip()]
    tables: dict[str, tuple[Mapping[str, object], str]]
    tables = {"update": (UPDATE_RULES, "update rule"), "model": (SENSOR_MODELS, "sensor model")}
    if key.startswith("sensors.") and key.rpartition(".")[2] in tables:
        table, what = tables[key.rpartition(".")[2]]
        for value in values:
            choose(table, value, what)
    return key.strip(), values


def _shorthand(known: Mapping[str, tuple[str, list[str]]], compare: str) -> tuple[str, list[str]]:
    """The key and values of a shorthand. Raises BadInput, with the missing key if it can."""
    given = [value.strip() for value in compare.split(",")]
    if len(given) == 1:
        try:
            return choose(known, compare, "comparison")
        except BadInput as error:
            raise BadInput(f"{error}, or A.B=C,D with values of one key") from None
    keys = [key for key, values in known.values() if set(given) <= set(values)]
    meant = f"{keys[0]}={compare}" if keys else f"A.B={compare}"
    raise BadInput(f"--compare {compare}: values of which key? Write --compare {meant}")


def _keys(key: str, base: MappingConfig) -> list[str]:
    """What is set for all sensors is set for each that the configuration names, too."""
    if not key.startswith(_OF_ALL_SENSORS):
        return [key]
    last = key.removeprefix(_OF_ALL_SENSORS)
    return [key, *(f"sensors.{name}.{last}" for name in base.sensors if name != "*")]


def _label(key: str, value: str) -> str:
    """The value, with the last part of its key where it means nothing by itself: 0.05, true."""
    text = value.strip("\"'/[]{} ")
    is_name = re.match(r"[^\W\d]", text) and text not in ("true", "false", "on", "off", "none")
    return text if is_name else f"{key.rpartition('.')[2]}-{text}"


def _name(text: str) -> str:
    """Fit for an entity of the recording and for a folder."""
    return re.sub(r"[^\w.-]+", "_", text).strip("_.") or "map"


def _distinct(variants: list[Variant]) -> list[Variant]:
    for name, count in Counter(variant.name for variant in variants).items():
        if count > 1:
            raise BadInput(f"{count} of the maps to compare would be called {name!r}: rename one")
    return variants
