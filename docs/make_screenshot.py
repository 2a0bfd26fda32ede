"""Take the pictures of the viewer again: ``python docs/make_screenshot.py [NAME ...]``.

Simulates a robot, maps its session and lets the real viewer draw steps of it, without a window: for
the README and ``docs/recording.md``. Needs a Vulkan driver; ``sudo apt install
mesa-vulkan-drivers`` brings one for the processor.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from mapping.artifacts import Artifact, MergedGrid, TempGrid
from mapping.beams import Beam
from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.errors import EchogridError
from recorder.session import read_session
from replay.rrd.blueprints import CHANGES, DISPLAYS
from replay.rrd.headless import HeadlessViewer

REPOSITORY = Path(__file__).resolve().parent.parent
IMAGES = REPOSITORY / "docs" / "images"
# The room and a little around it: a map as large as can be.
SETTINGS = (
    "grid.resolution_m=0.02", "grid.origin_m=[-0.3, -0.3]", "grid.size_m=[2.8, 2.2]",
)  # fmt: skip
WATCHED = (2.21, 0.21)  # a cell on the right wall
WIDTH_PX = 1400
MENU_PX = 36  # the viewer's own bar, of no interest here
GREETING_S = 8.0  # the viewer covers a corner with a message at first
MOST_BYTES = 400_000

Artifacts = Sequence[Artifact]


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture: its name, the tabs in front, its step, and whether a cell is watched in it."""

    name: str
    step: Callable[[Artifacts], int]
    tabs: tuple[str, ...] = ()
    watched: bool = False


def middle_sonar(artifacts: Artifacts) -> int:
    """A sonar reading over the half-built map."""
    steps = [
        step for step, a in enumerate(artifacts)
        if isinstance(a, TempGrid) and a.beam.sensor == "ping"
    ]  # fmt: skip
    return steps[len(steps) // 2]


def a_beam(artifacts: Artifacts) -> int:
    """The step before: the same reading's beam, and what the map foretells of it."""
    return middle_sonar(artifacts) - 1


def largest_change(artifacts: Artifacts) -> int:
    """The reading that made most cells of a half-built map both clearly fuller and emptier."""

    def both_ways(step: int) -> int:
        merged = artifacts[step]
        if not isinstance(merged, MergedGrid):
            return -1
        difference = merged.probability - merged.previous
        return min(int((difference > 0.03).sum()), int((difference < -0.03).sum()))

    return max(range(len(artifacts) // 3, len(artifacts)), key=both_ways)


def late_reading(artifacts: Artifacts) -> int:
    """A reading in the last quarter."""
    steps = [step for step, a in enumerate(artifacts) if isinstance(a, Beam)]
    return steps[3 * len(steps) // 4] + 2


def last(artifacts: Artifacts) -> int:
    """The end."""
    return len(artifacts) - 1


SHOTS = (
    Shot("demo.png", middle_sonar),
    Shot("lines.png", last),
    Shot("recording-beam.png", a_beam),
    Shot("recording-changes.png", largest_change, (CHANGES,)),
    Shot("recording-classes.png", last, ("classes: where the sensors agree",)),
    Shot("recording-displays.png", last, (DISPLAYS,)),
    Shot("recording-probe.png", late_reading, watched=True),
)


def main() -> None:
    """The asked pictures, or all, into docs/images."""
    asked = [shot for shot in SHOTS if shot.name in sys.argv[1:]] or list(SHOTS)
    IMAGES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder, "room.mcap")
        _echogrid("simulate", "room", "-o", str(session), "--duration", "60", "--seed", "1")
        config = load_config(settings=SETTINGS)
        artifacts = list(build_maps(read_session(session).messages(), config))
        for watched in (False, True):
            shots = [shot for shot in asked if shot.watched == watched]
            if shots:
                rrd = Path(folder, f"room-{watched}.rrd")
                _map(session, rrd, watched=watched)
                _take(rrd, shots, artifacts)


def _map(session: Path, rrd: Path, *, watched: bool) -> None:
    probe = ["--probe", f"{WATCHED[0]},{WATCHED[1]}"] if watched else []
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    _echogrid("map", str(session), "-o", str(rrd), *settings, *probe)


def _take(rrd: Path, shots: Sequence[Shot], artifacts: Artifacts) -> None:
    with HeadlessViewer(rrd) as viewer:
        time.sleep(GREETING_S)
        for shot in shots:
            viewer.bring_to_front("ping")
            for tab in shot.tabs:
                viewer.bring_to_front(tab)
            step = shot.step(artifacts)
            viewer.go_to(step)
            size = _save(viewer.screenshot(), IMAGES / shot.name)
            print(f"{shot.name}: step {step}, {size} bytes")
        for complaint in viewer.complaints:
            print(complaint, file=sys.stderr)


def _echogrid(*arguments: str) -> None:
    command = [sys.executable, "-m", "echogrid", *arguments, "--quiet"]
    subprocess.run(command, check=True, cwd=REPOSITORY)


def _save(taken: Image.Image, target: Path) -> int:
    """Cut off the menu, scale down, keep 256 colours for a small file; returns its bytes."""
    window = taken.crop((0, MENU_PX, taken.width, taken.height))
    height = round(window.height * WIDTH_PX / window.width)
    small = window.resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    small.quantize(256, dither=Image.Dither.NONE).save(target, optimize=True)
    size = target.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"{target.name} has {size} bytes, more than {MOST_BYTES}")
    return size


if __name__ == "__main__":
    try:
        main()
    except EchogridError as error:
        raise SystemExit(str(error)) from None
