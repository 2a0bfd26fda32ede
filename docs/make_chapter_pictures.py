"""The pictures of docs/chapter.md: ``python docs/make_chapter_pictures.py``.

They are those figures of the chapter, drawn from ``logs/room.mcap``, that the page names as
``images/chapter-NUMBER.png``.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path

from PIL import Image

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

COLOURS, WIDTH_PX = 128, 1100


def main() -> None:
    """Draw them."""
    from echogrid import main as echogrid

    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    page = (DOCS / "chapter.md").read_text("utf-8")
    numbers = re.findall(r"images/chapter-(\d+)\.png", page)
    session = DOCS.parent / "logs" / "room.mcap"
    with tempfile.TemporaryDirectory() as folder:
        only = [word for number in numbers for word in ("--only", str(int(number)))]
        drawn = Path(folder) / "figures"
        if code := echogrid(["figures", str(session), "-o", str(drawn), *only]):
            raise SystemExit(code)
        for number in numbers:
            (source,) = drawn.glob(f"{number}-*.png")
            picture = Image.open(source).convert("RGB")
            height = round(picture.height * WIDTH_PX / picture.width)
            small = picture.resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
            small.quantize(COLOURS).save(DOCS / "images" / f"chapter-{number}.png", optimize=True)


if __name__ == "__main__":
    main()
