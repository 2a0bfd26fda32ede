"""Maps of sessions in other people's tests: a pytest plugin, found by its entry point.

::

    def test_the_map_stays(session_map):
        session_map("logs/run.mcap", settings=["grid.resolution_m=0.02"]).matches(
            "golden/run.npz", atol=1e-4
        )

    def test_the_map_is_good(session_map):
        score = session_map("logs/run.mcap").score("room")
        assert score["fused"].cells.log_loss < 0.2

A map that differs fails the test with what ``echogrid diff`` reports of it, and leaves a picture in
the test's temporary folder. ``--update-golden`` writes the golden maps instead of comparing.
Nothing heavy is imported before a test asks for a map.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mapping.config import MappingConfig
    from mapping.scoring.layers import LayerScore
    from replay.diff.comparing import Report
    from replay.diff.layers import Source

OPTION = "--update-golden"
_WRITTEN = "echogrid golden map"
_LINES_ATOL_M = 1e-3


@pytest.hookimpl(wrapper=True)
def pytest_load_initial_conftests(
    early_config: pytest.Config, parser: pytest.Parser
) -> Iterator[None]:
    """Add the option last, and only where nobody else has one of that name: theirs then counts."""
    yield
    _, unknown = parser.parse_known_and_unknown_args([OPTION])
    if OPTION in unknown:
        group = parser.getgroup("echogrid", "maps of sessions")
        group.addoption(
            OPTION,
            action="store_true",
            default=False,
            help="write the golden maps that session_map(...).matches(...) compares with",
        )


class MapUnderTest:
    """The map of one session. ``layers`` holds its layers by name, each with its values."""

    def __init__(
        self, source: Source, request: pytest.FixtureRequest, pictures: Path, config: MappingConfig
    ) -> None:
        self._source, self._request, self._pictures = source, request, pictures
        self._config = config

    @property
    def layers(self) -> Mapping[str, Any]:
        """Every layer by name: ``values``, ``classes`` (rows, cols), ``geometry``, ``lines``."""
        return self._source.layers

    def matches(
        self,
        golden: str | Path,
        *,
        atol: float = 0.0,
        lines_atol_m: float = _LINES_ATOL_M,
        layers: Iterable[str] = (),
    ) -> bool:
        """Fail the test unless the map is the golden one; True otherwise.

        Cells differ beyond ``atol``, lines when an end moved further than ``lines_atol_m`` metres;
        ``layers`` compares those alone. ``golden`` is an .npz, written by ``--update-golden``, or
        any map that ``echogrid diff`` takes. A relative path is looked for beside the test file,
        then from pytest's root folder.
        """
        __tracebackhide__ = True
        path = _found(self._request, Path(golden))
        if self._request.config.getoption(OPTION, False):
            self._write(path)
            return True
        if not path.exists():
            pytest.fail(f"{path}: no such golden map; {OPTION} writes it", pytrace=False)
        report = self._report(path, atol, lines_atol_m, tuple(layers))
        if not report.differs:
            return True
        pytest.fail("\n".join(self._explanation(report, path)), pytrace=False)

    def score(self, walls: str | Path | None = None) -> Mapping[str, LayerScore]:
        """How right each layer is, by name, as ``echogrid score`` has it.

        ``walls`` are a room's name, a GeoJSON file or a map_server map, whose path is looked for
        as in ``matches``; without them those count that the session carries. Of a score,
        ``cells.log_loss``, ``cells.ghost_m2`` and their kin, and ``lines_of("grid")`` are what an
        assertion is made of. Raises an EchogridError where there is nothing to judge by.
        """
        from recorder.errors import BadInput
        from recorder.simulator.rooms import ROOMS
        from replay.scoring.judging import score_source

        given = None if walls is None else str(walls)
        if given is not None and given not in ROOMS:
            given = str(_found(self._request, Path(given)))
        report = score_source(
            self._source, walls=given, session=self._source.path, config=self._config
        )
        if report.truth is None:
            raise BadInput(f"{self._source.path} carries no walls: score(walls) needs them")
        return report.scores

    def _report(
        self, path: Path, atol: float, lines_atol_m: float, only: tuple[str, ...]
    ) -> Report:
        from recorder.errors import EchogridError
        from replay.diff.comparing import report
        from replay.diff.sources.opening import open_map

        __tracebackhide__ = True
        try:
            golden = open_map(path)
            return report(
                self._source, golden, tolerance=atol, line_tolerance_m=lines_atol_m, only=only
            )
        except EchogridError as error:
            pytest.fail(str(error), pytrace=False)

    def _explanation(self, report: Report, path: Path) -> list[str]:
        from replay.diff.picture import save_picture
        from replay.diff.report_text import summary

        picture = self._pictures / f"{path.stem}-difference.png"
        save_picture(report, picture)
        return [
            f"the map differs from {path.name} (A: the session, B: the golden map)",
            *summary(report),
            f"picture: {picture}",
            f"when the change is meant: pytest {OPTION}",
        ]

    def _write(self, path: Path) -> None:
        from recorder.errors import BadInput
        from replay.diff.sources.arrays import write_npz

        if path.suffix.lower() != ".npz":
            raise BadInput(f"{path}: a golden map is written as .npz")
        write_npz(path, self._source)
        self._request.node.user_properties.append((_WRITTEN, str(path)))


class SessionMapper:
    """Maps sessions for a test: call it with a session and its configuration."""

    def __init__(self, request: pytest.FixtureRequest, pictures: Path) -> None:
        self._request, self._pictures = request, pictures

    def __call__(
        self,
        session: str | Path,
        *,
        config: MappingConfig | str | Path | Iterable[str | Path] | None = None,
        settings: Iterable[str] = (),
        preset: str | None = None,
        plugins: Iterable[str | Path] = (),
    ) -> MapUnderTest:
        """Map a session. The rest is as for ``echogrid map``; paths as for ``matches``.

        ``config`` is one TOML file or several, or a configuration made in Python. Raises an
        EchogridError for a session or configuration that cannot be used; a damaged session fails.
        """
        from mapping.config import MappingConfig, load_config
        from mapping.plugins import load_plugin
        from replay.diff.sources.sessions import map_one

        for plugin in plugins:
            load_plugin(_found(self._request, Path(plugin)))
        if isinstance(config, MappingConfig):
            made = config
        else:
            given = [config] if isinstance(config, str | Path) else list(config or ())
            files = [_found(self._request, Path(each)) for each in given]
            made = load_config(files, settings, preset)
        source = map_one(_found(self._request, Path(session)), made)
        if source.damaged:
            pytest.fail("\n".join(source.notes), pytrace=False)
        return MapUnderTest(source, self._request, self._pictures, made)


@pytest.fixture
def session_map(request: pytest.FixtureRequest, tmp_path: Path) -> SessionMapper:
    """``session_map(session, settings=[...]).matches(golden, atol=...)``."""
    return SessionMapper(request, tmp_path)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """List the golden maps that were written."""
    reports = terminalreporter.getreports("passed")
    written = {
        value
        for report in reports
        for key, value in getattr(report, "user_properties", ())
        if key == _WRITTEN
    }
    for path in sorted(written):
        terminalreporter.write_line(f"golden map written: {path}")


def _found(request: pytest.FixtureRequest, path: Path) -> Path:
    """A path beside the test file, or from the root folder; a new one where its folder is."""
    if path.is_absolute():
        return path
    places = [request.path.parent / path, request.config.rootpath / path]
    for wanted in (*places, *(place.parent for place in places)):
        if wanted.exists():
            return wanted if wanted in places else wanted / path.name
    return places[0]
