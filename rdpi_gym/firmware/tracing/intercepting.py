"""While a controller is traced: its kernels are written down as calls, its new arrays are traced ones.

For that time the modules of this package see recorders in place of compiled kernels, and in place of
NumPy one whose ``zeros``, ``empty``, ``full``, ``ones`` and ``asarray`` know traced arrays. Other
threads, and calls without a traced array, get what was there before. All of it is put back at the end.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
from numba.core.errors import NumbaError
from numba.core.registry import CPUDispatcher
from numpy.typing import NDArray

from rdpi_gym.firmware.program import Block, Kind, Known, Number, Value
from rdpi_gym.firmware.tracing.arrays import (
    Recording,
    Store,
    Traced,
    assign,
    copy_of,
    here,
    kind_of,
    known_value,
)
from rdpi_gym.firmware.tracing.functions import TracedTensor
from rdpi_gym.firmware.tracing.naming import wish
from rdpi_gym.firmware.translation.kernels import Functions
from rdpi_gym.support.errors import InputError

# One trace at a time: it changes what modules see.
_LOCK = threading.RLock()


class Interception:
    """Replacements of kernels and NumPy during a trace."""

    def __init__(self, root: object, functions: Functions, recording: Recording) -> None:
        self.functions, self.recording = functions, recording
        self._thread = threading.get_ident()
        self._swapped: list[tuple[Callable[[Any], None], Any, Any]] = []
        self._recorders: dict[int, Recorder] = {}
        with _LOCK:  # no other trace has anything swapped
            self._collect(root)

    @contextmanager
    def active(self) -> Iterator[None]:
        """Swap, and put back at the end."""
        with _LOCK:
            self._put(1)
            try:
                yield
            finally:
                self._put(0)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Put back for a while."""
        self._put(0)
        try:
            yield
        finally:
            self._put(1)

    def records(self, arguments: Sequence[Any]) -> bool:
        """Whether a call is one of the traced code, on traced arrays."""
        return threading.get_ident() == self._thread and any(
            isinstance(each, Traced) for each in arguments
        )

    @property
    def is_ours(self) -> bool:
        """Whether the traced code runs in this thread."""
        return threading.get_ident() == self._thread

    def recorder(self, kernel: Any) -> Recorder:
        """Return what stands in for a kernel, always the same."""
        return self._recorders.setdefault(id(kernel), Recorder(self, kernel))

    def _put(self, which: int) -> None:
        for put, *values in self._swapped:
            put(values[which])

    def _collect(self, root: object) -> None:
        rooms = {*_ROOMS, *(kind.__module__.split(".")[0] for kind in type(root).__mro__[:-2])}
        numpy, making, torch = _NumPy(self, False), _NumPy(self, True), _Torch(self)
        for name, module in list(sys.modules.items()):
            if name.split(".")[0] not in rooms or name.startswith("rdpi_gym.firmware"):
                continue
            for attribute, value in list(vars(module).items()):
                if isinstance(value, CPUDispatcher):
                    self._swap(module, attribute, value, self.recorder(value))
                elif value is np:
                    # what the plant makes arrays of is known
                    own = numpy if name.startswith("rdpi_gym.") else making
                    self._swap(module, attribute, value, own)
                elif isinstance(value, ModuleType) and value.__name__ == "torch":
                    self._swap(module, attribute, value, torch)
                elif isinstance(value, type) and value.__module__ == name:
                    self._collect_class(value)
        for holder, attribute, value in _attributes(root):
            if isinstance(value, CPUDispatcher):
                self._swap_item(vars(holder), attribute, value, self.recorder(value))

    def _collect_class(self, kind: type) -> None:
        for attribute, value in list(vars(kind).items()):
            if isinstance(value, staticmethod) and isinstance(value.__func__, CPUDispatcher):
                instead = staticmethod(self.recorder(value.__func__))
                self._swap(kind, attribute, value, instead)

    def _swap(self, holder: Any, name: str, value: Any, instead: Any) -> None:
        self._swapped.append((lambda new: setattr(holder, name, new), value, instead))

    def _swap_item(self, holder: dict[str, Any], name: str, value: Any, instead: Any) -> None:
        self._swapped.append((lambda new: holder.__setitem__(name, new), value, instead))


class Recorder:
    """Stands in for a kernel: writes the call of its translation where an argument is traced."""

    def __init__(self, interception: Interception, kernel: Any) -> None:
        self._interception, self._kernel = interception, kernel

    def __call__(self, *arguments: Any) -> Any:
        """Write the call, or run the kernel itself."""
        interception = self._interception
        if interception.records(arguments):
            return self._recorded(arguments)
        if interception.is_ours:
            with interception.paused():
                return self._kernel(*arguments)
        try:
            return self._kernel(*arguments)
        except NumbaError:  # compiled anew while its module sees recorders: once the trace is done
            with _LOCK:
                return self._kernel(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._kernel, name)

    def _recorded(self, arguments: Sequence[Any]) -> Any:
        interception = self._interception
        recording, functions = interception.recording, interception.functions
        values: list[Value] = []
        given: dict[int, Traced] = {}
        for k, each in enumerate(arguments):
            if isinstance(each, Traced):
                with recording.wishing(wish(k, self._kernel.py_func.__code__.co_varnames[k])):
                    given[k] = each if each.is_dense or not each.ndim else copy_of(each)
                values.append(given[k].value())
            else:
                values.append(known_value(each, recording.tables))
        locals_: dict[str, tuple[str, Kind, int]] = {}

        def local(kind: Kind, size: int) -> str:
            name = recording.local(kind, size)
            pointer = f"&{name}" if size == 1 else name
            locals_[pointer] = name, kind, size
            return pointer

        place = here()
        with interception.paused():
            try:
                called = functions.call(self._kernel, values, local)
            except InputError as error:
                raise InputError(f"{place}: {error}") from error
        changed = [given[k] for k in sorted(called.writes) if k in given]
        written = [name for each in changed for name in each.store.names]
        written += [name for name, _, _ in locals_.values()]
        kept = any(not each.store.names for each in changed)
        answer: Any = called.value.value if isinstance(called.value, Known) else None
        if called.statement is not None:
            recording.tape.write(called.statement, writes=written, keeps=kept)
        if isinstance(called.value, Block):
            name, kind, size = locals_[called.value.text]
            places = np.arange(size, dtype=np.int64).reshape(called.value.shape)
            answer = Traced(Store(recording, name, size, kind), places)
        elif isinstance(called.value, Number):
            answer = recording.scalar(called.value.kind, called.value.text, (), written, kept)
        for k in sorted(called.writes):
            if k in given and given[k] is not arguments[k]:  # written back from a copy
                assign(arguments[k], given[k])
        return answer


_MADE: Mapping[str, Callable[..., tuple[Any, Any, Any]]] = {
    "zeros": lambda shape, dtype=float: (shape, dtype, 0),
    "ones": lambda shape, dtype=float: (shape, dtype, 1),
    "empty": lambda shape, dtype=float: (shape, dtype, None),
    "full": lambda shape, fill_value, dtype=None: (
        shape,
        dtype if dtype is not None else getattr(fill_value, "dtype", type(fill_value)),
        fill_value,
    ),
}
"""Shape, type and value of what NumPy makes."""


class _NumPy:
    """NumPy, but that traced arrays are taken as they are; what it `makes` is traced, too, if asked for."""

    def __init__(self, interception: Interception, makes: bool) -> None:
        self._interception, self._makes = interception, makes

    def __getattr__(self, name: str) -> Any:
        if name in ("asarray", "ascontiguousarray", "array"):
            return partial(self._taken, name)
        return partial(self._made, name) if self._makes and name in _MADE else getattr(np, name)

    def _taken(self, name: str, a: Any, dtype: Any = None, **options: Any) -> Any:
        if not isinstance(a, Traced):
            return getattr(np, name)(a, dtype, **options)
        if name == "array":
            return copy_of(a)
        return a if dtype is None or np.dtype(dtype) == a.dtype else a.astype(dtype)

    def _made(self, name: str, *given: Any, **options: Any) -> Any:
        if not self._interception.is_ours or options.keys() - {"shape", "fill_value", "dtype"}:
            return getattr(np, name)(*given, **options)
        shape, dtype, value = _MADE[name](*given, **options)
        shape = (shape,) if np.ndim(shape) == 0 else tuple(shape)
        found = self._interception.recording.array(shape, kind_of(dtype))
        if value is not None:
            assign(found, value)
        return found


class _Torch:
    """Torch, but that an array that is traced becomes a traced tensor."""

    def __init__(self, interception: Interception) -> None:
        self._interception = interception

    def __getattr__(self, name: str) -> Any:
        return getattr(sys.modules["torch"], name)

    def from_numpy(self, array: Any) -> Any:
        if isinstance(array, Traced):
            return TracedTensor(array)
        return sys.modules["torch"].from_numpy(array)


# How deep attributes of attributes are looked through.
_DEEPEST = 6
_ROOMS = ("baselines", "rdpi_gym")


def _attributes(root: object) -> Iterator[tuple[object, str, Any]]:
    """Yield the attributes of an object of this project and of its attributes: holder, name, value."""
    seen: set[int] = set()
    level: list[object] = [root]
    for _ in range(_DEEPEST):
        below: list[object] = []
        for holder in level:
            if id(holder) in seen:
                continue
            seen.add(id(holder))
            if isinstance(holder, Mapping):
                below += holder.values()
            elif isinstance(holder, (list, tuple)):
                below += holder
            elif type(holder).__module__.split(".")[0] in _ROOMS and hasattr(holder, "__dict__"):
                for name, value in list(vars(holder).items()):
                    yield holder, name, value
                    below.append(value)
        level = below


def named_arrays(root: object) -> list[tuple[str, NDArray[Any]]]:
    """Return the arrays of an object, its tuples and the modules of its classes, with their names."""
    found: list[tuple[str, Any]] = []
    kinds: dict[type, None] = dict.fromkeys(type(root).__mro__)
    for holder, name, value in _attributes(root):
        kinds |= dict.fromkeys(type(holder).__mro__)
        found.append((name, value))
        if isinstance(value, tuple):
            found += [(f"{name}_{i}", each) for i, each in enumerate(value)]
    for module in dict.fromkeys(kind.__module__ for kind in kinds):
        if module.split(".")[0] in _ROOMS:
            found += vars(sys.modules[module]).items()
    return [
        (name, value)
        for name, value in found
        if isinstance(value, np.ndarray) and value.size > 1 and value.dtype.kind in "fiub"
    ]
