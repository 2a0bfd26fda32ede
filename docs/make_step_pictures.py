"""What the viewer shows first, in the middle and last, to be looked at before and after a change.

``python docs/make_step_pictures.py OUT SESSION.mcap[=KEY=VALUE,...] ... [--beside BEFORE]`` maps
each session and lets the real viewer, without a window, draw three steps of it into ``OUT``. With
``--beside`` the pictures of the same names in another folder stand left of the new ones. Needs a
Vulkan driver, as ``docs/make_screenshot.py``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image

from recorder.errors import EchogridError
from replay.rrd.headless import HeadlessViewer
from replay.rrd.reader import read_rrd

REPOSITORY = Path(__file__).resolve().parent.parent
SIZE_PX = (1600, 1000)
GREETING_S = 8.0  # the viewer covers a corner with a message at first
PAINT_S = 1.5
SHOWN = "first", "middle", "last"


def main() -> None:
    """The pictures that the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("sessions", nargs="+", metavar="SESSION[=KEY=VALUE,...]")
    parser.add_argument("--beside", type=Path, help="folder with the same pictures as they were")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for session in given.sessions:
        path, _, settings = session.partition("=")
        take(Path(path).resolve(), settings.split(",") if settings else [], given.out, given.beside)


def take(session: Path, settings: list[str], out: Path, before: Path | None) -> None:
    """Map one session and draw its three steps."""
    rrd = out.resolve() / f"{session.stem}.rrd"
    asked = [part for setting in settings for part in ("--set", setting)]
    command = ["map", str(session), "-o", str(rrd), "--force", "--quiet", *asked]
    subprocess.run([sys.executable, "-m", "echogrid", *command], check=True, cwd=REPOSITORY)
    with HeadlessViewer(rrd, size=SIZE_PX) as viewer:
        time.sleep(GREETING_S)
        for name, step in zip(SHOWN, steps_of(rrd), strict=True):
            viewer.go_to(step, paint_s=PAINT_S)
            picture = viewer.screenshot()
            target = out / f"{session.stem}-{name}.png"
            if before is not None and (before / target.name).exists():
                picture = beside(Image.open(before / target.name), picture)
            picture.save(target)
            print(f"{target}: step {step}")
        for complaint in viewer.complaints:
            print(complaint, file=sys.stderr)


def steps_of(rrd: Path) -> tuple[int, int, int]:
    """The first step, the evidence of a reading in the middle, and the last."""
    steps = read_rrd(rrd).steps
    evidence = [each.step for each in steps if each.artifact == "TempGrid"]
    return steps[0].step, evidence[len(evidence) // 2], steps[-1].step


def beside(before: Image.Image, after: Image.Image) -> Image.Image:
    """Two pictures of one height, left and right."""
    both = Image.new("RGB", (before.width + after.width + 20, after.height), "white")
    both.paste(before, (0, 0))
    both.paste(after, (before.width + 20, 0))
    return both


if __name__ == "__main__":
    try:
        main()
    except EchogridError as error:
        raise SystemExit(str(error)) from None
