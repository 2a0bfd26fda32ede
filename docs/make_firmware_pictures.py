"""The pictures of docs/firmware.md: ``python docs/make_firmware_pictures.py [MAPS]``.

The wiring as SVG, and as PNG by a browser (without Chromium only the SVG is made). MAPS is a
folder that ``map --export`` wrote of a drive of the simulated board in ``room``: its infrared map,
with the room's walls.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from recorder.simulator.rooms import load_room

IMAGES = Path(__file__).resolve().parent / "images"
WIDTH, HEIGHT = 1000, 640
BOARD_X, BOARD_W, BOARD_TOP, PIN_STEP = 390, 220, 70, 36
RED, BLACK, BLUE, GREEN, ORANGE, VIOLET = (
    "#c62828", "#222222", "#1565c0", "#2e7d32", "#ef6c00", "#6a1b9a",
)  # fmt: skip


@dataclass(frozen=True)
class Part:
    """A box beside the board, and its wires: (its own pin, the board's pin, colour)."""

    title: str
    note: str
    left: bool
    top: int
    wires: tuple[tuple[str, str, str], ...]


LEFT_PINS = ("5V", "GND", "A0", "GND ")
RIGHT_PINS = ("9", "8", "7", "2", "4", "3", "5", "5V  ", "GND  ")
PARTS = (
    Part("Sharp GP2Y0A21", "infrared, 10 to 80 cm", True, 60, (
        ("V+  red", "5V", RED), ("GND  black", "GND", BLACK), ("OUT  yellow", "A0", ORANGE),
    )),
    Part("5 V for the servo, 1 A", "or 4 cells AA; + to its red wire", True, 340, (
        ("-  (and the servo's black)", "GND ", BLACK),
    )),
    Part("Head servo", "power from a supply of its own", False, 14, (("signal", "9", ORANGE),)),
    Part("HC-SR04 (two wires)", "Ping))): SIG to 8 alone", False, 116, (
        ("ECHO", "8", BLUE), ("TRIG", "7", GREEN),
    )),
    Part("Left wheel's encoder", "forwards, A leads B", False, 246, (
        ("A", "2", VIOLET), ("B", "4", BLUE),
    )),
    Part("Right wheel's encoder", "backwards? Swap A and B", False, 376, (
        ("A", "3", VIOLET), ("B", "5", BLUE),
    )),
    Part("Sonar and encoders", "power of all three", False, 506, (
        ("VCC", "5V  ", RED), ("GND", "GND  ", BLACK),
    )),
)  # fmt: skip


def text(x: float, y: float, words: str, size: int = 15, more: str = "") -> str:
    escaped = words.replace("&", "&amp;").replace("<", "&lt;")
    return f'<text x="{x}" y="{y}" font-size="{size}" {more}>{escaped}</text>'


def box(x: float, y: float, width: float, height: float, fill: str) -> str:
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="8" fill="{fill}" '
        'stroke="#444" stroke-width="1.5"/>'
    )


def pin_y(name: str) -> float:
    """The height of one of the board's pins."""
    pins = LEFT_PINS if name in LEFT_PINS else RIGHT_PINS
    gap = 0 if name in LEFT_PINS else 20
    extra = 120 if name == "GND " else 0
    return BOARD_TOP + 50 + gap + extra + PIN_STEP * 1.25 * pins.index(name)


def wire(x0: float, y0: float, x1: float, y1: float, lane: float, colour: str) -> str:
    """Across, along a lane of its own, and across again: no two wires share one."""
    return (
        f'<path d="M{x0} {y0} H{lane} V{y1} H{x1}" fill="none" stroke="{colour}" '
        'stroke-width="3" stroke-linejoin="round"/>'
        f'<circle cx="{x0}" cy="{y0}" r="4" fill="{colour}"/>'
        f'<circle cx="{x1}" cy="{y1}" r="4" fill="{colour}"/>'
    )


def drawing() -> str:
    pieces = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" '
        f'viewBox="0 0 {WIDTH} {HEIGHT}" font-family="DejaVu Sans, Arial, sans-serif">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        box(BOARD_X, BOARD_TOP, BOARD_W, 530, "#00838f"),
        text(BOARD_X + 110, BOARD_TOP + 255, "Arduino", 22, 'fill="white" text-anchor="middle"'),
        text(
            BOARD_X + 110, BOARD_TOP + 282, "Uno or Nano", 18, 'fill="white" text-anchor="middle"'
        ),
        text(
            BOARD_X + 110, BOARD_TOP + 310, "(ATmega328P)", 14, 'fill="white" text-anchor="middle"'
        ),
        box(BOARD_X + 70, BOARD_TOP - 34, 80, 34, "#cfd8dc"),
        text(BOARD_X + 110, BOARD_TOP - 12, "USB", 15, 'text-anchor="middle"'),
        text(BOARD_X + 162, BOARD_TOP - 12, "to the computer"),
    ]
    right_lane = BOARD_X + BOARD_W + 18
    for part in PARTS:
        height = 58 + 28 * len(part.wires)
        x = 30 if part.left else 730
        pieces += [box(x, part.top, 240, height, "#eceff1")]
        pieces += [text(x + 12, part.top + 24, part.title, 16, 'font-weight="bold"')]
        pieces += [text(x + 12, part.top + 43, part.note, 12.5, 'fill="#444"')]
        for i, (own, pin, colour) in enumerate(part.wires):
            y = part.top + 66 + 28 * i
            end_y = pin_y(pin)
            if part.left:
                pieces.append(text(x + 226, y + 5, own, 13.5, 'text-anchor="end"'))
                pieces.append(text(BOARD_X + 12, end_y + 5, pin.strip(), 15, 'fill="white"'))
                pieces.append(wire(x + 240, y, BOARD_X, end_y, 300 + 22 * i, colour))
            else:
                anchor = 'fill="white" text-anchor="end"'
                pieces.append(text(x + 14, y + 5, own, 13.5))
                pieces.append(text(BOARD_X + BOARD_W - 12, end_y + 5, pin.strip(), 15, anchor))
                pieces.append(wire(x, y, BOARD_X + BOARD_W, end_y, right_lane, colour))
                right_lane += 10
    return "\n".join([*pieces, "</svg>\n"])


def draw_map(maps: Path, scale: int = 3) -> None:
    """Black is occupied, white is free, grey was never seen; green are the true walls."""
    layer = np.load(maps / "dirrs.npz")
    values = np.flipud(layer["values"])
    picture = Image.fromarray(np.uint8(255.0 * (1.0 - values))).convert("RGB")
    picture = picture.resize([scale * n for n in picture.size], Image.Resampling.NEAREST)
    pen = ImageDraw.Draw(picture)
    walls_m = load_room("room").walls_m
    for wall_m in walls_m:
        at = (wall_m - layer["origin_m"]) / layer["resolution_m"] * scale
        pen.line([(x, picture.height - y) for x, y in at], fill=(46, 125, 50), width=2)
    margin_m = np.array([0.12, 0.12])
    corners_m = walls_m.min((0, 1)) - margin_m, walls_m.max((0, 1)) + margin_m
    (x0, y0), (x1, y1) = (
        (corner - layer["origin_m"]) / layer["resolution_m"] * scale for corner in corners_m
    )
    picture = picture.crop((int(x0), int(picture.height - y1), int(x1), int(picture.height - y0)))
    picture.save(IMAGES / "firmware-map.png", optimize=True)


def main() -> None:
    if len(sys.argv) > 1:
        draw_map(Path(sys.argv[1]))
    svg = IMAGES / "wiring.svg"
    svg.write_text(drawing(), "utf-8")
    chromium = shutil.which("chromium")
    if chromium is None:
        print("no chromium: only the SVG was made")
        return
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(
            [chromium, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
             f"--user-data-dir={profile}", f"--window-size={WIDTH},{HEIGHT}",
             f"--screenshot={IMAGES / 'wiring.png'}", svg.as_uri()],
            check=True, capture_output=True,
        )  # fmt: skip
    print(IMAGES / "wiring.png")


if __name__ == "__main__":
    main()
