"""``classical-*``: the inverse of the RDPI model, itself a weighted sum of plays; ``extended-inverse``: with effects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from baselines.base import Observation, limit_block, limited
from baselines.feedforward import (
    Feedforward,
    checked_reference,
    classical_polynomial,
    default_cutoff_hz,
    limiting_cutoff_hz,
)
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
from rdpi_gym.plant import RDPI, PlantModel, pack
from rdpi_gym.plant.cores.play import given_rate_block, play
from rdpi_gym.support.arrays import Array


def pack_inverse(models: Sequence[RDPI], ts_s: float) -> Array:
    """Pack the inverse's parameters: 1/a_0, b_i, thresholds at rest s_i (µm), a_0 δ2, rate pole.

    Notes
    -----
    c_i = a_0 + ... + a_i, b_i = -a_i / (c_i c_{i-1}), s_i = Σ_{j<i} c_j (r_{j+1} - r_j); with Eq. 8
    the gaps do not depend on the rate, so it enters every s_i as a_0 δ2 |v| and the inverse exists.
    """
    columns = []
    for model in models:
        c = np.cumsum(model.weights)
        b = -np.asarray(model.weights[1:]) / (c[1:] * c[:-1])
        s = np.cumsum(c[:-1] * np.diff([0.0, *model.thresholds_V]))
        columns.append([1.0 / c[0], *b, *s, c[0] * model.delta2_s, model.rate_pole(ts_s), 0.0])
    return np.ascontiguousarray(np.array(columns, dtype=np.float64).T)


def inverse_memory(model: RDPI, memory_V: ArrayLike) -> Array:
    """State of the inverse that belongs to the plant's play states."""
    xi = np.asarray(memory_V, dtype=np.float64)
    a = np.asarray(model.weights[1:])
    c = np.cumsum(model.weights)[1:]
    behind = np.cumsum((a * xi)[::-1])[::-1] - a * xi
    return np.asarray(c * xi + behind, dtype=np.float64)


@njit(cache=True)
def classical_own_rate(
    y_r: Array,
    p: Array,
    state: Array,
    ts: float,
    u: Array,
    low: float = -np.inf,
    high: float = np.inf,
    step: float = np.inf,
) -> None:
    """Inverse at the rate of its own command, one sample old, literal or low-passed as `p` says."""
    n = (p.shape[0] - 4) // 2
    for t in range(y_r.shape[0]):
        for b in range(y_r.shape[1]):
            shift = p[2 * n + 1, b] * abs(state[1, b])
            command = p[0, b] * y_r[t, b]
            for i in range(n):
                s = p[n + 1 + i, b] + shift
                eta = play(state[2 + i, b], y_r[t, b] - s, y_r[t, b] + s)
                state[2 + i, b] = eta
                command += p[1 + i, b] * eta
            command = limited(command, state[0, b], low, high, step)
            last = command if np.isnan(state[0, b]) else state[0, b]
            pole = p[2 * n + 2, b]
            state[1, b] = pole * state[1, b] + (1.0 - pole) * ((command - last) / ts)
            state[0, b] = command
            u[t, b] = command


class ClassicalInverse(Feedforward):
    """u = y/a_0 + Σ b_i Φ_{s_i}[y], thresholds s_i that grow with the command's rate by a_0 δ2 |v|.

    Its plays slide along the reference: where the command is clipped they know nothing of it.
    """

    def _packed(self) -> Array:
        return pack_inverse([self.model], self.layout.ts_s)

    def _rest_memory(self, plays_V: Array) -> Array:
        return inverse_memory(self.model, plays_V)


class ClassicalReferenceRate(ClassicalInverse):
    """The classical inverse at the rate of the reference over A, (r(k+1) - r(k)) / (A Ts).

    That is the command's rate while every play slides. Nothing is fed back, so it is always stable.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> controller = ClassicalReferenceRate(plant, ObservationLayout.for_plant(plant, ts_s=1e-3))
    >>> controller.command_block(np.array([[0.0], [1.0]])).round(3).tolist()
    [[0.0], [1.372]]
    """

    name = "classical-reference-rate"

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        v = self._reference_rate(reference_um, state)
        given_rate_block(reference_um - self.belief.offset_um, v, parameters, state[:-1], u)
        limit_block(u, state[0], *self.limits)


class ClassicalStatic(ClassicalReferenceRate):
    """The classical inverse with δ2 ignored: exact at low rates, and what most laboratories use.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> ClassicalStatic(plant, ObservationLayout.for_plant(plant, ts_s=5e-5)).model.delta2_s
    0.0
    """

    name = "classical-static"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the static model."""
        return hysteresis.static()


class ClassicalLiteral(ClassicalInverse):
    """The classical inverse at the rate of its own command one sample ago (Eq. 5).

    With all plays sliding it is the loop z² - κ z + κ = 0, κ = S δ2 / (A Ts): stable only while
    Ts > S δ2 / A.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P5")
    >>> ClassicalLiteral(plant, ObservationLayout.for_plant(plant, ts_s=1e-4)).warning()
    'outside its stability limit: pole magnitude 1.23 at Ts = 0.0001 s with belief P5; stable for Ts above 0.000151 s'
    """

    name = "classical-literal"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with the literal rate of Eq. 5."""
        return hysteresis.band_limited(None)

    def loop_polynomial(self) -> Array:
        """See :func:`baselines.feedforward.classical_polynomial`."""
        return classical_polynomial(self.model, self.layout.ts_s)

    def stable_where(self) -> str:
        """Say the limit on Ts."""
        return f"for Ts above {1.0 / self.model.zero_rad_s:.3g} s"

    def _fill(self, reference_um: Array, parameters: Array, state: Array, u: Array) -> None:
        displacement = reference_um - self.belief.offset_um
        classical_own_rate(displacement, parameters, state[:-1], self.layout.ts_s, u, *self.limits)


class ClassicalLowPassed(ClassicalLiteral):
    """The classical inverse at its own rate through a first-order low-pass.

    The loop is stable at every Ts while the cut-off is below A / (2π S δ2); the cut-off is 500 Hz,
    or 0.6 of that limit where that is lower.

    Examples
    --------
    >>> from rdpi_gym.envs.layout import ObservationLayout
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> controller = ClassicalLowPassed(plant, ObservationLayout.for_plant(plant, ts_s=5e-5))
    >>> round(controller.model.rate_bandwidth_hz), controller.warning()
    (492, None)
    """

    name = "classical-low-passed"

    def compensator_model(self, hysteresis: RDPI) -> RDPI:
        """Return the model with its rate low-passed at the compensator's cut-off."""
        return hysteresis.band_limited(default_cutoff_hz(hysteresis))

    def stable_where(self) -> str:
        """Say the limit on the cut-off."""
        return f"for a low-pass below {limiting_cutoff_hz(self.model):.3g} Hz"


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
