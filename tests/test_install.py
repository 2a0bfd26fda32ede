"""Installed as a tool: the wheel alone, in an environment of its own, far from the repository."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from conftest import ROOT

NEEDED = ("echogrid.py", "recorder", "mapping", "replay", "pyproject.toml", "README.md", "LICENSE")


def run(*command: str | Path, **options: object) -> subprocess.CompletedProcess[str]:
    ran = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, **options
    )  # type: ignore[call-overload]
    assert ran.returncode == 0, f"{command}: {ran.stdout}{ran.stderr}"
    return ran  # type: ignore[no-any-return]


def clean() -> dict[str, str]:
    """The environment without the folder that the tests themselves may be found by."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@pytest.fixture(scope="module")
def tool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of an environment that holds the wheel, and the libraries it needs.

    The libraries are those of the tests' own environment, so that nothing is fetched.
    """
    folder = tmp_path_factory.mktemp("install")
    source = folder / "source"
    source.mkdir()
    for name in NEEDED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, source / name)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check")
    run(*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, source)
    shutil.rmtree(source)
    (wheel,) = folder.glob("echogrid-*.whl")
    run(sys.executable, "-m", "venv", "--without-pip", folder / "venv")
    paths = sysconfig.get_paths(vars={"base": str(folder / "venv")}, scheme="venv")
    run(*pip, "--python", folder / "venv", "install", "-q", "--no-deps", wheel, env=clean())
    (Path(paths["purelib"]) / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return Path(paths["scripts"])


def test_the_wheel_works_without_the_repository(tool: Path, tmp_path: Path) -> None:
    here = {"cwd": tmp_path, "env": clean()}
    where = run(tool / "python", "-c", "import mapping; print(mapping.__file__)", **here)
    assert str(ROOT) not in where.stdout
    run(tool / "echogrid", "simulate", "room", "-o", "run.mcap", "--duration", "3", **here)
    ran = run(tool / "echogrid", "map", "run.mcap", "--export", "out", **here)
    assert "run.rrd" in ran.stdout
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
    assert (tmp_path / "out" / "fused.npz").exists()


def test_the_wheel_holds_every_package(tool: Path) -> None:
    installed = run(
        tool / "python", "-c", "import echogrid; print(echogrid.__file__)", cwd="/", env=clean()
    ).stdout
    site = Path(installed.strip()).parent
    for package in ("recorder", "mapping", "replay"):
        for file in (ROOT / package).rglob("*.py"):
            assert (site / file.relative_to(ROOT)).exists(), file
