"""Readings are made bytes by a shortcut: the same bytes that the library makes of them."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import serialize_dynamic

from recorder.messages import Radiation, Range
from recorder.ros_definitions import DEFINITIONS
from recorder.ros_types import Decoder, encode

NAME = "sensor_msgs/msg/Range"
FLOATS = st.floats(width=32, allow_nan=False)
READINGS = st.builds(
    Range,
    t_ns=st.integers(0, 2**31 * 10**9 - 1),
    sensor=st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=40),
    range_m=FLOATS,
    beam_width_rad=FLOATS,
    min_range_m=FLOATS,
    max_range_m=FLOATS,
    radiation=st.sampled_from(Radiation),
)


def made_by_the_library(reading: Range) -> bytes:
    return bytes(
        serialize_dynamic(NAME, DEFINITIONS[NAME])[NAME](
            {
                "header": {
                    "stamp": {"sec": reading.t_ns // 10**9, "nanosec": reading.t_ns % 10**9},
                    "frame_id": reading.sensor,
                },
                "radiation_type": min(reading.radiation, 1),
                "field_of_view": reading.beam_width_rad,
                "min_range": reading.min_range_m,
                "max_range": reading.max_range_m,
                "range": reading.range_m,
                "variance": 0.0,
            }
        )
    )


@settings(deadline=None, max_examples=200)
@given(READINGS)
def test_the_bytes_of_a_reading_are_those_of_the_library(reading: Range) -> None:
    assert encode(reading) == made_by_the_library(reading)


@settings(deadline=None, max_examples=50)
@given(READINGS)
def test_a_reading_comes_back(reading: Range) -> None:
    topic = f"/range/{reading.sensor}"
    [back] = Decoder(NAME, DEFINITIONS[NAME].encode()).decode(encode(reading), topic, 0)
    assert isinstance(back, Range)
    assert (back.t_ns, back.sensor) == (reading.t_ns, reading.sensor)
    for name in ("range_m", "beam_width_rad", "min_range_m", "max_range_m"):
        assert getattr(back, name) == round(getattr(reading, name), 7)
