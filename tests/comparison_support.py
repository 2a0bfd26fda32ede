"""What the tests of comparisons share: a short session, and files of settings."""

from __future__ import annotations

from pathlib import Path

from echogrid import main
from replay.comparison import Variant

COARSE = "grid.resolution_m=0.05"


def short_session(folder: Path) -> Path:
    """Four simulated seconds."""
    path = folder / "run.mcap"
    arguments = ["simulate", "room", "-o", str(path), "--duration", "4", "--seed", "3", "--quiet"]
    assert main(arguments) == 0
    return path


def toml(folder: Path, name: str, text: str) -> Path:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def names(variants: list[Variant]) -> list[str]:
    return [variant.name for variant in variants]
