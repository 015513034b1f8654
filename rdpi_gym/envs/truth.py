"""The plant that an environment really has and the reference it follows: chosen, randomised, drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from rdpi_gym.envs.draw_laws import DrawLaw
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel, find_plant
from rdpi_gym.plant.effects import Effect
from rdpi_gym.signals import SIGNALS, Signal, make_signal
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

# What an episode's options may say of its plant: a plant, and fields of its hysteresis.
PLANT_OPTIONS = ("plant", "weights", "thresholds_V", "delta2_s")
# The bound of readings in units of what the hysteresis reaches; effects (a resonance) go farther.
_MARGIN, _MARGIN_WITH_EFFECTS = 2.0, 10.0

EFFECT_LEVELS = 33
"""Values that a randomised parameter of an effect takes: few, so that what follows from them is kept."""

PlantChoice: TypeAlias = str | Path | Mapping[str, Any] | PlantModel


def choose_plant(choice: PlantChoice) -> PlantModel:
    """Return the plant that a name, a path, a dictionary or a model means."""
    if isinstance(choice, PlantModel):
        return choice
    if isinstance(choice, str | Path):
        return find_plant(str(choice))
    if isinstance(choice, Mapping):
        return PlantModel.from_dict(choice)
    raise InputError(
        f"plant is {quoted(choice)}; give the name of a plant, the path of its JSON file, or its dictionary"
    )


RATE_BANDWIDTH_HZ = 800.0
"""Cut-off (Hz) of the rate of plants that score, and of beliefs about them: a literal rate rewards dither."""


def limit_band(
    model: PlantModel, rate_bandwidth_hz: float | None = RATE_BANDWIDTH_HZ
) -> PlantModel:
    """Return the plant with its rate's cut-off at most `rate_bandwidth_hz` (Hz), or unchanged (None)."""
    own = model.hysteresis.rate_bandwidth_hz
    if rate_bandwidth_hz is None:
        return model
    if is_finite(rate_bandwidth_hz) and own is not None and own <= rate_bandwidth_hz:
        return model
    return model.with_hysteresis(model.hysteresis.band_limited(rate_bandwidth_hz))


def randomise_plant(
    model: PlantModel[Any], half_width: float, rng: np.random.Generator
) -> PlantModel:
    """Return the plant with the numbers of its hysteresis drawn about their values.

    Every gain, every gap between neighbouring thresholds and every number of the shape is
    multiplied by its own number, uniform over ``1 - half_width`` to ``1 + half_width``, within its
    bounds: the thresholds stay in order. Of the RDPI model that is weights, gaps and δ2.
    """
    if half_width == 0.0:
        return model
    nominal = model.hysteresis
    factors = rng.uniform(1.0 - half_width, 1.0 + half_width, nominal.factors)
    return model.with_hysteresis(nominal.scaled(factors))


def drawn_parameters(effect: Effect) -> list[str]:
    """Return the parameters of an effect that are randomised: all but scales that are chosen."""
    return [parameter.name for parameter in effect.parameters if not parameter.fixed]


def effect_at(effect: Effect, levels: Sequence[int], half_width: float) -> Effect:
    """Return an effect with each of its :func:`drawn_parameters` at a level of its range.

    Level 0 is ``1 - half_width`` times its value, the last ``1 + half_width`` times, the others
    evenly between; physical bounds are kept.
    """
    middle = (EFFECT_LEVELS - 1) / 2
    values = effect.values
    for name, level in zip(drawn_parameters(effect), levels, strict=True):
        values[name] *= 1.0 + half_width * (level / middle - 1.0)
    return type(effect).within_bounds(**values)


def randomise_effects(model: PlantModel, half_width: float, rng: np.random.Generator) -> PlantModel:
    """Return the plant with the parameters of its effects drawn about their values.

    Each is at a level of its own, see :func:`effect_at`, drawn uniformly.
    """
    if half_width == 0.0:
        return model
    counts = [len(drawn_parameters(effect)) for effect in model.effects]
    levels = (rng.random(sum(counts)) * EFFECT_LEVELS).astype(int).tolist()
    effects = []
    for effect, count in zip(model.effects, counts, strict=True):
        effects.append(effect_at(effect, levels[:count], half_width))
        levels = levels[count:]
    return replace(model, effects=tuple(effects))


def draw_truth(
    law: DrawLaw,
    half_width: float,
    effects_half_width: float,
    rng: np.random.Generator,
    number: int,
) -> tuple[PlantModel, Mapping[int, PlantModel]]:
    """Return a plant about a nominal one, and what it becomes within an episode, by the sample."""
    model = randomise_plant(law.nominals[number % len(law.nominals)], half_width, rng)
    model = randomise_effects(model, effects_half_width, rng)
    if law.ageing is not None:
        model = law.ageing(model, float(rng.uniform()))
    return model, {} if law.schedule is None else law.schedule(model, rng)


def with_parameters(model: PlantModel, parameters: Mapping[str, Any]) -> PlantModel:
    """Return the plant with other values of some fields of its hysteresis."""
    document = model.to_dict()
    document["hysteresis"] |= {
        key: x.tolist() if isinstance(x, np.ndarray | np.generic) else x
        for key, x in parameters.items()
    }
    return PlantModel.from_dict(document, f"plant {model.name}")


def farthest_um(model: PlantModel, layout: ObservationLayout) -> float:
    """Farthest reading from the layout's centre (µm) that commands in its range can cause.

    The hysteresis reaches A max |u|; the sensor adds its step and ten standard deviations.
    """
    reach = model.hysteresis.A * max(map(abs, layout.command_range_V))
    sensor = 10.0 * model.sensor.noise_um + model.sensor.resolution_um
    return reach + abs(model.offset_um - layout.centre_um) + sensor


class TruthSource:
    """Draws the plant of each episode about `nominal`: band-limited, with a sensor's fields replaced.

    The relative half-widths, 0 or more and below 1, are those of :func:`randomise_plant` and
    :func:`randomise_effects`; `law` says what is drawn beyond. `later` is what the last plant becomes,
    by the sample of its episode, `number` that of its nominal plant.
    """

    def __init__(
        self,
        plant: PlantChoice,
        rate_bandwidth_hz: float | None,
        sensor: Mapping[str, float | None],
        half_width: float,
        effects_half_width: float = 0.0,
        law: DrawLaw | None = None,
    ) -> None:
        widths = {"randomise": half_width, "randomise_effects": effects_half_width}
        for name, width in widths.items():
            if not (is_finite(width) and 0.0 <= width < 1.0):
                raise InputError(
                    f"{name} is {quoted(width)}; give a relative half-width of 0 to below 1"
                )
        self.half_width, self.effects_half_width = float(half_width), float(effects_half_width)
        self._rate_bandwidth_hz = rate_bandwidth_hz
        self._sensor = {name: value for name, value in sensor.items() if value is not None}
        self.nominal = self._equip(plant)
        self.law = DrawLaw((self.nominal,))
        if law is not None:
            nominals = tuple(map(self._equip, law.nominals)) or (self.nominal,)
            self.law = replace(law, nominals=nominals)
        self.later: Mapping[int, PlantModel] = {}
        self.number = 0

    def bound_um(self, layout: ObservationLayout) -> float:
        """Distance from the layout's centre (µm) that no reading of an episode goes beyond."""
        margin = _MARGIN_WITH_EFFECTS if self.nominal.effects else _MARGIN
        return margin * (1.0 + self.half_width) * farthest_um(self.nominal, layout)

    def draw(self, seed: int, options: Mapping[str, Any], layout: ObservationLayout) -> PlantModel:
        """Return the plant of an episode: what the options say, else one drawn about the nominal."""
        self.later, self.number = {}, 0
        model, law = self.given(options, layout), self.law
        if model is not None:
            self.number = law.kind_of(model)
            return model
        if self.half_width == self.effects_half_width == 0.0 and not law.draws:
            return self.nominal
        rng = np.random.default_rng(seed)
        self.number = int(rng.integers(len(law.nominals)))
        widths = self.half_width, self.effects_half_width
        model, self.later = draw_truth(law, *widths, rng, self.number)
        return model

    def given(self, options: Mapping[str, Any], layout: ObservationLayout) -> PlantModel | None:
        """Return the plant that the options of an episode say; None where they say nothing of it."""
        parameters = {key: options[key] for key in PLANT_OPTIONS[1:] if key in options}
        if "plant" not in options and not parameters:
            return None
        model = self._equip(options["plant"]) if "plant" in options else self.nominal
        model = with_parameters(model, parameters)
        farthest, bound = farthest_um(model, layout), self.bound_um(layout)
        if farthest > bound:
            raise InputError(
                f"plant {model.name} can be read {farthest:.4g} µm from the centre, and what can be shown "
                f"ends at {bound:.4g} µm; make an environment of that plant instead"
            )
        return model

    def _equip(self, choice: PlantChoice) -> PlantModel:
        model = limit_band(choose_plant(choice), self._rate_bandwidth_hz)
        if not self._sensor:
            return model
        return replace(model, sensor=replace(model.sensor, **self._sensor))


ReferenceChoice: TypeAlias = str | Mapping[str, Any] | Signal
FrequencyChoice: TypeAlias = float | Sequence[float]


@dataclass(frozen=True)
class ReferenceSource:
    """Draws the reference of each episode.

    Of `choices`, names of signals, dictionaries of their fields with the name under ``signal``, or
    signals, one is drawn. A signal is used as it is; what a dictionary leaves out comes from the
    fields here; random signals get a seed of their own in each episode unless their dictionary has
    one. The frequency (Hz) is drawn log-uniformly between the lowest and the highest.
    """

    choices: tuple[ReferenceChoice, ...]
    frequency_hz: tuple[float, float]
    amplitude_um: float
    offset_um: float
    smooth_start_s: float

    def __post_init__(self) -> None:
        if not self.choices:
            raise InputError("reference is empty; give at least one, for example 'sine'")
        for choice in self.choices:
            self.make(choice, self.frequency_hz[0], 0)

    def draw(
        self,
        rng: np.random.Generator,
        reference: ReferenceChoice | None = None,
        frequency_hz: FrequencyChoice | None = None,
    ) -> Signal:
        """Return the reference of an episode, with what is given instead of what would be drawn."""
        index, position, seed = rng.integers(len(self.choices)), rng.random(), rng.integers(2**31)
        bounds = self.frequency_hz if frequency_hz is None else frequency_bounds(frequency_hz)
        choice = self.choices[index] if reference is None else reference
        return self.make(choice, frequency_at(bounds, float(position)), int(seed))

    def make(self, choice: ReferenceChoice, frequency_hz: float, seed: int) -> Signal:
        """Return the signal that a choice means at a frequency (Hz), from a seed of its own."""
        if isinstance(choice, Signal):
            return choice
        if not isinstance(choice, str | Mapping):
            raise InputError(
                f"reference {quoted(choice)} is {type(choice).__name__}; give a name, a dictionary or "
                "a signal"
            )
        given = {"signal": choice} if isinstance(choice, str) else dict(choice)
        name = given.pop("signal", None)
        if not isinstance(name, str) or name not in SIGNALS:
            raise InputError(
                f"reference {quoted(choice)} names no signal; the signals are {', '.join(SIGNALS)}"
            )
        if not all(isinstance(key, str) for key in given):
            raise InputError(f"reference {quoted(choice)} has a key that is no text; give names")
        defaults = {
            "smooth_start_s": self.smooth_start_s,
            "frequency_hz": frequency_hz,
            "seed": seed,
        }
        if not SIGNALS[name].in_micrometres:  # else amplitude and centre are not theirs
            defaults |= {"amplitude_um": self.amplitude_um, "offset_um": self.offset_um}
        declared = {field.name for field in fields(SIGNALS[name])}
        known = {key: value for key, value in defaults.items() if key in declared}
        return make_signal(name, **(known | given))


def reference_choices(
    reference: ReferenceChoice | Sequence[ReferenceChoice],
) -> tuple[ReferenceChoice, ...]:
    """Return one reference, or a sequence of them, as a tuple."""
    if isinstance(reference, str | Mapping | Signal):
        return (reference,)
    choices = tuple(reference) if isinstance(reference, Sequence) else (reference,)
    for choice in choices:
        if not isinstance(choice, str | Mapping | Signal):
            raise InputError(
                f"reference {quoted(choice)} is {type(choice).__name__}; give a name, a dictionary or a signal"
            )
    return choices


def frequency_at(bounds_hz: tuple[float, float], position: float) -> float:
    """Return the frequency (Hz) at a place of 0 to 1 between two, evenly in its logarithm."""
    low, high = bounds_hz
    # exp(log(f)) is not f: a frequency that is not drawn stays as given.
    return low if low == high else low * (high / low) ** position


def frequency_bounds(frequency_hz: FrequencyChoice) -> tuple[float, float]:
    """Return a frequency, or its lowest and highest value, as two frequencies (Hz)."""
    try:
        low, high = np.broadcast_to(np.asarray(frequency_hz, dtype=np.float64), 2).tolist()
    except (TypeError, ValueError, OverflowError):
        low = high = math.nan
    if not 0.0 < low <= high < math.inf:
        raise InputError(
            f"frequency_hz is {quoted(frequency_hz)}; give a frequency above 0 Hz, or the lowest and the highest"
        )
    return low, high
