"""Arrays that write down as C what NumPy code does with them: a controller is exported from its own code.

Code that is vectorised over lanes runs once, with one lane, on :class:`Traced` arrays. What it would
compute is written on a :class:`~rdpi_gym.firmware.tracing.tape.Tape`, elementwise operations as loops, in
NumPy's order, so that numbers of double precision come out equal bit by bit. Where the code decides
by a truth, it is run again for the other answer. A view is a view: indexing, transposing and
reshaping are done by NumPy itself, on the places of the elements.
"""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.firmware.program import (
    C_KEYWORDS,
    C_TYPES,
    Block,
    Kind,
    Known,
    Number,
    Table,
    Value,
    literal,
    words,
)
from rdpi_gym.firmware.tracing.naming import wish
from rdpi_gym.firmware.tracing.tape import Tape, placed
from rdpi_gym.support.errors import InputError

Places: TypeAlias = NDArray[np.int64]
Operand: TypeAlias = "Traced | NDArray[Any] | float | int | bool"

_TYPES: dict[Kind, np.dtype[Any]] = {
    "real": np.dtype(np.float64),
    "int": np.dtype(np.int64),
    "bool": np.dtype(np.bool_),
}
# Words that cannot name a field of a struct, in C or where C++ reads the header.
_WORDS = C_KEYWORDS | words(
    "and bool catch class delete explicit export false friend mutable namespace new not operator or private "
    "protected public template this throw true try typename using virtual xor"
)
_INDICES = "ijk"
# Elements that are written one by one where no loop finds them.
_MOST_SINGLE = 64


class Library(NamedTuple):
    """NumPy's functions for traced arrays, by function and by the name of a method, and elementwise ones."""

    functions: Mapping[Callable[..., Any], Callable[..., Any]]
    methods: Mapping[str, Callable[..., Any]]
    ufunc: Callable[[np.ufunc, str, Sequence[Any], dict[str, Any]], Traced]


class Tables:
    """Constant arrays of the generated code, each once.

    Examples
    --------
    >>> tables = Tables([("_rest_V", np.array([1.0, 2.0]))])
    >>> tables.named(np.array([[1.0], [2.0]])), tables.named(np.array([3.0]))
    ('rest_v', 'table_1')
    >>> [table.values.tolist() for table in tables.all]
    [[1.0, 2.0], [3.0]]
    """

    def __init__(self, names: Sequence[tuple[str, NDArray[Any]]] = ()) -> None:
        self._wanted: dict[bytes, str] = {}
        for name, array in names:
            self._wanted.setdefault(_content(array), name)
        self._found: dict[bytes, Table] = {}

    @property
    def all(self) -> list[Table]:
        """The tables in the order of their first use."""
        return list(self._found.values())

    def named(self, array: NDArray[Any]) -> str:
        """Return the name of the table of an array's numbers, row by row."""
        content = _content(array)
        if content not in self._found:
            name = _identifier(self._wanted.get(content, ""))
            taken = {table.name for table in self._found.values()}
            if not name:
                name = f"table_{len(self._found)}"
            while name in taken:
                name += f"_{len(self._found)}"
            values = np.ascontiguousarray(array, dtype=np.float64).ravel()
            self._found[content] = Table(name, values.copy())
        return self._found[content].name


def _content(array: NDArray[Any]) -> bytes:
    return np.ascontiguousarray(array, dtype=np.float64).tobytes()


def _identifier(name: str) -> str:
    plain = re.sub(r"\W", "_", name.strip("_").lower(), flags=re.ASCII)
    return plain if re.fullmatch(r"[a-z]\w*", plain) and plain not in _WORDS else ""


class Recording:
    """The tape and the tables of one run of a trace, and reasons for which it is not exact."""

    def __init__(self, tape: Tape, tables: Tables, library: Library) -> None:
        self.tape, self.tables, self.library = tape, tables, library
        self.mathematics: set[str] = set()
        self.inexact: dict[str, None] = {}
        self._wished: str | None = None

    def fresh(self) -> str:
        """Return the name of a new variable, which says what it is for."""
        return self.tape.fresh(wish() if self._wished is None else self._wished)

    @contextmanager
    def wishing(self, name: str) -> Iterator[None]:
        """Call new variables so for a while."""
        before, self._wished = self._wished, name
        try:
            yield
        finally:
            self._wished = before

    def local(self, kind: Kind, size: int) -> str:
        """Declare a variable of so many elements, and return its name."""
        name = self.fresh()
        if size == 1:
            zero = "RDPI_C(0.0)" if kind == "real" else "0"
            self.tape.write(f"{C_TYPES[kind]} {name} = {zero};", declares=name)
        else:
            self.tape.write(f"{C_TYPES[kind]} {name}[{max(size, 1)}];", declares=name)
        return name

    def array(self, shape: Sequence[int], kind: Kind = "real") -> Traced:
        """Return a new array, not filled."""
        size = int(np.prod(shape, dtype=int))
        return Traced(Store(self, self.local(kind, size), size, kind), _counted(shape))

    def scalar(
        self,
        kind: Kind,
        text: str,
        shape: Sequence[int] = (),
        writes: Sequence[str] = (),
        keeps: bool = False,
    ) -> Traced:
        """Return a new number of one expression, in a shape of one element."""
        name = self.fresh()
        self.tape.write(f"{C_TYPES[kind]} {name} = {text};", name, (name, *writes), keeps)
        return Traced(Store(self, name, 1, kind), np.zeros(shape, dtype=np.int64))

    def is_inexact(self, why: str) -> None:
        """Note a reason for which numbers may differ from Python's in their last digits."""
        self.inexact[why] = None


class Store:
    """Numbers in C that arrays are views of: a local variable, or else a field of the memory."""

    writable: ClassVar[bool] = True

    def __init__(
        self, recording: Recording, text: str, size: int, kind: Kind = "real", local: bool = True
    ) -> None:
        self.recording, self.text, self.size, self.kind = recording, text, size, kind
        self.names: tuple[str, ...] = (text,) if local else ()

    def element(self, place: int) -> str:
        """Return the text of one element."""
        return self.text if self.names and self.size == 1 else f"{self.text}[{place}]"

    def indexed(self, first: int, last: int, index: Callable[[int], str]) -> str | None:
        """Return the text of an element by an index that runs between two places.

        `index` writes the index from the place where the array that is indexed begins. None: these
        places are not one array.
        """
        return f"{self.text}[{index(0)}]"

    def pointer(self, place: int) -> str:
        """Return the text of a pointer to an element."""
        element = self.element(place)
        return self.text if not place and element != self.text else f"&{element}"


class Inputs(Store):
    """The inputs of a step: names of scalars (None) and arrays with their numbers of elements."""

    writable = False

    def __init__(self, recording: Recording, parts: Sequence[tuple[str, int | None]]) -> None:
        self._texts: list[str] = []
        self._arrays: list[tuple[str, int, int]] = []
        for name, count in parts:
            first = len(self._texts)
            if count is None:
                self._texts.append(name)
            else:
                self._texts += [f"{name}[{i}]" for i in range(count)]
                self._arrays.append((name, first, first + count))
        super().__init__(recording, "", len(self._texts), local=False)

    def element(self, place: int) -> str:
        """See :meth:`Store.element`."""
        return self._texts[place]

    def indexed(self, first: int, last: int, index: Callable[[int], str]) -> str | None:
        """See :meth:`Store.indexed`."""
        for name, begins, ends in self._arrays:
            if begins <= first and last < ends:
                return f"{name}[{index(begins)}]"
        return None


class Traced(np.lib.mixins.NDArrayOperatorsMixin):
    r"""An array whose numbers are known only as the code runs; a view of a :class:`Store`.

    Examples
    --------
    >>> from rdpi_gym.firmware.tracing.statements import lines
    >>> from rdpi_gym.firmware.tracing.tape import Tape, recorded
    >>> from rdpi_gym.firmware.tracing.functions import NUMPY
    >>> def run(tape):
    ...     recording = Recording(tape, Tables(), NUMPY)
    ...     state = Store(recording, "m->state", 3, local=False)
    ...     memory = Traced(state, np.arange(3)[:, None])
    ...     memory[1:] += 2.0 * np.abs(memory[0])
    >>> print("\n".join(lines(recorded(run))))
    rdpi_real value = RDPI_C(2.0) * rdpi_abs(m->state[0]);
    for (int32_t i = 0; i < 2; ++i) {
        m->state[1 + i] = m->state[1 + i] + value;
    }
    """

    # from the table of NumPy's functions
    ravel: Callable[..., Traced]
    reshape: Callable[..., Traced]
    transpose: Callable[..., Traced]

    def __init__(self, store: Store, places: Places) -> None:
        self.store, self.places = store, places
        self.recording, self.kind = store.recording, store.kind
        self.shape, self.ndim, self.size = places.shape, places.ndim, places.size

    @property
    def dtype(self) -> np.dtype[Any]:
        """As of an array; real numbers are of double precision whatever the C makes of them."""
        return _TYPES[self.kind]

    @property
    def T(self) -> Traced:
        """As of an array."""
        return self.view(self.places.T)

    def view(self, places: Places) -> Traced:
        """Return other elements of the same store."""
        return Traced(self.store, places)

    def __len__(self) -> int:
        return len(self.places)

    def __iter__(self) -> Iterator[Traced]:
        return (self[i] for i in range(len(self)))

    def __bool__(self) -> bool:
        if self.size != 1:
            raise InputError(f"{here()} asks whether an array of {self.size} numbers is true")
        place = int(self.places.flat[0])
        text = self.store.element(place)
        return self.recording.tape.decide(text if self.kind == "bool" else f"({text} != 0)")

    def __float__(self) -> float:
        raise InputError(f"{here()} makes a Python number of one that is known only as it runs")

    __int__ = __index__ = __complex__ = __float__

    def __array__(self, *_: Any, **__: Any) -> NDArray[Any]:
        raise InputError(f"{here()} puts numbers that are known only as it runs into a NumPy array")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        return self.recording.library.ufunc(ufunc, method, inputs, options)

    def __array_function__(
        self, function: Callable[..., Any], types: Any, given: Any, options: Mapping[str, Any]
    ) -> Any:
        known = self.recording.library.functions.get(function)
        if known is None:
            raise InputError(f"{here()}: np.{function.__name__} has no C")
        return known(*given, **options)

    def __getattr__(self, name: str) -> Any:
        known = self.recording.library.methods.get(name)
        if known is None:
            raise AttributeError(name)
        return lambda *given, **options: known(self, *given, **options)

    def __getitem__(self, key: Any) -> Traced:
        key, copies = self._resolved(key)
        found = self.view(np.asarray(self.places[key]))
        # NumPy hands out numbers, and what a list of places picks, as copies
        copies |= found.ndim == 0 and not _has_ellipsis(key)
        return copy_of(found) if copies and self.store.writable else found

    def __setitem__(self, key: Any, value: Operand) -> None:
        assign(self.view(np.asarray(self.places[self._resolved(key)[0]])), value)

    def _resolved(self, key: Any) -> tuple[Any, bool]:
        parts = list(key) if isinstance(key, tuple) else [key]
        picks = False
        for i, part in enumerate(parts):
            if isinstance(part, Traced):
                if part.kind != "bool" or part.size != 1:
                    raise InputError(
                        f"{here()} looks up an element by a number that is known only as it runs"
                    )
                parts[i] = slice(None) if bool(part) else slice(0, 0)
                picks = True
            elif isinstance(part, (list, np.ndarray)) and np.ndim(part):
                picks = True
        return (tuple(parts) if isinstance(key, tuple) else parts[0]), picks

    def astype(self, dtype: Any, **_: Any) -> Traced:
        """As of an array; single precision is not rounded to."""
        kind = kind_of(dtype)
        if np.dtype(dtype) == np.float32:
            self.recording.is_inexact("numbers that are float32 in Python are not rounded to it")
        if kind == self.kind:
            return copy_of(self)
        if kind != "real":
            raise InputError(f"{here()} rounds a number that is known only as it runs")
        return compute("real", lambda x: x, self)

    @property
    def is_dense(self) -> bool:
        """Whether its elements are contiguous in their order, in a store that can be pointed at."""
        dense = _counted((self.size,)) + self._first
        return self.store.writable and np.array_equal(self.places.ravel(), dense)

    def value(self) -> Value:
        """Return what stands for it in a call of a function of C: a number, or a block; it is dense."""
        if self.ndim == 0:
            return Number(self.store.element(int(self.places)), self.kind)
        return Block(self.store.pointer(self._first), self.shape, self.kind)

    @property
    def _first(self) -> int:
        return int(self.places.flat[0]) if self.size else 0


def kind_of(dtype: Any) -> Kind:
    """Return the kind of C that numbers of a type are."""
    code = np.dtype(dtype).kind
    return "bool" if code == "b" else "int" if code in "iu" else "real"


def copy_of(array: Traced) -> Traced:
    """Return a copy."""
    return compute(array.kind, lambda x: x, array, cast=False)


def recording_of(*operands: Any) -> Recording:
    """Return the recording that operands belong to."""
    return next(each.recording for each in operands if isinstance(each, Traced))


def shape_of(operand: Operand) -> tuple[int, ...]:
    """Return the shape of a traced or any other array."""
    return operand.shape if isinstance(operand, Traced) else np.shape(operand)


def compute(
    kind: Kind,
    expression: Callable[..., str],
    *operands: Operand,
    out: Traced | None = None,
    cast: bool = True,
) -> Traced:
    """Write an elementwise operation."""
    recording = recording_of(*operands, out)
    shape = np.broadcast_shapes(*(shape_of(each) for each in operands))
    if out is None:
        if int(np.prod(shape, dtype=int)) == 1:
            texts = [_element(_read(each, recording, cast), 0, cast) for each in operands]
            return recording.scalar(kind, expression(*texts), shape)
        out = recording.array(shape, kind)
    elif out.kind != kind and not (out.kind == "real" and cast):
        raise InputError(f"{here()} puts numbers of one kind into an array of another")
    elif _overlaps(out, operands):
        out_again = compute(kind, expression, *operands, cast=cast)
        compute(kind, lambda x: x, out_again, out=out, cast=False)
        return out
    _loop(out, expression, operands, cast)
    return out


def assign(target: Traced, value: Operand) -> None:
    """Write ``target[...] = value``."""
    if not isinstance(value, Traced):
        value = np.asarray(value, dtype=np.bool_ if target.kind == "bool" else None)
    if value.ndim > target.ndim:  # leading axes of one
        value = value.reshape(value.shape[value.ndim - target.ndim :])
    is_itself = (
        isinstance(value, Traced)
        and value.store is target.store
        and np.array_equal(value.places, target.places)
    )
    if target.size and not is_itself:
        compute(target.kind, lambda x: x, value, out=target, cast=target.kind == "real")


def _overlaps(out: Traced, operands: Sequence[Operand]) -> bool:
    """Whether an operand has elements of the target's at other indices."""
    for each in operands:
        if isinstance(each, Traced) and each.store is out.store:
            places = np.broadcast_to(each.places, out.shape)
            if not np.array_equal(places, out.places) and np.isin(places, out.places).any():
                return True
    return False


def _counted(shape: Sequence[int]) -> Places:
    return np.arange(int(np.prod(shape, dtype=int)), dtype=np.int64).reshape(shape)


def _has_ellipsis(key: Any) -> bool:
    return any(part is Ellipsis for part in (key if isinstance(key, tuple) else (key,)))


def _cast(text: str, kind: Kind, cast: bool) -> str:
    return f"(rdpi_real){text}" if cast and kind != "real" else text


def constant(value: Any) -> str:
    """Return a constant number as C reads it; a flag as 1 or 0."""
    number = np.asarray(value).item()
    if isinstance(number, bool):
        return str(int(number))
    return literal(float(number))


def _read(operand: Operand, recording: Recording, cast: bool) -> Traced:
    """Return an operand as an array; flags and counts become numbers where they are cast."""
    if isinstance(operand, Traced):
        return operand
    array = np.asarray(operand)
    if array.size == 1 or (array == array.flat[0]).all():
        number = array.ravel()[0].item()
        text = constant(float(number) if cast else number)
        return Traced(Store(recording, text, 1), np.zeros(array.shape, dtype=np.int64))
    store = Store(recording, f"p->{recording.tables.named(array)}", array.size, local=False)
    return Traced(store, _counted(array.shape))


def _loop(
    out: Traced, expression: Callable[..., str], operands: Sequence[Operand], cast: bool
) -> None:
    if out.size == 0:
        return
    if not out.store.writable:
        raise InputError(f"{here()} writes into its inputs")
    recording, tape = out.recording, out.recording.tape
    writes, keeps = out.store.names, not out.store.names
    reads = [_read(each, recording, cast) for each in operands]
    reads = [each.view(np.broadcast_to(each.places, out.shape)) for each in reads]
    written = _written_loop(out, reads, expression, cast) if out.size > 1 else None
    if written is None and out.size > _MOST_SINGLE:
        raise InputError(f"{here()} picks {out.size} elements in an order that no loop of C has")
    if written is not None:
        tape.write(written, writes=writes, keeps=keeps)
        return
    for one in range(out.size):
        texts = [_element(each, one, cast) for each in reads]
        tape.write(f"{_element(out, one, False)} = {expression(*texts)};", "", writes, keeps)


def _element(array: Traced, one: int, cast: bool) -> str:
    return _cast(array.store.element(int(array.places.flat[one])), array.kind, cast)


def read_by_loops(
    recording: Recording,
    operands: Sequence[tuple[Operand, Sequence[int]]],
    cast: bool = True,
) -> list[str] | None:
    """Return the text of an element of each operand by the indices i, j, k of loops over three axes."""
    texts = []
    for operand, shape in operands:
        read = _read(operand, recording, cast).reshape(shape)
        steps = _steps(read.places, range(3))
        text = None if steps is None else _stepped(read, steps, cast)
        if text is None:
            return None
        texts.append(text)
    return texts


def _stepped(read: Traced, steps: Sequence[int], cast: bool) -> str | None:
    """Return the text of an element by the indices of loops over axes."""
    places = read.places
    if not any(steps):
        return _element(read, 0, cast)
    index = _index_writer(int(places.flat[0]), tuple(steps))
    text = read.store.indexed(int(places.min()), int(places.max()), index)
    return None if text is None else _cast(text, read.kind, cast)


def _written_loop(
    out: Traced, reads: Sequence[Traced], expression: Callable[..., str], cast: bool
) -> str | None:
    """Return the loops over all axes; None where an operand's places are no steps along them."""
    everything = _split((out, *reads))
    shape = everything[0].shape
    axes = [axis for axis, n in enumerate(shape) if n > 1]
    steps = [_steps(each.places, axes) for each in everything]
    if any(step is None for step in steps):
        return None
    counts, strides = _collapsed([shape[axis] for axis in axes], [step or () for step in steps])
    if len(counts) > len(_INDICES):
        return None
    texts = []
    for k, (each, stride) in enumerate(zip(everything, strides, strict=True)):
        text = _stepped(each, stride, cast and k > 0)
        if text is None:
            return None
        texts.append(text)
    lines = [f"{texts[0]} = {expression(*texts[1:])};"]
    for index, count in reversed(list(zip(_INDICES, counts, strict=False))):
        inner = [f"    {line}" for line in lines]
        lines = [f"for (int32_t {index} = 0; {index} < {count}; ++{index}) {{", *inner, "}"]
    return "\n".join(lines)


def _split(everything: tuple[Traced, ...]) -> tuple[Traced, ...]:
    """Return operands along one axis along two, where that makes even steps of an uneven one."""
    count = everything[0].size
    flat = [each.ravel() for each in everything]
    if all(_steps(each.places, [0]) is not None for each in flat):
        return everything
    for inner in range(count // 2, 1, -1):
        if count % inner == 0:
            two = tuple(each.reshape(-1, inner) for each in flat)
            if all(_steps(each.places, [0, 1]) is not None for each in two):
                return two
    return everything


def _index_writer(first: int, stride: tuple[int, ...]) -> Callable[[int], str]:
    def index(begins: int) -> str:
        terms = [
            ("- " if step < 0 else "+ ") + (name if abs(step) == 1 else f"{abs(step)} * {name}")
            for name, step in zip(_INDICES, stride, strict=False)
            if step
        ]
        if first - begins:
            return " ".join([str(first - begins), *terms])
        return " ".join(terms).removeprefix("+ ")

    return index


def _steps(places: Places, axes: Sequence[int]) -> tuple[int, ...] | None:
    """Return by how many places each axis moves on; None where it does not do so evenly."""
    origin = (0,) * places.ndim
    first = int(places[origin])
    steps = []
    even = np.full(places.shape, first)
    for axis in axes:
        at = tuple(int(other == axis) for other in range(places.ndim))
        step = int(places[at]) - first if places.shape[axis] > 1 else 0
        shape = [1] * places.ndim
        shape[axis] = -1
        even = even + step * np.arange(places.shape[axis]).reshape(shape)
        steps.append(step)
    return tuple(steps) if np.array_equal(even, places) else None


def _collapsed(
    counts: list[int], strides: list[tuple[int, ...]]
) -> tuple[list[int], list[list[int]]]:
    """Join neighbouring axes that every operand runs through in one go."""
    found: list[int] = []
    columns: list[list[int]] = []
    for axis, count in enumerate(counts):
        column = [stride[axis] for stride in strides]
        if found and all(b == a * count for a, b in zip(column, columns[-1], strict=True)):
            found[-1] *= count
            columns[-1] = column
        else:
            found.append(count)
            columns.append(column)
    return found, [[column[i] for column in columns] for i in range(len(strides))]


def here() -> str:
    """Return file and line of the traced code."""
    return placed(reversed(list(traceback.walk_stack(sys._getframe(1)))))


def known_value(value: Any, tables: Tables) -> Value:
    """Return what stands for a constant in a call of a function of C."""
    if isinstance(value, np.ndarray) and value.ndim:
        name = tables.named(value)
        return Block(f"p->{name}", value.shape, "real", np.asarray(value, dtype=np.float64))
    if isinstance(value, (np.generic, np.ndarray)):
        return Known(value.item())
    return Known(value)
