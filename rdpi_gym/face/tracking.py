"""`track`: one controller on one plant along a reference of the user's own."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from baselines import Controller
from benchmarks.tracking.episode import play
from benchmarks.tracking.scoring import Caution, cautions, score
from benchmarks.tracking.stages import RATE_BANDWIDTH_HZ
from rdpi_gym.envs.controller import warning_of
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tracking import TrackingTask
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.face.benchmarking import make_controller
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import micrometres

PREVIEW = 16
"""Samples of the reference that are shown ahead where nothing else is asked."""


@dataclass(frozen=True)
class Tracking:
    """A run along a reference.

    Parameters
    ----------
    controller
        Name of what tracked.
    t_s, reference_um, displacement_um, command_V
        Times (s), reference and displacement (µm), command (V), ``(K,)``.
    rmse_um, rmse_percent
        Error over the samples that count (µm rms), and in percent of the reference's peak to peak.
    warning
        What to beware of: outside its stability limit, diverged, saturated; None: nothing.
    cautions
        The same, one by one.
    """

    controller: str
    t_s: Array
    reference_um: Array
    displacement_um: Array
    command_V: Array
    rmse_um: float
    rmse_percent: float
    warning: str | None
    cautions: tuple[Caution, ...] = ()

    def __repr__(self) -> str:
        """Error first, then what to beware of."""
        said = f"{micrometres(self.rmse_um)} ({self.rmse_percent:.3g} %) with {self.controller}"
        return said if self.warning is None else f"{said}; {self.warning}"


@checked
def track(
    controller: str,
    plant: PlantModel | HasPlant | PathLike[str] | str,
    reference_um: ArrayLike,
    ts_s: float,
    *,
    belief: PlantModel | HasPlant | PathLike[str] | str | None = None,
    first: int = 1,
    preview: int = PREVIEW,
    seed: int = 0,
) -> Tracking:
    """Let a controller follow a reference on a plant, from rest at the command nearest 0 V.

    As in :func:`benchmark`, the rate of plant and belief has a cut-off of 800 Hz at most: no sampled
    command follows the literal rate of Eq. 5.

    Parameters
    ----------
    controller
        A name of :data:`rdpi_gym.controllers`.
    plant
        What it drives: a plant, a result that has one, the path of a plant file, or a plant's name.
    reference_um
        Where the plant is to be (µm), ``(K,)``.
    ts_s
        Sampling time (s).
    belief
        What the controller is told of the plant; by default the plant itself.
    first
        First sample that counts in the error.
    preview
        Samples of the reference that are shown ahead.
    seed
        Of the sensor's noise.

    Returns
    -------
    Tracking
        It prints the error.

    Raises
    ------
    InputError
        No such controller or plant, one that does not suit the belief, a reference that is not
        finite or has no motion.

    Examples
    --------
    >>> import numpy as np
    >>> import rdpi_gym as rg
    >>> sine = 5.0 * np.sin(2 * np.pi * 10.0 * np.arange(400) * 1e-3)
    >>> blind = rg.track("none", "P5", sine, 1e-3)
    >>> rg.track("classical-static", "P5", sine, 1e-3).rmse_um < blind.rmse_um / 2
    True
    """
    truth = limit_band(as_plant(plant), RATE_BANDWIDTH_HZ)
    told = truth if belief is None else limit_band(as_plant(belief), RATE_BANDWIDTH_HZ)
    reference = np.array(reference_um, dtype=np.float64)
    if reference.ndim != 1 or not np.isfinite(reference).all():
        raise InputError(f"reference_um of shape {reference.shape}; give finite numbers, (K,)")
    if not 1 <= first < reference.size - 1 or np.ptp(reference[first:]) <= 0:
        raise InputError(
            f"reference_um has {reference.size} samples and does not move from sample {first} on; "
            "give a motion"
        )
    layout = ObservationLayout.for_plant(truth, ts_s, preview)
    made: Controller = make_controller(controller, told, layout)
    # what is shown ahead at the end goes on as the reference ended
    shown = np.pad(reference, (0, preview), mode="edge")
    taken = play(
        made, TrackingTask(truth, layout), shown[:, None], [np.random.default_rng(seed)]
    )  # fmt: skip
    end = reference.size
    y, u, action = (
        part[:end, 0] for part in (taken.displacement_um, taken.command_V, taken.action)
    )
    scored = score(reference, y, u, action, first=first, ts_s=ts_s)
    found = cautions(
        scored, reference[first:], warning=warning_of(made), ts_s=ts_s, identified_V_s=None
    )
    return Tracking(
        controller, np.arange(end, dtype=np.float64) * float(ts_s), reference, y, u, scored.rmse_um, scored.rmse_percent,
        "; ".join(map(str, found)) or None, found,
    )  # fmt: skip
