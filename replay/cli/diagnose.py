"""``diagnose``: why a map is bad, and which setting mends it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mapping.cli import config_options
from recorder.cli import options
from recorder.cli.progress import progress_bar
from recorder.names import printable

if TYPE_CHECKING:
    from mapping.config import MappingConfig
    from mapping.diagnosis.diagnosing import Diagnosis


@click.command(epilog="Example:  echogrid diagnose run.mcap --fix run.toml -o run.html")
@click.argument("sessions", nargs=-1, required=True, type=options.INPUT)
@config_options
@click.option(
    "--fix", type=options.FILE,
    help="Write the configuration that mends it, for `map --config`: a .toml.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON, for programs.")
@click.option(
    "-o", "--output", type=options.FILE, help="Write a page with the evidence and plots: a .html."
)
@click.option(
    "--compare", type=options.FILE,
    help="Write a recording of the map before and after, in step: a .rrd.",
)  # fmt: skip
@options.force
@options.quiet
def diagnose(
    sessions: tuple[Path, ...], configs: tuple[Path, ...], settings: tuple[str, ...],
    preset: str | None, fix: Path | None, as_json: bool, output: Path | None,
    compare: Path | None, force: bool, quiet: bool,
) -> int:  # fmt: skip
    """Find out what is wrong with a SESSION, by its own readings.

    No true walls are needed. Each suspect comes with its evidence, what it costs and the setting
    that mends it. What cannot be told is not named.

    Exit code 0: nothing is wrong; 1: something is; 2: the session cannot be mapped.
    """
    from mapping.config import load_config
    from mapping.diagnosis.diagnosing import diagnose as find
    from recorder.session.columns import open_session
    from replay.mapping_run import cores

    _check(sessions, {".toml": fix, ".html": output, ".rrd": compare}, force=force)
    config = load_config(configs, settings, preset)
    name = sessions[0].name
    with progress_bar(f"diagnosing {name}", quiet=quiet) as advance:
        session = open_session(*sessions)
        found = find(session, config, threads=cores(), progress=advance)
    _print(found, session.damage, name, as_json=as_json, quiet=quiet)
    if fix is not None or output is not None:
        _write(found, name, fix, output)
    if compare is not None:
        _compare(sessions, config, found, compare, force=force, quiet=quiet)
    if not quiet and not as_json:
        for each in (fix, output, compare):
            if each is not None:
                click.echo(f"wrote {each}")
    return 1 if found.suspects or session.damage else 0


def _check(inputs: tuple[Path, ...], outputs: dict[str, Path | None], *, force: bool) -> None:
    from recorder.errors import BadInput
    from recorder.outputs import check_output

    for suffix, output in outputs.items():
        if output is None:
            continue
        if output.suffix.lower() != suffix:
            raise BadInput(f"{output}: its name must end in {suffix}")
        check_output(output, inputs, force=force)


def _print(
    found: Diagnosis, damage: tuple[str, ...], name: str, *, as_json: bool, quiet: bool
) -> None:
    import json

    from replay.diagnosis.text import as_json as plain
    from replay.diagnosis.text import lines

    for loss in damage[:3]:
        click.echo(f"echogrid: {name}: {printable(loss)}", err=True)
    if as_json:
        click.echo(json.dumps(plain(found), indent=1, ensure_ascii=False, allow_nan=False))
    elif not quiet:
        for note in found.notes:
            click.echo(f"echogrid: {name}: {printable(note)}", err=True)
        for line in lines(found):
            click.echo(printable(line, most=400))


def _write(found: Diagnosis, name: str, fix: Path | None, output: Path | None) -> None:
    from recorder.outputs import written_beside
    from replay.diagnosis.page import page
    from replay.diagnosis.text import fix_toml

    for path, text in ((fix, fix_toml), (output, page)):
        if path is not None:
            with written_beside(path) as part:
                part.write_text(text(found, name), encoding="utf-8")


def _compare(
    sessions: tuple[Path, ...], config: MappingConfig, found: Diagnosis, output: Path, *,
    force: bool, quiet: bool,
) -> None:  # fmt: skip
    from replay.comparison import Variant
    from replay.comparison_run import compare_session

    first, *more = sessions
    variants = [Variant("before", config), Variant("after", found.config)]
    with progress_bar(f"mapping {first.name} before and after", quiet=quiet) as advance:
        compare_session(
            first, variants, more=more, rrd=output, export=None, force=force, progress=advance
        )
