"""Reference and excitation signals: displacement (µm) at any time (s), with exact derivatives."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

from rdpi_gym.signals.base import Signal
from rdpi_gym.signals.broadband import (
    BandLimitedNoise,
    Chirp,
    DecayingSine,
    LaplaceProcess,
    Multisine,
    WienerProcess,
)
from rdpi_gym.signals.combine import Combination, Sequence, Sum
from rdpi_gym.signals.measured import Measured
from rdpi_gym.signals.periodic import (
    NestedLoops,
    Raster,
    RasterSlowRamp,
    RasterSlowStairs,
    Sawtooth,
    Sine,
    Triangle,
    first_order_reversals,
)
from rdpi_gym.signals.steps import Constant, RandomSteps, Steps
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.plugins import Members
from rdpi_gym.support.words import guess, quoted

__all__ = [
    "SIGNALS",
    "BandLimitedNoise",
    "Chirp",
    "Constant",
    "DecayingSine",
    "LaplaceProcess",
    "Measured",
    "Multisine",
    "NestedLoops",
    "RandomSteps",
    "Raster",
    "RasterSlowRamp",
    "RasterSlowStairs",
    "Sawtooth",
    "Sequence",
    "Signal",
    "Sine",
    "Steps",
    "Sum",
    "Triangle",
    "WienerProcess",
    "first_order_reversals",
    "make_signal",
    "signal_from_dict",
]

SIGNALS: Mapping[str, type[Signal]] = Members("rdpi_gym.signals", Signal)  # type: ignore[type-abstract]
"""Every signal by its name: a file of this folder that defines one is found."""

_DEEPEST = 20


def make_signal(name: str, **fields: Any) -> Signal:
    """Make a signal by its name.

    Parameters
    ----------
    name
        A name in `SIGNALS`.
    fields
        The fields of that signal; those left out have their defaults. The ``parts`` of a ``sum`` or
        ``sequence`` may be signals or what `Signal.to_dict` returns.

    Raises
    ------
    InputError
        The name or a field is unknown, a field that has no default is missing, or a value is bad.

    Examples
    --------
    >>> make_signal("sine", amplitude_um=10.0, frequency_hz=50.0)
    Sine(amplitude_um=10.0, offset_um=0.0, smooth_start_s=0.0, frequency_hz=50.0, phase_rad=0.0)
    >>> make_signal("sin")
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: unknown signal 'sin'; did you mean 'sine'? The signals are ...
    """
    return _make(name, fields, 0)


def signal_from_dict(document: Mapping[str, Any]) -> Signal:
    """Make a signal from what `Signal.to_dict` returned, or from the same in JSON.

    Raises
    ------
    InputError
        The document is no object with the key ``signal``, its parts have parts more than 20 times
        over, or `make_signal` refuses it.

    Examples
    --------
    >>> signal = make_signal("chirp", stop_hz=200.0)
    >>> signal_from_dict(signal.to_dict()) == signal
    True
    """
    return _from_dict(document, 0)


def _from_dict(document: Mapping[str, Any], depth: int) -> Signal:
    if not isinstance(document, Mapping) or not isinstance(document.get("signal"), str):
        raise InputError(
            'a signal is a JSON object with its name under "signal", for example '
            '{"signal": "sine", "frequency_hz": 10.0}'
        )
    fields = dict(document)
    return _make(fields.pop("signal"), fields, depth)


def _make(name: str, fields: Mapping[str, Any], depth: int) -> Signal:
    if not isinstance(name, str):
        raise InputError(f"a signal's name is text, for example 'sine'; {quoted(name)} is none")
    if name not in SIGNALS:
        raise InputError(
            f"unknown signal {quoted(name)}{_closest(name, SIGNALS)} The signals are {', '.join(SIGNALS)}"
        )
    cls = SIGNALS[name]
    declared = {field.name: field for field in dataclasses.fields(cls)}
    for given in fields:
        if given not in declared:
            raise InputError(
                f"{name}: unknown field {quoted(given)}{_closest(given, declared)} "
                f"Its fields are {', '.join(declared)}"
            )
    for field in declared.values():
        if field.default is dataclasses.MISSING and field.name not in fields:
            raise InputError(f"{name}: the field {field.name} is missing; it has no default")
    if issubclass(cls, Combination) and isinstance(fields["parts"], list | tuple):
        if depth > _DEEPEST:
            raise InputError(f"{name}: its parts have parts more than {_DEEPEST} times over")
        parts = [
            _from_dict(part, depth + 1) if isinstance(part, Mapping) else part
            for part in fields["parts"]
        ]
        fields = dict(fields) | {"parts": parts}
    try:
        return cls(**fields)
    except (OverflowError, ZeroDivisionError) as error:
        raise InputError(f"{name}: its numbers are too large or too small ({error})") from None


def _closest(name: str, known: Iterable[str]) -> str:
    meant = guess(name, known)
    return f"; {meant}" if meant else "."
