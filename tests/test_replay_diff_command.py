"""``echogrid diff`` as a user meets it: exit codes, lines, JSON, the picture and the recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from diff_maps import GEOMETRY, room, source
from diff_maps import layer as made_layer
from PIL import Image

from echogrid import main
from replay.diff.comparing import report
from replay.diff.layers import Line
from replay.diff.picture import draw
from replay.diff.sources.arrays import write_npz


@pytest.fixture
def maps(tmp_path: Path) -> tuple[Path, Path]:
    """Two maps of one layer and a wall that moved, with a line each."""
    paths = tmp_path / "a.npz", tmp_path / "b.npz"
    for path, col in zip(paths, (65, 57), strict=True):
        x = GEOMETRY.origin_m[0] + (col + 1) * GEOMETRY.resolution_m
        line = Line("grid", (x, 0.6), (x, 1.4))
        write_npz(path, source(made_layer(room(right_col=col), lines=(line,))))
    return paths


def test_the_same_is_0_and_different_1(
    maps: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    a, b = map(str, maps)
    assert main(["diff", a, a]) == 0
    assert "verdict: same\n" in capsys.readouterr().out
    assert main(["diff", a, b]) == 1
    reported = capsys.readouterr().out
    assert "verdict: a wall moved by 0.16 m: from (1.12, " in reported
    assert "  lines: 0 the same, 1 moved, 0 only in B, 0 only in A" in reported
    assert main(["diff", a, b, "--quiet"]) == 1
    assert capsys.readouterr().out == ""
    assert main(["diff", a, b, "--tolerance", "1", "--line-tolerance", "1", "--quiet"]) == 0


def test_json_has_its_keys(maps: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diff", *map(str, maps), "--json"]) == 1
    reported = json.loads(capsys.readouterr().out)
    assert set(reported) == {
        "a", "b", "differs", "verdict", "words", "wall_changes", "notes", "only_in_a", "only_in_b",
        "layers", "first_reading", "first_step",
    }  # fmt: skip
    assert reported["verdict"] == "wall moved"
    assert reported["wall_changes"][0]["moved_m"] == pytest.approx(0.16, abs=0.01)
    layer = reported["layers"]["ping"]
    assert {
        "compared", "differ", "class_changed_share", "occupied_iou", "worst",
        "lines", "borders", "origin_m", "resolution_m", "last_written_a",
    } <= set(layer)  # fmt: skip
    assert layer["worst"][0].keys() >= {"row", "col", "x_m", "y_m", "a", "b", "difference"}
    assert layer["lines"]["moved"][0]["offset_m"] == pytest.approx(0.16)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["missing.npz", "a.npz"], "missing.npz: no such file"),
        (["a.npz", "missing.mcap"], "missing.mcap"),
        (["a.npz", "b.npz", "--layer", "dirrs"], "no layer 'dirrs' in both: A has ping"),
        (["a.npz", "b.npz", "-o", "x.gif"], "written as .png or .rrd"),
        (["a.npz", "b.npz", "-o", "a.npz.png"], "exists already"),
        (["a.npz", "b.npz", "--tolerance", "-1"], "tolerance"),
        (["a.npz", "b.npz", "--set", "grid.nonsense=1"], "unknown key grid.nonsense"),
        (["a.npz", "shifted.npz"], "not a whole number of cells"),
        (["a.npz"], "Missing argument"),
    ],
)
def test_bad_input_is_2_in_one_line(
    maps: tuple[Path, Path], arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(maps[0].parent)
    Path("a.npz.png").write_bytes(b"precious")
    np.savez("shifted.npz", values=room(), origin_m=np.array([0.011, 0.0]), resolution_m=0.02)
    assert main(["diff", *arguments]) == 2
    reported = capsys.readouterr()
    assert reported.out == ""
    assert words in reported.err
    assert len(reported.err.splitlines()) == 1
    assert Path("a.npz.png").read_bytes() == b"precious"


def test_the_picture_shows_where(maps: tuple[Path, Path], tmp_path: Path) -> None:
    picture = tmp_path / "new" / "d.png"
    assert main(["diff", *map(str, maps), "-o", str(picture), "--quiet"]) == 1
    with Image.open(picture) as image:
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 24)}
    # The wall of A in orange, that of B in green, the worst cell's circle in purple.
    assert {(255, 127, 14), (44, 140, 44), (160, 32, 200), (150, 158, 178)} <= colours
    assert not list(picture.parent.glob("*.part"))


def test_red_is_where_b_is_more_occupied() -> None:
    """The third panel alone has colour where cells differ, and the highest y is at the top."""
    grid = np.full((20, 20), 0.3, np.float32)
    occupied = grid.copy()
    occupied[16:, :4] = 0.9
    image = np.asarray(draw(report(source(made_layer(grid)), source(made_layer(occupied)))), int)
    panel = image[:, 2 * image.shape[1] // 3 :]
    red = (panel[..., 0] > 180) & (panel[..., 1] < 90) & (panel[..., 2] < 90)
    high = np.flatnonzero(red.sum(axis=1) > 40)
    assert len(high)
    box = panel[high[0] : high[-1]]
    assert high.mean() < image.shape[0] / 2  # rows 16 and up are drawn in the upper half
    assert np.flatnonzero(red[high].any(axis=0)).mean() < panel.shape[1] / 2
    assert len(box) > 20


def test_the_recording_holds_both_maps_and_the_difference(
    maps: tuple[Path, Path], tmp_path: Path
) -> None:
    from rerun.chunk import RrdReader

    out = tmp_path / "d.rrd"
    assert main(["diff", *map(str, maps), "-o", str(out), "--quiet"]) == 1
    found = {}
    for chunk in RrdReader(out).stream():
        batch = chunk.to_record_batch()
        side = str(chunk.entity_path).rsplit("/", 1)[-1]
        if f"{side}_values" in batch.schema.names:
            column = batch.column(f"{side}_values")
            found[side] = column[0].values.to_numpy(zero_copy_only=False)
    a, b = room(right_col=65), room(right_col=57)
    np.testing.assert_array_equal(found["a"].reshape(a.shape), a)
    np.testing.assert_array_equal(found["b"].reshape(a.shape), b)
    np.testing.assert_array_equal(found["difference"].reshape(a.shape), b.astype(float) - a)
    assert not list(tmp_path.glob("*.part"))
