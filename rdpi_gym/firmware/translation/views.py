"""Arrays as a kernel's translation sees them: a pointer, what is added to it, and how far elements are apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rdpi_gym.firmware.values import Block, Kind, Known, Number


@dataclass(frozen=True)
class View:
    """Part of an array that stands at a name of C.

    Parameters
    ----------
    root
        The name.
    shape, strides
        Of the part, in elements; known as the code is written.
    kind
        Of an element.
    first
        Elements before its first one, as far as they are known.
    moves
        What is added to them as the code runs: an expression, or empty.
    known
        The part's numbers where nothing writes it and it does not move; else None.
    """

    root: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    kind: Kind = "real"
    first: int = 0
    moves: str = ""
    known: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, block: Block, root: str) -> View:
        """Return all of a block that stands at a name."""
        strides = tuple(
            int(np.prod(block.shape[k + 1 :], dtype=int)) for k in range(len(block.shape))
        )
        return cls(root, block.shape, strides, block.kind, known=block.known)

    @property
    def size(self) -> int:
        """Number of elements."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def is_contiguous(self) -> bool:
        """Whether its elements stand one behind the other in their order."""
        apart = 1
        for length, stride in zip(reversed(self.shape), reversed(self.strides), strict=True):
            if length != 1 and stride != apart:
                return False
            apart *= length
        return True

    @property
    def pointer(self) -> str:
        """Expression that points at its first element."""
        offset = _sum(self.first, self.moves)
        return self.root if offset == "0" else f"({self.root} + {offset})"

    def block(self) -> Block:
        """Return the part as a block; it has to be contiguous."""
        return Block(self.pointer, self.shape, self.kind, self.known)

    def fixed(self, axis: int, index: Known | Number) -> View:
        """Return the part at one index of an axis, without that axis."""
        shape = self.shape[:axis] + self.shape[axis + 1 :]
        strides = self.strides[:axis] + self.strides[axis + 1 :]
        stride, length = self.strides[axis], self.shape[axis]
        if isinstance(index, Known):
            place = int(index.value)
            place += length if place < 0 else 0
            known = None if self.known is None else np.take(self.known, place, axis)
            first = self.first + place * stride
            return replace(self, shape=shape, strides=strides, first=first, known=known)
        if length == 1:
            return replace(
                self,
                shape=shape,
                strides=strides,
                known=None if self.known is None else np.take(self.known, 0, axis),
            )
        move = index.text if stride == 1 else f"{stride} * {index.text}"
        moves = f"{self.moves} + {move}" if self.moves else move
        return replace(self, shape=shape, strides=strides, moves=moves, known=None)

    def cut(self, axis: int, start: int, stop: int) -> View:
        """Return the part between two places of an axis."""
        shape = (*self.shape[:axis], max(stop - start, 0), *self.shape[axis + 1 :])
        known = None
        if self.known is not None:
            known = np.take(self.known, range(start, max(stop, start)), axis)
        first = self.first + start * self.strides[axis]
        return replace(self, shape=shape, first=first, known=known)

    def reshaped(self, shape: Sequence[int]) -> View:
        """Return it in another shape; it has to be contiguous."""
        lengths = list(shape)
        if -1 in lengths:
            lengths[lengths.index(-1)] = -self.size // int(np.prod(lengths, dtype=int))
        block = Block(self.root, tuple(lengths), self.kind)
        known = None if self.known is None else self.known.reshape(lengths)
        return replace(View.of(block, self.root), first=self.first, moves=self.moves, known=known)

    def element(self, index: str | int = "") -> str:
        """Return the expression of one element: of a scalar part, or the `index`-th of a flat one."""
        moves = self.moves
        first = self.first
        if isinstance(index, int):
            first += index * (self.strides[0] if self.strides else 1)
        elif index:
            stride = self._flat_stride
            move = index if stride == 1 else f"{stride} * {index}"
            moves = f"{moves} + {move}" if moves else move
        return f"{self.root}[{_sum(first, moves)}]"

    @property
    def _flat_stride(self) -> int:
        """Elements between neighbours where one axis alone is longer than 1, or it is contiguous."""
        longer = [s for n, s in zip(self.shape, self.strides, strict=True) if n != 1]
        return 1 if self.is_contiguous or not longer else longer[0]


def _sum(first: int, moves: str) -> str:
    if not moves:
        return str(first)
    return moves if first == 0 else f"{first} + {moves}" if first > 0 else f"{moves} - {-first}"
