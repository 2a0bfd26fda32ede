"""The arrows of the architecture: who may import whom, and what `--help` must not load."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "ARCHITECTURE.md").read_text("utf-8")
ROOMS = ("recorder", "mapping", "replay")  # each may import itself and those before it
DOORS = {
    "serial": ("recorder/link.py",),
    "mcap": ("recorder/session/",),
    "mcap_ros2": ("recorder/ros_types.py",),
    "rosbags": ("recorder/session/other_bags.py",),
    "numba": ("mapping/kernels/", "mapping/line_kernels/", "replay/rrd/value_log/kernels.py"),
    "rerun": ("replay/rrd/",),
    "matplotlib": ("replay/pictures/drawing/",),
}
FOLDERS = (
    "recorder", "recorder/recording", "recorder/session", "mapping", "replay", "replay/rrd",
    "replay/pictures",
)  # fmt: skip
HEAVY = ("numpy", "rerun", "matplotlib", "mcap", "numba", "scipy", "pydantic", "rich", "serial")
HELP = f"""
import sys
import echogrid
after_import = sorted(set({HEAVY!r}) & set(sys.modules))
try:
    status = echogrid.main(["--help"])
except SystemExit as stop:
    status = stop.code
after_help = sorted(set({HEAVY!r}) & set(sys.modules))
print(status or 0, after_import, after_help, file=sys.stderr)
"""


def imported_modules(source: str, package: str) -> set[str]:
    """Full names of all that a file of ``package`` imports, wherever in the file it stands."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            up = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = [*up, *filter(None, [node.module])] if node.level else [node.module or ""]
            names.add(".".join(base))
    return names


def tops(file: Path) -> set[str]:
    """First parts of the names that a file of the repository imports."""
    package = ".".join(file.relative_to(ROOT).parent.parts)
    return {name.split(".")[0] for name in imported_modules(file.read_text("utf-8"), package)}


def files_of(room: str) -> list[Path]:
    return sorted((ROOT / room).rglob("*.py"))


def test_imports_are_found_wherever_they_stand() -> None:
    source = (
        "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from replay.rrd import layout\n"
        "def late():\n    import serial.tools, numba as nb\n"
        "from . import near\nfrom ..mapping import far\n"
    )
    assert imported_modules(source, "recorder.importers") == {
        "typing",
        "replay.rrd",
        "serial.tools",
        "numba",
        "recorder.importers",
        "recorder.mapping",
    }


@pytest.mark.parametrize("room", ROOMS)
def test_no_import_runs_back(room: str) -> None:
    forbidden = {*ROOMS[ROOMS.index(room) + 1 :], "echogrid", "tests", "benchmarks"}
    files = files_of(room)
    assert files
    back = {str(f.relative_to(ROOT)): tops(f) & forbidden for f in files if tops(f) & forbidden}
    assert back == {}


@pytest.mark.parametrize("library", DOORS)
def test_only_the_door_imports_the_library(library: str) -> None:
    files = [ROOT / "echogrid.py", *(f for room in ROOMS for f in files_of(room))]
    users = [f.relative_to(ROOT).as_posix() for f in files if f.exists() and library in tops(f)]
    assert users, f"nobody imports {library} any more: is it still a dependency?"
    assert [user for user in users if not user.startswith(DOORS[library])] == []


def test_the_page_names_the_same_doors() -> None:
    _, _, doors = PAGE.partition("## Doors")
    rows = re.findall(r"^\| `(\w+)` \| (.+) \|$", doors, re.MULTILINE)
    told = {library: tuple(re.findall(r"`([^`]+?)(?:\*\.py)?`", files)) for library, files in rows}
    assert told == DOORS


def test_every_file_that_the_page_names_is_there() -> None:
    names = set(re.findall(r"`([\w/*]+\.py)`", PAGE))
    files = [f.relative_to(ROOT) for top in (*ROOMS, "tests") for f in files_of(top)]
    files.append(Path("echogrid.py"))
    assert len(names) > 50
    assert [name for name in sorted(names) if not any(f.match(name) for f in files)] == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_page_names_every_file_of_a_room(folder: str) -> None:
    patterns = set(re.findall(r"`([\w*]+\.py)`", PAGE))
    files = [f for f in (ROOT / folder).glob("*.py") if f.name != "__init__.py"]
    assert len(files) > 5
    unnamed = [f.name for f in files if not any(f.match(each) for each in patterns)]
    assert sorted(unnamed) == []


@pytest.mark.parametrize("name", [*ROOMS, "echogrid"])
def test_the_bare_names_are_ours(name: str) -> None:
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.origin is not None
    assert Path(spec.origin).resolve().is_relative_to(ROOT)
    if name in ROOMS:
        assert Path(spec.origin).resolve() == ROOT / name / "__init__.py"


def test_every_folder_of_code_is_a_package() -> None:
    folders = {f.relative_to(ROOT).parent for room in ROOMS for f in files_of(room)}
    assert [str(d) for d in sorted(folders) if not (ROOT / d / "__init__.py").exists()] == []


def test_help_loads_nothing_heavy() -> None:
    run = subprocess.run(
        [sys.executable, "-c", HELP],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "Usage" in run.stdout or "usage" in run.stdout
    assert run.stderr.splitlines()[-1] == "0 [] []"
