"""Links over real pseudo-terminals and sockets: bulk reads, unplugging, words for failures."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest
from fake_links import Collector, ManualClock, PtyDevice, Rfc2217Server, TcpServer

from recorder.clock import HostClock
from recorder.errors import BadInput, LinkError
from recorder.link import MAX_CHUNK_BYTES, Link, LinkEvent, Received


def test_bytes_arrive_whole_and_stamped(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "robot")
    device.plug()
    clock = HostClock()
    before_ns = clock.now_ns()
    collector = Collector(Link(str(device.path), clock=clock))
    collector.wait_for_states("opened")
    sent = bytes(range(256)) * 40
    device.write(sent)
    collector.wait_for_data(sent)
    collector.finish()
    device.unplug()
    assert collector.data == sent
    received = [event for event in collector.events if isinstance(event, Received)]
    assert all(0 < len(event.data) <= MAX_CHUNK_BYTES for event in received)
    assert len(received) < len(sent) / 10, "read in bulk, not byte by byte"
    stamps = [event.arrival_ns for event in received]
    assert stamps == sorted(stamps)
    assert before_ns <= stamps[0] <= stamps[-1] <= clock.now_ns()


def test_unplugged_and_plugged_again(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "robot")
    device.plug()
    collector = Collector(Link(str(device.path), clock=HostClock()))
    collector.wait_for_states("opened")
    for round_trip in range(2):
        device.write(b"before %d" % round_trip)
        collector.wait_for_data(b"before %d" % round_trip)
        device.unplug()
        collector.wait_for_states("opened", *["lost", "reopened"] * round_trip, "lost")
        device.plug()
        collector.wait_for_states("opened", *["lost", "reopened"] * (round_trip + 1))
    device.write(b"after")
    collector.wait_for_data(b"after")
    collector.finish()
    assert collector.data == b"before 0before 1after"
    lost = [event for event in collector.events if isinstance(event, LinkEvent)][1]
    assert lost.reason
    assert "\n" not in lost.reason


def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    missing = Link(str(tmp_path / "nothing"), clock=ManualClock())
    with pytest.raises(LinkError, match="no such device") as caught:
        missing.open()
    assert "\n" not in str(caught.value)
    with pytest.raises(LinkError):
        next(missing.events(threading.Event()))


def test_a_device_that_is_waited_for(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "robot")
    collector = Collector(Link(str(device.path), clock=HostClock(), wait=True))
    device.plug()
    collector.wait_for_states("opened")
    device.write(b"here")
    collector.wait_for_data(b"here")
    collector.finish()
    assert collector.states == ["opened"]
    assert collector.data == b"here"
    device.unplug()


def test_a_device_is_opened_once_only(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "robot")
    device.plug()
    first = Link(str(device.path), clock=ManualClock())
    first.open()
    with pytest.raises(LinkError, match="another program"):
        Link(str(device.path), clock=ManualClock()).open()
    first.close()
    again = Link(str(device.path), clock=ManualClock())
    again.open()
    again.close()
    device.unplug()


def test_what_was_opened_beforehand_is_used(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "robot")
    device.plug()
    link = Link(str(device.path), clock=HostClock())
    link.open()
    device.write(b"early")
    collector = Collector(link)
    collector.wait_for_data(b"early")
    collector.finish()
    assert collector.data == b"early"
    assert "lost" not in collector.states
    device.unplug()


def test_a_file_is_no_serial_device(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("hello")
    for wrong in (path, tmp_path):
        with pytest.raises(LinkError, match=r"it is not a serial device$"):
            Link(str(wrong), clock=ManualClock()).open()


@pytest.mark.parametrize(
    "url",
    ["foo://x", "socket://", "socket://host", "tcp://host:port", "tcp://host:99999", "udp://:",
     "tcp://a..b:1"],
)  # fmt: skip
def test_addresses_that_never_work(url: str) -> None:
    with pytest.raises(BadInput):
        Link(url, clock=ManualClock())


def test_a_baud_rate_of_nothing() -> None:
    with pytest.raises(BadInput):
        Link("/dev/ttyUSB0", 0, clock=ManualClock())


@pytest.mark.parametrize("scheme", ["socket", "tcp"])
def test_a_socket_that_hangs_up_is_connected_again(scheme: str) -> None:
    server = TcpServer()
    collector = Collector(Link(f"{scheme}://127.0.0.1:{server.port}", clock=HostClock()))
    server.accept()
    server.send(b"one")
    collector.wait_for_data(b"one")
    server.hang_up()
    server.accept()
    server.send(b"two")
    collector.wait_for_data(b"two")
    collector.finish()
    server.close()
    assert collector.states == ["opened", "lost", "reopened"]
    assert collector.data == b"onetwo"


def test_nobody_listens() -> None:
    server = TcpServer()
    server.close()
    with pytest.raises(LinkError, match="nobody listens"):
        Link(f"socket://127.0.0.1:{server.port}", clock=ManualClock()).open()


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def test_each_datagram_ends_a_line() -> None:
    port = free_udp_port()
    collector = Collector(Link(f"udp://127.0.0.1:{port}", clock=HostClock()))
    collector.wait_for_states("opened")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in (b"a", b"", b"b\n", b"c"):
            sender.sendto(data, ("127.0.0.1", port))
        collector.wait_for_data(b"c\n")
    with pytest.raises(LinkError, match="another program"):
        Link(f"udp://127.0.0.1:{port}", clock=ManualClock()).open()
    collector.finish()
    assert collector.data == b"a\nb\nc\n"


def test_a_serial_port_over_the_network() -> None:
    server = Rfc2217Server()
    collector = Collector(Link(f"rfc2217://127.0.0.1:{server.port}", clock=HostClock()))
    collector.wait_for_states("opened")
    server.to_send = b"$hello \xff world\r\n"
    collector.wait_for_data(b"$hello \xff world\r\n")
    collector.finish()
    server.join(20)
    assert not server.is_alive()


def test_what_is_written_arrives(tmp_path: Path) -> None:
    device, server = PtyDevice(tmp_path / "robot"), TcpServer()
    device.plug()
    for url, receive in (
        (str(device.path), device.read),
        (f"tcp://127.0.0.1:{server.port}", server.receive),
    ):
        link = Link(url, clock=ManualClock())
        assert not link.write(b"too early")
        link.open()
        if url.startswith("tcp"):
            server.accept()
        assert link.write(b"\x0a")
        assert link.write(b"\x0bmore")
        received = b""
        while len(received) < 6:
            received += receive()
        assert received == b"\x0a\x0bmore"
        link.close()
        assert not link.write(b"too late")
    device.unplug()
    server.close()


def test_who_only_listens_cannot_write() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = Link(f"udp://127.0.0.1:{port}", clock=ManualClock())
    link.open()
    assert not link.write(b"x")
    link.close()


def test_writing_to_a_line_that_hung_up_is_no_error(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "robot")
    device.plug()
    link = Link(str(device.path), clock=ManualClock())
    link.open()
    device.unplug()
    assert not link.write(b"x")
    link.close()
