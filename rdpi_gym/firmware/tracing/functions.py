"""NumPy's functions on traced arrays: each writes the C of what NumPy would do, in NumPy's order."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rdpi_gym.firmware.program import Kind
from rdpi_gym.firmware.tracing.arrays import (
    Library,
    Operand,
    Recording,
    Store,
    Traced,
    assign,
    compute,
    copy_of,
    here,
    kind_of,
    read_by_loops,
    recording_of,
    shape_of,
)
from rdpi_gym.support.errors import InputError

_ANOTHER_ORDER = "sums of a matrix product or of np.sum are taken in another order by NumPy"
_OWN_FUNCTIONS = "NumPy has functions of its own for {}, off in the last digit"
_EXACT = {"SQRT", "FLOOR", "CEIL"}

# Text of an elementwise function by its operands, and the kind of its result.
_ELEMENTWISE: dict[np.ufunc, tuple[str, Kind]] = {
    np.add: ("{} + {}", "real"),
    np.subtract: ("{} - {}", "real"),
    np.multiply: ("{} * {}", "real"),
    np.divide: ("{} / {}", "real"),
    np.less: ("{} < {}", "bool"),
    np.less_equal: ("{} <= {}", "bool"),
    np.greater: ("{} > {}", "bool"),
    np.greater_equal: ("{} >= {}", "bool"),
    np.equal: ("{} == {}", "bool"),
    np.not_equal: ("{} != {}", "bool"),
    np.isnan: ("rdpi_is_nan({})", "bool"),
    np.isfinite: ("rdpi_abs({}) < RDPI_INFINITY", "bool"),
    np.absolute: ("rdpi_abs({})", "real"),
    np.fabs: ("rdpi_abs({})", "real"),
    np.negative: ("-{}", "real"),
    np.positive: ("{}", "real"),
    np.square: ("{0} * {0}", "real"),
    np.minimum: ("rdpi_min({}, {})", "real"),
    np.maximum: ("rdpi_max({}, {})", "real"),
    # NumPy's fmin and fmax take the other one where one is not a number
    np.fmin: ("rdpi_is_nan({0}) ? {1} : (rdpi_is_nan({1}) ? {0} : rdpi_min({0}, {1}))", "real"),
    np.fmax: ("rdpi_is_nan({0}) ? {1} : (rdpi_is_nan({1}) ? {0} : rdpi_max({0}, {1}))", "real"),
    np.copysign: ("rdpi_copysign({}, {})", "real"),
    np.sign: (
        "({0} > RDPI_C(0.0)) ? RDPI_C(1.0) : (({0} < RDPI_C(0.0)) ? RDPI_C(-1.0) : {0})",
        "real",
    ),
    **{
        getattr(np, name): (f"RDPI_{name.upper()}({{}})", "real")
        for name in (
            "sqrt", "floor", "ceil", "exp", "expm1", "log", "log1p", "sin", "cos", "tanh",
        )
    },
    np.arctanh: ("RDPI_C(0.5) * (RDPI_LOG1P({0}) - RDPI_LOG1P(-{0}))", "real"),
    np.arcsinh: (
        "rdpi_copysign(RDPI_LOG1P(rdpi_abs({0}) + {0} * {0} / "
        "(RDPI_C(1.0) + RDPI_SQRT(RDPI_C(1.0) + {0} * {0}))), {0})",
        "real",
    ),
}  # fmt: skip
_OF_FLAGS: dict[np.ufunc, str] = {
    **dict.fromkeys((np.logical_and, np.bitwise_and, np.multiply), "{} && {}"),
    **dict.fromkeys((np.logical_or, np.bitwise_or, np.add), "{} || {}"),
    **dict.fromkeys((np.logical_not, np.invert), "!{}"),
}
# Second operands that change nothing.
_NEUTRAL = {np.subtract: "RDPI_C(0.0)", np.multiply: "RDPI_C(1.0)"}
_POWERS: dict[float | None, str] = {1.0: "{0}", 2.0: "{0} * {0}", 0.5: "RDPI_SQRT({0})"}


def apply_ufunc(
    ufunc: np.ufunc, method: str, inputs: Sequence[Any], options: dict[str, Any]
) -> Traced:
    """Write an elementwise function of NumPy."""
    out = options.pop("out", None)
    where = options.pop("where", True)
    options.pop("dtype", None)
    options.pop("casting", None)
    target = out[0] if isinstance(out, tuple) else out
    if target is None and where is True:
        if method == "reduce" and ufunc is np.add:
            return _sum(*inputs, **{"axis": 0, **options})
        if method == "accumulate" and ufunc is np.add:
            return _cumsum(*inputs, **{"axis": 0, **options})
        if method == "outer" and ufunc is np.multiply:
            return _outer(*inputs)
    if method != "__call__" or options:
        raise InputError(f"{here()}: np.{ufunc.__name__}.{method} has no C")
    if target is not None and not isinstance(target, Traced):
        raise InputError(
            f"{here()} puts numbers that are known only as it runs into a NumPy array; make it with np.empty_like"
        )
    if ufunc is np.matmul:
        return _matmul(inputs[0], inputs[1], target)
    kind, expression, cast = _expression(ufunc, inputs, recording_of(*inputs, target))
    if where is True:
        return compute(kind, expression, *inputs, out=target, cast=cast)
    old = target if target is not None else np.zeros(())

    def guarded(test: str, before: str, *texts: str) -> str:
        return f"{test} ? ({expression(*texts)}) : {before}"

    # the flag stays a flag
    return _mixed(
        kind, guarded, (where, old, *inputs), (False, *[cast] * (1 + len(inputs))), target
    )


def _expression(
    ufunc: np.ufunc, inputs: Sequence[Any], recording: Recording
) -> tuple[Kind, Callable[..., str], bool]:
    """Return kind, text and whether flags become numbers first."""
    if ufunc in _OF_FLAGS and all(_kind(each) == "bool" for each in inputs):
        return "bool", _OF_FLAGS[ufunc].format, False
    if ufunc in (np.power, np.float_power):
        text = _POWERS.get(_only_number(inputs[1]), "RDPI_POW({}, {})")
        return "real", _calling(text, "powers", recording), True
    if ufunc not in _ELEMENTWISE:
        only = " of numbers has no C, only of truths" if ufunc in _OF_FLAGS else " has no C"
        raise InputError(f"{here()}: np.{ufunc.__name__}{only}")
    if ufunc is np.divide and _only_number(inputs[1]) is not None:
        return "real", "RDPI_OVER({}, {})".format, True
    text, kind = _ELEMENTWISE[ufunc]
    if ufunc in _NEUTRAL:
        return kind, lambda x, y: x if y == _NEUTRAL[ufunc] else text.format(x, y), True
    return kind, _calling(text, ufunc.__name__, recording), True


def _only_number(operand: Operand) -> float | None:
    """Return the number that all elements of a constant are."""
    array = None if isinstance(operand, Traced) else np.asarray(operand)
    return array.flat[0] if array is not None and (array == array.flat[0]).all() else None


def _calling(text: str, name: str, recording: Recording) -> Callable[..., str]:
    """Return an expression, whose functions of the mathematics are noted."""
    called = set(re.findall(r"RDPI_([A-Z0-9]+)\(", text)) - {"C"}
    recording.mathematics |= called
    if called - _EXACT:
        recording.is_inexact(_OWN_FUNCTIONS.format(name))
    return text.format


def _kind(operand: Operand) -> Kind:
    return operand.kind if isinstance(operand, Traced) else kind_of(np.asarray(operand).dtype)


def _mixed(
    kind: Kind,
    expression: Callable[..., str],
    operands: Sequence[Operand],
    casts: Sequence[bool],
    out: Traced | None = None,
) -> Traced:
    """Compute where some operands become numbers first, and some stay what they are."""
    made = [
        compute("real", lambda x: x, each)
        if cast and isinstance(each, Traced) and each.kind != "real"
        else (np.asarray(each, dtype=np.float64) if cast and not isinstance(each, Traced) else each)
        for each, cast in zip(operands, casts, strict=True)
    ]
    return compute(kind, expression, *made, out=out, cast=False)


def _where(condition: Operand, one: Operand, other: Operand) -> Traced:
    if not isinstance(condition, Traced):
        condition = np.asarray(condition, dtype=np.bool_)
    flags = _kind(one) == _kind(other) == "bool"
    return _mixed(
        "bool" if flags else "real",
        lambda test, x, y: f"{test} ? {x} : {y}",
        (condition, one, other),
        (False, not flags, not flags),
    )


def _clip(
    a: Operand,
    a_min: Operand | None = None,
    a_max: Operand | None = None,
    out: Traced | None = None,
    **named: Any,
) -> Traced:
    low, high = named.pop("min", a_min), named.pop("max", a_max)
    _refuse(named)
    if low is None or high is None:
        ufunc, bound = (np.minimum, high) if low is None else (np.maximum, low)
        return apply_ufunc(ufunc, "__call__", (a, bound), {"out": out})
    return compute(
        "real", lambda x, y, z: f"rdpi_min(rdpi_max({x}, {y}), {z})", a, low, high, out=out
    )


def _refuse(options: Mapping[str, Any]) -> None:
    if options:
        raise InputError(f"{here()}: there is no C with {', '.join(options)} in this call")


def _matmul(a: Operand, b: Operand, out: Traced | None = None) -> Traced:
    recording = recording_of(a, b)
    left, right = (x if isinstance(x, Traced) else np.asarray(x, dtype=np.float64) for x in (a, b))
    shape = (*left.shape[:-1], *right.shape[1:])
    rows = left.reshape(1, -1) if left.ndim == 1 else left
    columns = right.reshape(-1, 1) if right.ndim == 1 else right
    if rows.ndim != 2 or columns.ndim != 2:
        raise InputError(f"{here()}: a product of stacks of matrices has no C")
    if rows.shape[1] > 1:
        recording.is_inexact(_ANOTHER_ORDER)
    found = _products(recording, rows, columns).reshape(shape)
    if out is None:
        return found
    assign(out, found)
    return out


def _products(recording: Recording, rows: Any, columns: Any | None) -> Traced:
    """Write a product of two matrices, or without the second sums over rows: terms in their order."""
    height, width = len(rows), 1 if columns is None else columns.shape[1]
    if rows.shape[1] == 0:
        nothing = recording.array((height, width))
        assign(nothing, 0.0)
        return nothing
    if height == width == 1:
        out = Traced(Store(recording, recording.fresh(), 1), np.zeros((1, 1), dtype=np.int64))
    else:
        out = recording.array((height, width))
    if not _write_products(out, rows, columns):
        rows, columns = (copy_of(x) if isinstance(x, Traced) else x for x in (rows, columns))
        _write_products(out, rows, columns)
    return out


def _write_products(out: Traced, rows: Any, columns: Any | None) -> bool:
    """Write ``out[i, j] = Σ_k rows[i, k] columns[k, j]``; false where no loop reads them in order."""
    recording = out.recording
    (height, inner), width = rows.shape, out.shape[1]
    operands = [(out, (height, width, 1)), (rows, (height, 1, inner))]
    if columns is not None:
        operands.append((columns.T, (1, width, inner)))
    read = read_by_loops(recording, operands)
    if read is None:
        return False
    target, *factors = read
    total = target if out.size == 1 else recording.fresh()
    lines = [
        f"rdpi_real {total} = RDPI_C(0.0);",
        f"for (int32_t k = 0; k < {inner}; ++k) {{",
        f"    {total} += {' * '.join(factors)};",
        "}",
    ]
    if total != target:
        lines.append(f"{target} = {total};")
    for index, count in (("j", width), ("i", height)):
        if count > 1:
            inside = [f"    {line}" for line in lines]
            lines = [f"for (int32_t {index} = 0; {index} < {count}; ++{index}) {{", *inside, "}"]
    declares = total if out.size == 1 else ""
    recording.tape.write("\n".join(lines), declares, out.store.names)
    return True


def _einsum(subscripts: str, *operands: Any, **options: Any) -> Traced:
    _refuse(options)
    if subscripts.replace(" ", "") != "fb,fb->b" or len(operands) != 2:
        raise InputError(f"{here()}: np.einsum of {subscripts!r} has no C; only of 'fb,fb->b'")
    one, other = operands
    if shape_of(one)[1] != 1:
        raise InputError(f"{here()}: np.einsum over several lanes has no C")
    recording = recording_of(one, other)
    recording.is_inexact(_ANOTHER_ORDER)
    return _products(recording, one.T, other).reshape(1)


def _axis(array: Any, axis: int | None) -> tuple[Any, int]:
    if axis is None:
        return array.reshape(-1), 0
    return array, axis % array.ndim


def _kept(found: Traced, a: Traced, axis: int | None, keepdims: bool) -> Traced:
    """Return what was reduced along an axis, with that axis of one where it is to be kept."""
    if not keepdims:
        return found
    ends = range(a.ndim) if axis is None else (axis % a.ndim,)
    return found.reshape(tuple(1 if i in ends else n for i, n in enumerate(a.shape)))


def _sum(
    a: Traced, axis: int | None = None, dtype: Any = None, keepdims: bool = False, **options: Any
) -> Traced:
    _refuse(options)
    given = axis
    array, axis = _axis(a, axis)
    count = array.shape[axis]
    if axis == array.ndim - 1 and count > 1:
        a.recording.is_inexact(_ANOTHER_ORDER)
    rows = array.transpose(*[i for i in range(array.ndim) if i != axis], axis)
    shape = rows.shape[:-1]
    found = _products(a.recording, _real(rows).reshape(-1, count), None).reshape(shape)
    return _kept(found, a, given, keepdims)


def _mean(a: Traced, axis: int | None = None, keepdims: bool = False, **options: Any) -> Traced:
    count = a.size if axis is None else a.shape[axis]
    found: Traced = _sum(a, axis, keepdims=keepdims, **options) / float(count)
    return found


def _real(array: Traced) -> Traced:
    return array if array.kind == "real" else compute("real", lambda x: x, array)


def _moved_first(array: Traced, axis: int) -> Traced:
    return array.view(np.moveaxis(array.places, axis, 0))


def _cumsum(a: Traced, axis: int | None = None, dtype: Any = None, **options: Any) -> Traced:
    _refuse(options)
    array, axis = _axis(a, axis)
    found = copy_of(_real(array))
    along = _moved_first(found, axis)
    for i in range(1, len(along)):
        assign(along[i : i + 1], along[i - 1 : i] + along[i : i + 1])
    return found


def _diff(
    a: Operand, n: int = 1, axis: int = -1, prepend: Any = None, append: Any = None
) -> Traced:
    ends = []
    for end in (prepend, append):
        if end is not None and np.ndim(end) == 0 and not isinstance(end, Traced):
            shape = list(shape_of(a))
            shape[axis] = 1
            end = np.broadcast_to(end, shape)
        ends.append([] if end is None else [end])
    parts = [*ends[0], a, *ends[1]]
    found: Any = a if len(parts) == 1 else _concatenate(parts, axis=axis)
    for _ in range(n):
        along = _moved_first(found, axis)
        less = along[1:] - along[:-1]
        found = less.view(np.moveaxis(less.places, 0, axis))
    return found  # type: ignore[no-any-return]


def _concatenate(arrays: Sequence[Any], axis: int | None = 0, **options: Any) -> Traced:
    _refuse(options)
    parts = [_array(each) for each in arrays]
    if axis is None:
        parts, axis = [part.reshape(-1) for part in parts], 0
    kinds = {_kind(part) for part in parts}
    kind: Kind = kinds.pop() if len(kinds) == 1 else "real"
    shape = list(parts[0].shape)
    axis = axis % len(shape)
    shape[axis] = sum(part.shape[axis] for part in parts)
    out = recording_of(*parts).array(shape, kind)
    first = 0
    for part in parts:
        key = [slice(None)] * len(shape)
        key[axis] = slice(first, first + part.shape[axis])
        assign(out[tuple(key)], part)
        first += part.shape[axis]
    return out


def _array(operand: Any) -> Any:
    return operand if isinstance(operand, Traced) else np.asarray(operand)


def _stack(arrays: Sequence[Any], axis: int = 0, **options: Any) -> Traced:
    parts = [np.expand_dims(_array(each), axis) for each in arrays]
    return _concatenate(parts, axis=axis, **options)


def _vstack(arrays: Sequence[Any], **options: Any) -> Traced:
    return _concatenate([np.atleast_2d(each) for each in arrays], **options)


def _hstack(arrays: Sequence[Any], **options: Any) -> Traced:
    parts = [np.atleast_1d(each) for each in arrays]
    return _concatenate(parts, axis=0 if parts[0].ndim == 1 else 1, **options)


def _outer(a: Operand, b: Operand, out: Traced | None = None) -> Traced:
    column, row = _array(a).reshape(-1, 1), _array(b).reshape(1, -1)
    return compute("real", "{} * {}".format, column, row, out=out)


def _viewed(function: Callable[..., Any]) -> Callable[..., Traced]:
    """Return what NumPy itself does on the places of the elements."""
    return lambda a, *given, **options: a.view(function(a.places, *given, **options))


def _viewed_by(method: str) -> Callable[..., Traced]:
    return lambda a, *given: a.view(getattr(a.places, method)(*given))


def _picked(function: Callable[..., Any]) -> Callable[..., Traced]:
    """Return a copy of what NumPy itself does on the places of the elements."""
    return lambda a, *given, **options: copy_of(a.view(function(a.places, *given, **options)))


def _split(ary: Traced, indices_or_sections: Any, axis: int = 0) -> list[Traced]:
    return [ary.view(each) for each in np.split(ary.places, indices_or_sections, axis=axis)]


def _like(a: Operand, value: float | None, dtype: Any = None, shape: Any = None) -> Traced:
    kind = _kind(a) if dtype is None else kind_of(dtype)
    found = recording_of(a).array(shape_of(a) if shape is None else shape, kind)
    if value is not None:
        assign(found, value)
    return found


def _folded(one: str, of_flags: bool) -> Callable[..., Traced]:
    """Return what reduces flags or numbers by a text from two."""

    def reduce(
        a: Traced, axis: int | None = None, keepdims: bool = False, **options: Any
    ) -> Traced:
        _refuse(options)
        return _kept(folded(*_axis(a, axis)), a, axis, keepdims)

    def folded(array: Traced, axis: int) -> Traced:
        if of_flags and array.kind != "bool":
            array = compute("bool", lambda x: f"{x} != RDPI_C(0.0)", array)
        along = _moved_first(array, axis)
        if len(along) == 0:
            raise InputError(f"{here()} reduces an array of no elements")
        if len(along) == 1:
            return along[0] if along.ndim > 1 else along.reshape(())
        if along.size == len(along) and len(along) > 3:
            return _reduced(along.reshape(-1), one).reshape(along.shape[1:])
        found = copy_of(along[0:1])
        for i in range(1, len(along)):
            compute(array.kind, one.format, found, along[i : i + 1], out=found, cast=False)
        return found.reshape(along.shape[1:])

    return reduce


def _reduced(array: Traced, one: str) -> Traced:
    """Write a loop that reduces an array to a number."""
    recording, kind = array.recording, array.kind
    texts = read_by_loops(recording, [(array[1:], (1, 1, len(array) - 1))], cast=False)
    if texts is None:
        return _reduced(copy_of(array), one)
    found = copy_of(array[:1])
    (name,) = found.store.names
    lines = [
        f"for (int32_t k = 0; k < {len(array) - 1}; ++k) {{",
        f"    {name} = {one.format(name, texts[0])};",
        "}",
    ]
    recording.tape.write("\n".join(lines), writes=[name])
    return Traced(Store(recording, name, 1, kind), np.zeros((), dtype=np.int64))


_any, _all = _folded("{} || {}", True), _folded("{} && {}", True)
_max, _min = _folded("rdpi_max({}, {})", False), _folded("rdpi_min({}, {})", False)


def _flatnonzero(a: Traced) -> Any:
    if a.size != 1:
        raise InputError(f"{here()} looks up where of several something holds, as it runs")
    return np.arange(1 if bool(a) else 0)


def _nan_to_num(x: Traced, nan: float = 0.0, **_: Any) -> Traced:
    return _where(np.isnan(x), nan, x)


FUNCTIONS: dict[Callable[..., Any], Callable[..., Any]] = {
    np.where: _where,
    np.clip: _clip,
    np.sum: _sum,
    np.mean: _mean,
    np.cumsum: _cumsum,
    np.diff: _diff,
    np.einsum: _einsum,
    np.dot: _matmul,
    np.outer: _outer,
    np.concatenate: _concatenate,
    np.stack: _stack,
    np.vstack: _vstack,
    np.hstack: _hstack,
    np.split: _split,
    np.tile: _picked(np.tile),
    np.repeat: _picked(np.repeat),
    np.any: _any,
    np.all: _all,
    np.max: _max,
    np.min: _min,
    np.amax: _max,
    np.amin: _min,
    np.flatnonzero: _flatnonzero,
    np.copy: lambda a, **_: copy_of(a),
    np.nan_to_num: _nan_to_num,
    np.empty_like: lambda a, dtype=None, shape=None, **_: _like(a, None, dtype, shape),
    np.zeros_like: lambda a, dtype=None, shape=None, **_: _like(a, 0, dtype, shape),
    np.ones_like: lambda a, dtype=None, shape=None, **_: _like(a, 1, dtype, shape),
    np.full_like: lambda a, value, dtype=None, shape=None, **_: _like(a, value, dtype, shape),
    **{
        function: _viewed(function)
        for function in (
            np.atleast_1d, np.atleast_2d, np.broadcast_to, np.expand_dims, np.flip, np.moveaxis,
            np.ravel, np.reshape, np.squeeze, np.transpose,
        )
    },
    np.shape: lambda a: a.shape,
    np.ndim: lambda a: a.ndim,
    np.size: lambda a, axis=None: a.size if axis is None else a.shape[axis],
}  # fmt: skip
METHODS: dict[str, Callable[..., Any]] = {
    "fill": assign,
    **{
        name: FUNCTIONS[getattr(np, name)]
        for name in ("sum", "cumsum", "mean", "any", "all", "max", "min", "clip", "copy", "repeat", "dot")
    },
    **{name: _viewed_by(name) for name in ("ravel", "reshape", "squeeze", "transpose")},
}  # fmt: skip
NUMPY = Library(FUNCTIONS, METHODS, apply_ufunc)
"""NumPy's functions for :class:`~rdpi_gym.firmware.tracing.arrays.Recording`."""


class TracedTensor:
    """A tensor whose numbers are known only as the code runs; PyTorch's modules run on it."""

    def __init__(self, array: Traced) -> None:
        self.array = array

    def numpy(self) -> Traced:
        """Return its numbers."""
        return self.array

    @classmethod
    def __torch_function__(
        cls,
        function: Callable[..., Any],
        types: Any,
        given: tuple[Any, ...] = (),
        options: Mapping[str, Any] | None = None,
    ) -> TracedTensor:
        known = _TORCH.get(function.__name__)
        if known is None:
            raise InputError(f"{here()}: torch.{function.__name__} has no C")
        return cls(known(*(x.array if isinstance(x, cls) else x for x in given), **(options or {})))


def _linear(x: Traced, weight: Any, bias: Any = None) -> Traced:
    found: Traced = x @ weight.detach().numpy().astype(np.float64).T
    return found if bias is None else found + bias.detach().numpy().astype(np.float64)


def _elu(x: Traced, alpha: float = 1.0, **_: Any) -> Traced:
    x.recording.mathematics.add("EXPM1")
    text = "({0} > RDPI_C(0.0)) ? {0} : ({1} * RDPI_EXPM1({0}))"
    return compute("real", text.format, x, alpha)


# By their names: torch itself is imported only where a policy is.
_TORCH: dict[str, Callable[..., Traced]] = {
    "linear": _linear,
    "tanh": lambda x: np.tanh(x),
    "relu": lambda x, **_: np.maximum(x, 0.0),
    "elu": _elu,
    "silu": lambda x, **_: x / (1.0 + np.exp(-x)),
    "hardtanh": lambda x, min_val=-1.0, max_val=1.0, **_: _clip(x, min_val, max_val),
}
