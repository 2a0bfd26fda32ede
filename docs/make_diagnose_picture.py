"""Draw the picture of ``docs/diagnose.md`` again: ``python -m docs.make_diagnose_picture``.

Where the echoes of an infrared ranger lie before and after ``diagnose``, of the session that the
page makes first.
"""

from __future__ import annotations

import re
import shlex
import tempfile
from pathlib import Path

import matplotlib

from echogrid import main as echogrid
from mapping.config import load_config
from mapping.diagnosis.diagnosing import diagnose
from recorder.session.columns import open_session

matplotlib.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).resolve().parent
IMAGE = DOCS / "images" / "diagnose.png"


def main() -> None:
    """Simulate, diagnose, draw."""
    command = re.search(r"^echogrid (simulate .*)$", (DOCS / "diagnose.md").read_text(), re.M)
    assert command is not None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bad.mcap"
        words = [str(path) if word == path.name else word for word in shlex.split(command[1])]
        echogrid(words)
        found = diagnose(open_session(path), load_config())
    figure, axes = plt.subplots(
        1, 2, figsize=(9.0, 4.2), sharex=True, sharey=True, layout="constrained"
    )
    for plot, ax in zip(found.plots, axes, strict=True):
        assert plot.points is not None
        ax.plot(*plot.points.T, ".", markersize=1.5, color="#2f6f9f", alpha=0.6)
        ax.set(title=plot.title, xlabel=plot.x, ylabel=plot.y, aspect="equal")
        ax.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGE, dpi=110)
    print("\n".join(suspect.text for suspect in found.suspects))


if __name__ == "__main__":
    main()
