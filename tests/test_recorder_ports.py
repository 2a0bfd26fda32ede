"""Which device talks, and in what: simulated robots on real pseudo-terminals."""

from __future__ import annotations

import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest
from fake_links import PtyDevice

from echogrid import main
from recorder.port_probe import judge, probe_ports
from recorder.protocols.echogrid import encode
from recorder.protocols.rbc import sensor_packet
from recorder.protocols.reports import HelloReport, WheelReport
from recorder.simulator.rooms import load_room
from recorder.simulator.serial_robot import SerialRobot

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")


def robots(stack: ExitStack, *protocols: str) -> list[str]:
    room = load_room("room")
    return [
        stack.enter_context(SerialRobot(room, protocol=protocol)).device for protocol in protocols
    ]


def test_each_robot_is_known_by_what_it_sends(capsys: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as stack:
        echogrid, rbc, csv = robots(stack, "echogrid", "rbc", "csv")
        also = [word for device in (echogrid, rbc, csv) for word in ("--also", device)]
        status = main(["ports", *also, "--only", "--seconds", "5", "--probe-write"])
    assert status == 0
    lines = capsys.readouterr().out.splitlines()
    found = {line.split()[0]: " ".join(line.split()[1:]) for line in lines}
    assert found[echogrid].startswith("echogrid, 115200")
    assert found[rbc].startswith("rbc, 9600")
    assert found[csv].startswith("csv, 115200 (rows of 3 numbers, such as ")


def test_nothing_is_written_unless_asked(tmp_path: Path) -> None:
    """The course's robot stays silent: it was not greeted."""
    with ExitStack() as stack:
        (rbc,) = robots(stack, "rbc")
        missing = str(tmp_path / "nothing")
        silent, absent = probe_ports([rbc, missing], bauds=[9600], listen_s=1.0)
    assert silent.verdict == "silent"
    assert "no such device" in absent.verdict


def test_what_is_not_understood_is_shown(tmp_path: Path) -> None:
    device = PtyDevice(tmp_path / "other")
    device.plug()
    done = threading.Event()

    def talk() -> None:
        while not done.wait(0.02):  # what came before the port was opened nobody receives
            device.write(b"Hello \xff\x00 world\r\n")

    talker = threading.Thread(target=talk)
    talker.start()
    (report,) = probe_ports([str(device.path)], bauds=[115200], listen_s=3.0)
    done.set()
    talker.join()
    device.unplug()
    assert report.protocol == ""
    assert report.verdict.startswith("talks, in nothing known: ")
    assert "Hello ·· world" in report.verdict


def test_no_device_at_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["ports", "--only"]) == 0
    assert "no serial device" in capsys.readouterr().out
    assert main(["ports", "--only", "--quiet"]) == 0
    assert capsys.readouterr().out == ""


def test_judgements() -> None:
    hello = encode(HelloReport(1, "boe", "1.2"), 0, 0)
    assert judge(b"rest\r\n" + hello) == ("echogrid", "boe 1.2")
    assert judge(encode(WheelReport(0, 0), 1, 2)) == ("echogrid", "")
    assert judge(hello[:-6] + b"00\r\n") == ("", "")
    assert judge(sensor_packet(150, 35) * 3)[0] == "rbc"
    assert judge(sensor_packet(150, 35)) == ("", "")
    assert judge(sensor_packet(150, 35), hands_shaken=True)[0] == "rbc"
    assert judge(b"3\n1,2\n3,4\n5,6\n7")[0] == "csv"
    assert judge(b"3\n1,2\n3,4,5\n5,6\n7") == ("", "")
    assert judge(b"") == ("", "")
