"""Take the README's two pictures again: ``python docs/make_screenshot.py``.

Simulates a robot, maps its session and lets the real viewer draw two steps without a window: a
sonar reading over the half-built map, and the finished maps with their borders and lines. Needs a
Vulkan driver; ``sudo apt install mesa-vulkan-drivers`` brings one for the processor.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from mapping.artifacts import TempGrid
from mapping.config import load_config
from mapping.pipeline import build_maps
from recorder.errors import EchogridError
from recorder.session import read_session
from replay.rrd.headless import HeadlessViewer

REPOSITORY = Path(__file__).resolve().parent.parent
IMAGES = REPOSITORY / "docs" / "images"
SETTING = "grid.resolution_m=0.02"
SENSOR = "ping"
WIDTH_PX = 1400
MENU_PX = 36  # the viewer's own bar, of no interest here
GREETING_S = 8.0  # the viewer covers a corner with a message at first
MOST_BYTES = 400_000


def main() -> None:
    """Both pictures into docs/images."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        session, rrd = Path(folder, "room.mcap"), Path(folder, "room.rrd")
        _echogrid("simulate", "room", "-o", str(session), "--duration", "60", "--seed", "1")
        _echogrid("map", str(session), "-o", str(rrd), "--set", SETTING)
        middle, last = _steps(session)
        with HeadlessViewer(rrd) as viewer:
            time.sleep(GREETING_S)
            for name, step in (("demo.png", middle), ("lines.png", last)):
                viewer.go_to(step)
                size = _save(viewer.screenshot(), IMAGES / name)
                print(f"{name}: step {step}, {size} bytes")
            for complaint in viewer.complaints:
                print(complaint, file=sys.stderr)


def _echogrid(*arguments: str) -> None:
    command = [sys.executable, "-m", "echogrid", *arguments, "--quiet"]
    subprocess.run(command, check=True, cwd=REPOSITORY)


def _steps(session: Path) -> tuple[int, int]:
    """The middle one of the steps that show a sonar reading's temp grid, and the last step."""
    temps, last = [], 0
    for step, artifact in enumerate(build_maps(read_session(session).messages(),
                                               load_config(settings=[SETTING]))):  # fmt: skip
        last = step
        if isinstance(artifact, TempGrid) and artifact.beam.sensor == SENSOR:
            temps.append(step)
    return temps[len(temps) // 2], last


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
