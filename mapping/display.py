"""Ways to look at a map: values or probabilities → pictures. Pure functions, no files.

Every picture is uint8, ``(rows, cols, 3)`` RGB, and keeps the grid's order: row 0 is the lowest y,
so whoever writes an image file flips it. A *shade* runs from 0 (white paper) to 1 (full ink); a
probability is its own shade, so the unknown 0.5 is the middle one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapping.artifacts import Classes

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

BLACK: Colour = (0, 0, 0)
RED: Colour = (214, 39, 40)
BLUE: Colour = (31, 99, 200)
GREEN: Colour = (34, 139, 34)
FULL_DEPTH = 256
REDUCED_DEPTH = 5
"""Shades left at reduced colour depth; an odd number leaves the unknown a shade of its own."""

_CLASS_COLOURS: dict[str, Colour] = {
    "unknown": (128, 128, 128),
    "agree occupied": BLACK,
    "agree empty": (255, 255, 255),
    "contradict": (255, 200, 0),
}
_ALONE: tuple[tuple[Colour, Colour], ...] = (
    (RED, (255, 205, 205)),
    (BLUE, (205, 220, 255)),
    (GREEN, (205, 240, 205)),
    ((148, 60, 189), (235, 215, 245)),
)


def at_depth(shade: ArrayLike, levels: int = FULL_DEPTH) -> Floats:
    """Shades rounded to so many levels, spread evenly from 0 to 1; at least 2 levels."""
    clipped = np.clip(np.nan_to_num(np.asarray(shade, np.float64), nan=0.5), 0.0, 1.0)
    steps = max(levels, 2) - 1
    return np.round(clipped * steps) / steps


def against_largest(values: ArrayLike) -> Floats:
    """Values over the largest: how counts, sums and odds become shades; all 0 without a largest."""
    array = np.asarray(values, np.float64)
    largest = float(array.max(initial=0.0))
    return np.clip(array / largest, 0.0, 1.0) if largest > 0.0 else np.zeros_like(array)


def inked(shades: list[Floats], inks: list[Colour]) -> Image:
    """Inks printed over each other on white paper, each as strong as its shade."""
    paper = np.ones((*shades[0].shape, 3))
    for shade, ink in zip(shades, inks, strict=True):
        paper *= 1.0 - shade[..., None] * (1.0 - np.array(ink) / 255.0)
    return np.round(paper * 255.0).astype(np.uint8)


def grey(shade: ArrayLike, *, levels: int = FULL_DEPTH) -> Image:
    """Empty white, occupied black, unknown between them."""
    return inked([at_depth(shade, levels)], [BLACK])


def two_colours(first: ArrayLike, second: ArrayLike, *, levels: int = FULL_DEPTH) -> Image:
    """Two sensors' maps in one picture: red and blue, which mix where both hold a cell occupied."""
    return inked([at_depth(first, levels), at_depth(second, levels)], [RED, BLUE])


def three_colours(
    first: ArrayLike,
    second: ArrayLike,
    third: ArrayLike | None = None,
    *,
    levels: int = FULL_DEPTH,
) -> Image:
    """Red, blue and green: three sensors' maps; or two, and in green what both of them hold."""
    shades = [at_depth(first, levels), at_depth(second, levels)]
    if third is None:
        both = np.minimum(*shades)
        shades = [shades[0] - both, shades[1] - both, both]
    else:
        shades.append(at_depth(third, levels))
    return inked(shades, [RED, BLUE, GREEN])


def with_alpha(image: Image, observed: NDArray[np.bool_]) -> Image:
    """The picture as RGBA, ``(rows, cols, 4)``: clear where no reading ever was."""
    alpha = np.where(observed, 255, 0).astype(np.uint8)
    return np.concatenate([image, alpha[..., None]], axis=2)


def class_colours(names: tuple[str, ...]) -> NDArray[np.uint8]:
    """A colour for each class, ``(len(names), 3)``; each sensor that is alone has its own."""
    alone_names = [name.rpartition(" alone ")[0] for name in names if " alone " in name]
    sensors = list(dict.fromkeys(alone_names))
    colours = []
    for name in names:
        sensor, alone, state = name.rpartition(" alone ")
        if alone:
            strong, pale = _ALONE[sensors.index(sensor) % len(_ALONE)]
            colours.append(strong if state == "occupied" else pale)
        else:
            colours.append(_CLASS_COLOURS.get(name, _CLASS_COLOURS["unknown"]))
    return np.array(colours, np.uint8)


def classes(found: Classes) -> Image:
    """The class map in its colours."""
    image: Image = class_colours(found.names)[found.codes]
    return image
