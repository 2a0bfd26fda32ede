"""Every command in the README and the pages: it parses; those in ``sh`` blocks are run as written.

A block marked ``text`` (or not marked) may need a robot, a display or another program: of its lines
that begin with ``echogrid`` the command and its options must exist.
"""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import click
import pytest
from conftest import ROOT

import echogrid
from echogrid import main

PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
RUN_ELSEWHERE = {"import.md"}  # tests/test_docs_import.py makes the files that it speaks of
_BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
PLACEHOLDERS = {"COMMAND"}


def commands(page: Path, languages: set[str]) -> list[list[str]]:
    """The words of each command line of the page's blocks, comments and prompts taken off."""
    lines = []
    for language, block in _BLOCK.findall(page.read_text("utf-8")):
        if language in languages:
            text = re.sub(r"\\\n\s*", " ", block)
            lines += [line.removeprefix("$ ").strip() for line in text.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("echogrid ")]


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_and_option_exists(page: Path) -> None:
    for _, name, *arguments in commands(page, {"", "sh", "text", "console"}):
        if name in PLACEHOLDERS or name == "--help":
            continue
        command = echogrid.cli.commands.get(name)
        assert command is not None, f"no command {name}"
        context = click.Context(command, info_name=name)
        command.make_parser(context).parse_args(list(arguments))  # raises for an unknown option


def test_the_check_of_options_can_fail(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```text\n$ echogrid map a.mcap --no-such-thing  # a comment\n```\n")
    (words,) = commands(page, {"text"})
    context = click.Context(echogrid.cli.commands["map"])
    with pytest.raises(click.NoSuchOption):
        echogrid.cli.commands["map"].make_parser(context).parse_args(words[2:])


RUN = [page for page in PAGES if page.name not in RUN_ELSEWHERE and commands(page, {"sh"})]


@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_the_commands_of_the_page_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = commands(page, {"sh"})
    made = {words[k + 1] for words in lines for k, word in enumerate(words) if word == "-o"}
    for name in {"run.mcap", "bag.mcap"} - made:
        shutil.copy(ROOT / "logs" / "room.mcap", tmp_path / name)
    for words in lines:
        assert main(words[1:]) == 0, (words, capsys.readouterr().err)
