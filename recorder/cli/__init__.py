"""The commands that need a robot or a session alone."""

from recorder.cli.import_ import import_
from recorder.cli.ports import ports
from recorder.cli.record import record
from recorder.cli.recover import recover
from recorder.cli.simulate import simulate

COMMANDS = (record, ports, simulate, import_, recover)
