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
    I16,
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


@intrinsic
def lanes_of_border(
    typing: Any, borders: Any, k: Any, first: Any, after: Any, rows_up: Any, line: Any, to: Any,
    most: Any,
) -> Any:  # fmt: skip
    """``regions.fill_border_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        table, up = (Cells(context, builder, signature.args[n], args[n]) for n in (0, 4))
        _, k, first, after, _, line, to, most = args
        slope, offset = unpacked(builder, line)
        begin = builder.mul(table.shape[1], k)
        with by_width(builder, first, after) as (r, _):
            at = (up.load(r) * slope + offset).of("floor") + to
            at = at.at_least(builder.fneg(most)).at_most(most)
            table.store(builder.add(begin, r), at.to(I32).to(I16))
        return context.get_dummy_value()

    kinds = (types.int64, types.int64, types.int64, rows_up, line, types.float64, types.float64)
    return types.void(borders, *kinds), make


def _regions_of(builder: Any, borders: Cells, row: Any, c: Any, first: Any, flip: Any) -> Lanes:
    """``regions._region_of`` of the columns from c on."""
    one = ir.Constant(I64, 1)
    column = counted(builder, builder.trunc(builder.sub(c, builder.sext(first, I64)), I16)) ^ flip
    own = cgutils.alloca_once(builder, column.value.type)
    builder.store(splat(builder, ir.Constant(I16, 0)).value, own)
    with cgutils.for_range_slice(builder, one, borders.shape[0], one) as (k, _):
        border = borders.one(builder.add(builder.mul(borders.shape[1], k), row))
        count = Lanes(builder, builder.load(own)) + column.below(border).to(I16)
        builder.store(count.value, own)
    return Lanes(builder, builder.load(own)).to(I32)


def _of_region(builder: Any, values: Cells, few: Lanes, own: Lanes, count: Any) -> Lanes:
    """What ``values`` have of each region; ``few`` are the first of them."""
    found = cgutils.alloca_once(builder, few.value.type)
    is_few = builder.icmp_signed("<=", count, ir.Constant(I64, WIDTH))
    with builder.if_else(is_few) as (in_lanes, in_memory):
        with in_lanes:
            builder.store(few.picked(own).value, found)
        with in_memory:
            builder.store(values.picked(own).value, found)
    return Lanes(builder, builder.load(found))


def _loss(z: Lanes, powers: list[Any]) -> Lanes:
    """``regions._loss``."""
    s = z * z
    t = s * s
    p = (s * powers[5] + powers[4]) + t * powers[6]
    p = (s * powers[1] + powers[0]) + (s * powers[3] + powers[2]) * t + p * (t * t)
    steps: Lanes = (z * p).of("rint").to(I32)
    return steps


@intrinsic
def lanes_of_region_front(
    typing: Any, cells: Any, row: Any, square: Any, row_square: Any, borders: Any, r: Any,
    flip: Any, first_column: Any, factors: Any, full: Any, f: Any, g: Any, front: Any, powers: Any,
    lowest: Any,
) -> Any:  # fmt: skip
    """``regions.add_front_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, squares, table, factor, losses = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 2, 4, 8, 9)
        )
        _, row, _, row_square, _, r, flip, first_column, _, _, f, g, front, powers, lowest = args
        e0, e1, sure = unpacked(builder, front)
        powers = unpacked(builder, powers)
        begin, width = builder.mul(row, grid.shape[1]), builder.sub(g, f)
        aligned = builder.and_(builder.sext(f, I64), ir.Constant(I64, -WIDTH))
        said = cgutils.alloca_once(builder, ir.VectorType(I32, WIDTH))
        few = factor.load(ir.Constant(I64, 0)), losses.load(ir.Constant(I64, 0))
        with by_width(builder, aligned, builder.sext(g, I64)) as (c, _):
            column = counted(builder, builder.trunc(c, I32))
            own = _regions_of(builder, table, r, c, first_column, flip)
            first, last = squares.one(c), squares.one(builder.add(c, ir.Constant(I64, WIDTH - 1)))
            farthest = builder.select(builder.fcmp_ordered("<", first, last), last, first)
            is_full = builder.fcmp_ordered("<", builder.fadd(farthest, row_square), sure)
            with builder.if_else(is_full) as (near, far):
                with near:
                    step = _of_region(builder, losses, few[1], own, table.shape[0])
                    builder.store(step.value, said)
                with far:
                    most = _of_region(builder, factor, few[0], own, table.shape[0])
                    e = (squares.load(c) + row_square).of("sqrt") * e1 + e0
                    step = _loss(most * e.at_most(1.0).at_least(0.0), powers)
                    builder.store(step.value, said)
            step = Lanes(builder, builder.load(said)).where(column.within(f, width), 0)
            at = builder.add(begin, c)
            total = grid.load(at) + step
            grid.store(at, total.at_most(builder.neg(lowest)).at_least(lowest))
        return context.get_dummy_value()

    kinds = (
        cells, types.int64, square, types.float32, borders, types.int64, types.int16, types.int32,
        factors, full, types.int32, types.int32, front, powers, types.int32,
    )  # fmt: skip
    return types.void(*kinds), make


def _exact_bands(builder: Any, c: Any, dy: Any, exact: Any) -> Lanes:
    """Numbers of band regions in float64, of the columns from c on."""
    bands, begin, depth, first, size, origin, x = unpacked(builder, exact)
    dx = (counted(builder, builder.sitofp(c, F64)) + first + 0.5) * size + origin - x
    rho = (dx * dx + builder.fmul(dy, dy)).of("sqrt")
    last = builder.fsub(bands, ir.Constant(F64, 1.0))
    at: Lanes = ((rho - begin) / depth * bands).of("floor").at_least(0.0).at_most(last).to(I32)
    return at


@intrinsic
def lanes_of_region_band(
    typing: Any, cells: Any, row: Any, square: Any, row_square: Any, borders: Any, r: Any,
    flip: Any, first_column: Any, table: Any, a: Any, b: Any, band: Any, dy: Any, lowest: Any,
) -> Any:  # fmt: skip
    """``regions.add_band_plainly``."""

    def make(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        grid, squares, edges, gains = (
            Cells(context, builder, signature.args[k], args[k]) for k in (0, 2, 4, 8)
        )
        _, row, _, row_square, _, r, flip, first_column, _, a, b, band, dy, lowest = args
        scale, offset, unsure, exact = unpacked(builder, band)
        bands = builder.extract_value(exact, 0)
        last = builder.fptrunc(builder.fsub(bands, ir.Constant(F64, 1.0)), F32)
        begin, width = builder.mul(row, grid.shape[1]), builder.sub(b, a)
        aligned = builder.and_(builder.sext(a, I64), ir.Constant(I64, -WIDTH))
        number = cgutils.alloca_once(builder, ir.VectorType(I32, WIDTH))
        with by_width(builder, aligned, builder.sext(b, I64)) as (c, _):
            inside = counted(builder, builder.trunc(c, I32)).within(a, width)
            at = (squares.load(c) + row_square).of("sqrt") * scale + offset
            is_unclear = (at - at.of("rint")).of("fabs").below(unsure) & inside
            likely = at.of("floor").at_most(last).at_least(0.0).to(I32)
            builder.store(likely.value, number)
            with where_any(is_unclear):
                sure = _exact_bands(builder, c, dy, exact).where(is_unclear, likely)
                builder.store(sure.value, number)
            own = _regions_of(builder, edges, r, c, first_column, flip) * builder.fptosi(bands, I32)
            gain = gains.picked(own + Lanes(builder, builder.load(number))).where(inside, 0)
            at_cell = builder.add(begin, c)
            total = grid.load(at_cell) + gain
            grid.store(at_cell, total.at_most(builder.neg(lowest)).at_least(lowest))
        return context.get_dummy_value()

    kinds = (
        cells, types.int64, square, types.float32, borders, types.int64, types.int16, types.int32,
        table, types.int32, types.int32, band, types.float64, types.int32,
    )  # fmt: skip
    return types.void(*kinds), make
