"""True walls: an attachment of a session, or a file, as GeoJSON in metres, exact to the last bit.

Lines and polygons, alone or inside features and collections, become straight walls. GeoJSON is
meant for degrees on the globe; here its numbers are metres in the map frame, and every digit
counts: the library's rounding to six decimals is switched off.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import geojson
import numpy as np
from numpy.typing import NDArray

from recorder.errors import BadInput
from recorder.foreign import check_file, reading, reason_of
from recorder.inputs import note_input

WALLS = "truth.geojson"  # the name of the attachment
WALLS_TYPE = "application/geo+json"
SMOOTH = "smooth"  # the surface of a wall of which nothing is stated
MAX_EXTENT_M = 100.0
MAX_FARTHEST_M = 1e6
MAX_WALLS = 10_000
MAX_BYTES = 10_000_000
_ALL_DIGITS = 400  # more decimals than a double can have: coordinates stay as they are


def true_walls(attachments: Mapping[str, bytes]) -> NDArray[np.float64] | None:
    """The true walls (K, 2, 2) in metres that a session carries; None where it carries none."""
    if WALLS not in attachments:
        return None
    try:
        return walls_from_geojson(attachments[WALLS])
    except BadInput as error:
        raise BadInput(f"the session's attachment {WALLS}: {error}") from None


def true_surfaces(attachments: Mapping[str, bytes]) -> tuple[str, ...]:
    """What each of a session's :func:`true_walls` is made of; empty where nothing is stated."""
    return surfaced_walls(attachments[WALLS])[1] if WALLS in attachments else ()


def walls_to_geojson(
    walls_m: NDArray[np.float64], name: str, surfaces: Sequence[str] = ()
) -> bytes:
    """Walls (K, 2, 2) as features that :func:`walls_from_geojson` gives back exactly.

    They are one feature, or one for each stretch of the same surface, where ``surfaces`` (K) names
    what each is made of.
    """
    cuts = [k for k in range(1, len(surfaces)) if surfaces[k] != surfaces[k - 1]]
    features = []
    for first, end in itertools.pairwise([0, *cuts, len(walls_m)]):
        geometry = geojson.MultiLineString(walls_m[first:end].tolist(), precision=_ALL_DIGITS)
        made_of = {"surface": surfaces[first]} if surfaces else {}
        features.append(geojson.Feature(geometry=geometry, properties={"name": name, **made_of}))
    return str(geojson.dumps(geojson.FeatureCollection(features))).encode()


def walls_from_geojson(data: bytes) -> NDArray[np.float64]:
    """Lines and polygons → walls (K, 2, 2) in metres, read-only, in the order of the file.

    Raises BadInput as :func:`surfaced_walls` does.
    """
    return surfaced_walls(data)[0]


def surfaced_walls(data: bytes) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """The same, with what each wall is made of: its feature's property ``surface``.

    Walls without one are smooth; no surfaces at all where no feature has the property. Points are
    skipped, and so are walls without length. Raises BadInput, in one line, for anything that is not
    GeoJSON, holds no wall, holds a number that is not finite, spans more than 100 m or has more
    than 10,000 walls.
    """
    if len(data) > MAX_BYTES:
        raise BadInput(f"{len(data)} bytes are too many for a room (at most {MAX_BYTES})")
    try:
        root = geojson.loads(data.decode("utf-8-sig"), object_hook=_exact)
        found = [
            (piece, surface)
            for geometry, surface in _geometries(root)
            for piece in _pieces(geometry)
        ]
        walls_m = np.array([piece for piece, _ in found], dtype=np.float64).reshape(-1, 2, 2)
    except BadInput:
        raise
    except RecursionError:
        raise BadInput("this GeoJSON is nested too deeply") from None
    except Exception as error:  # the library raises whatever its parser happens to
        raise BadInput(f"this is no GeoJSON that can be read: {reason_of(error)}") from None
    surfaces = tuple(surface or SMOOTH for _, surface in found)
    return _checked(walls_m), surfaces if any(surface for _, surface in found) else ()


def read_walls(file: Path) -> NDArray[np.float64]:
    """The walls in a GeoJSON file; BadInput names the file."""
    return read_surfaced_walls(file)[0]


def read_surfaced_walls(file: Path) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """The walls in a GeoJSON file, and their surfaces; BadInput names the file."""
    note_input(file)
    check_file(file, most_bytes=MAX_BYTES)
    with reading(file, "GeoJSON"):
        data = file.read_bytes()
    try:
        return surfaced_walls(data)
    except BadInput as error:
        raise BadInput(f"{file}: {error}") from None


def _exact(mapping: dict[str, Any]) -> Any:
    """A JSON object as the type that it names, without rounding its coordinates."""
    if "coordinates" in mapping:
        mapping = {
            "type": mapping.get("type"),
            "coordinates": mapping["coordinates"],
            "precision": _ALL_DIGITS,
        }
    return geojson.GeoJSON.to_instance(mapping)


def _geometries(node: Any, surface: str = "") -> Iterator[tuple[Any, str]]:
    """All simple geometries below a GeoJSON value, in order, with the surface of their feature."""
    match node:
        case geojson.FeatureCollection():
            for feature in node["features"]:
                yield from _geometries(feature)
        case geojson.Feature():
            if node["geometry"] is not None:
                stated = (node.get("properties") or {}).get("surface")
                made_of = stated if isinstance(stated, str) else ""
                yield from _geometries(node["geometry"], made_of)
        case geojson.GeometryCollection():
            for geometry in node["geometries"]:
                yield from _geometries(geometry, surface)
        case geojson.geometry.Geometry():
            yield node, surface
        case _:
            raise BadInput("this is no GeoJSON: lines or polygons were expected")


def _pieces(geometry: Any) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """The straight pieces of one simple geometry."""
    errors = geometry.errors()
    if errors:
        raise BadInput(f"a {geometry['type']} in this GeoJSON is not right: {_first(errors)}")
    coordinates = geometry["coordinates"]
    match geometry:
        case geojson.Polygon() | geojson.MultiLineString():
            lines = coordinates
        case geojson.MultiPolygon():
            lines = [ring for polygon in coordinates for ring in polygon]
        case geojson.LineString():
            lines = [coordinates]
        case _:
            lines = []
    for line in lines:
        corners = [(float(position[0]), float(position[1])) for position in line]
        yield from ((a, b) for a, b in itertools.pairwise(corners) if a != b)


def _first(errors: Any) -> str:
    """The first of the library's nested error lists."""
    while isinstance(errors, list):
        errors = errors[0]
    return str(errors)


def _checked(walls_m: NDArray[np.float64]) -> NDArray[np.float64]:
    if len(walls_m) == 0:
        raise BadInput("there is no wall in this GeoJSON (no line and no polygon)")
    if len(walls_m) > MAX_WALLS:
        raise BadInput(f"{len(walls_m)} walls are too many (at most {MAX_WALLS})")
    if not np.isfinite(walls_m).all():
        raise BadInput("a coordinate in this GeoJSON is not a finite number")
    points_m = walls_m.reshape(-1, 2)
    farthest_m = float(np.abs(points_m).max())
    if farthest_m > MAX_FARTHEST_M:
        raise BadInput(f"a wall lies {farthest_m:g} m from the origin: are these metres?")
    extent_m = float((points_m.max(axis=0) - points_m.min(axis=0)).max())
    if extent_m > MAX_EXTENT_M:
        raise BadInput(f"a room of {extent_m:g} m is too large (at most {MAX_EXTENT_M:g} m)")
    walls_m.setflags(write=False)
    return walls_m
