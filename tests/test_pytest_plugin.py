"""The pytest plugin, used from a package of its own made in a temporary folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

TEST = """
SETTINGS = ["grid.resolution_m=0.1"]


def test_the_map_stays(session_map):
    made = session_map("logs/run.mcap", settings=SETTINGS)
    assert "ping" in made.layers
    assert made.matches("golden/run.npz", atol=1e-4)
"""
CHANGED = """

def test_the_map_changed(session_map):
    made = session_map("logs/run.mcap", settings=[*SETTINGS, "sensors.ping.hit=1.5"])
    made.matches("golden/run.npz", atol=1e-4)


def test_there_is_none(session_map):
    session_map("logs/run.mcap", settings=SETTINGS).matches("golden/missing.npz")
"""
OTHER_OPTION = """
def pytest_addoption(parser):
    parser.addoption("--update-golden", action="store_true", help="of somebody else")
"""


class Package:
    """A small separate package with a session and a test."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "tests").mkdir(parents=True)
        (folder / "logs").mkdir()
        (folder / "pyproject.toml").write_text("[tool.pytest.ini_options]\ntestpaths = ['tests']\n")
        (folder / "logs" / "run.mcap").write_bytes((ROOT / "logs" / "room.mcap").read_bytes())
        self.write_test(TEST)

    @property
    def golden(self) -> Path:
        return self.folder / "tests" / "golden" / "run.npz"

    def write_test(self, text: str) -> None:
        (self.folder / "tests" / "test_map.py").write_text(text)

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Pytest in a process of its own, with the plugin as an installation brings it."""
        environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
        return subprocess.run(
            [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *arguments,
             f"--basetemp={self.folder / 'tmp'}"],
            cwd=self.folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip


@pytest.fixture
def package(tmp_path: Path) -> Package:
    return Package(tmp_path / "theirs")


def test_a_golden_map_is_written_matched_and_missed(package: Package) -> None:
    run = package.run("--update-golden")
    assert run.returncode == 0, run.stdout + run.stderr
    assert f"golden map written: {package.golden}" in run.stdout
    written = package.golden.read_bytes()

    package.write_test(TEST + CHANGED)
    run = package.run()
    assert run.returncode == 1
    assert "2 failed, 1 passed" in run.stdout
    assert "the map differs from run.npz (A: the session, B: the golden map)" in run.stdout
    assert "verdict: " in run.stdout
    assert "layer ping: " in run.stdout
    assert "cells differ; worst x " in run.stdout
    assert "layer dirrs: all " in run.stdout
    assert "missing.npz: no such golden map; --update-golden writes it" in run.stdout
    pictures = [each for each in run.stdout.splitlines() if each.startswith("picture: ")]
    picture = Path(pictures[0].removeprefix("picture: "))
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.is_relative_to(package.folder / "tmp")
    assert package.golden.read_bytes() == written


def test_an_option_of_that_name_elsewhere_does_no_harm(package: Package) -> None:
    """Somebody else's --update-golden, in a conftest.py, counts for the maps too."""
    (package.folder / "conftest.py").write_text(OTHER_OPTION)
    run = package.run("--update-golden")
    assert run.returncode == 0, run.stdout + run.stderr
    assert f"golden map written: {package.golden}" in run.stdout
    assert package.golden.exists()


def test_the_plugin_imports_nothing_heavy() -> None:
    code = (
        "import sys, replay.pytest_plugin; "
        "print(sorted({'numpy', 'numba', 'scipy', 'rerun', 'pydantic', 'mcap'} & set(sys.modules)))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"
