"""Hyper-parameters from YAML, in the form that rl-baselines3-zoo reads."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_utf8
from rdpi_gym.support.words import quoted, short

SHIPPED = Path(__file__).parent / "hyperparameters"
"""One file an algorithm."""

ENVIRONMENT_ID = "rdpi_gym/PiezoTracking-v0"
_WRAPPERS = {
    "rdpi_gym.envs.wrappers.history.HistoryObservation": ("history",),
    "rdpi_gym.envs.wrappers.scaling.ScaledObservation": ("frequency_hz", "error"),
}
_LARGEST, _MOST_VALUES = 2**20, 10_000  # bytes, values
_LONGEST, _MOST_LANES = 4096, 1_000_000
_OWN = ("env", "seed", "device", "tensorboard_log", "verbose", "_init_setup_model")
_COUNTS = ("batch_size", "n_steps", "n_epochs", "buffer_size")
_TEXT = ("learning_rate", "clip_range", "clip_range_vf", "train_freq", "ent_coef")
_SCHEDULED = ("learning_rate", "clip_range", "clip_range_vf")


@dataclass(frozen=True)
class Settings:
    """Hyper-parameters of a file."""

    lanes: int
    timesteps: int  # ``n_envs`` and ``n_timesteps``
    history: int = 0  # earlier samples that observations are stacked with (``env_wrapper``)
    frequency_hz: float = 100.0
    error: float = 0.02  # units of the scaling (``env_wrapper``)
    algorithm: Mapping[str, Any] = field(
        default_factory=dict
    )  # the other keys, as the file has them

    def arguments(self) -> dict[str, Any]:
        """Arguments of the algorithm: schedules and noise made from what the file says."""
        # Copied: the library writes into what it is given.
        made = deepcopy(dict(self.algorithm))
        noise = {name: made.pop(name, None) for name in ("noise_type", "noise_std")}
        for name in _SCHEDULED:
            if isinstance(made.get(name), str):
                made[name] = _schedule(name, made[name])
        if isinstance(made.get("train_freq"), list):
            made["train_freq"] = tuple(made["train_freq"])
        if noise["noise_type"] is not None:
            made["action_noise"] = _noise(noise)
        return made


def read_settings(path: Path, algorithm: Callable[..., Any]) -> Settings:
    """Read hyper-parameters for the environment of this package."""
    left = read_values(path)
    try:
        lanes, timesteps = _count(left, "n_envs"), _count(left, "n_timesteps")
        wrappers = _wrappers(left.pop("env_wrapper", []))
        settings = Settings(lanes, timesteps, **wrappers, algorithm=left)
        _check(left, algorithm)
        settings.arguments()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return settings


def read_values(path: Path) -> dict[str, Any]:
    """Read hyper-parameters as the file has them, see :func:`read_settings`."""
    document = read_yaml(path)
    entries = document if isinstance(document, dict) else {}
    values = entries.get(ENVIRONMENT_ID, entries.get("default"))
    if not isinstance(values, dict):
        raise InputError(f"{path} has no hyper-parameters under {ENVIRONMENT_ID} or default")
    return dict(values)


def read_yaml(path: Path) -> Any:
    """Read YAML of plain values, a few hundred of them at most: an alias can stand for millions."""
    import yaml

    text = read_utf8(path, _LARGEST)
    try:
        document = yaml.safe_load(text)
    except Exception as error:  # dates that are none, whole numbers of thousands of digits, nesting
        reason = " ".join(str(error).split())[:150] or type(error).__name__
        raise InputError(f"{path} is no YAML file ({reason})") from error
    left = [document]
    for _ in range(_MOST_VALUES):
        if not left:
            return document
        value = left.pop()
        if isinstance(value, dict):
            left += [*value, *value.values()]
        elif isinstance(value, list):
            left += value
        elif not (value is None or isinstance(value, str | bool) or is_finite(value)):
            raise InputError(f"{path} has the value {quoted(value)}; give numbers and words")
    raise InputError(f"{path} has more than {_MOST_VALUES} values; give hyper-parameters alone")


def _check(values: Mapping[str, Any], algorithm: Callable[..., Any]) -> None:
    """Refuse what the algorithm does not take, and what is of another kind than its default."""
    parameters = inspect.signature(algorithm).parameters
    for name, value in values.items():
        if name in ("noise_type", "noise_std"):
            continue
        if name in _OWN or name not in parameters:
            raise InputError(f"{short(str(name))} is no hyper-parameter of {algorithm.__name__}")
        default = parameters[name].default
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if name == "policy_kwargs" and not isinstance(value, dict):
            raise InputError(f"policy_kwargs is {quoted(value)}; give a mapping")
        if isinstance(default, bool) and not isinstance(value, bool):
            raise InputError(f"{name} is {quoted(value)}; give true or false")
        if type(default) in (int, float) and not (number or name in _TEXT):
            raise InputError(f"{name} is {quoted(value)}; give a number")
        if name in _COUNTS and (type(value) is not int or value < 1):
            raise InputError(f"{name} is {quoted(value)}; give a whole number of 1 or more")


def _count(values: dict[str, Any], name: str) -> int:
    value = values.pop(name, None)
    if isinstance(value, float) and value.is_integer():  # !!float 1e6
        value = int(value)
    if type(value) is not int or value < 1:
        raise InputError(f"{name} is {quoted(value)}; give a whole number of 1 or more")
    if name == "n_envs" and value > _MOST_LANES:
        raise InputError(f"{name} is {quoted(value)}; give {_MOST_LANES} at most")
    return value


def _wrappers(listed: Any) -> dict[str, Any]:
    """Read the two wrappers of this package; each has a vector twin, which is used here."""
    found: dict[str, Any] = {}
    for entry in listed if isinstance(listed, list) else [listed]:
        name, options = entry, dict[str, Any]()
        if isinstance(entry, dict) and len(entry) == 1:
            ((name, options),) = entry.items()
        takes = _WRAPPERS.get(name) if isinstance(name, str) else None
        if takes is None:
            raise InputError(
                f"env_wrapper {quoted(name)} is unknown; known are {', '.join(_WRAPPERS)}"
            )
        if not isinstance(options, dict | None):
            raise InputError(f"{name} is {quoted(options)}; give its options by name")
        for option, value in (options or {}).items():
            if option not in takes:
                raise InputError(
                    f"{name} has no option {quoted(option)}; it has {', '.join(takes)}"
                )
            if option == "history" and not (type(value) is int and 0 <= value <= _LONGEST):
                raise InputError(
                    f"{option} of {name} is {quoted(value)}; give a whole number up to {_LONGEST}"
                )
            if not is_finite(value):
                raise InputError(f"{option} of {name} is {quoted(value)}; give a number")
            found[option] = value
    return found


def _schedule(name: str, text: str) -> Callable[[float], float]:
    """Read ``lin_3e-4``: linear from that value to 0, over what is left of the training."""
    word, _, number = text.partition("_")
    try:
        first = float(number)
    except ValueError:
        first = -1.0
    if word != "lin" or first < 0.0:
        raise InputError(
            f"{name} is {quoted(text)}; give a number, for example 0.0003, or lin_3e-4"
        )
    return lambda left: first * left


def _noise(values: Mapping[str, Any]) -> Any:
    from stable_baselines3.common.noise import NormalActionNoise

    kind, deviation = values.get("noise_type"), values.get("noise_std")
    if kind != "normal" or not is_finite(deviation) or float(deviation or 0.0) < 0.0:
        raise InputError(
            f"noise_type is {quoted(kind)} with noise_std {quoted(deviation)}; give normal and a deviation of 0 or more"
        )
    import numpy as np

    return NormalActionNoise(mean=np.zeros(1), sigma=float(deviation or 0.0) * np.ones(1))
