"""Base of every signal: displacement (µm) at any time (s), exact derivative, checks of fields."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted


def refuse(signal: Any, field: str, wanted: str) -> InputError:
    """Return the error for a field of `signal` that is not as `wanted` says."""
    return InputError(f"{signal.name}: {field} is {quoted(getattr(signal, field))}; give {wanted}")


def set_number(
    signal: Any,
    field: str,
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
) -> None:
    """Store a field as a float after checking that it is finite and within its bounds."""
    value = getattr(signal, field)
    if not (is_finite(value) and value > above and minimum <= value <= maximum):
        bounds = [
            f"{word} {bound:g}"
            for word, bound in (("above", above), ("at least", minimum), ("at most", maximum))
            if math.isfinite(bound)
        ]
        raise refuse(signal, field, " ".join(["a finite number", " and ".join(bounds)]).strip())
    object.__setattr__(signal, field, float(value))


def set_positive(signal: Any, *fields: str) -> None:
    """Store fields as floats after checking that they are finite and above zero."""
    for name in fields:
        set_number(signal, name, above=0.0)


def set_integer(signal: Any, field: str, *, minimum: int, maximum: int | None = None) -> None:
    """Store a field as an int after checking that it is a whole number within its bounds."""
    value = getattr(signal, field)
    if not is_whole(value, minimum) or (maximum is not None and value > maximum):
        limit = "" if maximum is None else f" and at most {maximum}"
        raise refuse(signal, field, f"a whole number of at least {minimum}{limit}")
    object.__setattr__(signal, field, int(value))


def set_numbers(signal: Any, field: str, *, count: int) -> None:
    """Store a field as a tuple of floats after checking that there are `count` of them or more."""
    try:
        values = np.asarray(getattr(signal, field), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.empty(0)
    if values.ndim != 1 or values.size < count or not np.isfinite(values).all():
        raise refuse(signal, field, f"a flat list of at least {count} finite numbers")
    object.__setattr__(signal, field, tuple(values.tolist()))


def checked(check: Callable[..., None], **bounds: Any) -> dict[str, Any]:
    """Return the metadata of a field that ``check(signal, field, **bounds)`` checks and stores."""
    return {"check": partial(check, **bounds)}


def number(default: float, **bounds: float) -> Any:
    """Return a field of a finite number within the bounds of :func:`set_number`."""
    return field(default=default, metadata=checked(set_number, **bounds))


positive = partial(number, above=0.0)
"""Field of a finite number above zero."""


def whole(default: int, *, minimum: int, maximum: int | None = None) -> Any:
    """Return a field of a whole number within its bounds."""
    return field(default=default, metadata=checked(set_integer, minimum=minimum, maximum=maximum))


def numbers(default: tuple[float, ...], *, count: int) -> Any:
    """Return a field of a list of at least `count` finite numbers, stored as a tuple."""
    return field(default=default, metadata=checked(set_numbers, count=count))


# A sample that falls on a jump or a corner up to rounding belongs to what comes after it, so that
# k * 1e-3 and 10 k * 1e-4 see the same value. In units of one cycle, hold or grid interval.
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Signal(ABC):
    """A reference or an excitation, defined at any time.

    Its value is ``w(t) (offset_um + amplitude_um shape(t))``: `shape` is what the subclass defines,
    about -1 to 1, and w the smooth start, the quintic ``10 s³ - 15 s⁴ + 6 s⁵`` of
    ``s = t / smooth_start_s``, twice continuously differentiable. With a smooth start the signal
    begins at 0 µm, where a plant at rest is. Before t = 0 the value at 0 is held.

    Signals are frozen and compare by value; `dataclasses.replace` makes a changed one. A signal of
    your own defines `name`, ``_shape(t)`` and ``_shape_rate(t)`` (1/s).

    Parameters
    ----------
    amplitude_um
        Factor on the shape (µm), 0 or more.
    offset_um
        Displacement about which the shape moves (µm).
    smooth_start_s
        Duration of the smooth start (s); 0 starts at once.

    Attributes
    ----------
    name
        By which `make_signal` knows it.
    in_micrometres
        Whether the shape is in µm already, so that `amplitude_um` is no amplitude but a factor.

    Raises
    ------
    InputError
        A field is not finite or outside its range.

    Examples
    --------
    >>> from rdpi_gym.signals import Sine
    >>> sine = Sine(amplitude_um=10.0, frequency_hz=50.0)
    >>> sine([0.0, 0.005, 0.015])
    array([  0.,  10., -10.])
    >>> round(float(sine.derivative(0.0)), 3)
    3141.593
    """

    name: ClassVar[str]
    in_micrometres: ClassVar[bool] = False

    amplitude_um: float = number(1.0, minimum=0.0)
    offset_um: float = number(0.0)
    smooth_start_s: float = number(0.0, minimum=0.0)

    def __post_init__(self) -> None:
        for each in fields(self):
            if "check" in each.metadata:
                each.metadata["check"](self, each.name)

    def __call__(self, t: ArrayLike) -> Array:
        """Return the displacement (µm) at times `t` (s), in the shape of `t`."""
        held = np.maximum(_times(t), 0.0)
        value = self.offset_um + self.amplitude_um * self._shape(held)
        if self.smooth_start_s > 0.0:
            value = value * _start(held, self.smooth_start_s)
        return np.asarray(value)

    def derivative(self, t: ArrayLike) -> Array:
        """Return the exact derivative (µm/s) at times `t` (s), in the shape of `t`.

        It is the right-sided one at corners. At a jump it is that of the signal after the jump:
        `has_derivative` says whether there are jumps. Before t = 0 it is zero.

        Raises
        ------
        InputError
            A time is NaN or infinite.
        """
        time = _times(t)
        held = np.maximum(time, 0.0)
        rate = self.amplitude_um * self._shape_rate(held)
        if self.smooth_start_s > 0.0:
            s = held / self.smooth_start_s
            value = self.offset_um + self.amplitude_um * self._shape(held)
            rate = smoothstep(s) * rate + smoothstep_rate(s) / self.smooth_start_s * value
        return np.where(time < 0.0, 0.0, rate)

    def preview(self, t: ArrayLike, ts_s: float, samples: int) -> Array:
        """Return what comes: the displacements (µm) at ``t + ts_s``, ... ``t + samples ts_s``.

        Parameters
        ----------
        t
            Times (s), any shape.
        ts_s
            Sampling time (s), above 0.
        samples
            How many samples ahead, 0 or more.

        Returns
        -------
        ndarray
            Shape of `t` with a last axis of length `samples`.

        Raises
        ------
        InputError
            `ts_s` is not above 0, `samples` is no whole number of 0 or more, or a time is not finite.

        Examples
        --------
        >>> from rdpi_gym.signals import Sawtooth
        >>> Sawtooth(frequency_hz=1.0).preview([0.0, 0.1], ts_s=0.1, samples=3)
        array([[0.2, 0.4, 0.6],
               [0.4, 0.6, 0.8]])
        """
        if not (is_finite(ts_s) and ts_s > 0.0):
            raise InputError(
                f"ts_s is {quoted(ts_s)}; give a sampling time above 0 s, for example 5e-5"
            )
        if not is_whole(samples, 0):
            raise InputError(f"samples is {quoted(samples)}; give a whole number, 0 or more")
        return self(_times(t)[..., np.newaxis] + ts_s * np.arange(1, samples + 1))

    @property
    def has_derivative(self) -> bool:
        """Whether the signal is continuous, so that `derivative` tells all of its change."""
        return True

    @property
    def period_s(self) -> float | None:
        """Time after which the signal repeats (s), once its smooth start is over; None: never."""
        return None

    def with_seed(self, seed: int) -> Self:
        """Return the signal drawn anew from `seed`; one without randomness is returned as it is.

        Examples
        --------
        >>> from rdpi_gym.signals import Multisine, Sine
        >>> Multisine().with_seed(7).seed
        7
        >>> Sine().with_seed(7) == Sine()
        True
        """
        if any(field.name == "seed" for field in fields(self)):
            return replace(self, seed=seed)  # type: ignore[call-arg]  # checked just above
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the signal as plain JSON values, which `signal_from_dict` reads back exactly.

        Examples
        --------
        >>> from rdpi_gym.signals import Constant
        >>> Constant(offset_um=3.0).to_dict()["signal"]
        'constant'
        """
        values = {field.name: _plain(getattr(self, field.name)) for field in fields(self)}
        return {"signal": self.name} | values

    @abstractmethod
    def _shape(self, t: Array) -> Array:
        """Return the shape, about -1 to 1, at times `t` (s), none below 0."""

    @abstractmethod
    def _shape_rate(self, t: Array) -> Array:
        """Return the right-sided derivative of the shape (1/s) at times `t` (s), none below 0."""


def smoothstep(s: Array) -> Array:
    """Return the quintic from 0 at s = 0 to 1 at s = 1, constant outside, C2 everywhere."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def _start(t: Array, duration_s: float) -> Array:
    """Smooth start at times `t` (s): the quintic where it has not ended, 1 elsewhere."""
    if t.ndim != 1:
        return smoothstep(t / duration_s)
    begins = t < duration_s
    weight = np.ones(t.shape)
    weight[begins] = smoothstep(t[begins] / duration_s)
    return weight


def smoothstep_rate(s: Array) -> Array:
    """Return the derivative of `smoothstep` with respect to s."""
    s = np.clip(s, 0.0, 1.0)
    return 30.0 * s**2 * (1.0 - s) ** 2


def _times(t: ArrayLike) -> Array:
    try:
        time = np.asarray(t, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"the times are {quoted(t)}; give numbers (s)") from None
    if not np.isfinite(time).all():
        raise InputError("a time is NaN or infinite; give finite times in s")
    return time


def _plain(value: Any) -> Any:
    if isinstance(value, Signal):
        return value.to_dict()
    return [_plain(item) for item in value] if isinstance(value, tuple) else value
