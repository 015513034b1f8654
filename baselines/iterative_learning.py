"""``iterative-learning``: the command of the next pass from the error of the last, of any reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from baselines.adaptive_feedforward import spline_weights
from baselines.core_inverse import hysteresis_inverse, linear_inverse, look_ahead
from baselines.feedforward import checked_reference
from baselines.preview import Planned
from baselines.tuning import Knob, Settings, Tunable
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError

# Error of the inverse model as share of the scale, and time constant (s) of what it may have to undo.
_DOUBT, _DYNAMICS_S = 1e-3, 3e-4
# Samples beyond the believed delay, for what a lag delays besides; samples of a derivative, less one:
# with delay, lag and mode the inverse has more than three derivatives that matter at a mode.
_AHEAD = 1
_ORDER = 6
_SPLINE = spline_weights(_ORDER)
# The inverse model is fitted to what lies above (Hz): below, hysteresis is most of the residual.
_FIT_HZ = 200.0


class IterativeLearning(Tunable, Planned):
    """w_{p+1} = w_p + γ F[e_p + θ_p · (e_p', e_p'', ...)] after pass p, u = the belief's inverse of w.

    F is a low-pass run forwards and backwards, so without phase. θ_p undoes delay, lag and mode; it
    is fitted after each pass by least squares of what went in, w_p, on the measured displacement
    and its derivatives, so a mode elsewhere than believed costs no stability. Where a pass was
    worse than the best one, the best is gone on from with half the gain.

    The protocol: :meth:`plan` with the reference of the pass, then a run from rest, then
    :meth:`learn`; a :meth:`plan` with another reference begins anew. Within a pass nothing is fed
    back.

    Parameters
    ----------
    belief, layout, settings
        As :class:`baselines.tuning.Tunable`.

    Attributes
    ----------
    repeats : bool
        It sees the reference again: scored in a track of its own.

    Examples
    --------
    >>> from rdpi_gym.plant import Plant, named_plant
    >>> plant = named_plant("P10")
    >>> learner = IterativeLearning(plant, ObservationLayout.for_plant(plant, ts_s=1e-4), {})
    >>> r = 20.0 * np.sin(2 * np.pi * 50.0 * 1e-4 * np.arange(600))[:, None]
    >>> errors = []
    >>> for _ in range(4):
    ...     u = learner.plan(r)
    ...     y = Plant(plant, 1e-4).simulate(u)
    ...     learner.learn(r, y, u)
    ...     errors.append(float(np.sqrt(np.mean((r - y) ** 2))))
    >>> errors[-1] < 0.5 * errors[0]
    True

    Notes
    -----
    Bristow, Tharayil, Alleyne, A survey of iterative learning control, IEEE Control Syst. Mag. 26,
    2006; of piezo scanners Leang, Devasia, Mechatronics 16, 2006.
    """

    name = "iterative-learning"
    repeats = True
    knobs = (
        Knob("gain", 0.1, 1.5, 0.8),
        Knob("band_hz", 50.0, 3000.0, 1000.0, "Hz", logarithmic=True),
    )

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        super().__init__(belief, layout, settings)
        self._inverse = hysteresis_inverse(belief, layout)
        delay, series = linear_inverse(belief, layout.ts_s)
        self._lead = round(delay) + _AHEAD
        self._prior = np.convolve(series, look_ahead(delay - self._lead, _ORDER))[1:_ORDER]
        band = min(self.settings["band_hz"] * layout.ts_s * 2.0, 0.95)
        self._low_pass = signal.butter(2, band, output="sos")
        fit_band = min(_FIT_HZ * layout.ts_s * 2.0, 0.5)
        self._high_pass = signal.butter(2, fit_band, btype="highpass", output="sos")
        self._reference: Array | None = None

    def _commands(self, reference_um: Array) -> Array:
        if self._reference is None or not np.array_equal(self._reference, reference_um):
            self._reference = reference_um.copy()
            lanes = reference_um.shape[1]
            self._wanted = self._first(reference_um)
            self._best, self._least = self._wanted.copy(), np.full(lanes, np.inf)
            self._step = np.zeros_like(self._wanted)
            self._gain = np.full(lanes, self.settings["gain"])
        state = self._inverse.start(self._reference[0])
        commands = self._inverse.command_block(self._wanted, state)
        commands[0] = self.limits.rest_V
        return commands

    def learn(self, reference_um: ArrayLike, measured_um: ArrayLike, command_V: ArrayLike) -> None:
        """Take in what a pass left, for the next :meth:`plan` of the same reference.

        Parameters
        ----------
        reference_um, measured_um, command_V
            Reference and reading (µm) and applied command (V), ``(K, B)`` each.

        Raises
        ------
        InputError
            A shape is another one, a value is not finite, or the reference is not the planned one.
        """
        reference, measured = checked_reference(reference_um), checked_reference(measured_um)
        if self._reference is None or not np.array_equal(reference, self._reference):
            raise InputError(
                "learn is called for another reference than was planned; plan it first"
            )
        if measured.shape != reference.shape:
            raise InputError(
                f"readings of shape {measured.shape} for a reference of {reference.shape}; give as many"
            )
        error = reference - measured
        rms = np.sqrt(np.mean(error**2, axis=0))
        better = rms < self._least
        self._least = np.where(better, rms, self._least)
        self._best[:, better] = self._wanted[:, better]
        update = self._update(error, measured)
        self._step[:, better] = update[:, better]
        self._gain[~better] *= 0.5
        self._wanted = self._best + self._gain * self._step

    def _first(self, reference_um: Array) -> Array:
        """Return the first pass by the belief."""
        values, *derivatives = _derivatives(reference_um)
        wanted = values + np.einsum("f,fkb->kb", self._prior, np.array(derivatives))
        return _earlier(wanted, self._lead)

    def _update(self, error_um: Array, measured_um: Array) -> Array:
        """Return the correction of w for an error, by the inverse model that fits this pass."""
        smooth, *rates = _derivatives(measured_um)
        entered = _later(_derivatives(self._wanted)[0], self._lead)
        shown = np.array([*rates, smooth, entered])
        *phi_rows, target = signal.sosfiltfilt(self._high_pass, shown, axis=1)
        phi = np.array(phi_rows)
        target = target - phi[-1]
        samples = self.layout.scale_um * _DOUBT
        dynamics = _DYNAMICS_S / self.layout.ts_s
        spread = np.array([*(dynamics**q for q in range(1, _ORDER)), 0.1])
        precision = np.diag((samples / spread) ** 2)
        prior = np.array([*self._prior, 0.0])
        left = np.einsum("fkb,gkb->bfg", phi, phi) / len(smooth) + precision
        right = np.einsum("fkb,kb->bf", phi, target) / len(smooth) + precision @ prior
        theta = np.linalg.solve(left, right[:, :, None])[:, :-1, 0]
        value, *changes = _derivatives(error_um)
        wanted = value + np.einsum("bf,fkb->kb", theta, np.array(changes))
        low: Array = signal.sosfiltfilt(self._low_pass, wanted, axis=0)
        return _earlier(low, self._lead)


def _derivatives(block: Array) -> Array:
    """Value and derivatives per sample of a block (K, B), float64[_ORDER, K, B]."""
    padded = np.pad(block, ((_ORDER // 2,) * 2, (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, _ORDER + 1, axis=0)
    derivatives: Array = np.einsum("dw,kbw->dkb", _SPLINE, windows)
    return derivatives


def _earlier(block: Array, samples: int) -> Array:
    return np.concatenate([block[samples:], np.repeat(block[-1:], samples, axis=0)])


def _later(block: Array, samples: int) -> Array:
    return np.concatenate([np.repeat(block[:1], samples, axis=0), block[: len(block) - samples]])
