"""What several test files share: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings beside the checkout; skipped without, but not where CI=true."""
    return _beside("data")


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """The folder of inputs with known answers beside the checkout; required where CI=true."""
    return _beside("cases")


def _beside(name: str) -> Path:
    folder = ROOT.parent / "shared" / name
    if not folder.is_dir():
        reason = f"no folder of {name} beside the checkout"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    return folder
