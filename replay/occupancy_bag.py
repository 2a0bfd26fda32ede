"""Maps as a ROS 2 bag: nav_msgs/OccupancyGrid, the path and TF, for bag players and viewers.

Each layer is a topic ``/map/NAME``: 0 .. 100 is the probability of occupied in per cent, -1 a cell
that no reading touched (as ``costmap`` layers of nav2 read it). ``/tf_static`` lays ``odom`` on
``map``, ``/tf`` moves ``base_link`` in it, ``/path`` is the whole way.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapping.grid import Layer
from recorder.geometry import IDENTITY
from recorder.messages import BASE_FRAME, MAP_FRAME, ODOM_FRAME, OccupancyGrid, Pose, Transform
from recorder.messages import Path as PathMessage
from recorder.session import SessionWriter


def percent_of(layer: Layer) -> NDArray[np.int8]:
    """A layer's probabilities in whole per cent, (rows, cols); -1 where nothing was observed."""
    known = layer.observed & np.isfinite(layer.probability)
    probability = np.where(known, layer.probability.astype(np.float64), 0.0)
    percent = np.round(100.0 * np.clip(probability, 0.0, 1.0)).astype(np.int8)
    percent[~known] = -1
    return percent


def write_bag(
    output: Path, layers: Sequence[Layer], poses: Sequence[Pose], *, force: bool = False
) -> None:
    """Write ``layers`` and where the robot was; the maps bear the time of the last pose.

    Raises OutputExists where ``output`` exists and ``force`` is not given.
    """
    end_ns = poses[-1].t_ns if poses else 0
    begin_ns = poses[0].t_ns if poses else 0
    with SessionWriter(
        output, metadata={"maps": [layer.name for layer in layers]}, force=force
    ) as bag:
        bag.write(Transform(begin_ns, MAP_FRAME, ODOM_FRAME, IDENTITY), log_ns=begin_ns)
        for pose in poses:
            turn = Transform(pose.t_ns, ODOM_FRAME, BASE_FRAME, pose.world_from_base, static=False)
            bag.write(turn, log_ns=pose.t_ns)
        bag.write(PathMessage(end_ns, tuple(poses)), log_ns=end_ns)
        for layer in layers:
            g = layer.geometry
            grid = OccupancyGrid(end_ns, layer.name, g.origin_m, g.resolution_m, percent_of(layer))
            bag.write(grid, log_ns=end_ns)
