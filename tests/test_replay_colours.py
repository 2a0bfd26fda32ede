"""One colour and one place a sensor, whatever the order in which it comes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from replay import colours

NAMES = st.lists(
    st.sampled_from(
        ["ping", "dirrs", "lidar", "vl53l0x", "ping_left", "ping_right", "hcsr04_10", "hcsr04_2",
         "front", "rear", "left eye", "fused"]
    ), unique=True, min_size=1,
)  # fmt: skip


@given(NAMES, st.randoms())
def test_colours_and_places_do_not_hang_on_the_order_of_the_names(names, random):
    shuffled = list(names)
    random.shuffle(shuffled)
    assert colours.sensor_colours(names) == colours.sensor_colours(shuffled)
    assert colours.in_place(names) == colours.in_place(shuffled)


@given(NAMES)
def test_no_two_sensors_look_alike(names):
    found = colours.sensor_colours(names)
    assert set(names) <= set(found)
    assert len({found[name] for name in names}) == len(names)


@pytest.mark.parametrize(
    "others", [(), ("dirrs",), ("dirrs", "lidar", "front"), ("fused", "ping", "dirrs")]
)
def test_a_known_kind_keeps_its_colour_in_any_company(others):
    assert colours.sensor_colours(["ping", *others])["ping"] == (245, 110, 0)
    assert colours.sensor_colour_names(["ping", *others])["ping"] == "orange"


def test_sensors_of_one_layer_have_shades_of_its_hue():
    layers = {"ping_left": "ping", "ping_right": "ping", "dirrs": "dirrs"}
    words = colours.sensor_colour_names(layers, layers)
    assert words["ping_left"] == "light orange"
    assert words["ping_right"] == "dark orange"
    assert words["ping"] == "orange"
    assert words["dirrs"] == "violet"


def test_sensors_of_unknown_names_share_the_hue_of_their_layer():
    layers = {"front": "ping", "rear": "ping"}
    assert colours.sensor_colour_names(layers, layers)["front"] == "light orange"


def test_no_sensor_looks_like_what_is_drawn_over_all_maps():
    over = [colours.BORDER, colours.LINE, colours.TRUE_WALL, colours.ROBOT, colours.ABOVE_THRESHOLD]
    known = colours.sensor_colours(["ping", "dirrs", "lidar", "vl53l0x"]).values()
    for one, other in itertools.product(over, known):
        assert np.abs(np.subtract(one, other)).sum() > 100, (one, other)


def test_numbers_in_names_are_taken_as_numbers():
    assert colours.in_place(["ping10", "fused", "dirrs", "ping9"]) == [
        "ping9", "ping10", "dirrs", "fused",
    ]  # fmt: skip
