"""What the pictures of `diff` and `score` have in common: their paper, their letters, a legend."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]

PAPER, INK, UNSEEN = (255, 255, 255), (20, 20, 20), (150, 158, 178)
GAP_PX = 16


def letters(size_px: int) -> ImageFont.FreeTypeFont:
    """The font of all texts."""
    font = ImageFont.load_default(size_px)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font


def wrapped(text: str, width_px: int, font: ImageFont.FreeTypeFont, indent: str = "") -> list[str]:
    """The text in lines that fit; those after the first begin with ``indent``."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if font.getlength(longer) > width_px and lines[-1]:
            lines.append(indent + word)
        else:
            lines[-1] = longer if lines[-1].strip() else word
    return lines


def legend(
    entries: Iterable[tuple[Colour, str]], width_px: int, text_px: int,
    ringed: Sequence[Colour] = (),
) -> Image.Image:  # fmt: skip
    """Coloured squares with their meaning, in as many lines as it takes; some are rings."""
    font, line = letters(text_px), text_px + 10
    places, x, y = [], GAP_PX, 0
    for colour, text in entries:
        wide = int(font.getlength(text)) + text_px + 28
        if x + wide > width_px and x > GAP_PX:
            x, y = GAP_PX, y + line
        places.append((x, y, colour, text))
        x += wide
    image = Image.new("RGB", (width_px, y + line), PAPER)
    pen = ImageDraw.Draw(image)
    for x, y, colour, text in places:
        box = (x, y + 2, x + text_px, y + 2 + text_px)
        if colour in ringed:
            pen.ellipse(box, outline=colour, width=3)
        else:
            pen.rectangle(box, fill=colour, outline=INK)
        pen.text((x + text_px + 6, y), text, INK, font)
    return image
