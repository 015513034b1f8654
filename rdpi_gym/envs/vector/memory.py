"""Memory by its addresses: copies, cache lines that are fetched ahead, arrays whose references nobody counts."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

FLOAT32, FLOAT64, LINE = 4, 8, 64
"""Bytes of numbers, and of a cache line."""
_BYTES = ir.IntType(8).as_pointer()


# These take addresses: an array that is handed to an intrinsic has its references counted, atomically.
@intrinsic
def copy_bytes(typing: Any, to: Any, source: Any, count: Any) -> tuple[Any, Any]:
    """Copy so many bytes from one address to another."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        ends = [builder.inttoptr(address, _BYTES) for address in values[:2]]
        cgutils.raw_memcpy(builder, *ends, values[2], 1)
        return context.get_dummy_value()

    return types.none(types.intp, types.intp, types.intp), build


@intrinsic
def copy_float32(typing: Any, to: Any, source: Any) -> tuple[Any, Any]:
    """Copy one number from one address to another."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        one, other = (builder.inttoptr(each, ir.FloatType().as_pointer()) for each in values)
        builder.store(builder.load(other), one)
        return context.get_dummy_value()

    return types.none(types.intp, types.intp), build


@intrinsic
def fetch_line(typing: Any, address: Any) -> tuple[Any, Any]:
    """Fetch the cache line at an address that is needed soon; where there is no memory nothing happens."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        line = builder.inttoptr(values[0], _BYTES)
        kind = ir.FunctionType(ir.VoidType(), [_BYTES, *[ir.IntType(32)] * 3])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        builder.call(fetch, [line, *(ir.Constant(ir.IntType(32), n) for n in (1, 3, 1))])
        return context.get_dummy_value()

    return types.none(types.intp), build


@intrinsic
def uncounted(typing: Any, arrays: Any) -> tuple[Any, Any]:
    """Return the same tuple without a count of its arrays' references, for a call in which they stay alive.

    A block's step hands hundreds of arrays on; each count is two atomic instructions.
    """

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        found = []
        for kind, value in zip(arrays, cgutils.unpack_tuple(builder, values[0]), strict=True):
            if isinstance(kind, types.Array):
                array = context.make_array(kind)(context, builder, value)
                array.meminfo = cgutils.get_null_value(array.meminfo.type)
                value = array._getvalue()
            found.append(value)
        return context.make_tuple(builder, arrays, found)

    return arrays(arrays), build
