"""What a sweep of hyper-parameters found."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BEST = "best.yml"


@dataclass(frozen=True)
class Trial:
    """A training of a sweep, done.

    Parameters
    ----------
    number
        From 0; its folder is ``trials/NUMBER``.
    tried
        Hyper-parameters that were chosen.
    reward, rmse_um, compensator_rmse_um
        Of the policy that was kept, on held-out plants; None: the training diverged.
    seconds
        It took.
    """

    number: int
    tried: dict[str, Any]
    reward: float | None
    rmse_um: float | None
    compensator_rmse_um: float | None
    seconds: float | None


@dataclass(frozen=True)
class Sweep:
    """A search of hyper-parameters, as far as it was asked for.

    Parameters
    ----------
    folder
        Holds ``best.yml``, ``trials.csv``, ``trials/NUMBER`` and the journal.
    trials
        All of them.
    """

    folder: Path
    trials: tuple[Trial, ...]

    @property
    def best(self) -> Trial:
        """The one with the highest reward."""
        return max((t for t in self.trials if t.reward is not None), key=lambda t: t.reward or 0.0)

    @property
    def hyperparameters(self) -> Path:
        """Its hyper-parameters, a file for ``rdpi train --hyperparameters``."""
        return self.folder / BEST

    def __str__(self) -> str:
        best, first = self.best, self.trials[0]
        diverged = sum(trial.reward is None for trial in self.trials)
        begun = "diverged" if first.rmse_um is None else f"{first.rmse_um:.3g} um"
        tried = ", ".join(f"{name} {text_of(value)}" for name, value in best.tried.items())
        return "\n".join(
            [
                f"RMSE {best.rmse_um:.3g} um on held-out plants: trial {best.number} of "
                f"{len(self.trials)}, {diverged} of which diverged; the first, with the file's values, "
                f"{begun}; the compensator {best.compensator_rmse_um:.3g} um",
                f"tried: {tried}",
                f"written: {self.hyperparameters}",
            ]
        )


def text_of(value: Any) -> str:
    """Return a hyper-parameter as tables have it."""
    return value if isinstance(value, str) else json.dumps(value)
