"""A trained policy as it is kept: a readable description, and weights that execute no code."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from baselines.learned.kept import DESCRIPTION, Trained, read_as, write_policy
from baselines.learned.network import Network
from baselines.learned.seen import checked_seen
from baselines.learned.weights import read_weights
from baselines.registry import known_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json
from rdpi_gym.support.folders import settled_folder
from rdpi_gym.support.words import quoted, some

FORMAT, VERSION = "rdpi-policy", 1
WEIGHTS = "weights.pt"
SHIPPED = Path(__file__).parent / "policies"
"""Where the policies of this release lie, each in a folder of its name."""
_LAYOUT_NUMBERS = ("centre_um", "scale_um", "ts_s", "action_scale_V")
_LONGEST = 4096  # samples ahead, and earlier ones


@dataclass(frozen=True)
class Policy(Trained):
    """A deterministic actor, and what it must be shown to act as it was trained to.

    Parameters
    ----------
    layout
        Observation and reading of actions of the environment that it was trained in.
    history
        Earlier samples that are stacked, see :class:`rdpi_gym.envs.wrappers.history.History`.
    frequency_hz, error
        Units of :class:`rdpi_gym.envs.wrappers.scaling.Scaling`.
    actor
        From scaled observations ``(B, size)`` to actions ``(B, 1)`` in [-1, 1].
    baseline
        Name of the controller that actions correct; None: they do not.
    training
        How it came about, for a reader.
    seen
        How far the loops of its training went, see :mod:`baselines.learned.seen`; empty: not known.

    Raises
    ------
    InputError
        The network does not fit the observation, or a baseline is missing or idle.

    Examples
    --------
    >>> import tempfile
    >>> from rdpi_gym.plant import named_plant
    >>> layout = ObservationLayout.for_plant(named_plant("P10"), ts_s=1e-4, action="increment")
    >>> actor = Network((layout.size + 6, 8, 1), "Tanh", "Hardtanh").build()
    >>> policy = Policy(layout, history=2, frequency_hz=100.0, error=0.02, actor=actor)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found = Policy.load(policy.save(Path(folder) / "mine"))
    >>> found.network
    Network(widths=(13, 8, 1), activation='Tanh', output='Hardtanh')
    """

    layout: ObservationLayout
    history: int
    frequency_hz: float
    error: float
    actor: nn.Sequential
    baseline: str | None = None
    training: Mapping[str, Any] = field(default_factory=dict)
    seen: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        widths = self.network.widths
        if widths[0] != self.scaling.history.size or widths[-1] != 1:
            raise InputError(
                f"a network of {widths[0]} inputs and {widths[-1]} outputs with an observation of "
                f"{self.scaling.history.size} numbers and one action; it belongs to another observation layout"
            )
        if (self.layout.action == "correction") != (self.baseline is not None):
            raise InputError(
                f"actions are read as {self.layout.action!r} and the baseline is {self.baseline!r}; "
                "a correction has a baseline, and only a correction"
            )

    @property
    def scaling(self) -> Scaling:
        """The law from an observation and its history to the network's input."""
        return Scaling(History(self.layout, self.history), self.frequency_hz, self.error)

    @property
    def network(self) -> Network:
        """Description of the actor."""
        return Network.of(list(self.actor))

    def save(self, folder: Path) -> Path:
        """Write ``policy.json`` and ``weights.pt``; what was in the folder is replaced as a whole."""
        weights = io.BytesIO()
        torch.save(self.actor.state_dict(), weights)
        document = {
            "format": FORMAT,
            "version": VERSION,
            "layout": self.layout.to_dict(),
            "history": self.history,
            "scaling": {"frequency_hz": self.frequency_hz, "error": self.error},
            "network": asdict(self.network),
            "baseline": self.baseline,
            "training": dict(self.training),
            **({"seen": dict(self.seen)} if self.seen else {}),
        }
        return write_policy(folder, WEIGHTS, weights.getvalue(), document)

    @classmethod
    def load(cls, folder: Path) -> Policy:
        """Read a policy; no code in its files is executed."""
        folder = settled_folder(folder)
        source = folder / DESCRIPTION
        document = read_json(source, FORMAT, VERSION)
        with read_as("policy", source):
            return cls(**_described(document), actor=_actor(document, folder / WEIGHTS))


def find_policy(name: str) -> Policy:
    """Return the policy in a folder, or a shipped one by its name."""
    return Policy.load(policy_folder(name))


def policy_folder(name: str) -> Path:
    """Return the folder of a policy, of a shipped one by its name."""
    if not name:
        raise InputError("the name of the policy is empty; give its folder")
    shipped = sorted(path.parent.name for path in SHIPPED.glob(f"*/{DESCRIPTION}"))
    if name in shipped:
        return SHIPPED / name
    if not (settled_folder(Path(name)) / DESCRIPTION).is_file():
        raise InputError(
            f"no policy is at {quoted(name)}: give a folder with {DESCRIPTION}"
            + (f", or a shipped policy: {', '.join(shipped)}" if shipped else "")
        )
    return Path(name)


def _described(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a description says beside the network; a name in it is a controller's of ours."""
    layout, scaling, training = (document[key] for key in ("layout", "scaling", "training"))
    low, high = map(_number, layout["command_range_V"])
    numbers = {key: _number(layout[key]) for key in _LAYOUT_NUMBERS}
    whole = {"preview": layout["preview"], "history": document["history"]}
    for key, value in whole.items():
        if type(value) is not int or not 0 <= value <= _LONGEST:
            raise InputError(f"{key} is {quoted(value)}; give a whole number up to {_LONGEST}")
    if set(layout) - {"fields"} != {*_LAYOUT_NUMBERS, "preview", "command_range_V", "action"}:
        raise InputError(f"the layout has the keys {some(layout)}; it is of another release")
    if not (isinstance(training, Mapping) and low < high):
        raise InputError("training is no mapping, or command_range_V is not lowest and highest")
    if document["baseline"] is not None:
        known_controller(document["baseline"])
    return {
        "layout": ObservationLayout.from_dict(
            {**layout, **numbers, "command_range_V": (low, high)}
        ),
        "history": whole["history"],
        "frequency_hz": _number(scaling["frequency_hz"]),
        "error": _number(scaling["error"]),
        "baseline": document["baseline"],
        "training": training,
        "seen": checked_seen(document.get("seen")),
    }


def _actor(document: Mapping[str, Any], path: Path) -> nn.Sequential:
    network = Network(**document["network"])
    with torch.device("meta"):  # shapes alone: the file says how large it is
        shapes = network.build().state_dict()
    weights = read_weights(path, str(document["weights_sha256"]), shapes)
    actor = network.build()
    actor.load_state_dict(weights)
    return actor.eval().requires_grad_(False)


def _number(value: Any) -> float:
    if not is_finite(value):
        raise TypeError(f"{quoted(value)} is no number")
    return float(value)
