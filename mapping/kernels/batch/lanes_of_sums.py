"""Steps in lanes of `saturating` and `pooled`: twins of the plain loops named in each.

A reading changes each array of sums only in some part of a row, so whole groups of cells are passed
over where none of them lies in that part: rows are short, and what is moved to and from memory is
most of the work.
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
    I32,
    I64,
    WIDTH,
    Cells,
    Lanes,
    by_width,
    counted,
    splat,
    unpacked,
)

_ONE = 2.0**24  # steps in evidence of 1


class _Group(NamedTuple):
    """Some cells of a row: the number of the row, their column and place, and what they are."""

    row: Any
    column: Any
    at: Any
    front: Lanes
    band: Lanes


@contextmanager
def _groups(
    builder: Any, grid: Cells, rows: Any, spans: Cells, shift: Any, with_free: Any
) -> Iterator[_Group]:
    """A loop over all groups of cells that a reading meets, row after row.

    ``rows``: the first row of the map, the step to the next, how many.
    """
    first, step, count = unpacked(builder, rows)
    stride = grid.shape[2]
    with cgutils.for_range_slice(builder, ir.Constant(I64, 0), count, ir.Constant(I64, 1)) as (
        k,
        _,
    ):
        a, f, g, b = (builder.sub(spans.one(spans.at(n, k)), shift) for n in range(4))
        line = builder.mul(builder.add(first, builder.mul(k, step)), stride)
        whole, front = builder.sub(b, a), builder.sub(g, f)
        free = builder.select(with_free, front, ir.Constant(I32, 0))
        start = builder.and_(builder.sext(a, I64), ir.Constant(I64, -WIDTH))
        after = builder.select(builder.icmp_signed("<", a, b), builder.sext(b, I64), start)
        with by_width(builder, start, after) as (c, _):
            column = counted(builder, builder.trunc(c, I32))
            in_front = column.within(f, front)
            outside = Lanes(builder, builder.not_(in_front.value))
            band = Lanes(builder, builder.and_(column.within(a, whole).value, outside.value))
            yield _Group(k, c, builder.add(line, c), column.within(f, free), band)


@contextmanager
def _where_any(builder: Any, mask: Lanes) -> Iterator[None]:
    """What follows is done where any of the cells is meant."""
    bits = builder.bitcast(mask.value, ir.IntType(WIDTH))
    with builder.if_then(builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))):
        yield


class _Sums:
    """The arrays of a rule."""

    def __init__(self, builder: Any, grid: Cells) -> None:
        self.builder, self.grid = builder, grid
        size = builder.mul(grid.shape[1], grid.shape[2])
        self.begins = [builder.mul(size, ir.Constant(I64, n)) for n in range(8)]

    def add(self, array: int, group: _Group, mask: Lanes, amount: Any) -> None:
        at = self.builder.add(self.begins[array], group.at)
        old = self.grid.load(at)
        self.grid.store(at, (old + amount).where(mask, old))

    def lower(self, array: int, group: _Group, mask: Lanes, bound: Lanes) -> None:
        at = self.builder.add(self.begins[array], group.at)
        old = self.grid.load(at)
        self.grid.store(at, bound.where(bound.below(old), old).where(mask, old))


def _both(one: Lanes, other: Lanes) -> Lanes:
    return Lanes(one.builder, one.builder.and_(one.value, other.value))


@intrinsic
def lanes_of_saturating(
    typing: Any, cells: Any, rows: Any, spans: Any, shift: Any, across: Any, down: Any, bell: Any,
    row_near: Any, numbers: Any,
) -> Any:  # fmt: skip
    """``sums.add_saturating_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, table, columns, lines, bells, nears = (
            Cells(context, builder, signature.args[n], args[n]) for n in (0, 2, 4, 5, 6, 7)
        )
        with_free, added, miss, most = unpacked(builder, args[8])
        is_free = builder.fcmp_ordered("!=", with_free, ir.Constant(with_free.type, 0.0))
        sums = _Sums(builder, grid)
        with _groups(builder, grid, args[1], table, args[3], is_free) as group:
            with _where_any(builder, group.front):
                depth = columns.load(group.column) + lines.one(group.row) + 1.0
                value = bells.load(group.column) * nears.one(group.row) + miss
                steps = ((value / depth).at_most(most) * _ONE).of("rint")
                sums.add(1, group, group.front, steps * (1.0 / _ONE))
            with _where_any(builder, group.band):
                sums.add(0, group, group.band, added)
        return context.get_dummy_value()

    tables = (across, down, bell, row_near)
    return types.void(cells, rows, spans, types.int32, *tables, numbers), make


@intrinsic
def lanes_of_pooled(
    typing: Any, cells: Any, rows: Any, spans: Any, shift: Any, across: Any, down: Any,
    faded_across: Any, faded_down: Any, numbers: Any,
) -> Any:  # fmt: skip
    """``sums.add_pooled_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, table, columns, lines, faded_columns, faded_lines = (
            Cells(context, builder, signature.args[n], args[n]) for n in (0, 2, 4, 5, 6, 7)
        )
        with_free, added, range_m, nearer, middle, farthest, last, arc_end = unpacked(
            builder, args[8]
        )
        is_free = builder.fcmp_ordered("!=", with_free, ir.Constant(with_free.type, 0.0))
        sums = _Sums(builder, grid)
        with _groups(builder, grid, args[1], table, args[3], is_free) as group:
            square = columns.load(group.column) + lines.one(group.row)
            with _where_any(builder, group.front):
                faded = faded_columns.load(group.column) + faded_lines.one(group.row) + 1.0
                share = (splat(builder, ir.Constant(with_free.type, _ONE)) / faded).of("rint")
                sums.add(1, group, group.front, share * (1.0 / _ONE))
                before = Lanes(builder, builder.not_(square.below(last).value))
                before = _both(group.front, before)
                with _where_any(builder, before):
                    sums.add(3, group, before, 1.0)
                within = _both(group.front, square.below(farthest))
                with _where_any(builder, within):
                    sums.lower(6, group, within, square.of("sqrt"))
                    near = _both(within, square.below(nearer))
                    with _where_any(builder, near):
                        sums.add(4, group, near, 1.0)
                    far = Lanes(builder, builder.not_(near.value))
                    between = _both(_both(within, square.below(middle)), far)
                    with _where_any(builder, between):
                        sums.add(5, group, between, 1.0)
            with _where_any(builder, group.band):
                sums.add(0, group, group.band, added)
                sums.lower(7, group, group.band, splat(builder, range_m))
                arc = _both(group.band, square.below(arc_end))
                with _where_any(builder, arc):
                    sums.add(2, group, arc, 1.0)
        return context.get_dummy_value()

    tables = (across, down, faded_across, faded_down)
    return types.void(cells, rows, spans, types.int32, *tables, numbers), make
