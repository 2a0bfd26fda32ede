"""The few elements of SVG that a drawing of a map is made of, named and written as drawsvg does.

drawsvg itself loads half of Python's network library, which takes longer than a small map to make;
a test holds the text to be the same, to the byte. Attributes are written as they come.
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass, field
from typing import Any

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" '
    'xmlns:xlink="http://www.w3.org/1999/xlink"\n     width="{}" height="{}" '
    'viewBox="{}">\n<defs>\n'
)


@dataclass(frozen=True, slots=True)
class Raw:
    """Text that is an element already."""

    text: str


@dataclass(frozen=True, slots=True)
class Element:
    """One element without content; an underscore in an attribute's name stands for a dash."""

    tag: str
    attributes: dict[str, Any]

    def text(self, clips: list[ClipPath]) -> str:
        """As it is written; ``clips`` are the clip paths defined before."""
        written = []
        for name, value in self.attributes.items():
            if isinstance(value, ClipPath):
                value = f"url(#d{next(k for k, each in enumerate(clips) if each is value)})"
            written.append(f'{name.replace("__", ":").replace("_", "-")}="{value}"')
        return f"<{self.tag} {' '.join(written)} />"


@dataclass(slots=True)
class ClipPath:
    """What lets only a part of an element be seen."""

    elements: list[Element] = field(default_factory=list)

    def append(self, element: Element) -> None:
        """Show also what lies in an element."""
        self.elements.append(element)


def Rectangle(x: float, y: float, width: float, height: float, **look: Any) -> Element:
    """A rectangle by its upper left corner."""
    return Element("rect", {"x": x, "y": y, "width": width, "height": height, **look})


def Lines(*places: float, close: bool = False, **look: Any) -> Element:
    """Straight lines through x, y, x, y, ..."""
    x, y = places[::2], places[1::2]
    way = [f"{'L' if k else 'M'}{a},{b}" for k, (a, b) in enumerate(zip(x, y, strict=True))]
    return Element("path", {"d": " ".join([*way, *(["Z"] if close else [])]), **look})


def Line(x0: float, y0: float, x1: float, y1: float, **look: Any) -> Element:
    """One straight line."""
    return Lines(x0, y0, x1, y1, **look)


def Image(
    x: float, y: float, width: float, height: float, *, data: bytes, mime_type: str, **look: Any
) -> Element:
    """A picture, with all of it."""
    place = {"x": x, "y": y, "width": width, "height": height}
    content = f"data:{mime_type};base64,{b64encode(data).decode()}"
    return Element("image", {**place, "xlink__href": content, **look})


class Drawing:
    """A page of elements; ``origin`` is its upper left corner, y down."""

    def __init__(self, width: float, height: float, origin: tuple[float, float]) -> None:
        self._box = (*origin, width, height)
        self._size: tuple[str, str] = str(width), str(height)
        self._elements: list[Element | Raw] = []

    def append(self, element: Element | Raw) -> None:
        """Put an element over those before."""
        self._elements.append(element)

    def set_render_size(self, width: str, height: str) -> None:
        """How large it is on paper."""
        self._size = width, height

    def as_svg(self) -> str:
        """The file."""
        clips: list[ClipPath] = []
        for element in self._elements:
            if isinstance(element, Element):
                used = (each for each in element.attributes.values() if isinstance(each, ClipPath))
                clips += (each for each in used if not any(each is known for known in clips))
        text = [_HEAD.format(*self._size, " ".join(map(str, self._box)))]
        for k, clip in enumerate(clips):
            inner = "".join(f"{each.text(clips)}\n" for each in clip.elements)
            text.append(f'<clipPath id="d{k}">\n{inner}</clipPath>\n')
        text.append("</defs>\n")
        for element in self._elements:
            shown = element.text if isinstance(element, Raw) else element.text(clips)
            text.append(f"{shown}\n")
        return "".join([*text, "</svg>"])
