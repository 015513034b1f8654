"""A trained policy as it is kept: a readable description, and weights that execute no code."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from baselines.learned.network import Network
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_atomic, write_json
from rdpi_gym.support.folders import replaced_folder, settled_folder

FORMAT, VERSION = "rdpi-policy", 1
DESCRIPTION, WEIGHTS = "policy.json", "weights.pt"
SHIPPED = Path(__file__).parent / "policies"
"""Where the policies of this release lie, each in a folder of its name."""


@dataclass(frozen=True)
class Policy:
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
        """Write ``policy.json`` and ``weights.pt``; what was in the folder is replaced as a whole.

        Raises
        ------
        InputError
            The folder cannot be written, or holds something else.
        """
        if folder.exists() and not (folder / DESCRIPTION).is_file():
            raise InputError(f"{folder} exists and holds no policy; give another folder")
        weights = io.BytesIO()
        torch.save(self.actor.state_dict(), weights)
        document = {
            "format": FORMAT,
            "version": VERSION,
            "layout": asdict(self.layout),
            "history": self.history,
            "scaling": {"frequency_hz": self.frequency_hz, "error": self.error},
            "network": asdict(self.network),
            "baseline": self.baseline,
            "weights_sha256": hashlib.sha256(weights.getvalue()).hexdigest(),
            "training": dict(self.training),
        }
        with replaced_folder(folder) as fresh:
            write_atomic(fresh / WEIGHTS, weights.getvalue())
            write_json(fresh / DESCRIPTION, document)
        return folder

    @classmethod
    def load(cls, folder: Path) -> Policy:
        """Read a policy; no code in its files is executed.

        Raises
        ------
        InputError
            A file is missing, was cut off, is of another version, or does not fit the other.
        """
        folder = settled_folder(folder)
        source = folder / DESCRIPTION
        document = read_json(source, FORMAT, VERSION)
        try:
            layout = dict(document["layout"])
            layout["command_range_V"] = tuple(layout["command_range_V"])
            actor = Network(**document["network"]).build()
            actor.load_state_dict(_weights(folder / WEIGHTS, str(document["weights_sha256"])))
            return cls(
                layout=ObservationLayout(**layout),
                history=document["history"],
                frequency_hz=document["scaling"]["frequency_hz"],
                error=document["scaling"]["error"],
                actor=actor.eval().requires_grad_(False),
                baseline=document["baseline"],
                training=document["training"],
            )
        except InputError as error:
            raise InputError(f"{source}: {error}") from error
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{source} does not describe a policy ({error!r})") from error
        except RuntimeError as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{folder}: {WEIGHTS} does not fit {DESCRIPTION} ({reason})"
            ) from error


def find_policy(name: str) -> Policy:
    """Return the policy in a folder, or a shipped one by its name.

    Raises
    ------
    InputError
        There is none, or it cannot be read.
    """
    shipped = sorted(path.parent.name for path in SHIPPED.glob(f"*/{DESCRIPTION}"))
    if name in shipped:
        return Policy.load(SHIPPED / name)
    if not (settled_folder(Path(name)) / DESCRIPTION).is_file():
        raise InputError(
            f"no policy is at {name!r}: give a folder with {DESCRIPTION}"
            + (f", or a shipped policy: {', '.join(shipped)}" if shipped else "")
        )
    return Policy.load(Path(name))


def _weights(path: Path, sha256: str) -> dict[str, torch.Tensor]:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror})") from error
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            f"{path.name} is not the file that was saved with it; perhaps one of them was cut off"
        )
    try:
        weights: dict[str, torch.Tensor] = torch.load(
            io.BytesIO(content), map_location="cpu", weights_only=True
        )
    except Exception as error:  # a file of something else raises whatever its reader trips over
        raise InputError(f"{path.name} holds no weights alone ({type(error).__name__})") from error
    for name, tensor in weights.items():
        if not torch.isfinite(tensor).all():
            raise InputError(f"{path.name} holds a weight in {name!r} that is not finite")
    return weights
