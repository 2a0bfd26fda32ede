"""The commands that show."""

from replay.cli.demo import demo
from replay.cli.diagnose import diagnose
from replay.cli.diff import diff
from replay.cli.figures import figures
from replay.cli.live import live
from replay.cli.map import map_
from replay.cli.picture import picture
from replay.cli.replay import replay
from replay.cli.score import score
from replay.cli.view import view

COMMANDS = (demo, diagnose, diff, figures, live, map_, picture, replay, score, view)
