"""A function that is replayed as a CUDA graph where the device is CUDA, and called where it is not."""

from __future__ import annotations

from collections.abc import Callable

import torch

_FIRST = 3  # calls before a capture: libraries set themselves up in them


class Replay:
    """Calls a function again and again.

    On CUDA the first calls run as they are, on a stream of their own; then the function is captured,
    and replayed from there on. All calls do the same.

    Parameters
    ----------
    function
        Looks at no value of a tensor, draws nothing, and changes tensors in place.
    device
        Of its tensors.

    Examples
    --------
    >>> total = torch.zeros(())
    >>> count = Replay(lambda: total.add_(1.0), torch.device("cpu"))
    >>> for _ in range(5):
    ...     count()
    >>> float(total)
    5.0
    """

    def __init__(self, function: Callable[[], object], device: torch.device) -> None:
        self._function, self._device = function, device
        self._calls = 0
        self._graph: torch.cuda.CUDAGraph | None = None

    def __call__(self) -> None:
        """Call it once more."""
        if self._device.type != "cuda":
            self._function()
        elif self._graph is not None:
            self._graph.replay()
        else:
            with torch.cuda.device(self._device):
                self._begin()

    def _begin(self) -> None:
        self._calls += 1
        if self._calls <= _FIRST:
            beside = torch.cuda.Stream()  # type: ignore[no-untyped-call]  # torch leaves it open
            main = torch.cuda.current_stream()
            beside.wait_stream(main)
            with torch.cuda.stream(beside):
                self._function()
            main.wait_stream(beside)
            return
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self._graph):  # records, and does not run
            self._function()
        self._graph.replay()
