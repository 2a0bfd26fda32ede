"""The colours that mean something, in every picture alike, and in which order sensors stand.

Recordings, exported pictures, differences and legends take them from here, so that a sensor has one
colour and one place wherever it is seen: what its name says of its kind decides, never the order in
which readings came. Sensors of one kind share a hue, in shades. No sensor looks like what is drawn
over all maps alike (borders, lines, walls, the robot).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from recorder.messages import Radiation
from recorder.sensors import guess_kind, time_of_flight

Colour = tuple[int, int, int]

FREE: Colour = (255, 255, 255)
OCCUPIED: Colour = (0, 0, 0)
NEVER_SEEN: Colour = (150, 158, 178)
MORE_OCCUPIED: Colour = (214, 39, 40)
MORE_FREE: Colour = (31, 100, 210)
TRUE_WALL: Colour = (46, 160, 67)
ABOVE_THRESHOLD: Colour = (255, 205, 0)
BORDER: Colour = (0, 205, 200)
LINE: Colour = (230, 0, 160)  # fitted to a grid: the walls that were found
ROBOT: Colour = (0, 140, 125)
REJECTED: Colour = (230, 110, 150)  # left out, as the dropped ones in the plot of ranges
CONTRADICTION: Colour = (220, 30, 30)
FUSED: Colour = (130, 130, 130)

_HUES: dict[str, Colour] = {
    "orange": (245, 110, 0), "violet": (145, 80, 230), "lime": (145, 160, 0),
    "brown": (165, 100, 55), "rose": (230, 110, 150), "blue": (0, 115, 230),
}  # fmt: skip
_KINDS = ("orange", "violet", "brown", "lime")  # sound, infrared, time of flight, lasers that scan
_FUSED_NAME = "fused"
_LIGHTEST, _DARKEST = 0.45, -0.4  # of the shades of one hue: towards white, and towards black


def sensor_colours(
    names: Iterable[str], layer_of: Mapping[str, str] | None = None
) -> dict[str, Colour]:
    """The colour of each sensor and layer in ``names``, whatever their order.

    ``layer_of`` names the layer of each sensor that shares one with others: their shades are of its
    hue, and the layer has the hue itself.
    """
    return {name: _shaded(*shade) for name, shade in _shades(names, layer_of or {}).items()}


def sensor_colour_names(
    names: Iterable[str], layer_of: Mapping[str, str] | None = None
) -> dict[str, str]:
    """The same in words: ``orange``, ``light orange``, ``dark orange``."""
    words = {}
    for name, (hue, tone) in _shades(names, layer_of or {}).items():
        how = "light " if tone > 0.1 else "dark " if tone < -0.1 else ""
        words[name] = how + (hue or "grey")
    return words


def in_place(names: Iterable[str]) -> list[str]:
    """Sensors or layers in the order in which they stand side by side, each once, fused last.

    Sound, infrared, time of flight, lasers, then what nobody knows; by name within each.
    """
    return sorted(dict.fromkeys(names), key=_place)


def pale(colour: Colour, share: float = 0.75) -> Colour:
    """A colour mixed with white."""
    return _shaded_colour(colour, share)


def _place(name: str) -> tuple[object, ...]:
    number = _kind_number(name)
    natural = [(int(part), "") if part.isdigit() else (-1, part)
               for part in re.split(r"(\d+)", name.lower())]  # fmt: skip
    return (name == _FUSED_NAME, len(_KINDS) if number is None else number, natural, name)


def _kind_number(name: str) -> int | None:
    """Which of :data:`_KINDS` a name tells of."""
    kind = guess_kind(name)
    if kind is None:
        return None
    if kind in time_of_flight.KINDS:
        return 2
    return {Radiation.ULTRASOUND: 0, Radiation.INFRARED: 1, Radiation.LASER: 3}[kind.radiation]


def _shades(
    names: Iterable[str], layer_of: Mapping[str, str]
) -> dict[str, tuple[str | None, float]]:
    """Hue (None: of all together) and tone (0: as it is, above: lighter) of each name."""
    ordered = [name for name in in_place([*names, *layer_of]) if name != _FUSED_NAME]
    layers = set(layer_of.values())
    sensors = [name for name in ordered if name not in layers or layer_of.get(name) == name]
    groups = {name: layer_of.get(name, name) for name in ordered}
    hues = _hues(in_place(groups.values()), groups)
    of_hue: dict[str, list[str]] = {}
    for sensor in sensors:
        of_hue.setdefault(hues[groups[sensor]], []).append(sensor)
    found: dict[str, tuple[str | None, float]] = {_FUSED_NAME: (None, 0.0)}
    for hue, same in of_hue.items():
        for sensor, tone in zip(same, _tones(len(same)), strict=True):
            found[sensor] = (hue, tone)
    for layer in in_place(groups.values()):
        found.setdefault(layer, (hues[layer], 0.0))
    return found


def _hues(layers: Sequence[str], groups: Mapping[str, str]) -> dict[str, str]:
    """The hue of each layer: of its kind, or else the first that no other has."""
    hues: dict[str, str] = {}
    for layer in layers:
        named = [layer, *(name for name, group in groups.items() if group == layer)]
        known = next((n for n in map(_kind_number, named) if n is not None), None)
        if known is not None:
            hues[layer] = _KINDS[known]
    for number, layer in enumerate(layer for layer in layers if layer not in hues):
        left = [hue for hue in _HUES if hue not in hues.values()]
        hues[layer] = left[0] if left else list(_HUES)[number % len(_HUES)]
    return hues


def _tones(count: int) -> list[float]:
    """From light to dark; one alone is as its hue is."""
    if count == 1:
        return [0.0]
    return [_LIGHTEST + (_DARKEST - _LIGHTEST) * n / (count - 1) for n in range(count)]


def _shaded(hue: str | None, tone: float) -> Colour:
    return FUSED if hue is None else _shaded_colour(_HUES[hue], tone)


def _shaded_colour(colour: Colour, tone: float) -> Colour:
    """Mixed with white (``tone`` above 0) or with black, by so large a share."""
    target = 255 if tone > 0 else 0
    r, g, b = (round(value + abs(tone) * (target - value)) for value in colour)
    return r, g, b
