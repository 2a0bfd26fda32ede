"""Maps as a ROS 2 bag: read again by readers that are not ours."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from mapping.grid import GridGeometry, Layer
from recorder.errors import OutputExists
from recorder.geometry import SE2
from recorder.messages import Pose
from replay.occupancy_bag import percent_of, write_bag


def made_layer(name: str = "fused") -> Layer:
    probability = np.array([[0.0, 0.5, 1.0], [0.126, math.nan, 0.999]], np.float32)
    observed = np.array([[True, True, True], [True, True, False]])
    geometry = GridGeometry((-0.5, 1.25), 0.05, 2, 3)
    return Layer(name, "probability", geometry, probability, probability, observed, {})


def poses() -> list[Pose]:
    return [Pose(10**9 * (i + 1), SE2(0.1 * i, 0.2, 0.3)) for i in range(5)]


def test_unknown_is_minus_one_and_the_rest_per_cent() -> None:
    np.testing.assert_array_equal(percent_of(made_layer()), [[0, 50, 100], [13, -1, -1]])


def test_other_readers_read_the_same_map(tmp_path: Path) -> None:
    bag = tmp_path / "maps.mcap"
    write_bag(bag, [made_layer(), made_layer("ping")], poses())
    with bag.open("rb") as file:
        found = {
            channel.topic: message
            for _, channel, _, message in make_reader(
                file, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
        }
    grid = found["/map/fused"]
    assert (grid.info.width, grid.info.height) == (3, 2)
    assert grid.info.resolution == pytest.approx(0.05)
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-0.5, 1.25)
    assert list(grid.data) == [0, 50, 100, 13, -1, -1]
    assert grid.header.frame_id == "map"
    assert len(found["/path"].poses) == 5
    assert found["/tf"].transforms[0].child_frame_id == "base_link"
    assert found["/tf_static"].transforms[0].header.frame_id == "map"
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        by_topic = {c.topic: reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()}
    np.testing.assert_array_equal(by_topic["/map/ping"].data, [0, 50, 100, 13, -1, -1])
    assert by_topic["/path"].poses[4].pose.position.x == pytest.approx(0.4)


def test_an_existing_bag_is_kept(tmp_path: Path) -> None:
    bag = tmp_path / "maps.mcap"
    bag.write_bytes(b"mine")
    with pytest.raises(OutputExists):
        write_bag(bag, [made_layer()], poses())
    assert bag.read_bytes() == b"mine"
