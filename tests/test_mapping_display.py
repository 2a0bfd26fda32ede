"""Maps as pictures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.display import (
    REDUCED_DEPTH,
    against_largest,
    at_depth,
    class_colours,
    classes,
    grey,
    three_colours,
    two_colours,
    with_alpha,
)
from mapping.fusion import classify
from mapping.grid import GridGeometry, Layer

SHADES = np.array([[0.0, 0.5, 1.0]])


def test_grey_runs_from_white_to_black_and_keeps_the_order_of_rows():
    image = grey(np.array([[0.0, 0.5], [1.0, 0.25]]))
    assert image.shape == (2, 2, 3)
    assert image.dtype == np.uint8
    np.testing.assert_array_equal(image[..., 0], [[255, 127], [0, 191]])
    assert (image[..., :1] == image).all()


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.integers(2, 40))
def test_reduced_depth_has_that_many_shades_and_none_moves_far(shades, levels):
    reduced = at_depth(np.array(shades), levels)
    assert len(np.unique(at_depth(np.linspace(0, 1, 1000), levels))) == levels
    assert np.abs(reduced - shades).max() <= 0.5 / (levels - 1) + 1e-12


def test_reduced_depth_keeps_the_unknown_apart():
    p = np.linspace(0.0, 1.0, 201)[None]
    few = np.unique(grey(p, levels=REDUCED_DEPTH)[..., 0])
    assert few.size == REDUCED_DEPTH
    assert at_depth(0.5, REDUCED_DEPTH) == 0.5
    assert np.unique(grey(p)[..., 0]).size > 100


def test_odds_are_shown_against_the_largest():
    np.testing.assert_allclose(against_largest([[0.5, 2.0, 8.0]]), [[0.0625, 0.25, 1.0]])
    np.testing.assert_array_equal(against_largest(np.zeros((2, 2))), np.zeros((2, 2)))
    np.testing.assert_array_equal(against_largest([[-1.0, 4.0]]), [[0.0, 1.0]])


def test_two_colours_mix_where_both_are():
    image = two_colours([[0.0, 1.0, 0.0, 1.0]], [[0.0, 0.0, 1.0, 1.0]])[0].astype(int)
    assert image[0].tolist() == [255, 255, 255]
    assert image[1, 0] > image[1, 2]  # red
    assert image[2, 2] > image[2, 0]  # blue
    assert image[3].sum() < min(image[1].sum(), image[2].sum())


def test_three_colours_show_in_green_what_two_sensors_share():
    image = three_colours([[0.0, 1.0, 0.0, 1.0]], [[0.0, 0.0, 1.0, 1.0]])[0].astype(int)
    assert image[0].tolist() == [255, 255, 255]
    assert image[1].argmax() == 0
    assert image[2].argmax() == 2
    assert image[3].argmax() == 1


def test_three_colours_of_three_sensors():
    eye = np.eye(3)
    image = three_colours(*eye.reshape(3, 1, 3))[0]
    assert [int(pixel.argmax()) for pixel in image] == [0, 2, 1]


def test_broken_values_still_make_a_picture():
    image = grey(np.array([[np.nan, -3.0, 7.0]]))
    np.testing.assert_array_equal(image[0, :, 0], [127, 255, 0])


def test_unseen_cells_can_be_clear():
    image = with_alpha(grey(SHADES), np.array([[True, False, True]]))
    np.testing.assert_array_equal(image[0, :, 3], [255, 0, 255])
    np.testing.assert_array_equal(image[..., :3], grey(SHADES))


def test_every_class_has_its_own_colour():
    values = np.array([[0.9, 0.1, 0.9, 0.5]], np.float32)
    geometry = GridGeometry((0.0, 0.0), 0.1, 1, 4)
    layers = [
        Layer(name, "probability", geometry, p, p, p != 0.5, {})
        for name, p in (("ping", values), ("dirrs", values[:, ::-1].copy()))
    ]
    found = classify(layers)
    colours = class_colours(found.names)
    assert len({tuple(c) for c in colours.tolist()}) == len(found.names)
    np.testing.assert_array_equal(classes(found), colours[found.codes])


@pytest.mark.parametrize(
    "picture", [grey, lambda p: two_colours(p, p), lambda p: three_colours(p, p)]
)
def test_an_empty_map_is_an_empty_picture(picture):
    assert picture(np.zeros((0, 4))).shape == (0, 4, 3)
