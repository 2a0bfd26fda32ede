"""Maps of files → one page, and the page into a file."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mapping.config import MappingConfig
from recorder.errors import BadInput
from recorder.names import printable
from recorder.outputs import check_output, written_beside
from replay.pictures.captions import caption_of, compared_caption
from replay.pictures.opening import Asked, Progress, open_views
from replay.pictures.parts import Box, Page, on_one_scale
from replay.pictures.views import MapView, panel_of, whole_of

FORMATS = ("png", "svg", "pdf")
MOST_PANELS = 12


@dataclass(frozen=True, slots=True)
class Drawn:
    """What was written, and its caption."""

    output: Path
    caption: str


def write_picture(
    files: Sequence[Path],
    output: Path,
    asked: Asked,
    config: MappingConfig,
    *,
    whole: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> Drawn:
    """The maps of some files, side by side at one scale where they are several.

    ``whole`` shows all cells. Raises an EchogridError in one line.
    """
    form = form_of(output)
    check_output(output, files, force=force)
    views = [view for file in files for view in open_views(file, asked, config, progress)]
    if len(views) > MOST_PANELS:
        raise BadInput(f"{len(views)} maps are too many for one picture (at most {MOST_PANELS})")
    page = page_of(views, whole=whole)
    write_page(page, output, form)
    return Drawn(output, page.caption)


def form_of(output: Path) -> str:
    """The format that a name's ending asks for. Raises BadInput for another."""
    form = output.suffix.lower().removeprefix(".")
    if form not in FORMATS:
        raise BadInput(f"{output}: a picture is written as .png, .svg or .pdf")
    return form


def page_of(views: Sequence[MapView], *, whole: bool = False) -> Page:
    """One map with what it shows in words, or several at one scale."""
    frames = [whole_of(view.cells.geometry) for view in views] if whole else frames_of(views)
    if len(views) == 1:
        (view,) = views
        title = f"{printable(view.layer)}: the map {view.when}"
        return Page(
            title, (panel_of(view, "", frames[0]),), printable(caption_of(view)),
            source=printable(view.file),
        )  # fmt: skip
    panels = tuple(
        panel_of(view, printable(f"{view.file}: {view.layer}"), frame)
        for view, frame in zip(views, frames, strict=True)
    )
    return Page("Compared", on_one_scale(panels), printable(compared_caption(views)))


def frames_of(views: Sequence[MapView]) -> list[Box]:
    """What is shown of each; a map without path and walls goes by those of the others there."""
    known = [frame for view in views if (frame := view.placed_frame) is not None]
    if not known:
        return [view.frame for view in views]
    together = functools.reduce(Box.joined, known)
    frames = []
    for view in views:
        own = view.frame
        lost = view.placed_frame is None and own.meets(together)
        frames.append(together if lost else own)
    return frames


def write_page(page: Page, output: Path, form: str) -> None:
    """A page into a file, beside its name first. Raises BadInput where it cannot be written."""
    from replay.pictures.drawing.pages import page_bytes

    content = page_bytes(page, form)
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with written_beside(output) as part:
            part.write_bytes(content)
    except OSError as error:
        raise BadInput(f"cannot write {output}: {error.strerror or error}") from error
