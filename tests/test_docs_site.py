"""The site builds without a warning, and holds what is made from the code."""

from __future__ import annotations

import html
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

import echogrid


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; mkdocs is strict, so a warning (a link that leads nowhere) fails it."""
    folder = tmp_path_factory.mktemp("site")
    command = ["-m", "mkdocs", "build", "-q", "-f", str(ROOT / "docs/site/mkdocs.yml")]
    built = subprocess.run(
        [sys.executable, *command, "-d", str(folder)],
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (built.returncode, built.stdout + built.stderr) == (0, "")
    return folder


def test_every_page_is_in_it(site: Path) -> None:
    pages = {page.with_suffix(".html").relative_to(ROOT / "docs").as_posix()
             for page in (ROOT / "docs").rglob("*.md")}  # fmt: skip
    assert pages <= {page.relative_to(site).as_posix() for page in site.rglob("*.html")}


def test_every_command_and_key_is_in_it(site: Path) -> None:
    commands = (site / "reference-commands.html").read_text("utf-8")
    for name in echogrid.cli.commands:
        assert f"Usage: echogrid {name} " in html.unescape(commands), name
    keys = (site / "reference-keys.html").read_text("utf-8")
    for key in ("resolution_m", "beam_width_deg", "occupied_thresh"):
        assert key in keys


def test_no_page_fetches_anything_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        for tag in ('<script src="http', 'rel="stylesheet" href="http', '<img src="http'):
            assert tag not in page.read_text("utf-8"), page.name
