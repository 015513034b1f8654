"""``adaptive-core-bank``: the kind of hysteresis identified while driving, as a mixture of nominal cores.

===================  =========================  ===========================================================
constant             unit                       meaning, and reason
===================  =========================  ===========================================================
``NOMINAL``          names                      models of one measured PICMA stack in the library, scaled to a
                                                belief: all kinds but the RDPI model, which the belief has
``LENGTHS``          command ranges             lengths of generic inner variables: within a small loop, and
                                                nearly a straight line
``THRESHOLDS``       command ranges             of generic plays: closer where small loops are, at most what
                                                the range can move
``POWERS``           1                          of the place in the range: gain, asymmetry, saturation
``CORE_SPREAD``      1                          expected weight of a nominal core: halving it costs 9 to 14 %
                                                of the error where the kind is foreign, doubling it gains 3 %
                                                there and costs 6 % on steps
``INNER_SPREAD``,    believed gains             expected gains of inner variables, and of powers and plays:
``GENERIC_SPREAD``                              they fill what no core has, so less than a core
``STATIC_SHARE``     ``adaptive-feedforward``'s  expected size of the corrections without dynamics: the cores
                                                carry most of them
``TUNED_TS_S``       s                          sampling time at which the settings were tuned; memory and
                                                dynamics are as many samples at any other, since a loop is
                                                sampled as fast as it moves
``TRIES``            1                          commands tried for a sample; a third costs half of the error
                                                where nothing lags, as the exact inverse of a rate rings, and
                                                gains a sixth on steps
``LEAST_SLOPE``,     believed largest gain      bounds of a chord's slope: within a factor of three of any
``LARGEST_SLOPE``                               mixture that has an inverse; wider ones let a mixture without
                                                one make much of roundings
``MOST``             scale                      largest part of the mixture, and largest correction beside it:
                                                a slow sensor's lag that is 40 % off asks for 0.7
``MEMORY_S``         s                          shorter than ``adaptive-feedforward``'s, as less noise enters:
                                                0.03 costs 6 to 16 % where nothing changes, 0.05 costs 7 % as
                                                a load comes and 6 % where the bank lacks the kind
``FIT_HALF``         samples                    half of those that the fit takes derivatives of y from: noise
                                                in these biases it; two cost 11 to 32 % of the error, six gain
                                                nothing more
===================  =========================  ===========================================================

Figures are of the first six to eight validation plants of Preisach, BoucWen, Duhem, Stage and Steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.adaptive_feedforward import HALF, PLAYS, PRODUCTS, spline_weights
from baselines.adaptive_feedforward import POWERS as POWERS_OF_R
from baselines.base import Observation, Rows, product, shift_in
from baselines.core_inverse import linear_inverse, look_ahead
from baselines.damping import AdaptiveDualLoop, CorrectedAdaptive
from baselines.inverses.linear import inverse_series, power_ratio
from baselines.least_squares import NestedLeastSquares
from baselines.tuning import Settings
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel, named_plant, pack
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.bouc_wen_kernel import bouc_wen_block
from rdpi_gym.plant.cores.duhem import Duhem, duhem_block
from rdpi_gym.plant.cores.generalised import generalised_block
from rdpi_gym.plant.cores.play import play
from rdpi_gym.plant.cores.preisach import preisach_block
from rdpi_gym.plant.effects.linear import linear_block
from rdpi_gym.support.arrays import Array

NOMINAL = ("preisach", "bouc_wen", "asymmetric_bouc_wen", "duhem", "generalised_pi")
LENGTHS = (0.2, 0.8)
THRESHOLDS = (0.03, 0.06, 0.1, 0.15, 0.26, 0.4)
POWERS = (1, 2, 3)
CORE_SPREAD, INNER_SPREAD, GENERIC_SPREAD = 0.5, 0.2, 0.1
STATIC_SHARE = 0.3
TUNED_TS_S = 1e-4
TRIES = 2
LEAST_SLOPE, LARGEST_SLOPE = 0.5, 1.5
MOST, MEMORY_S = 0.75, 0.04
FIT_HALF = 4
HYSTERETIC = slice(5, 5 + len(PLAYS) + len(PRODUCTS) + len(POWERS_OF_R))
"""Corrections of the hysteresis by plays, products and powers, among all of ``adaptive-feedforward``."""


@dataclass(frozen=True)
class Member:
    """A nominal core on a command range: y = gain (core(shift + scale u) - rest)."""

    core: Core
    gain: float
    rest_um: float  # of the core at 0 V of the belief


@lru_cache(maxsize=64)
def _library_core(kind: str) -> tuple[Core, tuple[float, float]]:
    """Return a library core with the command range (V) that it was identified on."""
    plant = named_plant(f"picma-{kind}")
    return plant.hysteresis, plant.command_range_V


def _walked(core: Core, ts_s: float, commands_V: Sequence[float], rest_V: float) -> Array:
    """Displacements (µm) along a slow walk from rest at a command."""
    u = np.array(commands_V)[:, None]
    state = np.zeros((2 + core.n, 1))
    state[2:, 0] = core.settled((rest_V,))
    y = np.empty_like(u)
    type(core).block(u, np.zeros_like(u), pack([core], ts_s, [0.0]), state, y)
    walked: Array = y[:, 0]
    return walked


def lag_in_front(belief: PlantModel, ts_s: float) -> float:
    """Return what of a command's distance is left after one sample of the belief's lags before its core."""
    samples = 0.0
    for effect in belief.effects:
        sampled = effect.sampled_at(ts_s)
        if sampled.slot == "input" and type(sampled).block is linear_block:
            samples += float(inverse_series(sampled.coefficients(ts_s, belief.hysteresis), 1)[1])
    return math.exp(-1.0 / samples) if samples > 0.0 else 0.0


class CoreBank:
    """y = H_0[u] + Σ w_c (H_c[u] - H_0[u]) + Σ g_i b_i[u] with its inverse; H_0 is the belief's core.

    The H_c are nominal cores of the library, scaled to the command range and the stroke of the belief.
    The b_i are generic: three powers of u, inner variables of two lengths, and plays times the place in
    the range, which bend rising and falling branches unlike. A column is what each of them gives for the applied
    command, so the weights enter linearly and no noise does. The command is found along chords, a
    fixed number of evaluations on copies of the memory.

    A lag in front does not commute with hysteresis: u is the command behind the believed one, as a lag of
    one sample's recursion, which has an exact inverse; its rate is that of u, low-passed as the belief's.
    """

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, kept: int, smoothing: Array
    ) -> None:
        core, ts = belief.hysteresis, layout.ts_s
        self.core, self._ts_s, self._kept, self._smoothing = core, ts, kept, smoothing
        self.lag = lag_in_front(belief, ts)
        self._pole, self._rises = core.rate_pole(ts), core.rises_at(ts)
        low, high = layout.command_range_V
        self.range_V = (low, high)
        self.rest_V = min(max(0.0, low), high)
        rest, *swing = _walked(core, ts, (0.0, low, high), 0.0)
        stroke_um = swing[1] - swing[0]
        members = [self._member(kind, stroke_um) for kind in NOMINAL]
        inner = [Duhem(b=0.0, c=1.0, length_V=part * (high - low)) for part in LENGTHS]
        self.cores = [*(member.core for member in members), *inner]
        self._packed = [pack([each], ts, [0.0]) for each in self.cores]
        self._anchor = pack([core], ts, [belief.offset_um])
        self._lanes = 1
        self.gains = tuple(member.gain for member in members)
        self.rests_um = tuple(member.rest_um for member in members)
        self._rest_um = float(rest) + belief.offset_um
        *_, own_range = _library_core(NOMINAL[0])
        scale = (own_range[1] - own_range[0]) / (high - low)
        self._place = (scale, own_range[0] - scale * low, 0.5 * (low + high), 0.5 * (high - low))
        self.thresholds_V = tuple(part * (high - low) for part in THRESHOLDS)
        self.count = len(self.cores) + len(POWERS) + len(THRESHOLDS)
        gain = (1.0 - self.lag) * core.A
        self.slopes = (LEAST_SLOPE * gain, gain, LARGEST_SLOPE * gain)
        counts = {f"member_{i}": 2 + each.n for i, each in enumerate([core, *self.cores])}
        self.rows = Rows(
            last_V=1,
            reached=2,  # command behind the lag (V), and its rate (V/s)
            asked=2,  # what was wanted last (µm), and the rate of that over the largest gain (V/s)
            columns=1 + self.count,
            ring=kept * (1 + self.count),
            members=sum(counts.values()) + len(THRESHOLDS),
        )
        ends = np.cumsum([0, *counts.values()]).tolist()
        self._states = tuple(int(end) for end in ends)
        self._tables = tuple(
            int(end) for end in np.cumsum([0, *(len(each) for each in self._packed)]).tolist()
        )
        self._table = np.concatenate(self._packed)

    def _member(self, kind: str, stroke_um: float) -> Member:
        core, (low, high) = _library_core(kind)
        own_low, own_high = self.range_V
        rest_V = low - own_low * (high - low) / (own_high - own_low)
        rest, bottom, top = _walked(core, self._ts_s, (rest_V, low, high), rest_V)
        return Member(core, float(stroke_um / (top - bottom)), float(rest))

    def spreads(self) -> list[float]:
        """Return the expected sizes of the weights, as the columns are ordered."""
        gain = self.core.A
        inner, others = len(LENGTHS), len(POWERS) + len(THRESHOLDS)
        return [
            *[CORE_SPREAD] * len(NOMINAL),
            *[INNER_SPREAD * gain] * inner,
            *[GENERIC_SPREAD * gain] * others,
        ]

    def start(self, reference_um: Array) -> Array:
        """Return the memory at rest at the command nearest 0 V, float64[rows, B]."""
        lanes = len(reference_um)
        memory, of = np.zeros((self.rows.total, lanes)), self.rows.of
        members = of(memory, "members")
        shift = self._place[1]
        for i, core in enumerate([self.core, *self.cores]):
            is_nominal = 0 < i <= len(NOMINAL)
            rest_V = shift if is_nominal else 0.0
            own = members[self._states[i] + 2 : self._states[i + 1]]
            own[:] = core.settled((rest_V,))[:, None]
        of(memory, "asked")[0] = reference_um
        of(memory, "last_V")[:] = self.rest_V
        reached = of(memory, "reached")
        reached[0] = self.rest_V
        columns = self._columns(reached, members)
        of(memory, "columns")[:] = columns
        of(memory, "ring").reshape(self._kept, 1 + self.count, lanes)[:] = columns
        return memory

    def take(self, applied_V: Array, memory: Array) -> None:
        """Move the cores on by the applied command, in place."""
        of = self.rows.of
        reached = self._reached(applied_V, memory)
        columns = self._columns(reached, of(memory, "members"))
        of(memory, "reached")[:] = reached
        of(memory, "last_V")[0] = applied_V
        of(memory, "columns")[:] = columns
        shift_in(of(memory, "ring").reshape(self._kept, 1 + self.count, -1), columns)

    def before(self, memory: Array) -> Array:
        """Return the columns of the oldest samples that are kept, smoothed, float64[1 + count, B]."""
        oldest = self.rows.of(memory, "ring").reshape(self._kept, -1)[: len(self._smoothing)]
        return product(self._smoothing, oldest).reshape(1 + self.count, -1)

    def command(self, wanted_um: Array, weights: Array, most_um: float, memory: Array) -> Array:
        """Return the command (V) at which the mixture gives what is wanted, from the last one on."""
        of = self.rows.of
        members, asked = of(memory, "members"), of(memory, "asked")
        asked[1] = (wanted_um - asked[0]) / (self._ts_s * self.core.A)
        asked[0] = wanted_um
        low, high = self.range_V
        search = np.empty((4, len(wanted_um)))
        search[0] = search[3] = of(memory, "reached")[0]
        search[1] = 0.0
        search[2] = self.slopes[1]
        given = (wanted_um, weights, most_um, *self.slopes, low, high, search)
        _along_chord(of(memory, "columns"), *given)
        for _ in range(TRIES):
            tried = self._reached(search[3], memory)
            _along_chord(self._columns(tried, members.copy()), *given)
        command: Array = search[3]
        return command

    def _reached(self, command_V: Array, memory: Array) -> Array:
        """Return the command behind the lag (V) one sample on, and its rate (V/s), float64[2, B].

        Where that rate would take more than the command gives, the rate is that of what is wanted.
        """
        of = self.rows.of
        reached: Array = _followed(
            command_V, of(memory, "reached"), self.lag, self._pole, self._ts_s
        )
        if not self._rises:
            reached[1] = of(memory, "asked")[1]
        return reached

    def _columns(self, reached: Array, members: Array) -> Array:
        """Return H_0 and the columns after one sample; the members are moved on."""
        lanes = reached.shape[1]
        if lanes != self._lanes:
            self._lanes = lanes
            self._table = np.repeat(self._table[:, :1], lanes, axis=1)
            self._anchor = np.repeat(self._anchor[:, :1], lanes, axis=1)
        out = np.empty((1 + self.count, lanes))
        u, v = reached[:1], reached[1:]
        self.core.block(u, v, self._anchor, members[: self._states[1]], out[:1])
        _member_columns(
            u, v, self._table, members, self._tables, self._states, self.gains, self.rests_um,
            self._rest_um, self._place, self.thresholds_V, out,
        )  # fmt: skip
        return out


@njit(cache=True)
def _followed(command_V: Array, before: Array, kept: float, pole: float, ts_s: float) -> Array:
    """Return what follows a command with a lag, and its rate low-passed."""
    after = np.empty_like(before)
    for b in range(len(command_V)):
        after[0, b] = kept * before[0, b] + (1.0 - kept) * command_V[b]
        rate = (after[0, b] - before[0, b]) / ts_s
        after[1, b] = pole * before[1, b] + (1.0 - pole) * rate
    return after


@njit(cache=True)
def _along_chord(
    columns: Array,
    wanted_um: Array,
    weights: Array,
    most_um: float,
    least: float,
    usual: float,
    largest: float,
    low_V: float,
    high_V: float,
    search: Array,
) -> None:
    """Take in what a command gives, and find the next: rows last command, its displacement, slope, next."""
    for b in range(wanted_um.shape[0]):
        added = 0.0
        for i in range(weights.shape[0]):
            added += weights[i, b] * columns[1 + i, b]
        y = columns[0, b] + min(max(added, -most_um), most_um)
        way = search[3, b] - search[0, b]
        if abs(way) > 1e-9 * (high_V - low_V):
            search[2, b] = min(max((y - search[1, b]) / way, least), largest)
        search[0, b], search[1, b] = search[3, b], y
        following = search[3, b] + (wanted_um[b] - y) / search[2, b]
        search[3, b] = min(max(following, low_V), high_V)


@njit(cache=True)
def _member_columns(
    u: Array,
    v: Array,
    p: Array,
    state: Array,
    tables: tuple[int, ...],
    states: tuple[int, ...],
    gains: tuple[float, ...],
    rests_um: tuple[float, ...],
    rest_um: float,
    place: tuple[float, ...],
    thresholds_V: tuple[float, ...],
    out: Array,
) -> None:
    """Fill rows 1 ... of the columns; row 0 holds the belief's displacement."""
    lanes = u.shape[1]
    w = np.empty_like(u)
    for b in range(lanes):
        w[0, b] = place[0] * u[0, b] + place[1]
    preisach_block(w, v, p[tables[0] : tables[1]], state[states[1] : states[2]], out[1:2])
    bouc_wen_block(w, v, p[tables[1] : tables[2]], state[states[2] : states[3]], out[2:3])
    bouc_wen_block(w, v, p[tables[2] : tables[3]], state[states[3] : states[4]], out[3:4])
    duhem_block(w, v, p[tables[3] : tables[4]], state[states[4] : states[5]], out[4:5])
    generalised_block(w, v, p[tables[4] : tables[5]], state[states[5] : states[6]], out[5:6])
    duhem_block(u, v, p[tables[5] : tables[6]], state[states[6] : states[7]], out[6:7])
    duhem_block(u, v, p[tables[6] : tables[7]], state[states[7] : states[8]], out[7:8])
    for b in range(lanes):
        own = out[0, b] - rest_um
        for i, gain in enumerate(gains):
            out[1 + i, b] = gain * (out[1 + i, b] - rests_um[i]) - own
        at = (u[0, b] - place[2]) / place[3]
        for i, power in enumerate(POWERS):
            out[8 + i, b] = place[3] * at**power
        for i, threshold in enumerate(thresholds_V):
            row = states[8] + i
            state[row, b] = play(state[row, b], u[0, b] - threshold, u[0, b] + threshold)
            out[8 + len(POWERS) + i, b] = at * state[row, b]


class BankFeedforward(CorrectedAdaptive):
    """The adaptive feedforward on a bank of cores, whose weights its least squares estimate too.

    w = y + θ·φ[y] holds of what the hysteresis gives, w, and what is measured, y. Where w is a mixture
    H_0[u] + Σ w_c D_c[u], H_0[u] - y = θ·φ[y] - Σ w_c D_c[u]: linear in both. The D_c follow the
    applied command, so a sample counts where the command was at its limit as well. Three models are
    weighed by how well they predict: the belief's hysteresis behind unknown dynamics, the same with the
    corrections of ``adaptive-feedforward``, and the mixture.
    """

    half = FIT_HALF

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        self.known = len(self.fit.spread)
        dynamics = self.settings["dynamics_s"] / TUNED_TS_S
        # the sensor's noise as the believed inverse of the dynamics passes it on
        passed = float(np.linalg.norm([1.0, *self.fit.prior[:3]] @ self.spline))
        doubt_um = self.settings["doubt"] * layout.scale_um
        static = (STATIC_SHARE * self.fit.spread[3:]).tolist()
        simple = [i for i in range(self.known) if not HYSTERETIC.start <= i < HYSTERETIC.stop]
        others = [i for i in range(self.known + self.bank.count) if i not in simple]
        self.fit = NestedLeastSquares(
            [*self.fit.prior, *[0.0] * self.bank.count],
            [dynamics, dynamics**2, dynamics**3, *static, *self.bank.spreads()],
            [len(simple), self.known, self.known + self.bank.count],
            noise=math.hypot(doubt_um, passed * belief.sensor.noise_um),
            memory_s=MEMORY_S,
            ts_s=TUNED_TS_S,
            order=[*simple, *others],
        )
        counts = {**self.rows.counts, "wanted": 0, "last_V": 0, "fit": self.fit.rows}
        self.rows = Rows(**counts, passed_um=1, weighed=1 + self.fit.size)
        _, series = self.behind()
        self._weighs = 1.0 - math.exp(-1.0 / series[1]) if series[1] > 0.0 else 1.0

    @cached_property
    def bank(self) -> CoreBank:
        """Cores of the mixture, which keep their columns until y gets there."""
        kept = self.lead + 2 * self.half + 1
        return CoreBank(self.belief, self.layout, kept, spline_weights(2 * self.half)[0])

    def behind(self) -> tuple[float, Array]:
        """Return delay and inverse of what the bank does not undo: the lag in front, it does."""
        delay, series = linear_inverse(self.belief, self.layout.ts_s)
        kept = lag_in_front(self.belief, self.layout.ts_s)
        undone = (look_ahead(0.0) - kept * look_ahead(-1.0)) / (1.0 - kept)
        return delay, power_ratio(series, undone)

    @property
    def most_um(self) -> float:
        """Largest part of the mixture and largest correction beside it (µm)."""
        return 2.0 * MOST * self.layout.scale_um

    def leads(self, delay: float) -> int:
        """Return the delay: without the lag in front no other lead is better."""
        return round(delay)

    def corrected(self, wanted_um: Array, state: Array, *corrections_um: Array) -> Array:
        """Add the corrections behind the believed lag, since the bank undoes it: the loop is as designed."""
        correction, *more = corrections_um
        for each in more:
            correction = correction + each
        passed = self.rows.of(state, "passed_um")
        passed[0] = self.bank.lag * passed[0] + (1.0 - self.bank.lag) * correction
        return super().corrected(wanted_um, state, passed[0].copy())

    def inverse_at_rest(self, reference_um: Array) -> Array:
        """Return the bank's memory at rest, its first row the last command (V)."""
        return self.bank.start(reference_um)

    def wanted_um(
        self,
        observation: Observation,
        measured_um: Array,
        reference_um: Array,
        state: Array,
        learns: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Move the bank on by the applied command; see :meth:`AdaptiveFeedforward.wanted_um`."""
        self.bank.take(self.layout.command_V(observation), self.rows.of(state, "inverse"))
        return super().wanted_um(observation, measured_um, reference_um, state, learns)

    def driven(self, observation: Observation, wanted_um: Array, state: Array) -> Array:
        """Return u(k+1) (V), ``(B,)``, at which the mixture gives w (µm)."""
        of = self.rows.of
        trust = of(state, "monitor")[-1]
        weights = trust * self.fit.theta(of(state, "fit"))[self.known :]
        memory = of(state, "inverse")
        last = self.layout.command_V(observation)
        command = self.bank.command(wanted_um, weights, 0.5 * self.most_um, memory)
        low, high, step = self.limits
        allowed = np.minimum(np.maximum(command, low), high)
        return np.minimum(np.maximum(allowed, last - step), last + step)

    def compared(self, state: Array) -> tuple[Array, Array]:
        """Return φ of the measured y beside the columns, and H_0[u] - y (µm), at k - half."""
        of = self.rows.of
        came = product(self.spline, of(state, "measured"))
        columns = self.bank.before(of(state, "inverse"))
        static = of(state, "seen").reshape(*self._rings, -1)[0]
        return np.concatenate([came[1:], static, -columns[1:]]), columns[0] - came[0]

    def _learn(self, state: Array, counts: NDArray[np.bool_]) -> None:
        """Learn behind a low-pass as slow as what lies between w and y, which leaves errors like the readings'."""
        count, weighed = self.rows.of(state, "count"), self.rows.of(state, "weighed")
        count += 1.0
        phi, z = self.compared(state)
        weighed[:-1] += self._weighs * (phi - weighed[:-1])
        weighed[-1] += self._weighs * (z - weighed[-1])
        begun: NDArray[np.bool_] = count[0] > self.lead + 2 * self.half + 2
        learns = counts & begun
        self.fit.learn(self.rows.of(state, "fit"), weighed[:-1], weighed[-1].copy(), learns)

    def _value(self, window_um: Array, smooth_um: Array) -> Array:
        """Reference itself: smoothing would round its corners."""
        return window_um[:, self.window[HALF]]

    def _bounded(self, believed_um: Array, learned_um: Array) -> Array:
        """Bound what was learned alone: what is believed of a slow sensor asks for more than that."""
        most = 0.5 * self.most_um
        bounded: Array = believed_um + np.minimum(np.maximum(learned_um, -most), most)
        return bounded

    def _is_free(self, observation: Observation, state: Array) -> NDArray[np.bool_]:
        """Everywhere: the columns follow the applied command."""
        return np.ones(len(observation), dtype=bool)


class AdaptiveCoreBank(AdaptiveDualLoop):
    """``adaptive-dual-loop`` on a bank of cores: it adapts the kind of hysteresis, weights and dynamics.

    Nothing but numbers is read of the belief: its core, effects, command range and stroke. The library's
    nominal cores are scaled to these; generic columns fill what no core of the bank has.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> layout = ObservationLayout.for_plant(P10, 1e-4, preview=8)
    >>> AdaptiveCoreBank(P10, layout, {}).feedforward.fit.size
    36

    Notes
    -----
    Mixtures of hysteresis models under one estimate: Kuhnen, Krejčí, IEEE Trans. Autom. Control 54,
    2009, adapt the weights of one model; here the models are weighed against one another.
    """

    name = "adaptive-core-bank"
    tuned_as = AdaptiveDualLoop.name  # the loop is the same

    def adaptive(self, belief: PlantModel, layout: ObservationLayout) -> CorrectedAdaptive:
        """Return the feedforward on the bank; its settings are those of ``adaptive-feedforward``."""
        return BankFeedforward(belief, layout)
