"""A search for missing effects in one picture: the error from model to model, and the candidates."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rdpi_gym.diagnosis.results import SearchResult
from rdpi_gym.report.discovery.sentences import staircase
from rdpi_gym.report.style import MUTED, PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 8  # candidates


def draw_search(figure: Figure, result: SearchResult) -> Any:
    """Draw the error of each model and of the candidates of the first round into an empty figure."""
    axes = figure.subplots(1, 2)
    stairs = staircase(result)
    names = [name.replace(", ", ",\n") for name, _ in stairs]
    validation = [errors.validation_rmse_um for _, errors in stairs]
    axes[0].plot(names, validation, "o-", color=PALETTE[0], label="validation records")
    training = [errors.train_rmse_um for _, errors in stairs]
    axes[0].plot(names, training, "s:", color=MUTED, label="training records")
    axes[0].set_ylim(bottom=0.0)
    axes[0].set_ylabel("RMS error ({output_unit})")
    axes[0].margins(x=0.15)
    known = [c for c in result.candidates if math.isfinite(c.errors.validation_rmse_um)][:_SHOWN]
    added = {candidate.effect for candidate in result.added}
    axes[1].barh(
        [candidate.effect for candidate in known] or ["no candidate"],
        [candidate.errors.validation_rmse_um for candidate in known] or [0.0],
        color=[PALETTE[0] if c.effect in added else "#C3CAD1" for c in known] or None,
    )
    axes[1].invert_yaxis()
    axes[1].set_xlabel("RMS error with the candidate ({output_unit})")
    axes[0].axhline(result.noise_floor_um, color=PALETTE[2], linestyle="--", label="noise floor")
    axes[1].axvline(result.noise_floor_um, color=PALETTE[2], linestyle="--")
    axes[0].legend()
    return axes
