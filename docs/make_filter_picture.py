"""The picture of docs/filter.md: a reading that a filter left out, as the viewer shows it.

``python docs/make_filter_picture.py`` needs a Vulkan driver, as ``docs/make_screenshot.py``.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from recorder.errors import EchogridError
from replay.rrd.headless import HeadlessViewer
from replay.rrd.reader import read_rrd

REPOSITORY = Path(__file__).resolve().parent.parent
SESSION, OUT = "logs/room.mcap", REPOSITORY / "docs" / "images" / "filter-rejected.png"
SIZE_PX, COLOURS = (1600, 1000), 96
GREETING_S, PAINT_S = 8.0, 2.0


def main() -> None:
    """Map a session with a filter and draw the middle one of the readings that it left out."""
    with tempfile.TemporaryDirectory() as folder:
        rrd = Path(folder) / "run.rrd"
        asked = ["--set", "sensors.ping.filter=median", "--quiet"]
        command = [sys.executable, "-m", "echogrid", "map", SESSION, "-o", str(rrd), *asked]
        subprocess.run(command, check=True, cwd=REPOSITORY)
        steps = [each.step for each in read_rrd(rrd).steps if each.artifact == "RejectedReading"]
        with HeadlessViewer(rrd, size=SIZE_PX) as viewer:
            time.sleep(GREETING_S)
            viewer.go_to(steps[len(steps) // 2], paint_s=PAINT_S)
            viewer.screenshot().quantize(COLOURS).save(OUT, optimize=True)


if __name__ == "__main__":
    try:
        main()
    except EchogridError as error:
        raise SystemExit(str(error)) from None
