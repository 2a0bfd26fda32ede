"""How right are the maps? The table over rooms, sensors, models and rules: it chooses the default.

    python -m benchmarks.quality [--rules fading,peak,...] [--kinds A,B,C] [--rooms empty,...]
        [--others FOLDER] [--set NAME:A.B=C,...]... [--lines] [--each] [--traces FILE...]
        [--save FOLDER] [--json FILE]

Sessions of the built-in rooms, 3,000 sonar and 3,000 infrared readings each, and those of another
simulator, where they lie beside the checkout. Kind A has exact poses, B poses that are off by 1 cm
and 2 degrees each, C every sixth reading of A. What is judged is what ``echogrid score`` judges, in
cells of 2 cm: log-loss of free and wall cells alike, AUC, wall found, and the ghosts' area; each
figure is the mean over rooms. ``--set`` adds a row of one's own: a name, and settings with commas
between. ``--lines`` adds completeness/correctness within 5 cm, and takes longer. ``--traces``
judges real sessions without truth, by the readings that were kept out. ``--save`` keeps the
simulated sessions for the next time.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.artifacts import Segment, Snapshot
from mapping.config import MappingConfig, load_config
from mapping.fusion import fuse
from mapping.grid import GridGeometry, Layer
from mapping.layer_map import empty_maps
from mapping.pipeline import build_maps, geometry_of
from mapping.placed_session import PlacedSession, place_session
from mapping.scoring.held_out import held_out
from mapping.scoring.layers import LayerScore, score_layer
from mapping.scoring.observable import observable_cells, with_silent_readings
from mapping.scoring.truth import TrueWalls
from mapping.update_rules.rules import UPDATE_RULES
from recorder.importers import import_comp4807
from recorder.messages import Message, Pose, Range
from recorder.session import SessionWriter, read_session
from recorder.session.columns import open_session
from recorder.simulator.faults import RunFaults
from recorder.simulator.robot import DEFAULT_START_NS, Robot, simulate
from recorder.simulator.rooms import ROOMS
from recorder.truth import read_surfaced_walls
from replay.tables import text_table

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
RESOLUTION_M = 0.02
READINGS = 3000  # of each sensor
RATE_HZ = 20.0
THINNED = 6
SENSORS = ("ping", "dirrs")
COMMON = (f"grid.resolution_m={RESOLUTION_M}",)


@dataclass(frozen=True, slots=True)
class Variant:
    """A model and rule to judge: settings and preset of a configuration."""

    name: str
    settings: tuple[str, ...] = ()
    preset: str | None = None

    @property
    def config(self) -> MappingConfig:
        """The whole configuration."""
        return load_config([], [*COMMON, *self.settings], self.preset)


def _of_all(*settings: str) -> tuple[str, ...]:
    return tuple(f"sensors.*.{each}" for each in settings)


VARIANTS = (
    Variant("default"),
    Variant("fading", _of_all("model=fading", "update=bayes")),
    Variant("fading, half", ("sensors.ping.hit=0.4", "sensors.ping.miss=0.04")),
    Variant("fade 0.5 m", ("sensors.ping.fade_m=0.5",)),
    Variant("saturating", _of_all("update=saturating")),
    Variant("pooled", _of_all("update=pooled")),
    Variant("dempster-shafer", _of_all("update=dempster-shafer")),
    Variant("peak", _of_all("model=peak", "update=bayes")),
    Variant("chapter", (), "chapter"),
    Variant("himm", _of_all("update=himm")),
)


@dataclass(frozen=True, slots=True)
class Case:
    """A session to judge: ``seen_from`` is the one with its true poses."""

    group: str
    room: str
    kind: str
    truth: TrueWalls
    session: Sequence[Message] | Path
    seen_from: Sequence[Message] | Path

    def placed(self, config: MappingConfig) -> PlacedSession:
        """Its readings in the map frame."""
        return _placed(self.session, config)


def _placed(session: Sequence[Message] | Path, config: MappingConfig) -> PlacedSession:
    return place_session(open_session(session) if isinstance(session, Path) else session, config)


def simulated(room: str, kinds: Sequence[str], seed: int, folder: Path | None) -> Iterator[Case]:
    """The kinds of session of a built-in room, made or read again from a folder."""
    truth, of_kind = TrueWalls.of(ROOMS[room].walls_m, ROOMS[room].surfaces), {}
    for kind in dict.fromkeys(["A", *kinds]):
        file = None if folder is None else folder / f"{room}_{kind}_{seed}.mcap"
        if file is None or not file.exists():
            messages = _simulated(room, kind, seed)
            if file is not None:
                _write(file, messages)
            of_kind[kind] = messages
        else:
            of_kind[kind] = [record.message for record in read_session(file).records]
    for kind in kinds:
        yield Case("ours", room, kind, truth, of_kind[kind], of_kind["C" if kind == "C" else "A"])


def _simulated(room: str, kind: str, seed: int) -> list[Message]:
    faults = RunFaults(pose_noise_m=0.01, pose_noise_deg=2.0) if kind == "B" else RunFaults()
    robot = Robot(ROOMS[room], seed=seed)
    pairs = simulate(ROOMS[room], duration_s=READINGS / RATE_HZ, seed=seed, faults=faults)
    messages, count = [], dict.fromkeys(SENSORS, 0)
    for _, message in pairs:
        if isinstance(message, Range):
            count[message.sensor] += 1
            if kind == "C" and count[message.sensor] % THINNED:
                continue
        if isinstance(message, Pose) and kind != "B":
            true = robot.world_from_base(message.t_ns - DEFAULT_START_NS)
            message = replace(message, world_from_base=true)
        messages.append(message)
    return messages


def _write(file: Path, messages: Iterable[Message]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with SessionWriter(file, force=True) as session:
        for message in messages:
            session.write(message, log_ns=message.t_ns)


def others(folder: Path, kinds: Sequence[str]) -> Iterator[Case]:
    """The sessions of another simulator: ROOM_KIND.mcap beside ROOM.geojson."""
    for walls in sorted(folder.glob("*.geojson")):
        for kind in kinds:
            file = folder / f"{walls.stem}_{kind}.mcap"
            if file.exists():
                seen_from = folder / f"{walls.stem}_{'C' if kind == 'C' else 'A'}.mcap"
                truth = TrueWalls.of(*read_surfaced_walls(walls))
                yield Case("other simulator", walls.stem, kind, truth, file, seen_from)


@dataclass(slots=True)
class Judge:
    """Maps a case with one variant after the other, and judges them; what is seen is found once."""

    case: Case
    lines: bool
    _seen: dict[GridGeometry, dict[str, NDArray[np.bool_]]] = field(default_factory=dict)

    def scores(self, variant: Variant) -> dict[str, LayerScore]:
        """By layer."""
        config, truth = variant.config, self.case.truth
        layers, lines = self._maps(config)
        geometry = layers[0].geometry
        if geometry not in self._seen:
            looking = _placed(self.case.seen_from, with_silent_readings(config))
            self._seen[geometry] = observable_cells(looking, truth, geometry)
        seen = self._seen[geometry]
        return {
            each.name: score_layer(
                each.name, each.probability, geometry, lines.get(each.name, {}), truth,
                seen[each.name],
            )
            for each in layers
        }  # fmt: skip

    def _maps(
        self, config: MappingConfig
    ) -> tuple[list[Layer], dict[str, dict[str, NDArray[np.float64]]]]:
        placed = self.case.placed(config)
        if not self.lines:
            sensors = placed.placement.sensors
            maps = empty_maps(sensors, geometry_of(placed, config), config.grid)
            for readings in placed:
                for each in maps.values():
                    each.merge_many(readings)
            layers = [each.layer() for each in maps.values()]
            return [*layers, fuse(layers, sensors, config.fusion)], {}
        layers, found = [], dict[str, dict[str, list[Segment]]]()
        for artifact in build_maps(placed, config, watched=False):
            if isinstance(artifact, Snapshot):
                layers.append(artifact.layer)
                found[artifact.layer.name] = {"grid": []}
            elif isinstance(artifact, Segment):
                found[artifact.layer].setdefault(artifact.source, []).append(artifact)
        ends = {
            name: {
                source: np.array([(s.start_m, s.end_m) for s in of]).reshape(-1, 2, 2)
                for source, of in by_source.items()
            }
            for name, by_source in found.items()
        }
        return layers, ends


def figures_of(score: LayerScore) -> dict[str, float]:
    """What the table takes of a score."""
    cells = score.cells
    figures = {
        "log_loss": cells.log_loss, "brier": cells.brier, "auc": cells.auc,
        "calibration_error": cells.calibration_error, "wall_found": cells.wall_found,
        "ghost_m2": cells.ghost_m2,
    }  # fmt: skip
    for line in score.lines:
        within = line.within[1]
        figures[f"{line.source}_completeness"] = within.completeness
        figures[f"{line.source}_correctness"] = within.correctness
        figures[f"{line.source}_angle_deg"] = line.angle_deg
        figures[f"{line.source}_per_wall"] = line.fragmentation
        figures[f"{line.source}_offset_m"] = line.offset_m
    return figures


Key = tuple[str, str, str, str]  # group, layer, variant, kind
Found = dict[Key, dict[str, dict[str, float]]]  # by room, by figure


def table(found: Found, kinds: Sequence[str], *, lines: bool) -> list[str]:
    """Means over rooms, a row for each layer and variant of a group."""
    texts = []
    for group, layer in dict.fromkeys((group, layer) for group, layer, _, _ in found):
        variants = dict.fromkeys(key[2] for key in found if key[:2] == (group, layer))
        rows = [[
            f"{group}, {layer}", *(f"log-loss {kind}" for kind in kinds), "AUC", "found",
            "ghosts m2", "calibr.", *(["grid lines", "raw lines", "offset", "turned"] * lines),
        ]]  # fmt: skip
        for variant in variants:
            means = [mean_of(found.get((group, layer, variant, kind), {})) for kind in kinds]
            first = means[0]
            row = [
                variant, *(f"{each.get('log_loss', math.nan):.3f}" for each in means),
                f"{first['auc']:.3f}", f"{100 * first['wall_found']:.0f} %",
                f"{first['ghost_m2']:.2f}", f"{first['calibration_error']:.3f}",
            ]  # fmt: skip
            if lines:
                row += [_lines(first, source) for source in ("grid", "raw")]
                row += [
                    f"{100 * first['grid_offset_m']:.1f} cm", f"{first['grid_angle_deg']:.1f} deg",
                ]  # fmt: skip
            rows.append(row)
        texts += [*text_table(rows), ""]
    return texts


def _lines(means: dict[str, float], source: str) -> str:
    shares = [means.get(f"{source}_{what}") for what in ("completeness", "correctness")]
    return "/".join("-" if share is None else f"{100 * share:.0f}" for share in shares)


def mean_of(by_room: dict[str, dict[str, float]]) -> dict[str, float]:
    """Each figure's mean over rooms, without those that have none."""
    keys = dict.fromkeys(key for figures in by_room.values() for key in figures)
    values = {key: [f[key] for f in by_room.values() if not math.isnan(f.get(key, math.nan))]
              for key in keys}  # fmt: skip
    return {key: float(np.mean(each)) if each else math.nan for key, each in values.items()}


def each_room(found: Found) -> list[str]:
    """Log-loss and ghosts of each room."""
    rows = [["room", "kind", "layer", "variant", "log-loss", "ghosts m2"]]
    for (group, layer, variant, kind), by_room in found.items():
        rows += [
            [f"{room} ({group})", kind, layer, variant, f"{f['log_loss']:.3f}",
             f"{f['ghost_m2']:.2f}"]
            for room, f in by_room.items()
        ]  # fmt: skip
    return text_table(rows, left=(0, 1, 2, 3))


def without_truth(file: Path, variants: Sequence[Variant]) -> list[str]:
    """A real session's score by its own readings, for each variant, and the gain over the first."""
    rows, first = [[file.name, "log-likelihood", "gain", "from", "to"]], None
    for variant in variants:
        config = variant.config
        if file.suffix == ".mcap":
            placed = place_session(open_session(file), config)
        else:
            placed = place_session([m for _, m in import_comp4807(file).records], config)
        judged = held_out(placed, config, geometry_of(placed, config))
        row = [variant.name, f"{judged.scores.mean:.3f}"]
        if first is not None:
            gain = judged.gain_over(first)
            row += [f"{gain.mean:+.3f}", f"{gain.low:+.3f}", f"{gain.high:+.3f}"]
        first = first or judged
        rows.append([*row, *[""] * (5 - len(row))])
    return text_table(rows)


def chosen(names: str | None, own: Sequence[str]) -> list[Variant]:
    """The variants to judge; those of rules that are not there are left out."""
    every = [*VARIANTS]
    for text in own:
        name, _, settings = text.partition(":")
        every.append(Variant(name, tuple(settings.split(","))))
    wanted = None if names is None else [name.strip() for name in names.split(",")]
    rules = {v.name: v for v in every if v.name not in ("saturating", "pooled")
             or v.name in UPDATE_RULES}  # fmt: skip
    if wanted is None:
        return list(rules.values())
    return [rules[name] for name in [*wanted, *(text.partition(":")[0] for text in own)]]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rules", help="names of variants, with commas between")
    parser.add_argument("--kinds", default="A,B,C")
    parser.add_argument("--rooms", default=",".join(ROOMS), help="built-in ones; - for none")
    parser.add_argument("--others", type=Path, default=SHARED / "rooms")
    parser.add_argument("--set", action="append", default=[], dest="own", metavar="NAME:A.B=C,...")
    parser.add_argument("--lines", action="store_true")
    parser.add_argument("--each", action="store_true")
    parser.add_argument("--traces", type=Path, nargs="*", default=[])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def main() -> None:
    """Print the table."""
    options = _options()
    kinds = options.kinds.split(",")
    rooms = [] if options.rooms == "-" else options.rooms.split(",")
    variants = chosen(options.rules, options.own)
    cases = [case for room in rooms for case in simulated(room, kinds, options.seed, options.save)]
    cases += others(options.others, kinds)
    found: Found = {}
    for case in cases:
        judge = Judge(case, options.lines)
        for variant in variants:
            for layer, score in judge.scores(variant).items():
                key = case.group, layer, variant.name, case.kind
                found.setdefault(key, {})[case.room] = figures_of(score)
    print("\n".join(table(found, kinds, lines=options.lines)))
    if options.each:
        print("\n".join(each_room(found)))
    for file in options.traces:
        print("\n".join(["", *without_truth(file, variants)]))
    if options.json:
        plain = [
            {"group": group, "layer": layer, "variant": variant, "kind": kind, "rooms": by_room}
            for (group, layer, variant, kind), by_room in found.items()
        ]
        options.json.write_text(json.dumps(plain, indent=1))


if __name__ == "__main__":
    main()
