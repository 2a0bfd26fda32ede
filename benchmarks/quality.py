"""How right are the maps? The table over rooms, sensors, models and rules: it chooses the default.

    python -m benchmarks.quality [--quick] [--rules fading,peak,...] [--kinds A,B,C,D,E]
        [--rooms empty,...] [--others FOLDER] [--set NAME:A.B=C,...]... [--no-lines] [--each]
        [--traces FILE...] [--seed 1] [--save FOLDER] [--json FILE]

Sessions of the built-in rooms, 3,000 sonar and 3,000 infrared readings each, and those of another
simulator, where they lie beside the checkout. Kind A has exact poses, B poses that are off by 1 cm
and 2 degrees each, C every sixth reading of A; of ours, D is driven far from walls, and in E all
walls are rough. What is judged is what ``echogrid score`` judges, in cells of 2 cm: log-loss of
free and wall cells alike; of kind A also AUC, wall found, the ghosts' area, and of lines
completeness/correctness within 5 cm. Each figure is the mean over rooms. ``learned`` is what
``echogrid learn --weights`` makes of other rooms of the same simulator. ``--set`` adds a row of
one's own: a name, and settings with commas between. ``--traces`` judges real sessions without
truth, by the readings that were kept out. ``--save`` keeps the simulated sessions for the next
time. ``--quick`` takes three rooms, A and C, and no lines: two minutes.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.quality_sessions import Case, others, simulated
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
from mapping.update_rules.rules import UPDATE_RULES
from recorder.importers import import_comp4807
from recorder.session.columns import open_session
from recorder.simulator.rooms import ROOMS
from replay.learning.run import learn
from replay.learning.strengths import strengths
from replay.learning.text import sensor_file
from replay.tables import text_table

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
RESOLUTION_M = 0.02
QUICK = ("cluttered", "pillar", "room")
TAUGHT_BY = 2  # rooms
COMMON = (f"grid.resolution_m={RESOLUTION_M}",)


@dataclass(frozen=True, slots=True)
class Variant:
    """A model and rule to judge: settings and preset of a configuration."""

    name: str
    settings: tuple[str, ...] = ()
    preset: str | None = None
    learned: bool = False

    def config(self, *files: Path) -> MappingConfig:
        """The whole configuration."""
        return load_config(files, [*COMMON, *self.settings], self.preset)


def _of_all(*settings: str) -> tuple[str, ...]:
    return tuple(f"sensors.*.{each}" for each in settings)


VARIANTS = (
    Variant("default"),
    Variant("fading", _of_all("model=fading", "update=bayes")),
    Variant("fading, half", ("sensors.ping.hit=0.4", "sensors.ping.miss=0.04")),
    Variant("fade 0.5 m", ("sensors.ping.fade_m=0.5",)),
    Variant("saturating", _of_all("update=saturating")),
    Variant("pooled", _of_all("update=pooled")),
    Variant("learned", _of_all("update=pooled"), learned=True),
    Variant("dempster-shafer", _of_all("update=dempster-shafer")),
    Variant("peak", _of_all("model=peak", "update=bayes")),
    Variant("chapter", (), "chapter"),
    Variant("himm", _of_all("update=himm")),
)


def _placed(session: Path, config: MappingConfig) -> PlacedSession:
    return place_session(open_session(session), config)


@dataclass(slots=True)
class Judge:
    """Maps a case with one variant after the other, and judges them; what is seen is found once.

    ``sensors`` is the file that was learned from other rooms.
    """

    case: Case
    lines: bool
    sensors: Path
    _seen: dict[GridGeometry, dict[str, NDArray[np.bool_]]] = field(default_factory=dict)

    def scores(self, variant: Variant) -> dict[str, LayerScore]:
        """By layer."""
        files = [self.sensors] if variant.learned else []
        config, truth = variant.config(*files), self.case.truth
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
        placed = _placed(self.case.session, config)
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


def learned_from(cases: Sequence[Case], number: int, folder: Path) -> Path:
    """What ``learn --weights`` makes of the next rooms of the same simulator, as a file."""
    case = cases[number]
    of_group = [each for each in cases if each.group == case.group and each.kind == "A"]
    others = [each for each in of_group if each.room != case.room]
    first = next((k for k, each in enumerate(others) if each.room > case.room), 0)
    others = [*others[first:], *others[:first]][:TAUGHT_BY]
    file = folder / f"learned_{case.group.replace(' ', '_')}_{case.room}.toml"
    if others and not file.exists():
        sessions, walls = [each.session for each in others], [each.walls for each in others]
        config = load_config([], [*COMMON, *_of_all("update=pooled")])
        learned = learn(sessions, config, walls=walls)
        strong = strengths(sessions, config, learned, walls=walls)
        file.write_text(sensor_file(learned, [each.name for each in sessions], strong), "utf-8")
    return file


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
                variant, *(f"{each['log_loss']:.3f}" if each else "-" for each in means),
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
        config = variant.config()
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
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--kinds")
    parser.add_argument("--rooms", help="built-in ones; - for none")
    parser.add_argument("--others", type=Path, default=SHARED / "rooms")
    parser.add_argument("--set", action="append", default=[], dest="own", metavar="NAME:A.B=C,...")
    parser.add_argument("--no-lines", action="store_true")
    parser.add_argument("--each", action="store_true")
    parser.add_argument("--traces", type=Path, nargs="*")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def main() -> None:
    """Print the table."""
    options = _options()
    with tempfile.TemporaryDirectory() as made:
        _judge_all(options, Path(made))


def _judge_all(options: argparse.Namespace, made: Path) -> None:
    quick, folder = options.quick, options.save or made
    kinds = (options.kinds or ("A,C" if quick else "A,B,C,D,E")).split(",")
    rooms = (options.rooms or ",".join(QUICK if quick else ROOMS)).split(",")
    variants = chosen(options.rules, options.own)
    folder.mkdir(parents=True, exist_ok=True)
    cases = [case for room in rooms if room != "-"
             for case in simulated(room, kinds, options.seed, folder)]  # fmt: skip
    cases += others(options.others, kinds)
    found: Found = {}
    for number, case in enumerate(cases):
        lines = case.kind == "A" and not (options.no_lines or quick)
        sensors = made / "none"
        if any(variant.learned for variant in variants):
            sensors = learned_from(cases, number, made)
        judge = Judge(case, lines, sensors)
        for variant in variants:
            if variant.learned and not sensors.exists():
                continue  # there is no other room to learn from
            for layer, score in judge.scores(variant).items():
                key = case.group, layer, variant.name, case.kind
                found.setdefault(key, {})[case.room] = figures_of(score)
        print(f"judged {case.room} {case.kind}, {case.group}", file=sys.stderr)
    print("\n".join(table(found, kinds, lines=not (options.no_lines or quick))))
    if options.each:
        print("\n".join(each_room(found)))
    traces = options.traces
    if traces is None:
        traces = [] if quick else sorted((SHARED / "comp4807").glob("*.trc"))
    for file in traces:
        plain = [variant for variant in variants if not variant.learned]
        print("\n".join(["", *without_truth(file, plain)]))
    if options.json:
        plain_rows = [
            {"group": group, "layer": layer, "variant": variant, "kind": kind, "rooms": by_room}
            for (group, layer, variant, kind), by_room in found.items()
        ]
        options.json.write_text(json.dumps(plain_rows, indent=1))


if __name__ == "__main__":
    main()
