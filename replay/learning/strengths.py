"""Sessions in rooms with known walls → how strong their sensors' evidence should be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from mapping.config import MappingConfig, validate
from mapping.learning.sensors import LearnedSensor
from mapping.learning.strengths import Case, LearnedStrengths, learn_strengths
from mapping.pipeline import geometry_of
from mapping.placed_session import place_session
from mapping.readings import Readings
from mapping.scoring.observable import with_silent_readings
from mapping.scoring.truth import TrueWalls
from recorder.errors import BadInput
from recorder.session.columns import open_session
from recorder.simulator.rooms import named_walls
from recorder.truth import true_surfaces, true_walls

RESOLUTION_M = 0.02  # of the maps that are judged


def strengths(
    sessions: Sequence[Path],
    config: MappingConfig,
    learned: Sequence[LearnedSensor],
    *,
    walls: Sequence[str] = (),
    known: bool = True,
    only: Sequence[str] = (),
) -> list[LearnedStrengths]:
    """What suits each layer of some sessions best, with what was ``learned`` of its sensors.

    ``walls`` are those of all sessions, or of each in order; without them their own count. Where
    walls are not ``known``, readings that are kept out judge. Raises BadInput, in one line, where
    walls are missing, or nothing can be learned.
    """
    mended = _mended(config, learned)
    of_layer: dict[str, list[Case]] = {}
    for path, given in zip(sessions, walls_of_each(walls, sessions), strict=True):
        for case in _cases(path, given, mended, known=known):
            mine = {s.name for s in case.readings.sensors if s.layer == case.layer}
            if not only or mine & set(only):
                of_layer.setdefault(case.layer, []).append(case)
    found, reasons = [], []
    for cases in of_layer.values():
        try:
            found.append(learn_strengths(cases))
        except BadInput as error:
            reasons.append(str(error))
    if not found:
        raise BadInput("; ".join(reasons) or "there is no layer to learn the weights of")
    return found


def walls_of_each(walls: Sequence[str], sessions: Sequence[Path]) -> list[str | None]:
    """What was given for all sessions, or for each of them; None: its own. BadInput otherwise."""
    if len(walls) not in (0, 1, len(sessions)):
        raise BadInput(
            f"{len(walls)} times --walls for {len(sessions)} sessions: give one for all, or one "
            "for each in order"
        )
    return [*walls] if len(walls) == len(sessions) else [*(walls or (None,))] * len(sessions)


def _cases(path: Path, given: str | None, config: MappingConfig, *, known: bool) -> Iterator[Case]:
    session = open_session(path)
    placed = place_session(session, config)
    truth, geometry = None, geometry_of(placed, config)
    own_m = true_walls(session.attachments)
    if known and given is not None:
        truth = TrueWalls.of(*named_walls(given))
    elif known and own_m is not None:
        truth = TrueWalls.of(own_m, true_surfaces(session.attachments))
    elif known:
        raise BadInput(f"{path} carries no walls, as other sessions do: --walls ROOM or GEOJSON")
    room = b"" if truth is None else truth.walls_m.tobytes()
    readings = Readings.joined(list(placed))
    looking = Readings.joined(list(place_session(open_session(path), with_silent_readings(config))))
    for layer in dict.fromkeys(sensor.layer for sensor in placed.placement.sensors):
        yield Case(
            path.name, room, layer, _of(readings, layer), _of(looking, layer),
            geometry, truth,
        )  # fmt: skip


def _of(readings: Readings, layer: str) -> Readings:
    """Those of a layer."""
    mine = [number for number, each in enumerate(readings.sensors) if each.layer == layer]
    kept = readings.sensor == mine[0]
    for number in mine[1:]:
        kept |= readings.sensor == number
    return readings.chosen(kept)


def _mended(config: MappingConfig, learned: Sequence[LearnedSensor]) -> MappingConfig:
    """The configuration with what was learned of the sensors, in cells that are judged fast."""
    values = config.model_dump(exclude_none=True)
    values["grid"] = {**values["grid"], "resolution_m": RESOLUTION_M}
    sensors = values.setdefault("sensors", {})
    for each in learned:
        sensors[each.sensor.name] = {**sensors.get(each.sensor.name, {}), **each.settings()}
    return validate(values)
