"""A session cut at every byte, or with a bit flipped in any byte: never wrong, always reported."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recorder.errors import BadInput
from recorder.geometry import SE2
from recorder.messages import Message, Pose, Radiation, Range, Record, Transform
from recorder.session import Session, SessionReader, SessionWriter, read_session
from recorder.session.recover import recover

T_NS = 1_700_000_000_123_456_789
CALIBRATION = {"mount_m": [0.044, 0.0], "name": "Ω"}
WALLS = b'{"walls": []}'
CHUNK = 6


def made_messages() -> Iterator[Message]:
    yield Transform(T_NS, "base_link", "ping", SE2(0.044, 0.0, 0.1))
    for i in range(7):
        t_ns = T_NS + i * 50_000_000
        yield Pose(t_ns, SE2(0.01 * i, 1.0, 0.02 * i))
        yield Range(t_ns, "ping", 0.5 + 0.01 * i, 0.663, 0.02, 3.3, Radiation.ULTRASOUND)


def written(path: Path, *, compress: bool) -> Session:
    with SessionWriter(path, metadata=CALIBRATION, compress=compress) as session:
        session.attach("truth.geojson", "application/geo+json", WALLS)
        for number, message in enumerate(made_messages()):
            session.write(message, log_ns=T_NS + number)
            if number % CHUNK == CHUNK - 1:
                session.sync()
    whole = read_session(path)
    assert len(whole.records) == 15
    assert whole.damage == ()
    return whole


def tried(path: Path, data: bytes | bytearray) -> Session | None:
    """What is read; None where the file is refused."""
    path.write_bytes(data)
    try:
        return read_session(path)
    except BadInput:
        return None


def is_part(part: tuple[Record, ...], whole: tuple[Record, ...]) -> bool:
    rest = iter(whole)
    return all(record in rest for record in part)


def assert_nothing_wrong(session: Session, whole: Session, where: int) -> None:
    """All that is there is right, and if something is not there, that is reported."""
    assert is_part(session.records, whole.records), where
    assert session.metadata in (whole.metadata, {}), where
    assert session.attachments in (whole.attachments, {}), where
    same = (
        session.records == whole.records
        and session.metadata == whole.metadata
        and session.attachments == whole.attachments
    )
    assert same or session.damage, where


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, bytes, Path]:
    """A session, its bytes, and a folder."""
    folder = tmp_path_factory.mktemp("damage")
    session = written(folder / "s.mcap", compress=False)
    return session, (folder / "s.mcap").read_bytes(), folder


def test_cut_at_every_byte(tmp_path: Path) -> None:
    whole = written(tmp_path / "s.mcap", compress=True)
    data, path = (tmp_path / "s.mcap").read_bytes(), tmp_path / "cut.mcap"
    kept: list[int] = []
    for length in range(len(data)):
        session = tried(path, data[:length])
        if session is None:
            kept.append(-1)
            continue
        assert_nothing_wrong(session, whole, length)
        assert session.records == whole.records[: len(session.records)], length
        assert session.damage, length
        kept.append(len(session.records))
    assert kept == sorted(kept)
    assert set(kept) == {-1, 0, 6, 12, 15}


@pytest.mark.parametrize("compress", [True, False])
def test_a_bit_flipped_in_every_byte(tmp_path: Path, compress: bool) -> None:
    """A flip costs one chunk at most, the rest is read; and every single one is noticed."""
    whole = written(tmp_path / "s.mcap", compress=compress)
    data, path = (tmp_path / "s.mcap").read_bytes(), tmp_path / "flip.mcap"
    kept: Counter[int] = Counter()
    for position in range(len(data)):
        flipped = bytearray(data)
        flipped[position] ^= 1 << position % 8
        session = tried(path, flipped)
        assert session is not None, position
        assert_nothing_wrong(session, whole, position)
        assert session.damage, position
        kept[len(session.records)] += 1
    assert set(kept) <= {9, 12, 15}
    assert kept[15] > len(data) / 3


def test_every_bit_of_the_framing(tmp_path: Path) -> None:
    """All eight bits of the bytes that no checksum of the format covers: between the chunks."""
    whole = written(tmp_path / "s.mcap", compress=True)
    data, path = (tmp_path / "s.mcap").read_bytes(), tmp_path / "flip.mcap"
    starts = [
        i for i in range(len(data)) if data[i : i + 1] == b"\x06" and b"zstd" in data[i:][:50]
    ]
    assert len(starts) >= 3
    for position in {p for start in starts[:3] for p in range(start - 30, start + 45)}:
        for bit in range(8):
            flipped = bytearray(data)
            flipped[position] ^= 1 << bit
            session = tried(path, flipped)
            assert session is not None, position
            assert_nothing_wrong(session, whole, position)
            assert session.damage, position


def test_what_is_recovered_of_any_flip_is_whole_again(tmp_path: Path) -> None:
    whole = written(tmp_path / "s.mcap", compress=True)
    data = (tmp_path / "s.mcap").read_bytes()
    bad, good = tmp_path / "bad.mcap", tmp_path / "good.mcap"
    for position in range(0, len(data), 23):
        flipped = bytearray(data)
        flipped[position] ^= 1 << position % 8
        bad.write_bytes(flipped)
        found, recovery = read_session(bad), recover(bad, good, force=True)
        assert recovery.lost == found.damage, position
        mended = read_session(good)
        assert mended.damage == (), position
        assert mended.records == found.records, position
        recovered = mended.metadata["recovered"]
        assert recovered == {"from": "bad.mcap", "lost": list(found.damage)}, position
        assert {k: v for k, v in mended.metadata.items() if k != "recovered"} == found.metadata
        assert mended.attachments == found.attachments
        assert_nothing_wrong(found, whole, position)


def test_what_is_recovered_of_any_cut_is_whole_again(tmp_path: Path) -> None:
    written(tmp_path / "s.mcap", compress=True)
    data = (tmp_path / "s.mcap").read_bytes()
    bad, good = tmp_path / "bad.mcap", tmp_path / "good.mcap"
    refused = 0
    for length in range(0, len(data), 23):
        session = tried(bad, data[:length])
        if session is None:
            with pytest.raises(BadInput):
                recover(bad, good, force=True)
            refused += 1
            continue
        assert recover(bad, good, force=True).lost == session.damage, length
        mended = read_session(good)
        assert mended.damage == ()
        assert mended.records == session.records
    assert 0 < refused < 20


@settings(deadline=None, max_examples=100)
@given(data=st.data())
def test_any_damage_at_all(data: st.DataObject, whole: tuple[Session, bytes, Path]) -> None:
    """Stretches missing, overwritten and put in, several of them: never wrong, always reported."""
    session, sound, folder = whole
    damaged = bytearray(sound)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(damaged)))
        end = data.draw(st.integers(start, min(start + 400, len(damaged))))
        damaged[start:end] = data.draw(st.binary(max_size=80))
    found = tried(folder / "damaged.mcap", damaged)
    if found is not None:
        assert is_part(found.records, session.records)
        assert found.metadata in (session.metadata, {})
        assert found.attachments in (session.attachments, {})
        assert found.damage or damaged == sound


def test_two_flips_leave_what_lies_between_and_behind(tmp_path: Path) -> None:
    """The first chunk, which alone defines the channels, and the length of the second are lost."""
    whole = written(tmp_path / "s.mcap", compress=False)
    data = bytearray((tmp_path / "s.mcap").read_bytes())
    chunks = [i for i in range(len(data) - 9) if _is_chunk_start(data, i)]
    data[chunks[0] + 60] ^= 1
    data[chunks[1] + 3] ^= 1
    session = tried(tmp_path / "two.mcap", data)
    assert session is not None
    assert session.records == whole.records[12:]
    assert any("12 of 15 messages are missing" in reason for reason in session.damage)


def _is_chunk_start(data: bytearray, position: int) -> bool:
    length = int.from_bytes(data[position + 1 : position + 9], "little")
    empty_compression = data[position + 9 + 28 : position + 9 + 32] == bytes(4)
    inside = int.from_bytes(data[position + 9 + 32 : position + 9 + 40], "little")
    return data[position] == 6 and empty_compression and length == inside + 40


def test_a_chunk_inside_an_attachment_is_no_part_of_the_session(tmp_path: Path) -> None:
    inner = tmp_path / "inner.mcap"
    with SessionWriter(inner) as session:
        session.write(Pose(5, SE2(9.0, 9.0, 0.0)), log_ns=5)
    outer = tmp_path / "outer.mcap"
    with SessionWriter(outer) as session:
        session.attach("inner.mcap", "application/mcap", inner.read_bytes())
        session.write(Pose(6, SE2(1.0, 1.0, 0.0)), log_ns=6)
    good, data = read_session(outer), bytearray(outer.read_bytes())
    end = data.index(inner.read_bytes()) + inner.stat().st_size
    for position in range(end + 4, end + 14):  # the frame of the chunk behind it
        flipped = bytearray(data)
        flipped[position] ^= 1 << position % 8
        found = tried(tmp_path / "flip.mcap", flipped)
        assert found is not None
        assert is_part(found.records, good.records), position
        assert found.damage


def test_a_reader_does_not_keep_what_it_has_read(tmp_path: Path) -> None:
    path = tmp_path / "s.mcap"
    with SessionWriter(path) as session:
        for number in range(3000):
            session.write(Pose(number, SE2(number, 0.0, 0.0)), log_ns=number)
            if number % 500 == 499:
                session.sync()
    reader, positions = SessionReader(path), []
    for number, record in enumerate(reader.records()):
        assert record.log_ns == number
        positions.append(reader.position)
    # it walks through the file as the records are asked for
    assert positions[0] < positions[1500] < positions[-1] <= path.stat().st_size
    assert reader.messages == 3000
