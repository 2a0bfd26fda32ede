"""Steps in lanes of spans and of `fading`: twins of the plain loops named in each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

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
)

# 2^u on -0.5 .. 0.5, within 1 ulp: the coefficients of 1, u, u^2, ...
POWERS = (
    1.0, 0.6931472, 0.24022651, 0.05550411, 0.009618129, 0.0013333558, 0.00015403530,
)  # fmt: skip


@intrinsic
def lanes_of_spans(typing: Any, spans: Any, doubt: Any, rows: Any, limits: Any) -> Any:
    """``spans.fill_spans_plainly``; of the rows past the last none is in doubt."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        table, doubts = (Cells(context, builder, kinds[k], args[k]) for k in (0, 1))
        (row0, step, size, base_y, reach_2, front_2, low_r, low_r0, low_l, low_l0, high_r, high_r0,
         high_l, high_l0, far, per_cell, offset, first, after, unsure, flat) = unpacked(
            builder, args[3])  # fmt: skip
        unclear = cgutils.alloca_once_value(builder, ir.Constant(I32, 0))
        far_left = builder.fneg(far)
        with by_width(builder, ir.Constant(I64, 0), args[2]) as (k, _):
            row = counted(builder, builder.sitofp(k, F64)) * step + row0
            dy = (row + 0.5) * size + base_y
            square = dy * dy
            wide = (splat(builder, reach_2) - square).at_least(0.0).of("sqrt")
            front_wide = (splat(builder, front_2) - square).at_least(0.0).of("sqrt")
            low = (dy * low_r + low_r0).at_least(dy * low_l + low_l0).at_most(far)
            high = (dy * high_r + high_r0).at_most(dy * high_l + high_l0).at_least(far_left)
            a = low.at_least(wide * -1.0) * per_cell + offset
            b = high.at_most(wide) * per_cell + offset
            f = low.at_least(front_wide * -1.0) * per_cell + offset
            g = high.at_most(front_wide) * per_cell + offset
            off = [(v - v.of("rint")).of("fabs") for v in (a, b, f, g)]
            near = off[0].at_most(off[1]).at_most(off[2].at_most(off[3]))
            index = counted(builder, builder.trunc(k, I32))
            is_row = index.below(builder.trunc(args[2], I32)).to(I32)
            doubtful = (near.below(unsure) | dy.of("fabs").below(flat)).to(I32) * is_row
            doubts.store(k, doubtful)
            builder.store(builder.add(builder.load(unclear), doubtful.total()), unclear)
            a = a.of("ceil").at_least(first).at_most(after)
            b = (b.of("floor") + 1.0).at_least(a).at_most(after)
            f = f.of("ceil").at_least(a).at_most(b)
            g = (g.of("floor") + 1.0).at_least(f).at_most(b)
            has_front = f.below(g)
            for n, column in enumerate((a, f.where(has_front, b), g.where(has_front, b), b)):
                table.store(table.at(n, k), column.to(I32))
        return builder.load(unclear)

    return types.int32(spans, doubt, types.int64, limits), make


@intrinsic
def lanes_of_gaussians(
    typing: Any, first: Any, count: Any, step: Any, size: Any, to: Any, per_near: Any,
    per_fade: Any, bell: Any, square: Any,
) -> Any:  # fmt: skip
    """``fading._fill_gaussians``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bells, squares = (Cells(context, builder, signature.args[k], args[k]) for k in (7, 8))
        first, count, step, size, to, per_near, per_fade = args[:7]
        first, step = builder.sitofp(first, F64), builder.sitofp(step, F64)
        with by_width(builder, ir.Constant(I64, 0), count) as (k, _):
            d = (counted(builder, builder.sitofp(k, F64)) * step + first + 0.5) * size + to
            x, y = (d * per_near).to(F32), (d * per_fade).to(F32)
            exponent = (x * x * -1.0).at_least(-126.0)
            whole = exponent.of("rint")
            u = exponent - whole
            p = u * POWERS[-1] + POWERS[-2]
            for power in reversed(POWERS[:-2]):
                p = p * u + power
            bits = (whole.to(I32) + 127) << 23
            bells.store(k, p * bits.bits_as(F32))
            squares.store(k, y * y)
        return context.get_dummy_value()

    floats = [types.float64] * 4
    ints = [types.int64] * 3
    return types.void(*ints, *floats, bell, square), make


@dataclass(frozen=True, slots=True)
class _Row:
    """A row of cells: where it begins in the map, its span (a, f, g, b), and what it loses."""

    begin: Any
    span: tuple[Any, Any, Any, Any]
    near: Any = None
    depth: Any = None


class _Zeros:
    """Did any cell become 0? Of all others it can be seen later that something was added."""

    def __init__(self, builder: Any) -> None:
        kind = ir.VectorType(ir.IntType(1), WIDTH)
        self.builder = builder
        self.found = cgutils.alloca_once_value(builder, ir.Constant(kind, [0] * WIDTH))

    def note(self, cells: Lanes, inside: Lanes) -> None:
        """Cells, and which of them something was added to."""
        none = ir.Constant(cells.value.type, [0] * WIDTH)
        is_zero = self.builder.icmp_signed("==", cells.value, none)
        new = self.builder.and_(is_zero, inside.value)
        self.builder.store(self.builder.or_(self.builder.load(self.found), new), self.found)

    def any(self) -> Any:
        """1 or 0."""
        kind = ir.IntType(WIDTH)
        bits = self.builder.bitcast(self.builder.load(self.found), kind)
        is_any = self.builder.icmp_unsigned("!=", bits, ir.Constant(kind, 0))
        return self.builder.zext(is_any, I32)


def _add_side_by_side(
    builder: Any, grid: Cells, rows: list[_Row], loss_of: Any, hit: Any, lowest: Any, zeros: _Zeros
) -> None:
    """Add to the cells of some rows at once, all columns that any of their spans holds.

    ``loss_of(row, column)`` makes what cells in front lose. To cells outside a span 0 is added.
    """
    start, end = ir.Constant(I32, 2**31 - WIDTH), ir.Constant(I32, 0)
    for row in rows:
        a, _f, _g, b = row.span
        is_empty = builder.icmp_signed(">=", a, b)
        a = builder.select(is_empty, start, a)
        start = builder.select(builder.icmp_signed("<", a, start), a, start)
        b = builder.select(is_empty, end, b)
        end = builder.select(builder.icmp_signed("<", end, b), b, end)
    start = builder.and_(builder.sext(start, I64), ir.Constant(I64, -WIDTH))
    top = builder.neg(lowest)
    with by_width(builder, start, builder.sext(end, I64)) as (c, _):
        column = counted(builder, builder.trunc(c, I32))
        for row in rows:
            a, f, g, b = row.span
            step = loss_of(row, c).where(column.within(f, builder.sub(g, f)), hit)
            inside = column.within(a, builder.sub(b, a))
            at = builder.add(row.begin, c)
            total = (grid.load(at) + step.where(inside, 0)).at_most(top).at_least(lowest)
            zeros.note(total, inside)
            grid.store(at, total)


def _fading_loss(builder: Any, bells: Cells, squares: Cells, miss: Any, lowest: Any) -> Any:
    """What `fading` takes from the cells in front."""
    least = builder.sitofp(lowest, F32)

    def loss(row: _Row, c: Any) -> Lanes:
        value = (bells.load(c) * row.near + miss) / (squares.load(c) + row.depth)
        said: Lanes = value.at_least(least).of("rint").to(I32)
        return said

    return loss


@contextmanager
def _in_pairs(
    builder: Any, grid: Cells, spans: Cells, first: Any, step: Any, count: Any, shift: Any,
    many: int = 2,
) -> Iterator[list[tuple[Any, Any, Any]]]:  # fmt: skip
    """A loop over the rows of a reading, two at a time: number, begin in the map, and span.

    Where the second is missing it is the first again, with no cells.
    """
    by = ir.Constant(I64, many)
    with cgutils.for_range_slice(builder, ir.Constant(I64, 0), count, by) as (k, _):
        pair = []
        for n in range(many):
            own = builder.add(k, ir.Constant(I64, n))
            is_there = builder.icmp_signed("<", own, count)
            own = builder.select(is_there, own, k)
            at = builder.mul(builder.add(first, builder.mul(own, step)), grid.shape[1])
            a, f, g, b = (builder.sub(spans.one(spans.at(m, own)), shift) for m in range(4))
            pair.append((own, at, (a, f, g, builder.select(is_there, b, a))))
        yield pair


@intrinsic
def lanes_of_rows(
    typing: Any, cells: Any, first: Any, step: Any, rows: Any, shift: Any, spans: Any, bell: Any,
    square: Any, row_bell: Any, row_square: Any, miss: Any, near: Any, hit: Any, lowest: Any,
) -> Any:  # fmt: skip
    """``fading.add_rows_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, table, bells, squares, row_bells, row_squares = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 5, 6, 7, 8, 9)
        )
        _, first, step, count, shift, *_, miss, near, hit, lowest = args
        loss, zeros = _fading_loss(builder, bells, squares, miss, lowest), _Zeros(builder)
        with _in_pairs(builder, grid, table, first, step, count, shift) as pair:
            rows = []
            for k, begin, span in pair:
                depth = builder.fadd(row_squares.one(k), ir.Constant(F32, 1.0))
                rows.append(_Row(begin, span, builder.fmul(near, row_bells.one(k)), depth))
            _add_side_by_side(builder, grid, rows, loss, hit, lowest, zeros)
        return zeros.any()

    singles, ints = (row_bell, row_square, types.float32, types.float32), (types.int32,) * 2
    place = (cells, types.int64, types.int64, types.int64, types.int32, spans)
    return types.int32(*place, bell, square, *singles, *ints), make


@intrinsic
def lanes_of_plain_rows(
    typing: Any, cells: Any, first: Any, step: Any, rows: Any, shift: Any, spans: Any, miss: Any,
    hit: Any, lowest: Any,
) -> Any:  # fmt: skip
    """``fading.add_plain_rows_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, table = (Cells(context, builder, signature.args[k], args[k]) for k in (0, 5))
        _, first, step, count, shift, _, miss, hit, lowest = args
        loss, zeros = splat(builder, miss), _Zeros(builder)
        with _in_pairs(builder, grid, table, first, step, count, shift) as pair:
            rows = [_Row(begin, span) for _, begin, span in pair]
            _add_side_by_side(builder, grid, rows, lambda *_: loss, hit, lowest, zeros)
        return zeros.any()

    place = (cells, types.int64, types.int64, types.int64, types.int32, spans)
    return types.int32(*place, *(types.int32,) * 3), make


@intrinsic
def lanes_of_row(
    typing: Any, cells: Any, row: Any, bell: Any, square: Any, bounds: Any, miss: Any, near: Any,
    depth: Any, hit: Any, lowest: Any,
) -> Any:  # fmt: skip
    """``fading.add_row_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, bells, squares = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 2, 3)
        )
        _, row, _, _, bounds, miss, near, depth, hit, lowest = args
        loss, zeros = _fading_loss(builder, bells, squares, miss, lowest), _Zeros(builder)
        begin, span = builder.mul(row, grid.shape[1]), tuple(unpacked(builder, bounds))
        rows = [_Row(begin, span, near, depth)]
        _add_side_by_side(builder, grid, rows, loss, hit, lowest, zeros)
        return zeros.any()

    singles = [types.float32] * 3
    row_of = (cells, types.int64, bell, square, types.UniTuple(types.int32, 4))
    return types.int32(*row_of, *singles, types.int32, types.int32), make


@intrinsic
def lanes_of_plain_row(
    typing: Any, cells: Any, row: Any, bounds: Any, miss: Any, hit: Any, lowest: Any
) -> Any:
    """``fading.add_plain_row_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid = Cells(context, builder, signature.args[0], args[0])
        _, row, bounds, miss, hit, lowest = args
        begin, span = builder.mul(row, grid.shape[1]), tuple(unpacked(builder, bounds))
        loss, zeros = splat(builder, miss), _Zeros(builder)
        _add_side_by_side(builder, grid, [_Row(begin, span)], lambda *_: loss, hit, lowest, zeros)
        return zeros.any()

    steps = [types.int32] * 3
    return types.int32(cells, types.int64, types.UniTuple(types.int32, 4), *steps), make
