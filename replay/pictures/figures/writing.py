"""The figures of a session into a folder: PNG and SVG of each, and one page with all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mapping.config import MappingConfig
from recorder.errors import BadInput, OutputExists
from recorder.names import printable
from recorder.outputs import written_beside
from replay.pictures.figures.bench import Bench
from replay.pictures.figures.figure import Drawing, LeftOut
from replay.pictures.figures.html_page import figures_page
from replay.pictures.figures.table import NUMBERED, command_of, map_command_of, stem_of
from replay.pictures.opening import Progress
from replay.pictures.parts import Page

PAGE = "index.html"


@dataclass(frozen=True, slots=True)
class Made:
    """One figure that was drawn: its number, its caption, and the commands that make it."""

    number: int
    caption: str
    command: str
    map_command: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was drawn, and what was left out (number, why); ``damage`` of the session."""

    made: tuple[Made, ...]
    left_out: tuple[tuple[int, str], ...]
    notes: tuple[str, ...]
    damage: tuple[str, ...]


def write_figures(
    session: Path,
    directory: Path,
    config: MappingConfig,
    *,
    only: Sequence[int] = (),
    force: bool = False,
    progress: Progress | None = None,
) -> Outcome:
    """Draw every figure, or those numbered. Raises an EchogridError in one line.

    A folder that holds something is refused without ``force``; with it, files of the same name are
    replaced and others stay.
    """
    numbers = _wanted(only)
    _make_directory(directory, force=force)
    bench = Bench(session, config)
    made: list[Made] = []
    left_out: list[tuple[int, str]] = []
    for done, number in enumerate(numbers):
        if progress is not None:
            progress(done, len(numbers))
        try:
            drawing = NUMBERED[number].draw(bench)
        except LeftOut as reason:
            left_out.append((number, str(reason)))
            continue
        for name, content in _files(number, drawing, session.name):
            _write(directory / name, content)
        caption, layer = printable(drawing.caption), _layer(bench, number)
        made.append(
            Made(
                number, caption, command_of(number, session.name),
                map_command_of(number, session.name, layer),
            )
        )  # fmt: skip
    outcome = Outcome(tuple(made), tuple(left_out), _notes(bench), tuple(bench.damage))
    _write(directory / PAGE, figures_page(session.name, outcome).encode())
    if progress is not None:
        progress(len(numbers), len(numbers))
    return outcome


def _wanted(only: Iterable[int]) -> list[int]:
    unknown = [number for number in only if number not in NUMBERED]
    if unknown:
        raise BadInput(f"there is no figure {unknown[0]}; they are 1 to {len(NUMBERED)}")
    return sorted(set(only)) or list(NUMBERED)


def _layer(bench: Bench, number: int) -> str:
    """The layer whose map a figure shows; empty where it shows none."""
    match NUMBERED[number].role:
        case "any":
            return bench.any_ranger.layer
        case "narrow":
            return bench.narrow.layer
    return ""


def _files(number: int, drawing: Drawing, session: str) -> list[tuple[str, bytes]]:
    """The PNG bears its caption, for slides; the SVG leaves it to the page that it stands on."""
    from replay.pictures.drawing.pages import page_bytes

    figure, stem = NUMBERED[number], stem_of(number)
    footer = f"{figure.passage}  ·  {command_of(number, session)}"
    page = Page(
        f"{number}. {figure.title}", drawing.panels, printable(drawing.caption),
        source="", columns=drawing.columns, footer=printable(footer),
    )  # fmt: skip
    bare = Page(
        "", drawing.panels, printable(drawing.caption), columns=drawing.columns,
        drawn_caption=False, named=page.title,
    )  # fmt: skip
    return [(f"{stem}.png", page_bytes(page, "png")), (f"{stem}.svg", page_bytes(bare, "svg"))]


def _notes(bench: Bench) -> tuple[str, ...]:
    """What of the session was taken, where it is not all of it as it is."""
    notes = []
    if len(bench.readings) < bench.total:
        notes.append(f"every figure is of {len(bench.readings):,} of the {bench.total:,} readings")
    return tuple(notes)


def _make_directory(directory: Path, *, force: bool) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        filled = any(directory.iterdir())
    except OSError as error:
        raise BadInput(f"cannot use {directory} as a directory: {error.strerror}") from error
    if filled and not force:
        raise OutputExists(directory)


def _write(path: Path, content: bytes) -> None:
    try:
        with written_beside(path) as part:
            part.write_bytes(content)
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror or error}") from error
