"""Arithmetic as an ONNX graph in double precision, and its file with metadata."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.onnx_metadata import METADATA

OPSET, IR_VERSION = 17, 8
"""Versions that runtimes of 2022 read."""
_CAST: Mapping[type[np.floating[Any]], int] = {np.float32: 1, np.float64: 11}
"""Types as ONNX counts them."""
_END = 2**63 - 1
"""End of a slice that runs to the end."""


@dataclass(frozen=True)
class _Node:
    kind: str
    operands: tuple[str, ...]
    name: str
    attributes: Mapping[str, Any]


class Graph:
    """Inputs and outputs of a type, constants and nodes, in the order in which they were written.

    Examples
    --------
    >>> graph = Graph()
    >>> x = graph.input("x", 3)
    >>> model = graph.model({"y": 2.0 * x[:, 1:] + 1.0})
    >>> [node.op_type for node in model.graph.node]
    ['Slice', 'Mul', 'Add', 'Identity']
    """

    def __init__(self, dtype: type[np.floating[Any]] = np.float64) -> None:
        self._type = dtype
        self._inputs: dict[str, tuple[int, ...]] = {}
        self._constants: dict[tuple[str, tuple[int, ...], bytes], str] = {}
        self._nodes: list[_Node] = []

    def input(self, name: str, *sizes: int) -> Signal:
        """Return an input of a number, or of an array of so many, for each lane: ``(batch, *sizes)``."""
        self._inputs[name] = sizes
        return Signal(self, name)

    def constant(self, values: NDArray[Any]) -> Signal:
        """Return numbers that are part of the file, each array once."""
        key = values.dtype.str, values.shape, values.tobytes()
        return Signal(self, self._constants.setdefault(key, f"c{len(self._constants)}"))

    def call(self, kind: str, *operands: Operand, **attributes: Any) -> Signal:
        """Return what an operator of ONNX makes of operands; numbers become constants."""
        names = tuple(
            each.name if isinstance(each, Signal) else self.constant(_constant(each)).name
            for each in operands
        )
        self._nodes.append(_Node(kind, names, f"s{len(self._nodes)}", attributes))
        return Signal(self, self._nodes[-1].name)

    def where(self, test: Signal, one: Operand, other: Operand) -> Signal:
        """Return one where a test holds, else the other."""
        return self.call("Where", test, one, other)

    def concat(self, *parts: Signal) -> Signal:
        """Return arrays side by side, along their last axis."""
        return self.call("Concat", *parts, axis=-1)

    def model(self, outputs: Mapping[str, Signal]) -> Any:
        """Return the model, checked."""
        import onnx
        from onnx import helper, numpy_helper

        kind_of = helper.np_dtype_to_tensor_dtype(np.dtype(self._type))

        nodes = [
            helper.make_node(n.kind, n.operands, [n.name], **n.attributes) for n in self._nodes
        ]
        nodes += [helper.make_node("Identity", [y.name], [name]) for name, y in outputs.items()]
        constants = [
            numpy_helper.from_array(
                np.frombuffer(content, dtype=np.dtype(kind)).reshape(shape), name=name
            )
            for (kind, shape, content), name in self._constants.items()
        ]
        inputs = [
            helper.make_tensor_value_info(name, kind_of, ["batch", *sizes])
            for name, sizes in self._inputs.items()
        ]
        answers = [helper.make_tensor_value_info(name, kind_of, None) for name in outputs]
        graph = helper.make_graph(nodes, "step", inputs, answers, initializer=constants)
        made = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
        )
        made = onnx.shape_inference.infer_shapes(made, check_type=True, strict_mode=True)
        del made.graph.value_info[:]  # of what is between: known to every runtime
        onnx.checker.check_model(made)
        return made


def _operator(kind: str, reflected: bool = False) -> Callable[[Signal, Operand], Signal]:
    """Return the method of a binary operator."""

    def method(one: Signal, other: Operand) -> Signal:
        return one.graph.call(kind, *((other, one) if reflected else (one, other)))

    return method


@dataclass(frozen=True, eq=False)
class Signal:
    """Numbers of a graph, with the arithmetic of arrays; the first axis is that of the lanes."""

    graph: Graph
    name: str

    # NumPy's arrays leave the arithmetic to it.
    __array_ufunc__ = None

    __add__, __radd__ = _operator("Add"), _operator("Add", reflected=True)
    __sub__, __rsub__ = _operator("Sub"), _operator("Sub", reflected=True)
    __mul__, __rmul__ = _operator("Mul"), _operator("Mul", reflected=True)
    __pow__, __rpow__ = _operator("Pow"), _operator("Pow", reflected=True)
    __truediv__, __matmul__ = _operator("Div"), _operator("MatMul")
    __gt__, __ge__ = _operator("Greater"), _operator("GreaterOrEqual")
    __lt__, __le__ = _operator("Less"), _operator("LessOrEqual")
    __and__, __or__ = _operator("And"), _operator("Or")

    def __abs__(self) -> Signal:
        return self.graph.call("Abs", self)

    def __invert__(self) -> Signal:
        return self.graph.call("Not", self)

    def __getitem__(self, key: tuple[slice, ...]) -> Signal:
        parts = [(axis, each) for axis, each in enumerate(key) if each != slice(None)]
        starts = [each.start or 0 for _, each in parts]
        ends = [_END if each.stop is None else each.stop for _, each in parts]
        axes = [axis for axis, _ in parts]
        return self.graph.call("Slice", self, *map(self._integers, (starts, ends, axes)))

    def take(self, places: Sequence[int] | NDArray[np.int64]) -> Signal:
        """Return elements of the second axis, in the shape of their places."""
        return self.graph.call("Gather", self, self._integers(places), axis=1)

    def unsqueeze(self, axis: int) -> Signal:
        """Return it with an axis of 1 more."""
        return self.graph.call("Unsqueeze", self, self._integers([axis]))

    def squeeze(self, axis: int) -> Signal:
        """Return it without an axis of 1."""
        return self.graph.call("Squeeze", self, self._integers([axis]))

    def transpose(self) -> Signal:
        """Return the matrix of each lane transposed."""
        return self.graph.call("Transpose", self, perm=[0, 2, 1])

    def full_like(self, value: float) -> Signal:
        """Return an array of this shape that holds one number."""
        return self.graph.call("Expand", value, self.graph.call("Shape", self))

    def sum(self) -> Signal:
        """Return the sum along the last axis, which stays as one of 1."""
        return self.graph.call("ReduceSum", self, self._integers([-1]), keepdims=1)

    def maximum(self, low: Operand) -> Signal:
        """Return the larger one."""
        return self.graph.call("Max", self, low)

    def clip(self, low: Operand, high: Operand) -> Signal:
        """Return what is no less than low and no more than high."""
        return self.graph.call("Min", self.maximum(low), high)

    def remainder(self, divisor: float) -> Signal:
        """Return what is left of a division, with the sign of what was divided."""
        return self.graph.call("Mod", self, divisor, fmod=1)

    def cast(self, dtype: type[np.floating[Any]]) -> Signal:
        """Return it in another type; 1 and 0 for what holds and what does not."""
        return self.graph.call("Cast", self, to=_CAST[dtype])

    def tanh(self) -> Signal:
        """Return its hyperbolic tangent."""
        return self.graph.call("Tanh", self)

    def sigmoid(self) -> Signal:
        """Return 1 / (1 + e^-x)."""
        return self.graph.call("Sigmoid", self)

    def asinh(self) -> Signal:
        """Return its inverse hyperbolic sine: runtimes have it in single precision only."""
        size = abs(self)
        grown = self.graph.call("Log", size + self.graph.call("Sqrt", size * size + 1.0))
        return self.graph.call("Sign", self) * grown

    def _integers(self, values: Sequence[int] | NDArray[np.int64]) -> Signal:
        return self.graph.constant(np.asarray(values, dtype=np.int64))


Operand: TypeAlias = Signal | NDArray[np.floating[Any]] | np.floating[Any] | float


def _constant(value: Any) -> NDArray[np.floating[Any]]:
    """Return a constant: single precision where it is given in it, else double."""
    array = np.asarray(value)
    return array if array.dtype == np.float32 else array.astype(np.float64)


def check_file(out: Path) -> None:
    """Refuse a path that is no ONNX file's, and an installation without the package."""
    if out.suffix != ".onnx" or out.is_dir():
        raise InputError(f"{out} is no file to export to; give one that ends in .onnx")
    try:
        import_module("onnx")
    except ImportError as error:
        raise InputError(
            "an export needs onnx, which cannot be imported; run pip install rdpi-gym[onnx]"
        ) from error


def content(model: Any, description: Mapping[str, Any]) -> bytes:
    """Return what a file holds: a model with its description, and nothing of how it was made."""
    import onnx

    for part in (model.graph, *model.graph.node, *model.graph.value_info):
        del part.metadata_props[:]
    onnx.helper.set_model_props(model, {METADATA: json.dumps(description, allow_nan=False)})
    onnx.checker.check_model(model)
    found: bytes = model.SerializeToString()
    return found
