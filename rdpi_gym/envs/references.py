"""The reference of an episode: given, or drawn from what the environment was given."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import numpy as np

from rdpi_gym.signals import SIGNALS, Signal, make_signal
from rdpi_gym.support.checks import shown
from rdpi_gym.support.errors import InputError

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
                f"reference {shown(choice)} is {type(choice).__name__}; give a name, a dictionary or "
                "a signal"
            )
        given = {"signal": choice} if isinstance(choice, str) else dict(choice)
        name = given.pop("signal", None)
        if not isinstance(name, str) or name not in SIGNALS:
            raise InputError(
                f"reference {shown(choice)} names no signal; the signals are {', '.join(SIGNALS)}"
            )
        if not all(isinstance(key, str) for key in given):
            raise InputError(f"reference {shown(choice)} has a key that is no text; give names")
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
                f"reference {shown(choice)} is {type(choice).__name__}; give a name, a dictionary or a signal"
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
            f"frequency_hz is {shown(frequency_hz)}; give a frequency above 0 Hz, or the lowest and the highest"
        )
    return low, high
