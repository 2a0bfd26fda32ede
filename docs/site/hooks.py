"""Pages of the site that are no files in docs/: made from the code, or from the folder above.

mkdocs calls ``on_files``; ``on_page_markdown`` turns links that leave docs/ into links of the site
or into the names of the files that they point to.
"""

from __future__ import annotations

import posixpath
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

FROM_ABOVE = ("ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """The pages of docs/ and the made ones."""
    for name in FROM_ABOVE:
        text = (ROOT / name).read_text("utf-8")
        files.append(File.generated(config, name, content=text))
    files.append(File.generated(config, "reference-commands.md", content=commands_page()))
    files.append(File.generated(config, "reference-keys.md", content=keys_page()))
    return files


def on_page_markdown(text: str, *, page: Any, files: Files, **_: Any) -> str:
    """Links out of docs/: to the page that the site has of that file, or the file's bare name."""
    source = page.file.src_uri
    folder = "" if source in FROM_ABOVE else posixpath.join("docs", posixpath.dirname(source))

    def mended(link: re.Match[str]) -> str:
        label, target = link[1], link[2]
        if ":" in target or target.startswith("#"):
            return link[0]
        path, _, anchor = target.partition("#")
        inside = posixpath.normpath(posixpath.join(folder, path))
        name = inside.removeprefix("docs/")
        if files.get_file_from_path(name) is None:
            exists = (ROOT / inside).exists()
            return f"{label} (`{inside}`)" if exists and f"`{inside}" not in label else label
        here = posixpath.relpath(name, posixpath.dirname(source) or ".")
        return f"[{label}]({here}{'#' + anchor if anchor else ''})"

    return _LINK.sub(mended, text)


def commands_page() -> str:
    """Every command with its help, as the terminal shows it."""
    import echogrid

    parts = [
        "# Commands\n",
        "Made from the program itself: each command's `--help`. Exit codes: 0 done, 1 differs or "
        "lost something, 2 bad input or usage (one line on standard error).\n",
    ]
    for name, context in _contexts(echogrid.cli):
        parts.append(f"## {name}\n\n```text\n{context.get_help()}\n```\n")
    return "\n".join(parts)


def _contexts(group: click.Group) -> Iterator[tuple[str, click.Context]]:
    top = click.Context(group, info_name="echogrid")
    for name, command in sorted(group.commands.items()):
        yield name, click.Context(command, info_name=name, parent=top, terminal_width=90)


def keys_page() -> str:
    """Every key of the configuration with its default and its comment."""
    from mapping.config import load_config
    from mapping.config_text import explained_toml

    return (
        "# Configuration\n\nMade from the program itself: what `echogrid config` prints. Any of it "
        "stands in a TOML file for `--config`, or is set by `--set SECTION.KEY=VALUE`.\n\n"
        f"```toml\n{explained_toml(load_config())}\n```\n"
    )
