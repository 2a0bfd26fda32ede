"""The memory of a recording does not grow with its length, and its file has its whole index."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, ChunkIndex, MessageIndex
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from benchmarks.recorder_memory import LongRun, indexed_chunks, record_long
from recorder.session import SessionWriter, read_session
from recorder.session import index as session_index
from recorder.session.index import LIST_OF_THE_LIBRARY, ChunkIndexes
from recorder.session.writer import new_writer

CHUNKS_OF_TEN_HOURS = 45_000
TOPICS = ("/serial/raw", "/range/ping", "/range/dirrs")
GROWTH_BYTES = 50_000  # the library's own list would take 36 MB for ten hours


def started(writer: Writer) -> list[int]:
    """A file begun, and the ids of its channels."""
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    return [writer.register_channel(topic, "cdr", schema) for topic in TOPICS]


def test_ten_hours_of_chunks_take_no_memory_and_are_all_in_the_index(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as file, ChunkIndexes(tmp_path) as indexes:
        writer = new_writer(file, indexes)
        channels = started(writer)
        tracemalloc.start()
        try:
            for number in range(CHUNKS_OF_TEN_HOURS):
                writer.add_message(channels[number % 3], number, b"", number)
                writer.flush()  # type: ignore[no-untyped-call]
                if number == 500:
                    early_bytes, _ = tracemalloc.get_traced_memory()
            late_bytes, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        writer.finish()  # type: ignore[no-untyped-call]
    assert late_bytes - early_bytes < GROWTH_BYTES
    assert indexed_chunks(path) == (CHUNKS_OF_TEN_HOURS, CHUNKS_OF_TEN_HOURS)


def test_a_recording_takes_no_more_memory_late_than_early(tmp_path: Path) -> None:
    """The whole recorder by a simulated clock: noise, unplugged, restarted, with a tracker."""
    run = LongRun(seconds=600, rate=10, hour_s=120)
    traced: list[int] = []
    tracemalloc.start()
    try:
        counters = record_long(
            tmp_path / "run.mcap",
            run,
            75,
            lambda _: traced.append(tracemalloc.get_traced_memory()[0]),
        )
    finally:
        tracemalloc.stop()
    assert counters.received == run.lines - run.noisy == 6_000 - 6
    assert counters.reconnects == 5
    assert counters.device_restarts == 5
    assert counters.poses == 300
    assert len(traced) == 10  # each minute; the clock's fit looks back over one
    assert max(traced[3:]) - traced[2] < GROWTH_BYTES
    indexed, chunks = indexed_chunks(tmp_path / "run.mcap")
    assert indexed == chunks >= 750


def indexes_found(path: Path) -> tuple[list[ChunkIndex], list[ChunkIndex]]:
    """The entries of a file's index, and what they should be by the chunks themselves."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        file.seek(0)
        should_be: list[ChunkIndex] = []
        position = 8
        for record in StreamReader(file, emit_chunks=True).records:
            end = file.tell()
            if isinstance(record, Chunk):
                should_be.append(
                    ChunkIndex(
                        chunk_length=end - position,
                        chunk_start_offset=position,
                        compression=record.compression,
                        compressed_size=len(record.data),
                        message_end_time=record.message_end_time,
                        message_index_length=0,
                        message_index_offsets={},
                        message_start_time=record.message_start_time,
                        uncompressed_size=record.uncompressed_size,
                    )
                )
            elif isinstance(record, MessageIndex):
                should_be[-1].message_index_offsets[record.channel_id] = position
                should_be[-1].message_index_length += end - position
            position = end
    return summary.chunk_indexes, should_be


def test_the_index_holds_where_each_chunk_and_each_channel_in_it_is(tmp_path: Path) -> None:
    record_long(tmp_path / "run.mcap", LongRun(seconds=20, rate=20), 10, lambda _: None)
    found, should_be = indexes_found(tmp_path / "run.mcap")
    assert len(found) > 20
    assert len({len(index.message_index_offsets) for index in found}) > 1
    assert found == should_be


def test_the_file_is_the_one_that_the_library_writes_by_itself(tmp_path: Path) -> None:
    def written(name: str, *, with_list: bool) -> bytes:
        with (tmp_path / name).open("wb") as file, ChunkIndexes(tmp_path) as indexes:
            writer = new_writer(file, indexes)
            if with_list:
                vars(writer)[LIST_OF_THE_LIBRARY] = []
            for number, channel in enumerate(started(writer) * 100):
                writer.add_message(channel, number, b"%d" % number, number)
                if number % 7 == 0:
                    writer.flush()  # type: ignore[no-untyped-call]
            writer.finish()  # type: ignore[no-untyped-call]
        return (tmp_path / name).read_bytes()

    assert written("ours.mcap", with_list=False) == written("theirs.mcap", with_list=True)


def test_the_library_still_keeps_its_index_where_we_look_for_it(tmp_path: Path) -> None:
    """Fails when the library changed: then see how it keeps its index now."""
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        [channel, *_] = started(writer)
        assert vars(writer).get(LIST_OF_THE_LIBRARY) == []
        writer.add_message(channel, 1, b"", 1)
        writer.flush()  # type: ignore[no-untyped-call]
        [index] = vars(writer)[LIST_OF_THE_LIBRARY]
    assert isinstance(index, ChunkIndex)


def test_a_library_without_that_list_is_left_alone() -> None:
    class OtherWriter:
        """A later version."""

    later = OtherWriter()
    with ChunkIndexes(Path()) as indexes:
        indexes.serve(later)  # type: ignore[arg-type]
    assert vars(later) == {}


def test_a_folder_that_takes_no_other_file_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(**_: object) -> None:
        raise PermissionError("not here")

    monkeypatch.setattr(session_index.tempfile, "TemporaryFile", refused)
    record_long(tmp_path / "run.mcap", LongRun(seconds=20, rate=5), 10, lambda _: None)
    indexed, chunks = indexed_chunks(tmp_path / "run.mcap")
    assert indexed == chunks > 20


def test_nothing_is_left_beside_a_session(tmp_path: Path) -> None:
    with SessionWriter(tmp_path / "run.mcap", live=True):
        assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]
    assert read_session(tmp_path / "run.mcap").damage == ()
