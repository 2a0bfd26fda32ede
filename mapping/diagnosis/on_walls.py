"""How well the points of thin beams fit straight walls, if a hypothesis holds.

The score without truth asks how well cells predict ranges; of a robot that sees each wall from one
side, or seldom twice, it may even fall as the map gets better. That walls are torn apart is plain
all the same: their points no longer lie on any.
"""

from __future__ import annotations

import numpy as np

from mapping.diagnosis.hypothesis import Hypothesis
from mapping.diagnosis.patches import TUKEY, ThinBeams, find_patches
from mapping.scoring.held_out import BlockScores

_SHIFTS = (0.0, 0.25, 0.5, 0.75)  # of four grids: which pieces a wall falls into is chance


def on_walls(beams: ThinBeams, hypothesis: Hypothesis, wide: float, blocks: int) -> BlockScores:
    """By block, how well points fit walls: one exactly on the line of a wall counts as one, others
    by Tukey's biweight (1 - (z / 4)^2)^3 of how many spreads, ``wide`` times as wide as assumed,
    they lie away; one on no wall as nothing. Where only noise scatters them, and so wide, the mean
    is 0.84. The mean over four grids."""
    points = beams.points(hypothesis)
    near = np.zeros(len(points))
    for shift in _SHIFTS:
        patches = find_patches(points, shift=shift, wide=wide)
        inside = patches.patch >= 0
        z = (points.range_m - patches.expected_m)[inside] / (wide * patches.spread_m[inside])
        near[inside] += np.maximum(1.0 - np.square(z / TUKEY), 0.0) ** 3 / len(_SHIFTS)
    return BlockScores.of(near, points.block, blocks)
