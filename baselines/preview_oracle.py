"""``preview-oracle``: what could be reached by somebody who knows the reference beforehand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from baselines.base import Controller
from baselines.classical_static import ClassicalStatic
from baselines.feedforward import checked_reference
from baselines.feedforwards import FEEDFORWARDS
from baselines.preview_inversion import invert_ahead
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Share of the scale below which an error is that of actions, which are float32.
_ENOUGH = 1e-7


class PreviewOracle(Controller):
    """Plays back a command planned over the whole reference; optimality gaps are measured against it.

    :meth:`plan` inverts the belief iteratively (:mod:`baselines.preview_inversion`), once from the
    static inverse and once from the best feedforward that is within its stability limit, and keeps
    the better for each lane: so on its belief it is never worse than one of those. It may look
    ahead, as the plant's right-half-plane zero asks; a causal compensator cannot. What it learns is
    low-passed at 4 kHz, so it does not dither.

    Parameters
    ----------
    belief, layout
        As :class:`baselines.base.Controller`.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> oracle = PreviewOracle(plant, ObservationLayout.for_plant(plant, ts_s=5e-5))
    >>> r = 10.0 * np.sin(2 * np.pi * 50.0 * 5e-5 * np.arange(800))[:, None]
    >>> u = oracle.plan(r)
    >>> bool(np.abs(Plant(plant, 5e-5).simulate(u) - r).max() < 0.02)
    True

    Notes
    -----
    Where the belief's rate is band-limited below A / (2π S δ2), or Ts is above 2 S δ2 / A, the
    all-sliding plant has a causal inverse too, and only the number of iterations and the
    smoothness stand between the plan and no error at all.
    """

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        super().__init__(belief, layout)
        self._plan: Array | None = None

    def plan(self, reference_um: ArrayLike) -> Array:
        """Invert the belief over the references of the episodes to come.

        Parameters
        ----------
        reference_um
            r(0) ... r(K-1) (µm), ``(K, B)``: one lane for each episode side by side. Lane b is
            played whenever episode b begins anew, until the next plan. One lane serves all.

        Returns
        -------
        float64[K, B]
            u(k) (V); u(0) is the command at rest. The last one is held beyond the end.

        Raises
        ------
        InputError
            The reference has another shape, less than two samples, or is not finite.
        """
        reference = checked_reference(reference_um)
        if len(reference) < 2:
            raise InputError("a reference of one sample to plan over; give two samples or more")
        self._plan = invert_ahead(
            self.belief,
            self.layout.ts_s,
            self.limits,
            reference,
            self._starting_commands(reference),
            _ENOUGH * self.layout.scale_um,
        )
        return self._plan.copy()

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest: the number of samples played, float64[1, B]."""
        return np.zeros((1, len(reference_um)))

    def next_command(
        self, observation: NDArray[np.floating[Any]], reference_um: Array, state: Array
    ) -> Array:
        """Play u(k+1); see :meth:`baselines.base.Controller.next_command`.

        Raises
        ------
        InputError
            There is no plan, or one for another number of episodes.
        """
        if self._plan is None:
            raise InputError(
                "the preview oracle has no plan; call plan(reference_um) with the whole reference, (samples, lanes), before an episode"
            )
        samples, planned = self._plan.shape
        lanes = state.shape[1]
        if planned not in (1, lanes):
            raise InputError(
                f"the preview oracle's plan has {planned} lanes for {lanes} episodes; plan one lane for each, or one for all"
            )
        state += 1.0
        now = np.minimum(state[0].astype(np.int64), samples - 1)
        command: Array = self._plan[now, np.arange(lanes) if planned > 1 else 0]
        return command

    def _starting_commands(self, reference_um: Array) -> list[Array]:
        lanes = reference_um.shape[1]
        plant = Plant(self.belief, self.layout.ts_s, lanes)
        static = best = np.empty_like(reference_um)
        smallest = np.full(lanes, np.inf)
        for feedforward in FEEDFORWARDS.values():
            compensator = feedforward(self.belief, self.layout)
            if not compensator.is_stable:
                continue
            if compensator.needed_preview > self.layout.preview:  # the whole reference is known
                seeing = replace(self.layout, preview=compensator.needed_preview)
                compensator = feedforward(self.belief, seeing)
            u = np.full_like(reference_um, self.limits.rest_V)
            u[1:] = compensator.command_block(reference_um[1:], compensator.start(reference_um[0]))
            plant.reset(u0_V=self.limits.rest_V)
            rms = np.sqrt(np.mean((reference_um - plant.simulate(u))[1:] ** 2, axis=0))
            best = np.where(rms < smallest, u, best)
            smallest = np.minimum(rms, smallest)
            if isinstance(compensator, ClassicalStatic):
                static = u
        return [static, best]
