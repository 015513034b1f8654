"""A trained policy as an ONNX file: it runs where neither torch nor this package is."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from baselines.learned.onnx_file import check_file, content
from baselines.learned.policy import Policy
from rdpi_gym.support.files import write_atomic

FORMAT, VERSION = "rdpi-policy-onnx", 1
INPUT, OUTPUT = "observation", "action"


class StackedActor(nn.Module):
    """Scaling and actor in one: what an environment's stacked observation makes the policy do.

    Differences of nearly equal numbers are taken in double precision, so that runtimes that add
    in another order agree.

    Parameters
    ----------
    policy
        What was trained.

    Examples
    --------
    >>> from baselines.learned.network import Network
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P10"), ts_s=1e-4)
    >>> actor = Network((layout.size + 6, 8, 1), "Tanh", "Hardtanh").build()
    >>> policy = Policy(layout, history=2, frequency_hz=100.0, error=0.02, actor=actor)
    >>> StackedActor(policy)(torch.zeros(5, 13)).shape
    torch.Size([5, 1])
    """

    matrix: Tensor

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.register_buffer("matrix", torch.from_numpy(policy.scaling.matrix).double())
        self.actor = policy.actor

    def forward(self, observation: Tensor) -> Tensor:
        """Return actions ``(B, 1)`` in [-1, 1] of stacked observations ``(B, size)``."""
        scaled = observation.double() @ self.matrix
        action: Tensor = self.actor(scaled.float())
        return action


def description(policy: Policy) -> dict[str, Any]:
    """Return what a caller needs to know of the input and the output, as JSON holds it.

    ``observation`` names the entries of the input, k being the present sample; displacements and
    commands are scaled as ``layout`` says.
    """
    layout = policy.layout
    return {
        "format": FORMAT,
        "version": VERSION,
        "layout": layout.to_dict(),
        "history": policy.history,
        "observation": policy.scaling.history.entries,
        "baseline": policy.baseline,
    }


def export_onnx(policy: Policy, out: Path) -> Path:
    """Write the deterministic actor, with its scaling, as one ONNX file.

    Input ``observation``, float32 ``(batch, size)``: the environment's observation with its history
    behind, as :class:`rdpi_gym.envs.wrappers.history.History` stacks it, not scaled. Output ``action``,
    float32 ``(batch, 1)`` in [-1, 1]. The metadata holds :func:`description`.
    """
    check_file(out, ["onnx", "onnxscript"])
    return write_atomic(out, _model(policy))


def _model(policy: Policy) -> bytes:
    """Return the file's content."""
    module = StackedActor(policy).eval()
    shown = torch.zeros(2, policy.scaling.history.size)
    with _quiet():
        program = torch.onnx.export(
            module,
            (shown,),
            input_names=[INPUT],
            output_names=[OUTPUT],
            dynamic_shapes=({0: torch.export.Dim("batch")},),
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    return content(program.model_proto, description(policy))


@contextmanager
def _quiet() -> Iterator[None]:
    """Hold back what the exporter says of itself: none of it is about the policy."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # of its own calls
            yield
    finally:
        logger.setLevel(level)
