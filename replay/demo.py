"""The main job on a fresh machine: a simulated robot behind a real serial line → session → map."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from recorder.errors import OutputExists


def new_folder(asked: Path | None, name: str, *, force: bool) -> Path:
    """The folder to write into: the asked one, or ``name`` here, numbered when it is taken."""
    if asked is not None:
        if asked.exists() and any(asked.iterdir()) and not force:
            raise OutputExists(asked)
        asked.mkdir(parents=True, exist_ok=True)
        return asked
    number = 1
    folder = Path(name)
    while folder.exists():
        number += 1
        folder = Path(f"{name}-{number}")
    folder.mkdir(parents=True)
    return folder


def record_demo(
    session: Path, *, room: str, duration_s: float, seed: int, speed: float, quiet: bool
) -> None:
    """Record the simulated robot over a pseudo-terminal, its poses over TCP."""
    from recorder.recording.controls import Controls, signals
    from recorder.recording.options import RecordingOptions
    from recorder.recording.run import opened_source, record_line
    from recorder.recording.screen import open_screen

    controls = Controls()
    plan = RecordingOptions(duration_s=duration_s, force=True)
    with ExitStack() as stack:
        line, known = stack.enter_context(
            opened_source(f"sim:{room}", plan, seed=seed, speed=speed)
        )
        stack.enter_context(signals(controls))
        on_status, period_s = (None, 1.0) if quiet else open_screen(stack, session, keys=False)
        record_line(
            line, session, known, stop=controls.stop, on_status=on_status,
            status_period_s=period_s,
        )  # fmt: skip
