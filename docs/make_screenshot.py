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

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mapping.artifacts import Artifact, MergedGrid, TempGrid
from mapping.beams import Beam
from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.errors import EchogridError
from recorder.session import read_session
from replay.rrd import layout
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
STRIP = "reading.png"
STRIP_WINDOW_PX = (2400, 1500)  # large, so that a part of it is still sharp
PANEL_PX, CAPTION_PX, GAP_PX = 460, 34, 10

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
    """The step before: the same reading's beam, and what the map predicts of it."""
    return middle_sonar(artifacts) - 1


def largest_change(artifacts: Artifacts) -> int:
    """The reading that made most cells of a half-built map clearly more occupied or more free."""

    def both_ways(step: int) -> int:
        merged = artifacts[step]
        if not isinstance(merged, MergedGrid):
            return -1
        difference = merged.probability - merged.previous
        return min(int((difference > 0.03).sum()), int((difference < -0.03).sum()))

    return max(range(len(artifacts) // 3, len(artifacts)), key=both_ways)


def clearest_change(artifacts: Artifacts) -> int:
    """The sonar reading that changed most cells clearly, and made some more occupied."""

    def seen(step: int) -> int:
        merged = artifacts[step]
        if not isinstance(merged, MergedGrid) or merged.layer != "ping":
            return -1
        difference = merged.probability - merged.previous
        occupied = int((difference > 0.04).sum())
        return int((np.abs(difference) > 0.12).sum()) if occupied > 100 else 0

    return max(range(len(artifacts)), key=seen)


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
    unknown = set(sys.argv[1:]) - {STRIP, *(shot.name for shot in SHOTS)}
    if unknown:
        sys.exit(f"no such picture: {', '.join(sorted(unknown))}")
    strip = not sys.argv[1:] or STRIP in sys.argv[1:]
    asked = [shot for shot in SHOTS if shot.name in sys.argv[1:] or not sys.argv[1:]]
    IMAGES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder, "room.mcap")
        _echogrid("simulate", "room", "-o", str(session), "--duration", "60", "--seed", "1")
        config = load_config(settings=SETTINGS)
        artifacts = list(build_maps(read_session(session).messages(), config))
        for watched in (False, True):
            shots = [shot for shot in asked if shot.watched == watched]
            if shots or (strip and not watched):
                rrd = Path(folder, f"room-{watched}.rrd")
                _map(session, rrd, watched=watched)
                _take(rrd, shots, artifacts)
                if strip and not watched:
                    _take_strip(rrd, artifacts)


def _map(session: Path, rrd: Path, *, watched: bool) -> None:
    probe = ["--probe", f"{WATCHED[0]},{WATCHED[1]}"] if watched else []
    settings = [part for setting in SETTINGS for part in ("--set", setting)]
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


def _take_strip(rrd: Path, artifacts: Artifacts) -> None:
    """The three steps of one reading side by side: the map of its sensor in each."""
    merged = clearest_change(artifacts)
    beam = artifacts[merged - 2]
    assert isinstance(beam, Beam), "a reading is a beam, its evidence, and what it changed"
    captions = (
        f"1  the sonar measures {beam.ranges_m[0]:.2f} m",
        "2  maybe there (red), not here (blue)",
        "3  the map with this reading",
    )
    with HeadlessViewer(rrd, size=STRIP_WINDOW_PX) as viewer:
        time.sleep(GREETING_S)
        panels = []
        for step in (merged - 2, merged - 1, merged):
            if step == merged:  # the beam would hide what it did
                viewer.switch(beam.layer, layout.beam(beam.layer), on=False)
            viewer.go_to(step)
            time.sleep(GREETING_S / 4)  # the window is large, and loads while it draws
            panels.append(viewer.screenshot(beam.layer))
    box = _map_box(panels[0])
    panels = [panel.crop(box) for panel in panels]
    height = round(panels[0].height * PANEL_PX / panels[0].width)
    width = len(panels) * (PANEL_PX + GAP_PX) - GAP_PX
    whole = Image.new("RGB", (width, height + CAPTION_PX), "white")
    pen = ImageDraw.Draw(whole)
    for number, (panel, caption) in enumerate(zip(panels, captions, strict=True)):
        left = number * (PANEL_PX + GAP_PX)
        pen.text((left + 2, 4), caption, "black", ImageFont.load_default(20))
        small = panel.resize((PANEL_PX, height), Image.Resampling.LANCZOS)
        whole.paste(small, (left, CAPTION_PX))
    target = IMAGES / STRIP
    _few_colours(whole).save(target, optimize=True)
    print(f"{STRIP}: step {merged}, {target.stat().st_size} bytes")


def _map_box(view: Image.Image) -> tuple[int, int, int, int]:
    """The map without the dark around it: much of it is as bright as what was never seen."""
    bright = view.convert("L").point(lambda value: 255 * (value > 128))
    rows = [y for y in range(view.height) if _share(bright.crop((0, y, view.width, y + 1))) > 0.3]
    cols = [x for x in range(view.width) if _share(bright.crop((x, 0, x + 1, view.height))) > 0.2]
    return cols[0], rows[0], cols[-1] + 1, rows[-1] + 1


def _few_colours(picture: Image.Image) -> Image.Image:
    """256 colours, for a small file; those of thin lines are kept apart from others."""
    return picture.quantize(256, kmeans=3, dither=Image.Dither.NONE)


def _share(strip: Image.Image) -> float:
    return strip.histogram()[255] / (strip.width * strip.height)


def _echogrid(*arguments: str) -> None:
    command = [sys.executable, "-m", "echogrid", *arguments, "--quiet"]
    subprocess.run(command, check=True, cwd=REPOSITORY)


def _save(taken: Image.Image, target: Path) -> int:
    """Cut off the menu, scale down, keep 256 colours for a small file; returns its bytes."""
    window = taken.crop((0, MENU_PX, taken.width, taken.height))
    height = round(window.height * WIDTH_PX / window.width)
    small = window.resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    _few_colours(small).save(target, optimize=True)
    size = target.stat().st_size
    if size > MOST_BYTES:
        raise SystemExit(f"{target.name} has {size} bytes, more than {MOST_BYTES}")
    return size


if __name__ == "__main__":
    try:
        main()
    except EchogridError as error:
        raise SystemExit(str(error)) from None
