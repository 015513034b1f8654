"""The Gymnasium environment: make a piezo stage follow a reference."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import NDArray

from rdpi_gym.envs.controller import Correction
from rdpi_gym.envs.draw_laws import DrawLaw
from rdpi_gym.envs.layout import DEFAULT_FIELDS, ActionMode, ObservationLayout
from rdpi_gym.envs.limits import COST_KEYS, Bounds, Limits
from rdpi_gym.envs.privileged import in_place, latent_values, latents_of
from rdpi_gym.envs.tracking import NoiseSource, TrackingTask
from rdpi_gym.envs.truth import (
    PLANT_OPTIONS,
    RATE_BANDWIDTH_HZ,
    FrequencyChoice,
    PlantChoice,
    ReferenceChoice,
    ReferenceSource,
    TruthSource,
    choose_plant,
    frequency_bounds,
    reference_choices,
)
from rdpi_gym.envs.unit_box import UnitBox
from rdpi_gym.envs.wrappers.history import History
from rdpi_gym.plant import PlantModel
from rdpi_gym.signals import Signal
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, is_whole, shape_of
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

if TYPE_CHECKING:
    from rdpi_gym.envs.rendering import LiveFigure

# Samples of the reference made at a time: one registered episode, and what it looks ahead.
_CHUNK = 2048
_LANE, _BEGINS, _GOES_ON = np.zeros(1, dtype=np.int64), np.ones(1, bool), np.zeros(1, bool)
_OPTIONS = ("reference", "frequency_hz", *PLANT_OPTIONS)


def read_options(options: Any, *more: str) -> dict[str, Any]:
    """Return the options of a reset as a dictionary of their own."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InputError(f"options is {quoted(options)}; give a dictionary, or None")
    known = (*_OPTIONS, *more)
    for key in options:
        if key not in known:
            raise InputError(f"reset has no option {quoted(key)}; it has {', '.join(known)}")
    return dict(options)


class PiezoTrackingEnv(gym.Env[NDArray[np.float32], NDArray[Any]]):
    """Track a reference with a piezo stage that has rate-dependent hysteresis.

    ## Description
    A voltage moves a piezo stage. Its displacement follows the voltage by the rate-dependent
    Prandtl-Ishlinskii model (RDPI, Eq. 2 to 5 and 8 of Aljanaideh, Al Janaideh and Rakotondrabe):
    a sum of play operators whose thresholds grow with the rate of the command. The same voltage
    gives different displacements depending on where it came from and how fast. The task is to keep
    the displacement on a reference, of which a few samples ahead are known.

    The plant of the environment is the truth. What a controller believes of it (`belief`) is kept
    apart, and `randomise` draws the truth of each episode about the nominal plant. While all plays
    slide, the plant has a right-half-plane zero: the literal rate of Eq. 5 rewards a command that
    dithers from sample to sample. Therefore the rate is low-passed at `rate_bandwidth_hz`.

    ## Action Space
    `Box(-1.0, 1.0, (1,), float32)`. The action at step k sets the command u(k+1), which is reached
    linearly over the interval.

    | `action` | command u(k+1) (V) |
    |---|---|
    | `"command"` | place in the plant's command range: -1 is the lowest, 1 the highest |
    | `"increment"` | u(k) plus the action times `action_scale_V` |
    | `"correction"` | command of the `baseline` plus the action times `action_scale_V` |

    Actions outside [-1, 1] and commands outside the range are clipped, and `info["saturated"]`
    counts the steps at which that happened. Actions that are NaN or infinite are refused.

    The space is `rdpi_gym.envs.unit_box.UnitBox`, equal to that Box: its `sample` returns what
    `Box.sample` returns, an order of magnitude faster.

    ## Observation Space
    `Box` of `preview + 3` numbers, float32; displacements as `(x - offset_um) / amplitude_um`.
    `env.unwrapped.layout` decodes them. The bounds are twice what the hysteresis can reach over the
    command range (ten times for a plant with further effects). The sensor's range ends there: a
    displacement beyond it, as of a resonance without damping, is shown as the end of the range,
    while reward and `info` hold the true one.

    | index | quantity |
    |---|---|
    | 0 | reference r(k) |
    | 1 ... `preview` | reference r(k+1) ... r(k+`preview`) |
    | `preview` + 1 | measured displacement: y(k), the sensor's noise, rounded to its resolution |
    | `preview` + 2 | command u(k), -1 to 1 over the command range |

    ## Rewards
    `-|e(k+1)| / amplitude_um - command_cost |u(k+1) - u(k)| / (highest - lowest command)`, where
    e = r - y is the true tracking error: 0 is the best. `info` holds, as plain floats of what is
    not observed:

    | key | meaning |
    |---|---|
    | `displacement_um` | true displacement y (µm) |
    | `reference_um` | reference r (µm) |
    | `error_um` | r - y (µm) |
    | `command_V` | command u (V) |
    | `saturated` | steps of this episode whose action or command was clipped |
    | `cost` | with `limits`: number of limits that this sample leaves; 0 at a reset |
    | `cost_saturation`, `cost_rate`, `cost_ringing`, `cost_stroke` | its components, each 0 or 1, as Safety-Gymnasium has them: clipped; command too fast; error bent too much in a sample; displacement too far |
    | `privileged` | with `privileged`: float64, gains (µm/V), thresholds (V) and shape of the core, then each effect's parameters, as they are now; `env.unwrapped.latents` names each with its unit. For a critic, never for a controller |

    ## Starting State
    The plant rests at the command nearest 0 V of its range, all play states at zero. The time is 0:
    with a smooth start, so is the reference. `reset(options=...)` fixes for one episode what would
    be drawn:

    | option | meaning |
    |---|---|
    | `reference` | a name, dictionary or signal |
    | `frequency_hz` | a frequency, or the lowest and the highest |
    | `plant` | as the keyword; the spaces and the command range stay |
    | `weights`, `thresholds_V`, `delta2_s` | these parameters of the plant (µm/V, V, s) |

    An episode with any option of the plant has exactly that plant, without randomisation.
    Randomised plants, references and the sensor's noise come from generators of their own: of two
    environments with the same seed, one with noise sees the references of the one without.

    ## Episode End
    Nothing terminates an episode. It is truncated after 2000 steps (`max_episode_steps` of
    `gymnasium.make` changes that), 0.2 s at the default sampling time.

    ## Arguments

    | keyword | default | meaning |
    |---|---|---|
    | `plant` | `"P10"` | name of `rdpi_gym.plant.PLANTS`, path of a plant JSON, dictionary or `PlantModel` |
    | `ts_s` | `1e-4` | sampling time (s) |
    | `rate_bandwidth_hz` | `800.0` | the rate's low-pass (Hz); a plant whose own is lower keeps it; `None`: the plant as it is |
    | `reference` | `"sine"` | name of `rdpi_gym.signals.SIGNALS`, dictionary with the name under `signal`, `Signal`, or a sequence of these: one is drawn per episode |
    | `frequency_hz` | `(10.0, 100.0)` | frequency of references given without one (Hz), or lowest and highest, drawn log-uniformly per episode |
    | `amplitude_um`, `offset_um` | the plant's | amplitude and centre of references (µm), and the unit of errors |
    | `smooth_start_s` | `0.01` | smooth start of references (s) |
    | `preview` | `8` | samples of the reference shown ahead |
    | `fields` | those above | fields of the observation in their order, names among `rdpi_gym.envs.layout.FIELDS`, the three above among them |
    | `action` | `"command"` | how actions are read |
    | `action_scale_V` | 5 % of the range | command (V) of an action of 1, for `increment` and `correction` |
    | `baseline` | `None` | controller under `correction`: name of `baselines.CONTROLLERS` or `module:attribute`; one that plans ahead knows the first 2048 samples |
    | `belief` | the nominal plant, without effects | what the baseline believes, as `plant` |
    | `noise_um`, `resolution_um` | the plant's | standard deviation and step of the sensor's reading (µm) |
    | `randomise` | `0.0` | relative half-width of the hysteresis core's gains, thresholds and shape (RDPI: weights, thresholds, δ2), drawn per episode |
    | `randomise_effects` | `0.0` | relative half-width of the parameters of the plant's effects, drawn per episode at one of 33 levels |
    | `command_cost` | `0.0` | price of a command change over the whole range |
    | `limits` | `None` | limits of safe operation, a dictionary of `rate_V_s`, `ringing_um_s2`, `stroke_um` ([Limits](rdpi_gym.envs.limits.Limits)): `info` holds costs |
    | `privileged` | `False` | whether `info` holds the plant's latent parameters |
    | `render_mode` | `None` | `"rgb_array"`: hysteresis loop, tracking and error of the last moments |

    ```python
    import gymnasium as gym
    import rdpi_gym

    env = gym.make("rdpi_gym/PiezoTracking-v0", reference=["sine", "triangle"], randomise=0.1)
    ```

    ## Version History
    * v0: initial version

    Raises
    ------
    InputError
        A keyword has a value that no environment can be made of; the line names it.

    Examples
    --------
    >>> env = PiezoTrackingEnv(plant="P5", preview=2)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, info["displacement_um"]
    ((5,), 0.0)
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # the base class declares it so
        "render_modes": ["rgb_array"],
        "render_fps": 50,
    }

    def __init__(
        self,
        *,
        plant: PlantChoice = "P10",
        ts_s: float = 1e-4,
        rate_bandwidth_hz: float | None = RATE_BANDWIDTH_HZ,
        reference: ReferenceChoice | Sequence[ReferenceChoice] = "sine",
        frequency_hz: FrequencyChoice = (10.0, 100.0),
        amplitude_um: float | None = None,
        offset_um: float | None = None,
        smooth_start_s: float = 0.01,
        preview: int = 8,
        fields: Sequence[str] = DEFAULT_FIELDS,
        action: ActionMode = "command",
        action_scale_V: float | None = None,
        baseline: str | None = None,
        belief: PlantChoice | None = None,
        noise_um: float | None = None,
        resolution_um: float | None = None,
        randomise: float = 0.0,
        randomise_effects: float = 0.0,
        command_cost: float = 0.0,
        limits: Limits | Mapping[str, float] | None = None,
        privileged: bool = False,
        render_mode: str | None = None,
    ) -> None:
        sensor = {"noise_um": noise_um, "resolution_um": resolution_um}
        self.truths = TruthSource(
            plant, rate_bandwidth_hz, sensor, randomise, randomise_effects, self._draw_law()
        )
        self.truth = self.nominal = self.truths.nominal
        unaware = replace(self.nominal, effects=())
        self.belief = unaware if belief is None else choose_plant(belief)
        self._low_V, self._high_V = low, high = self.nominal.command_range_V
        self._span_V = high - low
        centre, amplitude = self.nominal.reference_um
        self.layout = ObservationLayout(
            preview=preview,
            fields=fields,
            centre_um=centre if offset_um is None else offset_um,
            scale_um=amplitude if amplitude_um is None else amplitude_um,
            command_range_V=(low, high),
            ts_s=ts_s,
            action=action,
            action_scale_V=0.05 * self._span_V if action_scale_V is None else action_scale_V,
        )
        self._commands_place = action == "command"
        self.references = ReferenceSource(
            reference_choices(reference),
            frequency_bounds(frequency_hz),
            self.layout.scale_um,
            self.layout.centre_um,
            smooth_start_s,
        )
        if not (is_finite(command_cost) and command_cost >= 0.0):
            raise InputError(
                f"command_cost is {quoted(command_cost)}; give a finite price of 0 or above"
            )
        self.command_cost = float(command_cost)
        self.limits = Limits.of(limits)
        self._bounds = None if self.limits is None else self.limits.of_sample(self.layout)
        self._errors_um = 0.0, 0.0
        if not isinstance(privileged, bool):
            raise InputError(f"privileged is {quoted(privileged)}; give True or False")
        self.latents = latents_of(self.truths.law.nominals) if privileged else ()
        self._latent: Array = np.empty(0)
        self.history = History(self.layout, 0)
        self.baseline = baseline
        self._correction = self._make_correction(baseline)
        self.bound_um = self.truths.bound_um(self.layout)
        bound = self.layout.bounds(self.bound_um)
        self.observation_space = Box(-bound, bound, dtype=np.float32)
        self.action_space = UnitBox()
        if render_mode is not None and not (
            isinstance(render_mode, str) and render_mode in self.metadata["render_modes"]
        ):
            raise InputError(f"render_mode is {quoted(render_mode)}; give 'rgb_array' or None")
        self.render_mode = render_mode
        self._figure: LiveFigure | None = None
        self._task = self._track(self.nominal)
        self.signal: Signal | None = None
        self._k = self._known = 0
        self._saturated = 0.0  # as a number of info, which it is
        self._command_V = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; the class says what `options` fixes.

        Raises
        ------
        InputError
            An unknown option, or one that no episode can be made of.
        """
        if seed is not None and not is_whole(seed, 0):
            raise InputError(f"seed is {quoted(seed)}; give a whole number of 0 or more, or None")
        chosen = read_options(options)
        super().reset(seed=None if seed is None else int(seed))
        plant_seed, reference_seed, noise_seed = self.np_random.integers(2**63, size=3).tolist()
        truth = self.truths.draw(plant_seed, chosen, self.layout)
        signal = self.references.draw(
            np.random.default_rng(reference_seed),
            chosen.get("reference"),
            chosen.get("frequency_hz"),
        )
        known = _CHUNK + self.layout.preview
        reference = self.reference_um(signal, 0, known)
        if truth is not self.truth:
            self._task, self.truth = self._track(truth), truth
        self.signal, self._known = signal, known
        self._k, self._saturated = 0, 0.0
        noise = None
        if truth.sensor.noise_um:
            noise = [self._noise(np.random.default_rng(noise_seed))]
        observation = self._task.reset(reference, noise)
        if self._correction is not None:
            if self._correction.plans:
                self._correction.plan(_LANE, {0: reference[:, 0]}, observation)
            else:
                self._correction.observe(observation, _BEGINS)
        if self._figure is not None:
            self._figure.reset()
        info = self._info()
        self._command_V = info["command_V"]
        if self._bounds is not None:
            self._errors_um = info["error_um"], info["error_um"]
            info |= dict.fromkeys(COST_KEYS, 0.0)
        if self.latents:
            info["privileged"] = self._latent_values()
        return observation[0], info

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Set the next command; the class says what observation, reward and info hold.

        Raises
        ------
        InputError
            The action is not finite or not of shape (1,).
        gymnasium.error.ResetNeeded
            There was no reset yet.
        """
        layout, signal = self.layout, self.signal
        if signal is None:
            raise ResetNeeded("call reset() before step()")
        clipped = self._saturated
        command = self._command_for(action)
        observation = self._task.step(command)
        self._k += 1
        if self._k + layout.preview + 1 >= self._known:  # the next step would outlive the reference
            self._task.extend(self.reference_um(signal, self._known, self._known + _CHUNK))
            self._known += _CHUNK
        if self._correction is not None:
            self._correction.observe(observation, _GOES_ON)
        info = self._info()
        change_V = abs(command - self._command_V)
        reward = -abs(info["error_um"]) / layout.scale_um
        reward -= self.command_cost * change_V / self._span_V
        if self._bounds is not None:
            self._add_costs(info, self._bounds, self._saturated - clipped, change_V)
        if self.latents:
            info["privileged"] = self._latent_values()
        self._command_V = command
        return observation[0], reward, False, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return a frame, ``uint8[480, 960, 3]``; None, with a warning, without a render mode."""
        if self.render_mode is None:
            gym.logger.warn('no render_mode was given; make the environment with "rgb_array"')
            return None
        return self._live_figure().draw()

    @property
    def plans(self) -> bool:
        """Whether actions correct a baseline that plans ahead."""
        return self._correction is not None and self._correction.plans

    def _draw_law(self) -> DrawLaw | None:
        """Return what an episode draws beyond numbers about one nominal plant."""
        return None

    def _track(self, truth: PlantModel) -> TrackingTask:
        """Return the tracking problem of a plant."""
        return TrackingTask(truth, self.layout, self.bound_um)

    def _noise(self, rng: np.random.Generator) -> NoiseSource:
        """Return the noise of an episode, in units of the sensor's."""
        return rng

    def _command_for(self, action: NDArray[np.float32]) -> float:
        """Read an action as the command u(k+1) (V), and count it if it has to be clipped."""
        place: float
        try:
            (place,) = action.tolist()
            inside = -1.0 <= place <= 1.0
        except (AttributeError, TypeError, ValueError):
            raise InputError(
                f"action is {type(action).__name__} of shape {shape_of(action)}; "
                "give a numpy array of shape (1,), -1 to 1"
            ) from None
        if not inside:
            if not math.isfinite(place):
                raise InputError(f"action is {place}; give a finite number of -1 to 1")
            place = math.copysign(1.0, place)
        if self._commands_place:
            command = min(self._low_V + 0.5 * (place + 1.0) * self._span_V, self._high_V)
        else:
            base = (
                self._command_V
                if self._correction is None
                else float(self._correction.commands_V[0])
            )
            wanted = base + place * self.layout.action_scale_V
            command = min(max(wanted, self._low_V), self._high_V)
            inside = inside and command == wanted
        if not inside:
            self._saturated += 1.0
        return command

    def _info(self) -> dict[str, Any]:
        displacement, _, reference, command, error = self._task.quantities[:, 0].tolist()
        if self.render_mode is not None:
            self._live_figure().record(command, reference, displacement)
        return {
            "displacement_um": displacement,
            "reference_um": reference,
            "error_um": error,
            "command_V": command,
            "saturated": self._saturated,
        }

    def _add_costs(
        self, info: dict[str, Any], bounds: Bounds, clipped: float, change_V: float
    ) -> None:
        error, y = info["error_um"], info["displacement_um"]
        last, before = self._errors_um
        self._errors_um = error, last
        info["cost_saturation"] = clipped
        rate = info["cost_rate"] = 1.0 if change_V > bounds[0] else 0.0
        bend = abs(error - 2.0 * last + before)
        ringing = info["cost_ringing"] = 1.0 if bend > bounds[1] else 0.0
        stroke = info["cost_stroke"] = 0.0 if bounds[2] <= y <= bounds[3] else 1.0
        info["cost"] = clipped + rate + ringing + stroke

    def _latent_values(self) -> Array:
        """Return the numbers of the plant as it is now, as `latents` names them."""
        (model,), law = self._task.plant.models, self.truths.law
        if self._k == 0 or self._k in self.truths.later:
            values = np.array(latent_values(model))
            self._latent = in_place(values, self.truths.number, law.nominals)
        return self._latent.copy()

    def reference_um(self, signal: Signal, start: int, stop: int) -> Array:
        """Sample an episode's reference (µm), ``(stop - start, 1)``.

        Raises
        ------
        InputError
            It goes farther than what can be shown.
        """
        layout = self.layout
        reference = signal(layout.ts_s * np.arange(start, stop))
        farthest = float(np.abs(reference - layout.centre_um).max())
        if not farthest <= self.bound_um:  # NaN too, of a phase beyond all numbers
            raise InputError(
                f"reference {signal.name} goes {farthest:.4g} µm from its centre, and what can be "
                f"shown ends at {self.bound_um:.4g} µm; give it a smaller amplitude_um"
            )
        return reference[:, None]

    def _live_figure(self) -> LiveFigure:
        if self._figure is None:
            from rdpi_gym.envs.rendering import LiveFigure  # matplotlib, only where it is needed

            self._figure = LiveFigure(self.layout, f"PiezoTracking, {self.nominal.name}")
        return self._figure

    def _make_correction(self, baseline: str | None) -> Correction | None:
        correcting = self.layout.action == "correction"
        if correcting != (baseline is not None) or not isinstance(baseline, str | None):
            raise InputError(
                f"action is {self.layout.action!r} and baseline is {quoted(baseline)}; the name of a baseline is given "
                "with action='correction', and only there"
            )
        return None if baseline is None else Correction(baseline, self.belief, self.layout)
