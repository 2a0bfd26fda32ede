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
from typing import Any

import numpy as np
from llvmlite import binding as llvm
from llvmlite import ir
from numba import njit
from numba.core import cgutils

WITH_LANES = os.environ.get("ECHOGRID_PLAIN_LOOPS", "") in ("", "0")
# More than fit into a register of most processors: that hides what one step waits for the last.
WIDTH = 16 if llvm.get_host_cpu_features().get("avx512f") else 8
ROOM = 16
F32, F64 = ir.FloatType(), ir.DoubleType()
I16, I32, I64 = (ir.IntType(bits) for bits in (16, 32, 64))
loop = njit(cache=WITH_LANES, error_model="numpy")
inlined_loop = njit(cache=WITH_LANES, error_model="numpy", forceinline=True)
free_loop = njit(cache=WITH_LANES, error_model="numpy", nogil=True)


class Lanes:
    """Numbers of one LLVM type, while code is made: what is done to one is done to all."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value
        self.element = value.type.element
        self.is_float = self.element in (F32, F64)

    def _same(self, other: Any) -> Any:
        """The other operand: lanes as they are, numbers of Python and of LLVM in every lane."""
        if isinstance(other, Lanes):
            return other.value
        if isinstance(other, ir.Value):
            return splat(self.builder, other).value
        if self.element is F32:
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

    def __and__(self, other: Any) -> Lanes:
        return self._made(self.builder.and_(self.value, self._same(other)))

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
        if element is I16:
            make = b.trunc if self.element is I32 else b.zext
        elif element is I32:
            make = b.fptosi if self.is_float else b.zext
        else:
            make = (b.fptrunc if element is F32 else b.fpext) if self.is_float else b.sitofp
        return self._made(make(self.value, wanted))

    def total(self) -> Any:
        """The sum of whole numbers."""
        kind = ir.FunctionType(self.element, [self.value.type])
        full = f"llvm.vector.reduce.add.v{WIDTH}{self.element.intrinsic_name}"
        function = cgutils.get_or_insert_function(self.builder.module, kind, full)
        return self.builder.call(function, [self.value])

    def picked(self, places: Lanes) -> Lanes:
        """The numbers in several lanes of these."""
        b, said = self.builder, ir.Constant(self.value.type, ir.Undefined)
        for n in range(WIDTH):
            lane = ir.Constant(I32, n)
            value = b.extract_element(self.value, b.extract_element(places.value, lane))
            said = b.insert_element(said, value, lane)
        return self._made(said)

    def bits_as(self, element: Any) -> Lanes:
        """The same bits read as numbers of another type."""
        return self._made(self.builder.bitcast(self.value, ir.VectorType(element, WIDTH)))


def splat(builder: Any, value: Any) -> Lanes:
    """One number in every lane."""
    kind = ir.VectorType(value.type, WIDTH)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(I32, 0))
    lanes = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
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
        self.align = 2 if self.element == I16 else 4

    def _at(self, index: Any) -> Any:
        pointer = self.builder.gep(self.data, [index], source_etype=self.element)
        return self.builder.bitcast(pointer, ir.VectorType(self.element, WIDTH).as_pointer())

    def at(self, row: int, column: Any) -> Any:
        """The index of a cell of a table."""
        begin = self.builder.mul(self.shape[1], ir.Constant(I64, row))
        return self.builder.add(begin, column)

    def one(self, index: Any) -> Any:
        """One number."""
        pointer = self.builder.gep(self.data, [index], source_etype=self.element)
        return self.builder.load(pointer, typ=self.element)

    def picked(self, places: Lanes) -> Lanes:
        """The numbers at several places."""
        b, kind = self.builder, ir.VectorType(self.element, WIDTH)
        pointers = b.gep(self.data, [places.value], source_etype=self.element)
        pointers.type = ir.VectorType(self.data.type, WIDTH)  # which llvmlite does not see
        every = ir.Constant(ir.VectorType(ir.IntType(1), WIDTH), [1] * WIDTH)
        function = cgutils.get_or_insert_function(
            b.module,
            ir.FunctionType(kind, [pointers.type, I32, every.type, kind]),
            f"llvm.masked.gather.v{WIDTH}{self.element.intrinsic_name}.v{WIDTH}p0",
        )
        none = ir.Constant(kind, ir.Undefined)
        return Lanes(b, b.call(function, [pointers, ir.Constant(I32, 4), every, none]))

    def load(self, index: Any) -> Lanes:
        kind = ir.VectorType(self.element, WIDTH)
        return Lanes(self.builder, self.builder.load(self._at(index), align=self.align, typ=kind))

    def store(self, index: Any, lanes: Lanes) -> None:
        self.builder.store(lanes.value, self._at(index), align=self.align)


def unpacked(builder: Any, values: Any) -> list[Any]:
    return [builder.extract_value(values, k) for k in range(len(values.type))]


def by_width(builder: Any, first: Any, after: Any) -> Any:
    """A loop over first, first + WIDTH, ... as a context that gives the index."""
    return cgutils.for_range_slice(builder, first, after, ir.Constant(I64, WIDTH), inc=True)


@contextmanager
def where_any(mask: Lanes) -> Iterator[None]:
    """What follows is done where any of the lanes is meant."""
    builder = mask.builder
    bits = builder.bitcast(mask.value, ir.IntType(WIDTH))
    with builder.if_then(builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))):
        yield
