"""Rooms, their GeoJSON and their routes."""

from __future__ import annotations

import json
import math

import geojson
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from naive_echoes import nearest_wall, point_to_wall
from scipy import ndimage

from recorder.errors import BadInput
from recorder.simulator.rooms import ROOMS, ROUTES, Room, check_route, load_room, parse_route
from recorder.simulator.routes import ROBOT_RADIUS_M, _outline, default_route, inside
from recorder.simulator.walls import disc, leg_clearance, path, point_clearance, rectangle
from recorder.truth import surfaced_walls, true_surfaces, walls_from_geojson, walls_to_geojson

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [0.0, 0.0]]
walls_arrays = hnp.arrays(
    np.float64, st.tuples(st.integers(1, 8), st.just(2), st.just(2)), elements=st.floats(-40, 40)
).map(lambda walls: walls[np.any(walls[:, 0] != walls[:, 1], axis=1)])


def drawn(*geometries: dict) -> bytes:
    features = [{"type": "Feature", "properties": {}, "geometry": g} for g in geometries]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def test_the_rooms_are_the_promised_ones():
    promised = {
        "room", "empty", "l-room", "corridor", "cluttered", "pillar", "skewed", "square", "glass",
        "rough", "flat",
    }  # fmt: skip
    assert set(ROOMS) == promised
    width_m, height_m = np.ptp(ROOMS["room"].walls_m, axis=(0, 1))
    assert (width_m, height_m) == (2.2, 1.6)
    assert len(ROOMS["room"].walls_m) == 4 + 2 * 4


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_can_be_driven_and_cannot_be_changed(name):
    room = ROOMS[name]
    check_route(room.route_m, room)
    check_route(default_route(room.walls_m), room)
    with pytest.raises(ValueError, match="read-only"):
        room.walls_m[0, 0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        room.route_m[0, 0] = 1.0


@pytest.mark.parametrize("name", ROOMS)
def test_rooms_have_no_hole_in_their_outer_walls(name):
    """From every waypoint, whatever the direction, there is a wall within the sonar's 4 m."""
    room = ROOMS[name]
    for waypoint in room.route_m:
        for heading_rad in np.linspace(-math.pi, math.pi, 73):
            assert nearest_wall(room.walls_m, waypoint, heading_rad)[0] < 4.0


@given(walls_arrays.filter(len))
@settings(deadline=None)
def test_walls_come_back_from_geojson_exactly(walls_m):
    again = walls_from_geojson(walls_to_geojson(walls_m, "any"))
    assert again.tobytes() == walls_m.tobytes()


@pytest.mark.parametrize("name", ROOMS)
def test_built_in_rooms_come_back_from_geojson_exactly(name):
    data = walls_to_geojson(ROOMS[name].walls_m, name, ROOMS[name].surfaces)
    walls_m, surfaces = surfaced_walls(data)
    np.testing.assert_array_equal(walls_m, ROOMS[name].walls_m)
    assert surfaces == ROOMS[name].surfaces
    assert geojson.loads(data)["features"][0].is_valid


def test_every_kind_of_line_and_polygon_is_read():
    line = {"type": "LineString", "coordinates": [[0, 0], [1, 0], [1, 0], [1, 1]]}
    lines = {"type": "MultiLineString", "coordinates": [[[0, 0], [0, 1]], [[2, 2], [3, 3]]]}
    polygon = {"type": "Polygon", "coordinates": [SQUARE, [[1, 1], [1.5, 1], [1, 1.5], [1, 1]]]}
    polygons = {"type": "MultiPolygon", "coordinates": [[SQUARE], [SQUARE]]}
    point = {"type": "Point", "coordinates": [5, 5]}
    for geometry, count in ((line, 2), (lines, 2), (polygon, 7), (polygons, 8)):
        assert len(walls_from_geojson(json.dumps(geometry).encode())) == count
        assert len(walls_from_geojson(drawn(geometry, point))) == count
    collection = {"type": "GeometryCollection", "geometries": [line, point, polygon]}
    assert len(walls_from_geojson(json.dumps(collection).encode())) == 9
    assert len(walls_from_geojson(drawn(collection, lines))) == 11
    with_heights = {"type": "LineString", "coordinates": [[0, 0, 7], [1, 0, 7]]}
    assert walls_from_geojson(drawn(with_heights)).tolist() == [[[0, 0], [1, 0]]]
    assert walls_from_geojson(b"\xef\xbb\xbf" + drawn(line)).shape == (2, 2, 2)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "no GeoJSON"),
        (b"\xff\xfe\x00", "no GeoJSON"),
        (b"[1, 2]", "lines or polygons"),
        (b'{"type": "Robot"}', "lines or polygons"),
        (b'{"type": "FeatureCollection"}', "no GeoJSON"),
        (b'{"type": "FeatureCollection", "features": 3}', "no GeoJSON"),
        (drawn(), "no wall"),
        (drawn({"type": "Point", "coordinates": [1, 2]}), "no wall"),
        (drawn({"type": "LineString", "coordinates": [[1, 1], [1, 1]]}), "no wall"),
        (drawn({"type": "LineString", "coordinates": [[1, 1]]}), "not right"),
        (drawn({"type": "LineString", "coordinates": "abc"}), "no GeoJSON"),
        (drawn({"type": "LineString", "coordinates": [["a", 1], [2, 2]]}), "no GeoJSON"),
        (drawn({"type": "Polygon", "coordinates": [SQUARE[:4]]}), "must end where it started"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [NaN, 1]]}', "no GeoJSON"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [1e999, 1]]}', "not a finite number"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [1%s, 1]]}' % (b"0" * 400), "GeoJSON"),
        (b'{"type": "LineString", "coordinates": [[0, 0], [1e300, 1]]}', "metres"),
        (drawn({"type": "LineString", "coordinates": [[0, 0], [101, 1]]}), "too large"),
        (b'{"type": "GeometryCollection", "geometries": [' * 5000, "nested too deeply"),
        (b" " * 10_000_001, "too many for a room"),
        (
            drawn({"type": "LineString", "coordinates": [[k % 2, 0] for k in range(10_002)]}),
            "too many",
        ),
    ],
)
def test_what_is_no_room_is_refused_in_one_line(data, reason):
    with pytest.raises(BadInput, match=reason) as caught:
        walls_from_geojson(data)
    assert "\n" not in str(caught.value)


def test_rooms_are_found_by_name_and_by_file(tmp_path):
    assert load_room("pillar") is ROOMS["pillar"]
    file = tmp_path / "flat.geojson"
    file.write_bytes(walls_to_geojson(ROOMS["l-room"].walls_m, "l-room"))
    room = load_room(file)
    assert room.name == "flat"
    np.testing.assert_array_equal(room.walls_m, ROOMS["l-room"].walls_m)
    check_route(room.route_m, room)
    with pytest.raises(BadInput, match="did you mean 'corridor'"):
        load_room("coridor")
    with pytest.raises(BadInput, match="there are room, empty"):
        load_room("xyz")
    with pytest.raises(BadInput, match="no such file"):
        load_room(tmp_path / "missing.geojson")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(BadInput, match=r"bad\.json: this is no GeoJSON"):
        load_room(tmp_path / "bad.json")
    with pytest.raises(BadInput, match="a folder"):
        load_room(tmp_path)
    tiny = {"type": "Polygon", "coordinates": [[[x / 40, y / 40] for x, y in SQUARE]]}
    (tmp_path / "tiny.geojson").write_bytes(drawn(tiny))
    with pytest.raises(BadInput, match=r"tiny\.geojson: .* no place where a robot could drive"):
        load_room(tmp_path / "tiny.geojson")


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=25)
def test_a_made_up_route_keeps_clear_of_the_walls(seed):
    """Random boxes and pillars in a random rectangle, turned by a random angle."""
    rng = np.random.default_rng(seed)
    angle_rad = rng.uniform(-math.pi, math.pi)
    groups = [rectangle((0, 0), *rng.uniform(1.2, 4.0, 2), angle_rad)]
    for _ in range(rng.integers(0, 5)):
        groups.append(rectangle(rng.uniform(-1, 1, 2), 0.3, 0.2, rng.uniform(-3, 3)))
        groups.append(disc(rng.uniform(-1, 1, 2), 0.1))
    walls_m = np.concatenate(groups)
    route_m = default_route(walls_m)
    check_route(route_m, Room("random", walls_m, route_m))
    np.testing.assert_array_equal(route_m, default_route(walls_m))


def test_walls_that_enclose_nothing_are_driven_around():
    walls_m = path([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0)])
    route_m = default_route(walls_m)
    assert len(route_m) > 2
    check_route(route_m, Room("open", walls_m, route_m))


def test_one_place_is_enough_to_turn_on_the_spot():
    walls_m = rectangle((0.0, 0.0), 0.42, 0.42)
    route_m = default_route(walls_m)
    check_route(route_m, Room("closet", walls_m, route_m))
    assert np.abs(route_m).max() < 0.1


def test_routes_are_read():
    room = ROOMS["empty"]
    assert parse_route("default", room) is room.route_m
    route_m = parse_route(" 0.3,0.3; 1.5 , 0.3;1.5,1.1;", room)
    assert route_m.tolist() == [[0.3, 0.3], [1.5, 0.3], [1.5, 1.1]]
    assert not route_m.flags.writeable
    assert parse_route("1,0.7", room).shape == (1, 2)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty"),
        (";;", "empty"),
        ("defualt", "no waypoint"),
        ("1,2,3", "no waypoint"),
        ("1", "no waypoint"),
        ("nan,1", "not finite"),
        ("1,1e999", "not finite"),
        ("0.2,0.3;2.5,0.3", r"leaves room 'room' at \(2.5, 0.3\)"),
        ("-0.2,0.3", "leaves room"),
        ("0.3,0.8;1.2,0.8", "crosses a wall"),
        ("0.3,0.3;0.3,1.58", "comes within 0.020 m of a wall"),
        ("0.75,0.8", "comes within|leaves"),
    ],
)
def test_a_route_that_cannot_be_driven_is_refused_in_one_line(text, reason):
    with pytest.raises(BadInput, match=reason) as caught:
        parse_route(text, ROOMS["room"])
    assert "\n" not in str(caught.value)


def test_the_notch_of_an_l_is_outside():
    walls_m = ROOMS["l-room"].walls_m
    points_m = np.array([[0.5, 1.5], [1.8, 0.5], [1.8, 1.5], [1.2, 1.1], [-0.1, 0.5]])
    assert inside(points_m, walls_m).tolist() == [True, True, False, False, False]


@given(walls_arrays.filter(len), st.tuples(*[st.floats(-40, 40)] * 2))
@settings(deadline=None, max_examples=15)
def test_distance_from_a_wall_is_that_of_its_nearest_point(walls_m, point):
    found_m = point_clearance(np.array([point]), walls_m[0])[0]
    assert found_m == pytest.approx(point_to_wall(point, walls_m[0]), abs=0.01)


def test_clearance_of_a_leg():
    walls_m = rectangle((0.0, 0.0), 2.0, 2.0)
    a, b = np.array([-0.5, 0.0]), np.array([0.5, 0.6])
    assert leg_clearance(a, b, walls_m) == pytest.approx(0.4)
    assert leg_clearance(a, np.array([1.5, 0.0]), walls_m) == 0.0
    across_a_corner = np.array([[0.0, 1.5], [1.5, 0.0]])
    assert leg_clearance(*across_a_corner, walls_m) == 0.0
    assert leg_clearance(a, b, np.empty((0, 2, 2))) == math.inf
    assert ROBOT_RADIUS_M > 0.044  # the sonar in front never pokes through a wall


# --- routes by name


@pytest.mark.parametrize("name", ROOMS)
@pytest.mark.parametrize("kind", ROUTES)
def test_every_room_has_every_route(name, kind):
    room = ROOMS[name]
    route_m = parse_route(kind, room, seed=3)  # which checks that it can be driven
    np.testing.assert_array_equal(route_m, parse_route(kind, room, seed=3))
    assert not route_m.flags.writeable
    clearance_m = min(
        leg_clearance(a, b, room.walls_m)
        for a, b in zip(route_m, np.roll(route_m, -1, axis=0), strict=True)
    )
    if kind == "far":
        assert clearance_m > 0.2
    if kind == "walls":
        assert 0.07 <= clearance_m < 0.2


def test_along_the_walls_all_of_a_square_is_passed_and_on_the_spot_its_middle():
    room = ROOMS["square"]
    along = parse_route("walls", room)
    np.testing.assert_allclose(np.ptp(along, axis=0), 2.0 - 2 * 0.14, atol=0.05)
    np.testing.assert_allclose(parse_route("spin", room), [[1.0, 1.0]], atol=0.03)


def test_random_routes_follow_from_the_seed():
    one, other = (parse_route("random", ROOMS["empty"], seed) for seed in (1, 2))
    assert one.shape != other.shape or not np.array_equal(one, other)


@given(hnp.arrays(np.bool_, (7, 8)))
@settings(deadline=None, max_examples=100)
def test_an_outline_goes_round_its_patch(flags):
    """Neighbouring cells of the patch, all those at its rim, and no cell inside it."""
    label, count = ndimage.label(flags)
    for number in range(1, count + 1):
        patch = label == number
        cells = _outline(patch)
        assert patch[cells[:, 0], cells[:, 1]].all()
        steps = np.abs(np.roll(cells, -1, axis=0) - cells).max(axis=1)
        assert (steps <= 1).all()
        filled = ndimage.binary_fill_holes(patch)
        rim = filled & ~ndimage.binary_erosion(filled)
        assert {tuple(cell) for cell in cells.tolist()} <= set(
            map(tuple, np.argwhere(rim).tolist())
        )
        assert cells[:, 0].max() == np.flatnonzero(patch.any(axis=1)).max()
        assert cells[:, 1].max() == np.flatnonzero(patch.any(axis=0)).max()


# --- surfaces


def test_surfaces_of_a_file_and_of_a_session(tmp_path):
    line = {"type": "LineString", "coordinates": [[1.0, 0.0], [1.0, 1.0]]}
    feature = {"type": "Feature", "properties": {"surface": "glass"}, "geometry": line}
    room = {"type": "Polygon", "coordinates": [SQUARE]}
    collection = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "properties": None, "geometry": room}, feature]}  # fmt: skip
    data = json.dumps(collection).encode()
    surfaces = surfaced_walls(data)[1]
    assert surfaces == ("smooth",) * 4 + ("glass",)
    assert true_surfaces({"truth.geojson": data}) == surfaces
    assert true_surfaces({}) == ()
    assert surfaced_walls(drawn(room))[1] == ()
    file = tmp_path / "mine.geojson"
    file.write_bytes(data)
    assert load_room(file).surfaces == surfaces
    feature["properties"]["surface"] = "glas"
    file.write_bytes(json.dumps(collection).encode())
    with pytest.raises(BadInput, match="did you mean 'glass'"):
        load_room(file)


def test_a_room_has_a_surface_for_each_wall():
    room = ROOMS["empty"]
    with pytest.raises(ValueError, match="as many surfaces"):
        Room("x", room.walls_m.copy(), room.route_m.copy(), ("glass",))
