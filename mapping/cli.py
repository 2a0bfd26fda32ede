"""The commands that need the maths alone: config, check."""

from __future__ import annotations

from pathlib import Path

import click

FILE = click.Path(path_type=Path)
config_options = (
    click.option("--config", "configs", type=FILE, multiple=True, help="A TOML file; repeatable."),
    click.option("--set", "settings", multiple=True, metavar="A.B=C", help="One key; repeatable."),
    click.option("--preset", help="chapter: the lecture chapter's own choices."),
)


@click.command(epilog="Example:  echogrid config --set grid.resolution_m=0.02")
@config_options[0]
@config_options[1]
@config_options[2]
def config(configs: tuple[Path, ...], settings: tuple[str, ...], preset: str | None) -> int:
    """Print the configuration in force, with a comment to each key."""
    from mapping.config import load_config
    from mapping.config_text import commented_toml

    if len(configs) < 2:
        click.echo(commented_toml(load_config(configs, settings, preset)), nl=False)
        return 0
    for file in configs:  # as for map: each is a configuration of its own
        click.echo(f"# {file}\n{commented_toml(load_config([file], settings, preset))}")
    return 0


@click.command(epilog="Example:  echogrid check my_rule.py")
@click.argument("rule", type=FILE)
def check(rule: Path) -> int:
    """Try the laws on a sensor model or update rule of your own; say in words which fail."""
    from mapping.laws import check_plugin

    findings = check_plugin(rule)
    for finding in findings:
        verdict = "keeps" if finding.broken is None else "BREAKS"
        click.echo(f"{finding.subject} {verdict}: {finding.law}")
        if finding.broken is not None:
            click.echo(f"    {finding.broken}")
    return 1 if any(finding.broken is not None for finding in findings) else 0


COMMANDS = (config, check)
