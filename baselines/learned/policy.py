"""Trained networks as policies: description, weights and folder; no code in the files is executed."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from baselines.monitors import checked_envelope
from baselines.registry import known_controller
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.envs.wrappers.scaling import Scaling
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import (
    read_bytes,
    read_json,
    replaced_folder,
    settled_folder,
    write_atomic,
    write_json,
)
from rdpi_gym.support.words import quoted, some

DESCRIPTION = "policy.json"
"""Name of the file that says what a policy is."""


class SavedPolicy:
    """A policy that was trained in a loop of one layout."""

    layout: ObservationLayout  # of the observations of its training
    seen: Mapping[str, float]  # how far the loops of its training went

    def runs_at(self, ts_s: float) -> bool:
        """Whether a sampling time (s) is that of its training: it means nothing at another."""
        return abs(ts_s - self.layout.ts_s) <= 1e-9 * self.layout.ts_s

    def check_runs(self, layout: ObservationLayout) -> None:
        """Refuse a loop of another sampling time."""
        if not self.runs_at(layout.ts_s):
            raise InputError(
                f"a policy trained at Ts = {self.layout.ts_s:g} s belongs to another observation layout than "
                f"one of Ts = {layout.ts_s:g} s; run it at its own"
            )


def check_preview(layout: ObservationLayout, needed: int) -> None:
    """Refuse observations that show less of the reference ahead than a policy was shown."""
    if layout.preview < needed:
        raise InputError(
            f"the policy was shown {needed} samples of the reference ahead and belongs "
            f"to another observation layout than one of preview {layout.preview}"
        )


def write_policy(folder: Path, file: str, weights: bytes, document: Mapping[str, Any]) -> Path:
    """Write a policy's weights and description; what was in the folder is replaced as a whole."""
    if folder.exists() and not (folder / DESCRIPTION).is_file():
        raise InputError(f"{folder} exists and holds no policy; give another folder")
    with replaced_folder(folder) as fresh:
        write_atomic(fresh / file, weights)
        digest = hashlib.sha256(weights).hexdigest()
        write_json(fresh / DESCRIPTION, {**document, "weights_sha256": digest})
    return folder


@contextmanager
def reading(what: str, source: Path) -> Iterator[None]:
    """Turn the errors of a reader into one line with the path."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{source} does not describe a {what} ({quoted(error)})") from error


def check_digest(content: bytes, sha256: str, name: str) -> None:
    """Refuse the content of a file that was not written with its description."""
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            f"{name} is not the file that was saved with it; perhaps one of them was cut off"
        )


_WIDEST, _DEEPEST = 16_384, 64

ACTIVATIONS: Mapping[str, type[nn.Module]] = {
    each.__name__: each for each in (nn.Tanh, nn.ReLU, nn.ELU, nn.SiLU, nn.Hardtanh)
}
"""Activations between and behind the linear layers of a network."""


@dataclass(frozen=True)
class Network:
    """The deterministic actor: linear layers with one activation between them and one behind.

    Parameters
    ----------
    widths
        Inputs, hidden units, outputs.
    activation, output
        Names in :data:`ACTIVATIONS`; behind the last layer, what keeps actions within [-1, 1].

    Raises
    ------
    InputError
        Fewer than 2 widths or more than 64, one that is no whole number of 1 to 16,384, or an unknown
        activation.

    Examples
    --------
    >>> [type(module).__name__ for module in Network((9, 64, 1), "ReLU", "Tanh").build()]
    ['Linear', 'ReLU', 'Linear', 'Tanh']
    """

    widths: tuple[int, ...]
    activation: str
    output: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "widths", tuple(self.widths))
        if not 2 <= len(self.widths) <= _DEEPEST or any(
            type(w) is not int or not 1 <= w <= _WIDEST for w in self.widths
        ):
            raise InputError(
                f"network widths are {quoted(list(self.widths))}; give inputs, hidden units and outputs, "
                f"each 1 to {_WIDEST}, {_DEEPEST} at most"
            )
        for name in (self.activation, self.output):
            if not isinstance(name, str) or name not in ACTIVATIONS:
                raise InputError(
                    f"activation {quoted(name)} is unknown; known: {', '.join(ACTIVATIONS)}"
                )

    def build(self) -> nn.Sequential:
        """Return the network, weights not yet trained."""
        modules: list[nn.Module] = []
        for inputs, outputs in zip(self.widths[:-1], self.widths[1:], strict=True):
            modules += [nn.Linear(inputs, outputs), ACTIVATIONS[self.activation]()]
        return nn.Sequential(*modules[:-1], ACTIVATIONS[self.output]())

    @classmethod
    def of(cls, modules: Sequence[nn.Module]) -> Network:
        """Describe linear layers with activations between and behind them."""
        linear = [module for module in modules[::2] if isinstance(module, nn.Linear)]
        between = {type(module).__name__ for module in modules[1:-1:2]}
        if len(linear) * 2 != len(modules) or len(between) > 1:
            shown = ", ".join(type(module).__name__ for module in modules)
            raise InputError(
                f"an actor of {shown} cannot be kept; train one of linear layers with one activation"
            )
        widths = (linear[0].in_features, *(layer.out_features for layer in linear))
        last = type(modules[-1]).__name__
        return cls(widths, next(iter(between), last), last)


_LARGEST = 2**28  # bytes
_LARGEST_INDEX = 2**20  # of what says which bytes are which tensor


def read_tensors(path: Path, sha256: str | None = None) -> Mapping[str, Any]:
    """Read what `torch.save` wrote of a mapping of tensors, and of mappings of these."""
    content = read_bytes(path, _LARGEST)
    if sha256 is not None:
        check_digest(content, sha256, path.name)
    try:
        _check_archive(content)
        found = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # a file of something else raises whatever its reader trips over
        raise InputError(f"{path.name} holds no weights alone ({type(error).__name__})") from error
    if not isinstance(found, Mapping):
        raise InputError(f"{path.name} holds a {type(found).__name__} and no weights")
    return found


def read_weights(path: Path, sha256: str, expected: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Read the weights of a network."""
    found = read_tensors(path, sha256)
    if list(found) != list(expected):
        raise InputError(
            f"{path.name} does not fit the network: it holds weights of other layers "
            f"({quoted(list(found))})"
        )
    for name, wanted in expected.items():
        tensor = found[name]
        is_plain = type(tensor) is Tensor and tensor.layout == torch.strided
        if not is_plain or tensor.dtype != wanted.dtype or tensor.shape != wanted.shape:
            shape = "x".join(map(str, wanted.shape))
            raise InputError(
                f"{path.name} does not fit the network: {name!r} is not {shape} numbers"
            )
        if not torch.isfinite(tensor).all():
            raise InputError(f"{path.name} holds a weight in {name!r} that is not finite")
    return dict(found)


def _check_archive(content: bytes) -> None:
    """Refuse archives that expand, or whose index alone is large."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = archive.infolist()
    indices = [member.file_size for member in members if member.filename.endswith(".pkl")]
    if (
        any(member.compress_type != zipfile.ZIP_STORED for member in members)
        or sum(member.file_size for member in members) > len(content)
        or max(indices, default=0) > _LARGEST_INDEX
    ):
        raise ValueError("it is larger inside than outside")


FORMAT, VERSION = "rdpi-policy", 1
WEIGHTS = "weights.pt"
SHIPPED = Path(__file__).parent / "policies"
"""Folder of the policies of this release, each in a folder of its name."""
_LAYOUT_NUMBERS = ("centre_um", "scale_um", "ts_s", "action_scale_V")
_LONGEST = 4096  # samples ahead, and earlier ones


@dataclass(frozen=True)
class Policy(SavedPolicy):
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
        How far the loops of its training went, see :mod:`baselines.monitors`; empty: not known.

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
        with reading("policy", source):
            return cls(**_described(document), actor=_actor(document, folder / WEIGHTS))


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
        "seen": checked_envelope(document.get("seen")),
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
