"""``hybrid``: feedback where the reference rests or creeps along, adaptive feedforward where it moves."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from baselines.adaptive_feedforward import AdaptiveFeedforward
from baselines.base import Observation, Rows
from baselines.loops import Certificate, belief_path, certify, integrator, sampled, unit_delay
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array

BLEND_S = 1e-3
"""Time (s) in which one regime takes over from the other."""
FADE_S = 2e-2
"""Time constant (s) with which the feedback's part is forgotten while the reference moves."""
SECTOR = (0.5, 2.0)
"""Gain of the inverted hysteresis over its design, for which a certificate is sought."""


class Hybrid(Tunable):
    """u inverts w + σ-gated integral: σ = 1 where the reference rests, 0 where it moves.

    The regime is read off the preview: the reference moves where it changes faster than the knob
    `slow_per_s` times the scale, and rests where it has not for as long as the plant is late. While
    it moves, the adaptive feedforward drives and learns. While it rests, there is nothing to learn
    the dynamics from, so what was learned is kept, and an integral of the low-passed error makes up
    for creep and drift. The switch is without a bump: σ slides within a millisecond, it multiplies
    what the integral takes in and not its state, and in motion that state fades.

    Examples
    --------
    >>> from rdpi_gym.plant import named_plant
    >>> plant = named_plant("P10")
    >>> layout = ObservationLayout.for_plant(plant, ts_s=1e-4, preview=8)
    >>> Hybrid(plant, layout, {}).certified.stable
    True

    Notes
    -----
    As the hybrid systems of the paper's [12] (Al Janaideh, Naldi, Marconi, Krejčí, CDC 2012) switch
    between modes of a hysteresis; here the controller switches, by the reference.
    """

    name = "hybrid"
    aliases = ("adaptive-feedforward-integral",)
    knobs = (
        *AdaptiveFeedforward.knobs,
        Knob("crossover_hz", 1.0, 100.0, 15.0, "Hz", logarithmic=True),
        Knob("slow_per_s", 0.05, 50.0, 2.0, "1/s", logarithmic=True),
    )

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        own = ("crossover_hz", "slow_per_s")
        inner = {name: value for name, value in self.settings.items() if name not in own}
        self.feedforward = AdaptiveFeedforward(belief, layout, inner)
        ts = layout.ts_s
        self._integral = 2.0 * math.pi * self.settings["crossover_hz"] * ts
        self._cutoff_hz = 10.0 * self.settings["crossover_hz"]
        self._pass = 1.0 - math.exp(-2.0 * math.pi * self._cutoff_hz * ts)
        self._slow_um = self.settings["slow_per_s"] * layout.scale_um * ts
        self._late = self.feedforward.lead + 1
        self._slide, self._fade = min(ts / BLEND_S, 1.0), math.exp(-ts / FADE_S)
        inside = self.feedforward.rows.total
        self.rows = Rows(inside=inside, error=1, integral=1, share=1, rested=1)

    @property
    def needed_preview(self) -> int:
        """That of the feedforward."""
        return self.feedforward.needed_preview

    def warning(self) -> str | None:
        """Return the feedforward's warning, else what the feedback lacks, else None."""
        if not self.certified.stable:
            return f"the feedback at rest is unstable: pole magnitude {self.certified.radius:.3g}"
        return self.feedforward.warning()

    @cached_property
    def certified(self) -> Certificate:
        """Certificate of the feedback on its belief, were it on all the time."""
        ts = self.layout.ts_s
        path = belief_path(self.belief, ts)
        low = sampled([1.0], [1.0 / (2.0 * math.pi * self._cutoff_hz), 1.0], ts)
        shape = unit_delay() * low * integrator(ts).times(self._integral / ts)
        z = np.exp(1j * np.geomspace(1e-5, math.pi, 1500))
        return certify([shape * each for each in path.extremes], z, SECTOR)

    def certificate(self) -> str | None:
        """Return what is certain of the feedback at rest; in motion nothing is fed back."""
        line = self.certified.line()
        return None if line is None else f"at rest {line}; in motion no fixed feedback"

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest; see :meth:`baselines.base.Baseline.start`."""
        state = np.zeros((self.rows.total, len(reference_um)))
        self.rows.of(state, "inside")[:] = self.feedforward.start(reference_um)
        return state

    def next_command(self, observation: Observation, reference_um: Array, state: Array) -> Array:
        """See :meth:`baselines.base.Baseline.next_command`."""
        of, inner = self.rows.of, self.feedforward
        inside, rested = of(state, "inside"), of(state, "rested")[0]
        shown = self.layout.reference_um(observation)
        moves = np.abs(np.diff(shown, axis=1)).max(axis=1) > self._slow_um
        rested[:] = np.where(moves, 0.0, rested + 1.0)
        rests = rested > self._late
        measured = self.layout.measured_um(observation)
        share, integral = of(state, "share")[0], of(state, "integral")[0]
        share += np.clip(rests - share, -self._slide, self._slide)
        error = of(state, "error")[0]
        error += self._pass * (reference_um[0] - measured - error)
        integral[:] = np.where(rests, integral, self._fade * integral)
        integral += share * self._integral * error
        most = 0.1 * self.layout.scale_um
        np.clip(integral, -most, most, out=integral)
        wanted = inner.wanted_um(observation, measured, reference_um[0], inside, ~rests)
        return inner.driven(observation, wanted + integral, inside)
