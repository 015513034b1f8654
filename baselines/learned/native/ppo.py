"""Hyper-parameters of the PPO of this package."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from baselines.learned.native.update import Law
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


@dataclass(frozen=True)
class NativePPO:
    """Hyper-parameters; those that Stable-Baselines3 has too mean the same and have its names.

    Parameters
    ----------
    learning_rate, clip_range
        Numbers, or functions of the share of the training that is left.
    n_steps
        Steps of each lane in a rollout.
    batch_size, n_epochs, target_kl, ent_coef, vf_coef, max_grad_norm
        As :class:`~baselines.learned.native.update.Law`.
    horizon_s
        Time (s) after which a reward counts 1/e: the discount of a step is exp(-Ts / horizon).
    gae_horizon_s
        The same of the advantage's bias against its variance: lambda is exp(-Ts / gae_horizon).
    normalise_returns
        Whether the critic estimates returns by their running mean and deviation, its last layer
        rescaled as these move (van Hasselt et al., Learning values across many orders of magnitude,
        2016).
    return_memory
        Share of a rollout in these running moments.
    log_std_init
        Logarithm of the exploration's standard deviation at the start.
    net_arch
        Hidden units of actor and of critic, tanh between them.
    adaptive_rate
        Whether the learning rate goes below `learning_rate` where updates diverge by more than
        `target_kl`, and back up where by less. The narrower the exploration has become, the farther
        the same step of the weights leads from the policy that acted.

    Raises
    ------
    InputError
        A value that nothing can be trained with.
    """

    learning_rate: float | Callable[[float], float] = 3e-4
    n_steps: int = 64
    batch_size: int = 2048
    n_epochs: int = 2
    horizon_s: float = 0.005
    gae_horizon_s: float = 0.001
    clip_range: float | Callable[[float], float] = 0.2
    target_kl: float | None = None
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    normalise_returns: bool = True
    return_memory: float = 0.5
    log_std_init: float = -1.5
    net_arch: Sequence[int] = (64, 64)
    adaptive_rate: bool = True

    def __post_init__(self) -> None:
        for name in ("n_steps", "batch_size", "n_epochs"):
            if not is_whole(getattr(self, name), 1):
                raise InputError(
                    f"{name} is {quoted(getattr(self, name))}; give a whole number of 1 or more"
                )
        for name in ("horizon_s", "gae_horizon_s", "max_grad_norm", "return_memory"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0.0):
                raise InputError(f"{name} is {quoted(value)}; give a finite number above 0")
        for name in ("ent_coef", "vf_coef", "log_std_init"):
            if not is_finite(getattr(self, name)):
                raise InputError(f"{name} is {quoted(getattr(self, name))}; give a number")
        if self.target_kl is not None and not (is_finite(self.target_kl) and self.target_kl > 0):
            raise InputError(
                f"target_kl is {quoted(self.target_kl)}; give a number above 0, or null for none"
            )
        if not isinstance(self.net_arch, list | tuple):
            raise InputError(f"net_arch is {quoted(self.net_arch)}; give hidden units, as [64, 64]")

    def law(self, left: float) -> Law:
        """Return the numbers of an update where a share of the training is left."""
        return Law(
            self.batch_size, self.n_epochs, at(self.clip_range, left), self.target_kl,
            self.ent_coef, self.vf_coef, self.max_grad_norm,
        )  # fmt: skip


def at(value: float | Callable[[float], float], left: float) -> float:
    """Return a number, or what a schedule of the share that is left says."""
    return value(left) if callable(value) else value
