"""Steps in lanes of `regions` and `peak`: twins of the plain loops named in each."""

from __future__ import annotations

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


@intrinsic
def lanes_of_borders(
    typing: Any, borders: Any, k: Any, rows: Any, limits: Any, spans: Any, crossing: Any
) -> Any:
    """``regions.fill_borders_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        table, ends, found = (
            Cells(context, builder, signature.args[n], args[n]) for n in (0, 4, 5)
        )
        row0, step, size, base_y, slope, offset, most, up, missed_up, down, missed_down, shift = (
            unpacked(builder, args[3])
        )
        shift_32 = builder.fptosi(shift, I32)
        with by_width(builder, ir.Constant(I64, 0), args[2]) as (r, _):
            row = counted(builder, builder.sitofp(r, F64)) * step + row0
            dy = (row + 0.5) * size + base_y
            at = (dy * slope + offset).at_least(builder.fneg(most)).at_most(most)
            above = (at.of("floor") + 1.0) * up + missed_up - shift
            below = (at.of("ceil") * down + missed_down - shift) * -1.0
            is_above = splat(builder, ir.Constant(F64, 0.0)).below(dy)
            own = above.where(is_above, below).to(I32)
            begin = builder.mul(table.shape[1], args[1])
            table.store(builder.add(begin, r), own)
            a, b = (ends.load(ends.at(n, r)) - shift_32 for n in (0, 3))
            first, last = a.where(is_above, b * -1), (b - 1).where(is_above, (a + 1) * -1)
            for n, bound in enumerate((last, first)):
                counted_so_far = found.load(found.at(n, r))
                found.store(found.at(n, r), counted_so_far + bound.below(own).to(I32))
        return context.get_dummy_value()

    return types.void(borders, types.int64, types.int64, limits, spans, crossing), make


_PAIR = types.UniTuple(types.int32, 2)


def _by_region(
    builder: Any, borders: Cells, row: Any, crossing: Any, column: Lanes, values: Any
) -> Lanes:
    """``values(k)`` of the angular region k that each column of a row lies in.

    The row lies wholly beyond the borders 1 .. ``crossing[0]`` and before those past the other.
    """
    low, high = (builder.sext(n, I64) for n in unpacked(builder, crossing))
    own = cgutils.alloca_once(builder, ir.VectorType(values(low).type, WIDTH))
    builder.store(splat(builder, values(low)).value, own)
    one = ir.Constant(I64, 1)
    after = builder.add(high, one)
    with cgutils.for_range_slice(builder, builder.add(low, one), after, one) as (k, _):
        border = borders.one(builder.add(builder.mul(borders.shape[1], k), row))
        value = splat(builder, values(k)).where(
            column.below(border), Lanes(builder, builder.load(own))
        )
        builder.store(value.value, own)
    return Lanes(builder, builder.load(own))


@intrinsic
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
        powers = unpacked(builder, powers)
        begin, width = builder.mul(row, grid.shape[1]), builder.sub(g, f)
        start = builder.and_(builder.sext(f, I64), ir.Constant(I64, -WIDTH))
        with by_width(builder, start, builder.sext(g, I64)) as (c, _):
            column = counted(builder, builder.trunc(c, I32))
            own = _by_region(builder, table, r, crossing, column ^ flip, factor.one)
            e = (squares.load(c) + row_square).of("sqrt") * e1 + e0
            z = own * e.at_most(1.0).at_least(0.0)
            s = z * z
            t = s * s
            p = (s * powers[5] + powers[4]) + t * powers[6]
            p = (s * powers[1] + powers[0]) + (s * powers[3] + powers[2]) * t + p * (t * t)
            step = (z * p * scale).of("rint").to(I32).where(column.within(f, width), 0)
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


@intrinsic
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
        doubtful = cgutils.alloca_once_value(builder, ir.Constant(I32, 0))
        last, width = builder.sub(bands, ir.Constant(I32, 1)), builder.sub(b, a)
        start = builder.and_(builder.sext(a, I64), ir.Constant(I64, -WIDTH))

        def base(k: Any) -> Any:
            return builder.mul(builder.trunc(k, I32), bands)

        with by_width(builder, start, builder.sext(b, I64)) as (c, _):
            column = counted(builder, builder.trunc(c, I32))
            own = _by_region(builder, table, r, crossing, column ^ flip, base)
            at = (squares.load(c) + row_square).of("sqrt") * scale + offset
            unclear = (at - at.of("rint")).of("fabs").below(unsure).to(I32)
            unclear = unclear.where(column.within(a, width), 0)
            builder.store(builder.add(builder.load(doubtful), unclear.total()), doubtful)
            band = at.of("floor").at_most(builder.sitofp(last, F32)).at_least(0.0)
            out.store(c, own + band.to(I32))
        return builder.load(doubtful)

    singles, ints = (types.float32,) * 3, (types.int32,) * 4
    kinds = (square, types.float32, borders, types.int64, _PAIR, types.int32)
    return types.int32(*kinds, *ints[1:], *singles, index), make


@intrinsic
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
        start = builder.and_(builder.sext(a, I64), ir.Constant(I64, -WIDTH))
        with by_width(builder, start, builder.sext(b, I64)) as (c, _):
            said: Any = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
            for n in range(WIDTH):
                place = places.one(builder.add(c, ir.Constant(I64, n)))
                value = values.one(builder.sext(place, I64))
                said = builder.insert_element(said, value, ir.Constant(I32, n))
            column = counted(builder, builder.trunc(c, I32))
            step = Lanes(builder, said).where(column.within(a, width), 0)
            at = builder.add(begin, c)
            total = grid.load(at) + step
            grid.store(at, total.at_most(builder.neg(lowest)).at_least(lowest))
        return context.get_dummy_value()

    ints = (types.int32, types.int32)
    return types.void(cells, types.int64, *ints, table, index, types.int32), make
