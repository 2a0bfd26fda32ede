"""Steps in lanes of `saturating` and `pooled`: what readings add, as small numbers side by side.

What a kernel waits for here is memory: eight sums of float64 are 64 bytes a cell. So readings add
to ``tiles`` first: of 16 cells of a row a line of the cache for each of a few int32 (``sums`` names
them), all of them one after the other. What a reading changes only in some part of a row (near the
sensor, just before its arc) is passed over where no cell of a group lies in that part.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from mapping.kernels.batch.lanes import (
    F32,
    F64,
    I32,
    I64,
    WIDTH,
    Cells,
    Lanes,
    by_width,
    counted,
    splat,
    unpacked,
    where_any,
)
from mapping.kernels.batch.steps import LANES as TILE

_ROWS_AHEAD = 10  # what is asked for before it is wanted
_ONE = 2.0**24  # steps in evidence of 1
_UPWARDS = 1.0 + 2.0**-22  # a number times this is not below itself in single precision
_FULL_SUM, _FULL_COUNT = 1 << 30, 0x80808080 - (1 << 32)  # bits of what has to be taken away soon


class _Group(NamedTuple):
    """Some cells of a row: the number of the row, their column, the line of the tile's first
    number, their place in the map, and what they are."""

    row: Any
    column: Any
    tile: Any
    at: Any
    front: Lanes
    band: Lanes


@contextmanager
def _groups(
    builder: Any, cells: Cells, tiles: Cells, lines: int, rows: Any, spans: Cells, shift: Any,
    with_free: Any,
) -> Iterator[_Group]:  # fmt: skip
    """A loop over all groups of cells that a reading meets, row after row.

    ``rows``: the first row of the map, how many, the first one's tiles.
    """
    first, count, own = unpacked(builder, rows)
    is_free = builder.fcmp_ordered("!=", with_free, ir.Constant(F64, 0.0))
    with cgutils.for_range_slice(builder, ir.Constant(I64, 0), count, ir.Constant(I64, 1)) as (
        k,
        _,
    ):
        a, f, g, b = (builder.sub(spans.one(spans.at(n, k)), shift) for n in range(4))
        line = builder.mul(builder.add(first, k), cells.shape[2])
        tile_line = builder.mul(builder.add(own, k), tiles.shape[1])
        whole, front = builder.sub(b, a), builder.sub(g, f)
        free = builder.select(is_free, front, ir.Constant(I32, 0))
        start = builder.and_(builder.sext(a, I64), ir.Constant(I64, -WIDTH))
        after = builder.select(builder.icmp_signed("<", a, b), builder.sext(b, I64), start)
        with by_width(builder, start, after) as (c, _):
            column = counted(builder, builder.trunc(c, I32))
            outside = Lanes(builder, builder.not_(column.within(f, front).value))
            band = _both(column.within(a, whole), outside)
            number = builder.and_(c, ir.Constant(I64, TILE - 1))
            tile = builder.mul(builder.sub(c, number), ir.Constant(I64, lines))
            tile = builder.add(tile_line, builder.add(tile, number))
            yield _Group(k, c, tile, builder.add(line, c), column.within(f, free), band)


def _both(one: Lanes, other: Lanes) -> Lanes:
    return Lanes(one.builder, one.builder.and_(one.value, other.value))


def _not(mask: Lanes) -> Lanes:
    return Lanes(mask.builder, mask.builder.not_(mask.value))


def _constant(builder: Any, number: int) -> Lanes:
    return splat(builder, ir.Constant(I32, number))


class _Tiles:
    """The tiles of a map, and whether any of their numbers grew large."""

    def __init__(self, builder: Any, tiles: Cells) -> None:
        self.builder, self.tiles = builder, tiles
        nothing = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
        self._full = cgutils.alloca_once_value(builder, nothing)

    def _at(self, group: _Group, line: int) -> Any:
        return self.builder.add(group.tile, ir.Constant(I64, line * TILE))

    def _fetch(self, group: _Group, line: int) -> None:
        """Ask for the same line some rows on: it is wanted soon, or at least does no harm."""
        ahead = self.builder.mul(self.tiles.shape[1], ir.Constant(I64, _ROWS_AHEAD))
        at = self.builder.add(self._at(group, line), ahead)
        address = self.builder.gep(self.tiles.data, [at], source_etype=I32)
        address = self.builder.bitcast(address, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [address.type, I32, I32, I32])
        fetch = cgutils.get_or_insert_function(self.builder.module, kind, "llvm.prefetch.p0i8")
        self.builder.call(fetch, [address, *(ir.Constant(I32, n) for n in (1, 3, 1))])

    def add(self, group: _Group, line: int, mask: Lanes, amount: Any, full: int) -> None:
        self._fetch(group, line)
        old = self.tiles.load(self._at(group, line))
        new = (old + amount).where(mask, old)
        self.tiles.store(self._at(group, line), new)
        bits = _both(new, _constant(self.builder, full)) | Lanes(
            self.builder, self.builder.load(self._full)
        )
        self.builder.store(bits.value, self._full)

    def bound(self, group: _Group, line: int) -> Lanes:
        """What is not below the least value so far; 0 where that is not known."""
        self._fetch(group, line)
        return self.tiles.load(self._at(group, line)).bits_as(F32)

    def set_bound(self, group: _Group, line: int, mask: Lanes, least: Lanes) -> None:
        upper = (least * _UPWARDS).to(F32)
        self.tiles.store(
            self._at(group, line), upper.where(mask, self.bound(group, line)).bits_as(I32)
        )

    def any_full(self) -> Any:
        bits = self.builder.icmp_signed("!=", self.builder.load(self._full),
                                        _constant(self.builder, 0).value)  # fmt: skip
        whole = self.builder.bitcast(bits, ir.IntType(WIDTH))
        return self.builder.zext(
            self.builder.icmp_unsigned("!=", whole, ir.Constant(whole.type, 0)), I32
        )


def _lower(
    builder: Any, cells: Cells, tiles: _Tiles, group: _Group, places: tuple[int, int],
    mask: Lanes, compared: Lanes, power: int, least: Any,
) -> None:  # fmt: skip
    """Lower an array of the map to ``least()`` where its bound does not rule that out.

    ``places``: the array, and the line of its bounds, which are ``power``s of its values and
    compared with ``compared``.
    """
    array, line = places
    bound = tiles.bound(group, line)
    unknown = Lanes(builder, builder.fcmp_ordered("==", bound.value, bound._same(0.0)))
    doubtful = _both(mask, compared.below(bound.to(F64)) | unknown)
    with where_any(doubtful):
        size = builder.mul(cells.shape[1], cells.shape[2])
        at = builder.add(builder.mul(size, ir.Constant(I64, array)), group.at)
        old, new = cells.load(at), least()
        lower = new.where(new.below(old), old)
        cells.store(at, lower.where(doubtful, old))
        tiles.set_bound(group, line, doubtful, lower * lower if power == 2 else lower)


@intrinsic
def lanes_of_saturating(
    typing: Any, cells: Any, tiles: Any, rows: Any, spans: Any, shift: Any, across: Any, down: Any,
    bell: Any, row_near: Any, added: Any, numbers: Any,
) -> Any:  # fmt: skip
    """``sums.add_saturating_plainly``; 1 where a tile has to be emptied."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, tiled, table, columns, lines, bells, nears = (
            Cells(context, builder, signature.args[n], args[n]) for n in (0, 1, 3, 5, 6, 7, 8)
        )
        with_free, miss, most = unpacked(builder, args[10])
        small = _Tiles(builder, tiled)
        with _groups(builder, grid, tiled, 2, args[2], table, args[4], with_free) as group:
            with where_any(group.front):
                depth = columns.load(group.column) + lines.one(group.row) + 1.0
                value = bells.load(group.column) * nears.one(group.row) + miss
                steps = ((value / depth).at_most(most) * _ONE).of("rint")
                small.add(group, 1, group.front, steps.to(I32), _FULL_SUM)
            with where_any(group.band):
                small.add(group, 0, group.band, args[9], _FULL_SUM)
        return small.any_full()

    tables = (across, down, bell, row_near)
    return types.int32(cells, tiles, rows, spans, types.int32, *tables, types.int32, numbers), make


@intrinsic
def lanes_of_pooled(
    typing: Any, cells: Any, tiles: Any, rows: Any, spans: Any, shift: Any, across: Any, down: Any,
    faded_across: Any, faded_down: Any, added: Any, numbers: Any,
) -> Any:  # fmt: skip
    """``sums.add_pooled_plainly``; 1 where a tile has to be emptied."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, tiled, table, columns, lines, faded_columns, faded_lines = (
            Cells(context, builder, signature.args[n], args[n]) for n in (0, 1, 3, 5, 6, 7, 8)
        )
        with_free, range_m, nearer, middle, farthest, last, arc_end = unpacked(builder, args[10])
        small = _Tiles(builder, tiled)
        with _groups(builder, grid, tiled, 5, args[2], table, args[4], with_free) as group:
            square = columns.load(group.column) + lines.one(group.row)
            with where_any(group.front):
                faded = faded_columns.load(group.column) + faded_lines.one(group.row) + 1.0
                share = splat(builder, ir.Constant(F64, _ONE)) / faded
                small.add(group, 1, group.front, share.of("rint").to(I32), _FULL_SUM)
                before, near = _not(square.below(last)), square.below(middle)
                with where_any(_both(group.front, before | near)):
                    each = [_constant(builder, 1 << bits) for bits in (0, 8, 16)]
                    count = each[0].where(square.below(nearer), each[1].where(near, 0))
                    count = count + each[2].where(before, 0)
                    small.add(group, 2, group.front, count, _FULL_COUNT)
                within = _both(group.front, square.below(farthest))
                with where_any(within):
                    _lower(builder, grid, small, group, (6, 3), within, square, 2,
                           lambda: square.of("sqrt"))  # fmt: skip
            with where_any(group.band):
                small.add(group, 0, group.band, args[9], _FULL_SUM)
                range_of = splat(builder, range_m)
                _lower(builder, grid, small, group, (7, 4), group.band, range_of, 1,
                       lambda: range_of)  # fmt: skip
                arc = _both(group.band, square.below(arc_end))
                with where_any(arc):
                    small.add(group, 2, arc, _constant(builder, 1 << 24), _FULL_COUNT)
        return small.any_full()

    tables = (across, down, faded_across, faded_down)
    return types.int32(cells, tiles, rows, spans, types.int32, *tables, types.int32, numbers), make
