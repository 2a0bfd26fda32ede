"""The commands that need the maths alone: config, check, info."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from recorder.cli import options
from recorder.cli.progress import progress_bar
from recorder.names import printable

if TYPE_CHECKING:
    from mapping.config import MappingConfig

config_option = click.option(
    "--config",
    "configs",
    type=options.INPUT,
    multiple=True,
    help="Configuration to use, a TOML file as `echogrid config` prints.",
)
setting_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="A.B=C",
    help="Change one key of it, as in grid.resolution_m=0.02; repeatable.",
)
preset_option = click.option("--preset", help="chapter: the lecture chapter's own choices.")
plugin_option = click.option(
    "--plugin",
    "plugins",
    type=options.INPUT,
    multiple=True,
    help="A Python file with rules or models of your own; repeatable.",
)


def config_options(command: Callable[..., int]) -> Callable[..., int]:
    """The three options that make up a configuration."""
    return config_option(setting_option(preset_option(command)))


@click.command(epilog="Example:  echogrid config --set grid.resolution_m=0.02")
@config_options
@plugin_option
def config(
    configs: tuple[Path, ...], settings: tuple[str, ...], preset: str | None,
    plugins: tuple[Path, ...],
) -> int:  # fmt: skip
    """Print the configuration in force, with a comment to each key."""
    from mapping.config import load_config
    from mapping.config_text import explained_toml
    from mapping.plugins import load_plugin

    for plugin in plugins:
        load_plugin(plugin)
    if len(configs) < 2:
        merged = load_config(configs, settings, preset)
        click.echo(explained_toml(merged), nl=False)
        echo_unused(merged)
        return 0
    for file in configs:  # as for map: each is a configuration of its own
        alone = load_config([file], settings, preset)
        click.echo(f"# {printable(str(file))}\n{explained_toml(alone)}")
        echo_unused(alone, f"{file}: ")
    return 0


def echo_unused(config: MappingConfig, whose: str = "") -> None:
    """Report keys that are set in vain, which may be meant for another model."""
    from mapping.config import unused_note

    if note := unused_note(config):
        click.echo(printable(f"echogrid: {whose}{note}"), err=True)


@click.command(epilog="Example:  echogrid check my_rule.py")
@click.argument("rule", type=options.INPUT)
def check(rule: Path) -> int:
    """Try the laws on a model or rule of your own.

    RULE is a Python file with them. Says in words which law fails, and why.
    """
    from mapping.laws import check_plugin

    findings = check_plugin(rule)
    for finding in findings:
        verdict = "keeps" if finding.broken is None else "BREAKS"
        click.echo(f"{finding.subject} {verdict}: {finding.law}")
        if finding.broken is not None:
            click.echo(f"    {finding.broken}")
    return 1 if any(finding.broken is not None for finding in findings) else 0


@click.command(epilog="Example:  echogrid info run.mcap")
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=options.INPUT)
@options.quiet
def info(files: tuple[Path, ...], quiet: bool) -> int:
    """Show what is in a session, and what is wrong with it.

    That is rates, gaps, what a map would be made of, odd channels and losses, and the worst that a
    map would suffer from, where that is plain to see.

    Exit code 0: all of it can be read; 1: something is lost; 2: it cannot be used.
    """
    from recorder.session import SessionReader, session_files
    from recorder.summary import summary_lines

    damaged = False
    for file in session_files(*files):
        reader = SessionReader(file)
        size = file.stat().st_size if file.exists() else None
        with progress_bar(f"reading {file.name}", quiet=quiet) as advance:
            lines = list(summary_lines(reader, functools.partial(advance, total=size)))
        for line in lines if not quiet else ():
            click.echo(line)
        damaged = damaged or bool(reader.damage)
        if not quiet and reader.messages <= _QUICK and (line := _worst(file)):
            click.echo(f"  odd: {printable(line, most=400)}")
    return 1 if damaged else 0


_QUICK = 100_000  # messages: of more `info` would take noticeably longer


def _worst(file: Path) -> str:
    """What a map of the session would suffer from most, as ``map`` names it."""
    from mapping.config import load_config
    from mapping.diagnosis.first_sight import worst_line
    from mapping.placed_session import place_session
    from recorder.errors import BadInput
    from recorder.session.columns import open_session

    try:
        config = load_config()
        return worst_line(place_session(open_session(file), config), config)
    except BadInput:
        return ""  # it cannot be mapped, which the lines above it name


COMMANDS = (config, check, info)
