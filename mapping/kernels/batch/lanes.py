"""Several cells at a time: vector steps spelled out, where loops of numba lose most of their time.

A row of a beam is short, and a loop that numba turns into vectors takes up to 32 cells at once and
the rest one by one. What is here takes 8 or 16 at a time to the end, so arrays have room for whole
groups of ``ROOM``. Every function has a plain loop as its twin, which gives the same bytes. LLVM
makes of the vectors what a processor has; where it cannot, or to compare, ECHOGRID_PLAIN_LOOPS=1
switches to the twins (compiled at each start then: numba's cache does not know which it holds).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import binding as llvm
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

WITH_LANES = os.environ.get("ECHOGRID_PLAIN_LOOPS", "") in ("", "0")
# More than fit into a register of most processors: that hides what one step waits for the last.
WIDTH = 16 if llvm.get_host_cpu_features().get("avx512f") else 8
ROOM = 16
_F32, _F64, _I32, _I64 = ir.FloatType(), ir.DoubleType(), ir.IntType(32), ir.IntType(64)
# 2^u on -0.5 .. 0.5, within 1 ulp: the coefficients of 1, u, u^2, ...
POWERS = (
    1.0, 0.6931472, 0.24022651, 0.05550411, 0.009618129, 0.0013333558, 0.00015403530,
)  # fmt: skip
loop = njit(cache=WITH_LANES, error_model="numpy")
inlined_loop = njit(cache=WITH_LANES, error_model="numpy", forceinline=True)
free_loop = njit(cache=WITH_LANES, error_model="numpy", nogil=True)


class Lanes:
    """Numbers of one LLVM type, while code is made: what is done to one is done to all."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value
        self.element = value.type.element
        self.is_float = self.element in (_F32, _F64)

    def _same(self, other: Any) -> Any:
        """The other operand: lanes as they are, numbers of Python and of LLVM in every lane."""
        if isinstance(other, Lanes):
            return other.value
        if isinstance(other, ir.Value):
            return splat(self.builder, other).value
        if self.element is _F32:
            other = float(np.float32(other))
        return ir.Constant(self.value.type, [ir.Constant(self.element, other)] * WIDTH)

    def _made(self, value: Any) -> Lanes:
        return Lanes(self.builder, value)

    def __add__(self, other: Any) -> Lanes:
        add = self.builder.fadd if self.is_float else self.builder.add
        return self._made(add(self.value, self._same(other)))

    def __sub__(self, other: Any) -> Lanes:
        sub = self.builder.fsub if self.is_float else self.builder.sub
        return self._made(sub(self.value, self._same(other)))

    def __mul__(self, other: Any) -> Lanes:
        mul = self.builder.fmul if self.is_float else self.builder.mul
        return self._made(mul(self.value, self._same(other)))

    def __truediv__(self, other: Any) -> Lanes:
        return self._made(self.builder.fdiv(self.value, self._same(other)))

    def __or__(self, other: Any) -> Lanes:
        return self._made(self.builder.or_(self.value, self._same(other)))

    def __xor__(self, other: Any) -> Lanes:
        return self._made(self.builder.xor(self.value, self._same(other)))

    def __lshift__(self, bits: int) -> Lanes:
        return self._made(self.builder.shl(self.value, self._same(bits)))

    def below(self, other: Any) -> Lanes:
        less = self.builder.fcmp_ordered if self.is_float else self.builder.icmp_signed
        return self._made(less("<", self.value, self._same(other)))

    def within(self, first: Any, count: Any) -> Lanes:
        """Which lanes of whole numbers are first .. first + count - 1?"""
        off = self - first
        return self._made(self.builder.icmp_unsigned("<", off.value, off._same(count)))

    def where(self, mask: Lanes, other: Any) -> Lanes:
        return self._made(self.builder.select(mask.value, self.value, self._same(other)))

    def at_most(self, other: Any) -> Lanes:
        return self.where(self.below(other), other)

    def at_least(self, other: Any) -> Lanes:
        bound = self._made(self._same(other))
        return self.where(bound.below(self), bound)

    def of(self, name: str) -> Lanes:
        """sqrt, rint, floor, ceil or fabs."""
        kind = ir.FunctionType(self.value.type, [self.value.type])
        full = f"llvm.{name}.v{WIDTH}{self.element.intrinsic_name}"
        function = cgutils.get_or_insert_function(self.builder.module, kind, full)
        return self._made(self.builder.call(function, [self.value]))

    def to(self, element: Any) -> Lanes:
        """As numbers of another type; what is not whole is cut."""
        wanted, b = ir.VectorType(element, WIDTH), self.builder
        if element is _I32:
            make = b.fptosi if self.is_float else b.zext
        else:
            make = (b.fptrunc if element is _F32 else b.fpext) if self.is_float else b.sitofp
        return self._made(make(self.value, wanted))

    def total(self) -> Any:
        """The sum of whole numbers."""
        kind = ir.FunctionType(self.element, [self.value.type])
        full = f"llvm.vector.reduce.add.v{WIDTH}{self.element.intrinsic_name}"
        function = cgutils.get_or_insert_function(self.builder.module, kind, full)
        return self.builder.call(function, [self.value])

    def bits_as(self, element: Any) -> Lanes:
        """The same bits read as numbers of another type."""
        return self._made(self.builder.bitcast(self.value, ir.VectorType(element, WIDTH)))


def splat(builder: Any, value: Any) -> Lanes:
    """One number in every lane."""
    kind = ir.VectorType(value.type, WIDTH)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(_I32, 0))
    lanes = ir.Constant(ir.VectorType(_I32, WIDTH), [0] * WIDTH)
    return Lanes(builder, builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), lanes))


def counted(builder: Any, first: Any) -> Lanes:
    """first, first + 1, ..."""
    return splat(builder, first) + Lanes(
        builder, ir.Constant(ir.VectorType(first.type, WIDTH), list(range(WIDTH)))
    )


class Cells:
    """The numbers of a numba array, several from an index on."""

    def __init__(self, context: Any, builder: Any, kind: Any, value: Any) -> None:
        self.builder = builder
        array = context.make_array(kind)(context, builder, value)
        self.data, self.element = array.data, context.get_data_type(kind.dtype)
        self.shape = cgutils.unpack_tuple(builder, array.shape)

    def _at(self, index: Any) -> Any:
        pointer = self.builder.gep(self.data, [index], source_etype=self.element)
        return self.builder.bitcast(pointer, ir.VectorType(self.element, WIDTH).as_pointer())

    def at(self, row: int, column: Any) -> Any:
        """The index of a cell of a table."""
        begin = self.builder.mul(self.shape[1], ir.Constant(_I64, row))
        return self.builder.add(begin, column)

    def one(self, index: Any) -> Any:
        """One number."""
        pointer = self.builder.gep(self.data, [index], source_etype=self.element)
        return self.builder.load(pointer, typ=self.element)

    def load(self, index: Any) -> Lanes:
        kind = ir.VectorType(self.element, WIDTH)
        return Lanes(self.builder, self.builder.load(self._at(index), align=4, typ=kind))

    def store(self, index: Any, lanes: Lanes) -> None:
        self.builder.store(lanes.value, self._at(index), align=4)


def _unpacked(builder: Any, values: Any) -> list[Any]:
    return [builder.extract_value(values, k) for k in range(values.type.count)]


def _from(builder: Any, first: Any, after: Any) -> Any:
    """A loop over first, first + WIDTH, ... as a context that gives the index."""
    return cgutils.for_range_slice(builder, first, after, ir.Constant(_I64, WIDTH), inc=True)


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_spans(typing: Any, spans: Any, doubt: Any, rows: Any, limits: Any) -> Any:
    """``spans.fill_spans_plainly``; of the rows past the last none is in doubt."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = signature.args
        table, doubts = (Cells(context, builder, kinds[k], args[k]) for k in (0, 1))
        (row0, step, size, base_y, reach_2, front_2, low_r, low_r0, low_l, low_l0, high_r, high_r0,
         high_l, high_l0, far, per_cell, offset, first, after, unsure, flat) = _unpacked(
            builder, args[3])  # fmt: skip
        unclear = cgutils.alloca_once_value(builder, ir.Constant(_I32, 0))
        far_left = builder.fneg(far)
        with _from(builder, ir.Constant(_I64, 0), args[2]) as (k, _):
            row = counted(builder, builder.sitofp(k, _F64)) * step + row0
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
            index = counted(builder, builder.trunc(k, _I32))
            is_row = index.below(builder.trunc(args[2], _I32)).to(_I32)
            doubtful = (near.below(unsure) | dy.of("fabs").below(flat)).to(_I32) * is_row
            doubts.store(k, doubtful)
            builder.store(builder.add(builder.load(unclear), doubtful.total()), unclear)
            a = a.of("ceil").at_least(first).at_most(after)
            b = (b.of("floor") + 1.0).at_least(a).at_most(after)
            f = f.of("ceil").at_least(a).at_most(b)
            g = (g.of("floor") + 1.0).at_least(f).at_most(b)
            has_front = f.below(g)
            for n, column in enumerate((a, f.where(has_front, b), g.where(has_front, b), b)):
                table.store(table.at(n, k), column.to(_I32))
        return builder.load(unclear)

    return types.int32(spans, doubt, types.int64, limits), make


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_gaussians(
    typing: Any, first: Any, count: Any, step: Any, size: Any, to: Any, per_near: Any,
    per_fade: Any, bell: Any, square: Any,
) -> Any:  # fmt: skip
    """``fading._fill_gaussians``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bells, squares = (Cells(context, builder, signature.args[k], args[k]) for k in (7, 8))
        first, count, step, size, to, per_near, per_fade = args[:7]
        first, step = builder.sitofp(first, _F64), builder.sitofp(step, _F64)
        with _from(builder, ir.Constant(_I64, 0), count) as (k, _):
            d = (counted(builder, builder.sitofp(k, _F64)) * step + first + 0.5) * size + to
            x, y = (d * per_near).to(_F32), (d * per_fade).to(_F32)
            exponent = (x * x * -1.0).at_least(-126.0)
            whole = exponent.of("rint")
            u = exponent - whole
            p = u * POWERS[-1] + POWERS[-2]
            for power in reversed(POWERS[:-2]):
                p = p * u + power
            bits = (whole.to(_I32) + 127) << 23
            bells.store(k, p * bits.bits_as(_F32))
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


def _add_side_by_side(
    builder: Any, grid: Cells, rows: list[_Row], loss_of: Any, hit: Any, lowest: Any
) -> None:
    """Add to the cells of some rows at once, all columns that any of their spans holds.

    ``loss_of(row, column)`` makes what cells in front lose. To cells outside a span 0 is added.
    """
    start, end = ir.Constant(_I32, 2**31 - WIDTH), ir.Constant(_I32, 0)
    for row in rows:
        a, _f, _g, b = row.span
        is_empty = builder.icmp_signed(">=", a, b)
        a = builder.select(is_empty, start, a)
        start = builder.select(builder.icmp_signed("<", a, start), a, start)
        b = builder.select(is_empty, end, b)
        end = builder.select(builder.icmp_signed("<", end, b), b, end)
    start = builder.and_(builder.sext(start, _I64), ir.Constant(_I64, -WIDTH))
    top = builder.neg(lowest)
    with _from(builder, start, builder.sext(end, _I64)) as (c, _):
        column = counted(builder, builder.trunc(c, _I32))
        for row in rows:
            a, f, g, b = row.span
            step = loss_of(row, c).where(column.within(f, builder.sub(g, f)), hit)
            step = step.where(column.within(a, builder.sub(b, a)), 0)
            at = builder.add(row.begin, c)
            grid.store(at, (grid.load(at) + step).at_most(top).at_least(lowest))


def _fading_loss(builder: Any, bells: Cells, squares: Cells, miss: Any, lowest: Any) -> Any:
    """What `fading` takes from the cells in front."""
    least = builder.sitofp(lowest, _F32)

    def loss(row: _Row, c: Any) -> Lanes:
        value = (bells.load(c) * row.near + miss) / (squares.load(c) + row.depth)
        return value.at_least(least).of("rint").to(_I32)

    return loss


@contextmanager
def _in_pairs(
    builder: Any, grid: Cells, spans: Cells, first: Any, step: Any, count: Any, shift: Any,
    many: int = 2,
) -> Iterator[list[tuple[Any, Any, Any]]]:  # fmt: skip
    """A loop over the rows of a reading, two at a time: number, begin in the map, and span.

    Where the second is missing it is the first again, with no cells.
    """
    by = ir.Constant(_I64, many)
    with cgutils.for_range_slice(builder, ir.Constant(_I64, 0), count, by) as (k, _):
        pair = []
        for n in range(many):
            own = builder.add(k, ir.Constant(_I64, n))
            is_there = builder.icmp_signed("<", own, count)
            own = builder.select(is_there, own, k)
            at = builder.mul(builder.add(first, builder.mul(own, step)), grid.shape[1])
            a, f, g, b = (builder.sub(spans.one(spans.at(m, own)), shift) for m in range(4))
            pair.append((own, at, (a, f, g, builder.select(is_there, b, a))))
        yield pair


@intrinsic  # type: ignore[untyped-decorator]
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
        loss = _fading_loss(builder, bells, squares, miss, lowest)
        with _in_pairs(builder, grid, table, first, step, count, shift) as pair:
            rows = []
            for k, begin, span in pair:
                depth = builder.fadd(row_squares.one(k), ir.Constant(_F32, 1.0))
                rows.append(_Row(begin, span, builder.fmul(near, row_bells.one(k)), depth))
            _add_side_by_side(builder, grid, rows, loss, hit, lowest)
        return context.get_dummy_value()

    singles, ints = (row_bell, row_square, types.float32, types.float32), (types.int32,) * 2
    place = (cells, types.int64, types.int64, types.int64, types.int32, spans)
    return types.void(*place, bell, square, *singles, *ints), make


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_plain_rows(
    typing: Any, cells: Any, first: Any, step: Any, rows: Any, shift: Any, spans: Any, miss: Any,
    hit: Any, lowest: Any,
) -> Any:  # fmt: skip
    """``fading.add_plain_rows_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, table = (Cells(context, builder, signature.args[k], args[k]) for k in (0, 5))
        _, first, step, count, shift, _, miss, hit, lowest = args
        with _in_pairs(builder, grid, table, first, step, count, shift) as pair:
            rows = [_Row(begin, span) for _, begin, span in pair]
            _add_side_by_side(builder, grid, rows, lambda *_: splat(builder, miss), hit, lowest)
        return context.get_dummy_value()

    place = (cells, types.int64, types.int64, types.int64, types.int32, spans)
    return types.void(*place, *(types.int32,) * 3), make


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_borders(
    typing: Any, borders: Any, k: Any, rows: Any, limits: Any, spans: Any, crossing: Any
) -> Any:
    """``regions.fill_borders_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        table, ends, found = (
            Cells(context, builder, signature.args[n], args[n]) for n in (0, 4, 5)
        )
        row0, step, size, base_y, slope, offset, most, up, missed_up, down, missed_down, shift = (
            _unpacked(builder, args[3])
        )
        shift_32 = builder.fptosi(shift, _I32)
        with _from(builder, ir.Constant(_I64, 0), args[2]) as (r, _):
            row = counted(builder, builder.sitofp(r, _F64)) * step + row0
            dy = (row + 0.5) * size + base_y
            at = (dy * slope + offset).at_least(builder.fneg(most)).at_most(most)
            above = (at.of("floor") + 1.0) * up + missed_up - shift
            below = (at.of("ceil") * down + missed_down - shift) * -1.0
            is_above = splat(builder, ir.Constant(_F64, 0.0)).below(dy)
            own = above.where(is_above, below).to(_I32)
            begin = builder.mul(table.shape[1], args[1])
            table.store(builder.add(begin, r), own)
            a, b = (ends.load(ends.at(n, r)) - shift_32 for n in (0, 3))
            first, last = a.where(is_above, b * -1), (b - 1).where(is_above, (a + 1) * -1)
            for n, bound in enumerate((last, first)):
                counted_so_far = found.load(found.at(n, r))
                found.store(found.at(n, r), counted_so_far + bound.below(own).to(_I32))
        return context.get_dummy_value()

    return types.void(borders, types.int64, types.int64, limits, spans, crossing), make


_PAIR = types.UniTuple(types.int32, 2)


def _by_region(
    builder: Any, borders: Cells, row: Any, crossing: Any, column: Lanes, values: Any
) -> Lanes:
    """``values(k)`` of the angular region k that each column of a row lies in.

    The row lies wholly beyond the borders 1 .. ``crossing[0]`` and before those past the other.
    """
    low, high = (builder.sext(n, _I64) for n in _unpacked(builder, crossing))
    own = cgutils.alloca_once(builder, ir.VectorType(values(low).type, WIDTH))
    builder.store(splat(builder, values(low)).value, own)
    one = ir.Constant(_I64, 1)
    after = builder.add(high, one)
    with cgutils.for_range_slice(builder, builder.add(low, one), after, one) as (k, _):
        border = borders.one(builder.add(builder.mul(borders.shape[1], k), row))
        value = splat(builder, values(k)).where(
            column.below(border), Lanes(builder, builder.load(own))
        )
        builder.store(value.value, own)
    return Lanes(builder, builder.load(own))


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_region_front(
    typing: Any, cells: Any, row: Any, square: Any, row_square: Any, borders: Any, r: Any,
    crossing: Any, flip: Any, factors: Any, f: Any, g: Any, e0: Any, e1: Any, powers: Any,
    scale: Any, lowest: Any,
) -> Any:  # fmt: skip
    """``regions.add_front_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, squares, table, factor = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 2, 4, 8)
        )
        _, row, _, row_square, _, r, crossing, flip, _, f, g, e0, e1, powers, scale, lowest = args
        powers = _unpacked(builder, powers)
        begin, width = builder.mul(row, grid.shape[1]), builder.sub(g, f)
        start = builder.and_(builder.sext(f, _I64), ir.Constant(_I64, -WIDTH))
        with _from(builder, start, builder.sext(g, _I64)) as (c, _):
            column = counted(builder, builder.trunc(c, _I32))
            own = _by_region(builder, table, r, crossing, column ^ flip, factor.one)
            e = (squares.load(c) + row_square).of("sqrt") * e1 + e0
            z = own * e.at_most(1.0).at_least(0.0)
            s = z * z
            t = s * s
            p = (s * powers[5] + powers[4]) + t * powers[6]
            p = (s * powers[1] + powers[0]) + (s * powers[3] + powers[2]) * t + p * (t * t)
            step = (z * p * scale).of("rint").to(_I32).where(column.within(f, width), 0)
            at = builder.add(begin, c)
            total = grid.load(at) + step
            grid.store(at, total.at_most(builder.neg(lowest)).at_least(lowest))
        return context.get_dummy_value()

    singles = types.float32
    kinds = (
        cells, types.int64, square, singles, borders, types.int64, _PAIR, types.int32, factors,
        types.int32, types.int32, singles, singles, powers, singles, types.int32,
    )  # fmt: skip
    return types.void(*kinds), make


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_region_band(
    typing: Any, square: Any, row_square: Any, borders: Any, r: Any, crossing: Any, flip: Any,
    bands: Any, a: Any, b: Any, scale: Any, offset: Any, unsure: Any, index: Any,
) -> Any:  # fmt: skip
    """``regions.index_band_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        squares, table, out = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 2, 12)
        )
        _, row_square, _, r, crossing, flip, bands, a, b, scale, offset, unsure, _ = args
        doubtful = cgutils.alloca_once_value(builder, ir.Constant(_I32, 0))
        last, width = builder.sub(bands, ir.Constant(_I32, 1)), builder.sub(b, a)
        start = builder.and_(builder.sext(a, _I64), ir.Constant(_I64, -WIDTH))

        def base(k: Any) -> Any:
            return builder.mul(builder.trunc(k, _I32), bands)

        with _from(builder, start, builder.sext(b, _I64)) as (c, _):
            column = counted(builder, builder.trunc(c, _I32))
            own = _by_region(builder, table, r, crossing, column ^ flip, base)
            at = (squares.load(c) + row_square).of("sqrt") * scale + offset
            unclear = (at - at.of("rint")).of("fabs").below(unsure).to(_I32)
            unclear = unclear.where(column.within(a, width), 0)
            builder.store(builder.add(builder.load(doubtful), unclear.total()), doubtful)
            band = at.of("floor").at_most(builder.sitofp(last, _F32)).at_least(0.0)
            out.store(c, own + band.to(_I32))
        return builder.load(doubtful)

    singles, ints = (types.float32,) * 3, (types.int32,) * 4
    kinds = (square, types.float32, borders, types.int64, _PAIR, types.int32)
    return types.int32(*kinds, *ints[1:], *singles, index), make


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_table_row(
    typing: Any, cells: Any, row: Any, a: Any, b: Any, table: Any, index: Any, lowest: Any
) -> Any:
    """``regions.add_table_row_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, values, places = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 4, 5)
        )
        _, row, a, b, _, _, lowest = args
        begin, width = builder.mul(row, grid.shape[1]), builder.sub(b, a)
        start = builder.and_(builder.sext(a, _I64), ir.Constant(_I64, -WIDTH))
        with _from(builder, start, builder.sext(b, _I64)) as (c, _):
            said: Any = ir.Constant(ir.VectorType(_I32, WIDTH), [0] * WIDTH)
            for n in range(WIDTH):
                place = places.one(builder.add(c, ir.Constant(_I64, n)))
                value = values.one(builder.sext(place, _I64))
                said = builder.insert_element(said, value, ir.Constant(_I32, n))
            column = counted(builder, builder.trunc(c, _I32))
            step = Lanes(builder, said).where(column.within(a, width), 0)
            at = builder.add(begin, c)
            total = grid.load(at) + step
            grid.store(at, total.at_most(builder.neg(lowest)).at_least(lowest))
        return context.get_dummy_value()

    ints = (types.int32, types.int32)
    return types.void(cells, types.int64, *ints, table, index, types.int32), make


@intrinsic  # type: ignore[untyped-decorator]
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
        loss = _fading_loss(builder, bells, squares, miss, lowest)
        begin, span = builder.mul(row, grid.shape[1]), tuple(_unpacked(builder, bounds))
        _add_side_by_side(builder, grid, [_Row(begin, span, near, depth)], loss, hit, lowest)
        return context.get_dummy_value()

    singles = [types.float32] * 3
    row_of = (cells, types.int64, bell, square, types.UniTuple(types.int32, 4))
    return types.void(*row_of, *singles, types.int32, types.int32), make


@intrinsic  # type: ignore[untyped-decorator]
def lanes_of_plain_row(
    typing: Any, cells: Any, row: Any, bounds: Any, miss: Any, hit: Any, lowest: Any
) -> Any:
    """``fading.add_plain_row_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid = Cells(context, builder, signature.args[0], args[0])
        _, row, bounds, miss, hit, lowest = args
        begin, span = builder.mul(row, grid.shape[1]), tuple(_unpacked(builder, bounds))
        loss = splat(builder, miss)
        _add_side_by_side(builder, grid, [_Row(begin, span)], lambda *_: loss, hit, lowest)
        return context.get_dummy_value()

    steps = [types.int32] * 3
    return types.void(cells, types.int64, types.UniTuple(types.int32, 4), *steps), make
