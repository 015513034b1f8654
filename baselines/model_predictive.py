"""``model-predictive``, and the bound of everybody with a preview: horizons that recede."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from baselines.base import Baseline, Observation, Rows, product
from baselines.core_inverse import hysteresis_inverse, inverse_command
from baselines.loops import LinearSystem, Response, belief_path
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import Plant, PlantModel
from rdpi_gym.support.arrays import Array

MODE_FACTORS = (0.6, 0.8, 1.2, 1.4)
"""Factors on the believed frequency of a mode at which the certificate asks for stability."""
MOST_GAIN = 0.9
"""Largest loop gain that is left to modes elsewhere than believed."""


class ModelPredictive(Tunable):
    """w(k+1 ... k+N) minimise Σ (r - d - y)² + ρ Σ (w(j) - 2 w(j-1) + w(j-2))², N the preview; u inverts w.

    y is what the belief's lags, modes and delay make of w, the displacement of the hysteresis. The
    hysteresis itself is linearised about the branch it is on by its inverse, which is slid along w
    sample by sample: so the problem is linear, its solution a row of gains on the reference shown,
    the model's state and the last two w, and the horizon recedes at the price of a product. The
    command is clipped to its range and largest change. d = measured - y, low-passed, is held over
    the horizon: no constant disturbance leaves an offset. Its band is lowered until the small-gain
    theorem covers a mode at 0.6 to 1.4 times the believed frequency.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> from rdpi_gym.plant.effects import load_effect
    >>> stage = replace(P10, effects=(load_effect("resonance")(f0_hz=739.0, damping=0.03),))
    >>> layout = ObservationLayout.for_plant(stage, ts_s=1e-4, preview=8)
    >>> ModelPredictive(stage, layout, {"band_hz": 20.0}).certificate()
    'small gain: stable with a mode of 0.6 to 1.4 times the believed frequency, as far as the loop is linear; largest gain 0.483'

    Notes
    -----
    Offset-free prediction: Maeder, Borrelli, Morari, Automatica 45, 2009. Without limits within the
    horizon the quadratic programme has this closed form (Rawlings, Mayne, Diehl, Model Predictive
    Control, 2017, 1.3); only the last clipping knows of them.
    """

    name = "model-predictive"
    inverts_effects = True
    knobs = (
        Knob("smoothness", 1e-6, 10.0, 1e-2, logarithmic=True),
        Knob("band_hz", 1.0, 500.0, 20.0, "Hz", logarithmic=True),
    )

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        self._inverse = hysteresis_inverse(belief, layout)
        path = belief_path(belief, layout.ts_s)
        self.model = path.dynamics
        self.wanted_preview = math.ceil(path.delay_s / layout.ts_s) + 3
        self._gains = horizon_gains(self.model, layout.preview, self.settings["smoothness"])
        self.band_hz = self._safe_band_hz()
        self._pass = 1.0 - math.exp(-2.0 * math.pi * self.band_hz * layout.ts_s)
        states = np.eye(self.model.order) - self.model.a
        self._at_rest = np.linalg.solve(states, self.model.b) if self.model.order else self.model.b
        self.rows = Rows(
            state=self.model.order,
            wanted=2,
            disturbance=1,
            inverse=len(self._inverse.start(np.zeros(1))),
        )

    @property
    def needed_preview(self) -> int:
        """Delay of slow signals, and three samples."""
        return self.wanted_preview

    def warning(self) -> str | None:
        """Return one line where the horizon ends before the plant has answered, else None."""
        if self.layout.preview >= self.wanted_preview:
            return None
        return f"short horizon: preview {self.layout.preview}, {self.wanted_preview} needed"

    def certificate(self) -> str | None:
        """Return what the small-gain theorem says of a mode elsewhere than believed, else None."""
        if not self._has_mode:
            return None
        largest = self._largest_gain(self.band_hz)
        low, high = min(MODE_FACTORS), max(MODE_FACTORS)
        return (
            f"small gain: stable with a mode of {low} to {high} times the believed frequency, as far as "
            f"the loop is linear; largest gain {largest:.3g}"
        )

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        state, of = np.zeros((self.rows.total, len(reference_um))), self.rows.of
        of(state, "state")[:] = self._at_rest[:, None] * reference_um
        of(state, "wanted")[:] = reference_um
        of(state, "inverse")[:] = self._inverse.start(reference_um)
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Correct by y(k), answer all that is shown; see :meth:`baselines.base.Baseline.next_command`."""
        of, model = self.rows.of, self.model
        x, last, disturbance = of(state, "state"), of(state, "wanted"), of(state, "disturbance")
        expected = product(model.c, x) + model.d * last[1]
        measured = self.layout.measured_um(observation)
        disturbance[0] += self._pass * (measured - expected - disturbance[0])
        x[:] = product(model.a, x) + np.outer(model.b, last[1])
        shown = self.layout.reference_um(observation)[:, 1:].T - disturbance
        on_reference, on_state, on_last = self._gains
        wanted = product(on_reference, shown) + product(on_state, x) + product(on_last, last)
        last[0], last[1] = last[1].copy(), wanted
        return inverse_command(self._inverse, observation, wanted, of(state, "inverse"))

    @property
    def _has_mode(self) -> bool:
        return any(effect.name == "resonance" for effect in self.belief.effects)

    def _safe_band_hz(self) -> float:
        """The band that is asked for (Hz), lowered until the certificate holds with a margin."""
        band: float = self.settings["band_hz"]
        while self._has_mode and self._largest_gain(band) > MOST_GAIN:
            band *= 0.85
        return band

    def _largest_gain(self, band_hz: float) -> float:
        """Largest |F Q (P - P̂)| over the frequencies, for modes of :data:`MODE_FACTORS`.

        Q is what d makes of w; by the internal model only what the path is otherwise than believed
        is fed back.
        """
        later, answer, unlike = self._responses
        kept = math.exp(-2.0 * math.pi * band_hz * self.layout.ts_s)
        low = (1.0 - kept) / (1.0 - kept * later)
        return max(float(np.abs(low * answer * each).max()) for each in unlike)

    @cached_property
    def _responses(self) -> tuple[Response, Response, list[Response]]:
        """1/z, Q, and by how much the path with each moved mode is another than the believed one."""
        z = np.exp(1j * np.geomspace(1e-3, math.pi, 3000))
        on_reference, on_state, on_last = self._gains
        model, later = self.model, 1.0 / z
        fed_back = LinearSystem(model.a, model.b, on_state, 0.0).response(z)
        own = 1.0 - fed_back - on_last[1] * later - on_last[0] * later**2
        answer = on_reference.sum() * later / own
        believed = model.response(z)
        moved = [belief_path(with_mode_at(self.belief, f), self.layout.ts_s) for f in MODE_FACTORS]
        return later, answer, [path.dynamics.response(z) - believed for path in moved]


def with_mode_at(belief: PlantModel, factor: float) -> PlantModel:
    """Return a belief with its mode at so many times its frequency; one without a mode as it is."""
    effects = [
        type(e).within_bounds(**{**e.values, "f0_hz": factor * e.values["f0_hz"]})
        if e.name == "resonance"
        else e
        for e in belief.effects
    ]
    return replace(belief, effects=tuple(effects))


def horizon_gains(
    model: LinearSystem, horizon: int, smoothness: float
) -> tuple[Array, Array, Array]:
    """Return the first w of the plan as gains on the reference ahead, the state, and the last two w."""
    free, pulse = [], [model.d]
    row = model.c
    for _ in range(horizon):
        free.append(row)
        pulse.append(float(row @ model.b))
        row = row @ model.a
    lag = np.subtract.outer(np.arange(horizon), np.arange(horizon))
    forced = np.where(lag >= 0, np.array(pulse)[np.maximum(lag, 0)], 0.0)
    bends = second_differences(horizon)
    own = bends[:, 2:]
    normal = forced.T @ forced + smoothness * own.T @ own
    solved = np.linalg.solve(normal, np.hstack([forced.T, smoothness * own.T @ bends[:, :2]]))
    on_reference, on_last = solved[0, :horizon], -solved[0, horizon:]
    return on_reference, -on_reference @ np.array(free).reshape(horizon, model.order), on_last


HORIZON_BOUND = "true-plant-horizon"
"""Name of :class:`TrueHorizon` in tables."""
SMOOTHING = 1e-4
"""Price of the second difference of the command, in units of the squared error that the largest gain
makes of it: what keeps the plan from ringing at zeros that sampling makes."""
# Of the command's range: the step that derivatives are taken with.
_STEP = 1e-3


class TrueHorizon(Baseline):
    """Knows the true plants and all that they remember, and looks as far ahead as anybody.

    In each sample it improves the commands over the preview by a Gauss-Newton step on the plant
    itself, for the smallest squared error, and sets the first of them: each is improved as often as
    there are samples of preview before it is set. No reading enters, so no noise does. A controller that knew the plant exactly could do as much: the distance to it is the
    price of not knowing. It is no proof of a smallest error, as its horizon ends and its commands
    are kept smooth. Like the full-preview inversion it holds what no controller may hold, so
    :func:`~baselines.make_controller` does not make it.

    Parameters
    ----------
    plant
        The true plants, one a lane; of its own, as it is run along.
    layout
        As :class:`baselines.base.Baseline`.
    smoothing
        Price of the second difference of the command, in units of the squared error that the largest
        gain makes of it.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> p5 = named_plant("P5-static")
    >>> layout = ObservationLayout.for_plant(p5, ts_s=1e-3, preview=4)
    >>> bound = TrueHorizon(Plant(p5, 1e-3), layout)
    >>> flat = np.zeros((1, layout.size), dtype=np.float32)
    >>> flat[0, 1:5] = 0.1  # r = 1 µm from the next sample on
    >>> action, _ = bound.predict(flat)
    >>> check = Plant(p5, 1e-3)
    >>> bool(abs(check.simulate([0.0, float(layout.place_to_V(action[0, 0]))])[1] - 1.0) < 0.02)
    True
    """

    def __init__(
        self, plant: Plant, layout: ObservationLayout, smoothing: float = SMOOTHING
    ) -> None:
        super().__init__(plant.models[0], layout)
        self._twin, self._count = plant, layout.preview + 1
        self._models = plant.models
        self._many = Plant(list(plant.models) * self._count, layout.ts_s)
        h = layout.preview
        gain = np.array([model.hysteresis.A for model in plant.models])
        self._second = second_differences(h)
        self._price = smoothing * gain**2
        self._plan = np.zeros((h + 2, plant.lanes))

    def warning(self) -> str | None:
        """Say that it is a bound."""
        return "it holds the true plant, as no controller may"

    def start(self, reference_um: Array) -> Array:
        """Put the true plants to rest, float64[0, B]."""
        rest = self.limits.rest_V
        self._twin.reset(u0_V=rest)
        self._twin.step(np.full((1, self._twin.lanes), rest))
        self._plan[:] = rest
        return np.zeros((0, len(reference_um)))

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """Plan, and set the first command; see :meth:`baselines.base.Baseline.next_command`."""
        target = self.layout.reference_um(observation)[:, 1:].T  # (H, B)
        here = [np.tile(part, (1, self._count)) for part in self._twin.snapshot()]
        if self._twin.models is not self._models:
            self._models = self._twin.models
            self._many.retune(list(self._models) * self._count)
        # Rows 0 and 1 are the last two commands; the plan goes on as it ended.
        plan = np.concatenate([self._plan[1:], 2.0 * self._plan[-1:] - self._plan[-2:-1]])
        plan[2:] += self._improvement(target, plan, here)
        np.clip(plan, self.limits.low_V, self.limits.high_V, out=plan)
        self._plan = plan
        command = plan[2]
        self._twin.step(np.ascontiguousarray(command[None]))
        return np.array(command, dtype=np.float64)

    def _improvement(self, target: Array, plan: Array, here: list[Array]) -> Array:
        h, lanes = target.shape
        step = _STEP * (self.limits.high_V - self.limits.low_V)
        tried = np.repeat(plan[2:, None, :], self._count, axis=1)
        for j in range(h):
            tried[j, j + 1] += step
        self._many.restore(here)
        y = self._many.simulate(tried.reshape(h, -1)).reshape(h, self._count, lanes)
        slope = ((y[:, 1:] - y[:, :1]) / step).transpose(2, 0, 1)  # (B, out, in)
        error = (target - y[:, 0]).T[:, :, None]
        own = self._second[:, 2:]
        bent = (self._second @ plan).T[:, :, None]
        price = self._price[:, None, None]
        turned = slope.transpose(0, 2, 1)
        normal = turned @ slope + price * (own.T @ own)
        wanted = turned @ error - price * (own.T @ bent)
        return np.asarray(np.linalg.solve(normal, wanted)[:, :, 0].T, dtype=np.float64)


def second_differences(horizon: int) -> Array:
    """Return what makes second differences of two past samples and those of a horizon."""
    bends = np.zeros((horizon, horizon + 2))
    for i in range(horizon):
        bends[i, i : i + 3] = 1.0, -2.0, 1.0
    return bends
