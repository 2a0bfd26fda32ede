"""The commands that show."""

from replay.cli.demo import demo
from replay.cli.map import map_
from replay.cli.view import view

COMMANDS = (demo, map_, view)
