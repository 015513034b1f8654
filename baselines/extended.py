"""``extended-inverse``: the classical inverse among the inverses of the belief's effects."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from baselines.base import Observation, limit_block
from baselines.classical import ClassicalReferenceRate
from baselines.feedforward import checked_reference
from baselines.inverses import Inverse, inverses_of
from baselines.inverses.chain import (
    congruent_inverse_block,
    followed,
    growth,
    rising_range,
    run_stages,
    start_stages,
)
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel, pack
from rdpi_gym.plant.cores.play import given_rate_block
from rdpi_gym.support.arrays import Array


class ExtendedInverse(ClassicalReferenceRate):
    """Undoes the effects of its belief from the outside in, around the classical inverse.

    The reference passes the inverses of the output effects, the classical inverse at the rate of
    what is left of it, and the inverses of the input effects. Some of them look ahead along the
    reference: :attr:`needed_preview` says how far. Without effects it is
    ``classical-reference-rate``.

    Its memory has the rows of that one, then one that is 0 before the first sample, then those of
    the stages.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> from rdpi_gym.plant.effects import load_effect
    >>> slow = named_plant("P5-static")
    >>> plant = replace(slow, effects=(load_effect("delay")(delay_s=2e-3),))
    >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-3, preview=3)
    >>> controller = ExtendedInverse(plant, layout)
    >>> r = 10.0 * np.sin(np.arange(100.0) / 10.0)[:, None]
    >>> y = Plant(plant, 1e-3).simulate(controller.command_block(r))
    >>> bool(np.abs(y - r)[3:-2].max() < 1e-12), controller.needed_preview
    (True, 3)
    """

    name = "extended-inverse"
    inverts_effects = True

    def __init__(self, belief: PlantModel, layout: ObservationLayout) -> None:
        rest_V = min(max(0.0, layout.command_range_V[0]), layout.command_range_V[1])
        self.inverses = inverses_of(
            belief, layout.ts_s, layout.scale_um, rest_V, shown_ahead=layout.preview - 1
        )
        super().__init__(belief, layout)
        row = len(self._rest) + 1
        self._stages: dict[str, list[tuple[Inverse, slice]]] = {}
        for name, stages in (("output", self.inverses.output), ("command", self.inverses.command)):
            self._stages[name] = []
            for stage in stages:
                self._stages[name].append((stage, slice(row, row + stage.rows)))
                row += stage.rows

    @property
    def needed_preview(self) -> int:
        """Samples of the reference that a layout should show ahead for the inverses to be whole."""
        return 1 + self.inverses.wanted_ahead

    def warning(self) -> str | None:
        """Return one line where effects of the belief are not, or not wholly, inverted, else None."""
        said = []
        if self.inverses.passed_over:
            names = ", ".join(self.inverses.passed_over)
            said.append(f"{names} of belief {self.belief.name} passed over for want of an inverse")
        if self.inverses.short:
            names = ", ".join(self.inverses.short)
            said.append(
                f"{names} inverted in part: preview {self.layout.preview}, {self.needed_preview} needed"
            )
        return f"incomplete inverse: {', '.join(said)}" if said else None

    def _packed(self) -> Array:
        if self.inverses.congruency is not None:
            return pack([self.model], self.layout.ts_s, [0.0])
        return super()._packed()

    def _rest_memory(self, plays_V: Array) -> Array:
        return plays_V if self.inverses.congruency is not None else super()._rest_memory(plays_V)

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        own = super().start(reference_um)
        if self.inverses.changes_nothing:
            return own
        behind, x = start_stages(self.inverses.output, reference_um - self.belief.offset_um)
        own[-1] = x
        rest = np.full(len(reference_um), self.inverses.rest_V)
        before, _ = start_stages(self.inverses.command, rest)
        return np.concatenate([own, np.zeros((1, len(x))), *behind, *before])

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Answer r(k+1) and what follows; see :meth:`baselines.base.Baseline.next_command`."""
        if self.inverses.changes_nothing:
            return super().next_command(observation, reference_um, state)
        shown = self.layout.reference_um(observation, slice(1, 2 + self.inverses.ahead))
        command: Array = self._answer(np.ascontiguousarray(shown.T), state)[0]
        return command

    def corrected_command(
        self, observation: Observation, correction_um: Array, state: Array
    ) -> Array:
        """Return u(k+1) (V), ``(B,)``, with feedback inside: what the plays are to give is corrected."""
        shown = self.layout.reference_um(observation, slice(1, 2 + self.inverses.ahead))
        block = np.ascontiguousarray(shown.T)
        if self.inverses.changes_nothing:
            command: Array = self._through(block, state, False, correction_um)[0]
        else:
            command = self._answer(block, state, correction_um)[0]
        return command

    def command_block(
        self,
        reference_um: ArrayLike,
        state: Array | None = None,
        ahead_um: ArrayLike | None = None,
    ) -> Array:
        """Return the commands that answer a reference, row by row.

        Parameters
        ----------
        reference_um, state
            As :meth:`baselines.feedforward.Feedforward.command_block`.
        ahead_um
            What follows the block (µm), ``(M, B)``, for inverses that look ahead; its last row, or
            that of the block, is held where M is less than ``needed_preview - 1``. Splitting a
            block changes nothing where what follows is given.

        Returns
        -------
        float64[T, B]
            u(k) (V), within the limits.

        Raises
        ------
        InputError
            The reference has another shape or is not finite.
        """
        block = checked_reference(reference_um)
        memory = self.start(block[0]) if state is None else state
        if self.inverses.changes_nothing:
            return super().command_block(block, memory)
        known = block if ahead_um is None else np.concatenate([block, checked_reference(ahead_um)])
        samples = len(block) + self.inverses.ahead
        held = np.repeat(known[-1:], max(samples - len(known), 0), axis=0)
        return self._answer(np.concatenate([known[:samples], held]), memory)

    def _answer(self, shown_um: Array, state: Array, correction_um: Array | float = 0.0) -> Array:
        """Answer all rows but the last `ahead`, which an episode that runs has yet to see."""
        ahead, flag = self.inverses.ahead, len(self._rest)
        fresh = state[flag] == 0.0
        state[flag] = 1.0
        if fresh.all() or not fresh.any():
            begins = bool(fresh[0])
            known = shown_um if begins else shown_um[ahead:]
            return self._through(known, state, begins, correction_um)
        correction = np.broadcast_to(correction_um, fresh.shape)
        u = np.empty((len(shown_um) - ahead, len(fresh)))
        for begins, lanes in ((True, fresh), (False, ~fresh)):
            part = np.ascontiguousarray(shown_um[0 if begins else ahead :, lanes])
            moved = np.ascontiguousarray(state[:, lanes])
            u[:, lanes] = self._through(part, moved, begins, correction[lanes])
            state[:, lanes] = moved
        return u

    def _through(
        self, reference_um: Array, state: Array, begins: bool, correction_um: Array | float = 0.0
    ) -> Array:
        own = state[: len(self._rest)]
        x = run_stages(self._stages["output"], reference_um - self.belief.offset_um, state, begins)
        v = self._reference_rate(x, own)
        for effect in self.inverses.rate:
            v = followed(effect, v, self.layout.ts_s)
        own[-1] = x[-1]
        x = np.ascontiguousarray(x + correction_um)
        u = np.empty_like(x)
        parameters = np.repeat(self._parameters[:, :1], x.shape[1], axis=1)
        if self.inverses.congruency is None:
            given_rate_block(x, v, parameters, own[:-1], u)
        else:
            powers = growth(self.inverses.congruency, self.layout.ts_s, self.model)
            low, high = rising_range(self.model, powers, self.layout.command_range_V)
            congruent_inverse_block(x, v, powers, parameters, own[:-1], low, high, u)
        u = np.ascontiguousarray(run_stages(self._stages["command"], u, state, begins))
        limit_block(u, own[0], *self.limits)
        return u
