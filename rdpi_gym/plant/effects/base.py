"""Interface of an effect: declarations, parameters and compiled kernel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from inspect import get_annotations
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from rdpi_gym.plant.chain import CHAIN
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.cores.rdpi import RDPI
from rdpi_gym.plant.parameters import DataScale as DataScale
from rdpi_gym.plant.parameters import Parameter as Parameter
from rdpi_gym.plant.parameters import moved
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.words import quoted

Slot: TypeAlias = Literal["input", "rate", "memory", "hysteresis", "output"]
"""Where a stage stands: before the plays, on the rate that sets their thresholds, in their initial
state, on the hysteretic displacement (which still sees the command), or on the path behind it."""

SLOTS: tuple[Slot, ...] = tuple(place for place in CHAIN if place in get_args(Slot))  # type: ignore[misc]
"""The slots in the chain's order."""

Block = Callable[[Array, Array, Array, Array, float, Array], None]
"""Kernel ``block(x, u, p, state, ts, y)``: input and command ``[T, B]``, parameters ``[P, B]``,
state ``[S, B]``, sampling time (s), output ``[T, B]``; the state is left where the block ended.

`x` is the command (V) in slot ``input``, the rate (V/s) in ``rate``, and the displacement (µm)
without offset in ``hysteresis`` and ``output``; `u` is the command that the plays saw. A kernel
changes neither, takes a NaN in row 0 of the state for a stage that has seen no sample, and ignores
rows of the state beyond those that it asked for (lanes share the largest number)."""


def parameter(
    default: float,
    unit: str,
    low: float,
    high: float,
    typical: tuple[float, float],
    meaning: str,
    neutral: float | None = None,
    fixed: bool = False,
    step: float | None = None,
) -> Any:
    """Return a field of an effect that declares its :class:`Parameter`, under the name of the field.

    Examples
    --------
    >>> from rdpi_gym.plant.effects import CATALOGUE
    >>> CATALOGUE["backlash"].parameters[0].meaning
    'half of the gap, w'
    """
    declared = Parameter("", unit, low, high, typical, meaning, neutral, fixed, step)
    return field(default=default, metadata={"parameter": declared})


def rows(count: int) -> Any:
    """Return a method :meth:`Effect.state_rows` of an effect with as many rows at any sampling time."""

    def state_rows(effect: Effect, ts_s: float) -> int:
        """Return the number of state rows."""
        return count

    return state_rows


class Look:
    """One way to look at an effect, half of its picture.

    Parameters
    ----------
    kind
        What is drawn, for example ``loops``: a function of ``studies.effect_pages``.
    title
        Above it.
    arguments
        What that function takes besides: names of records of the standard protocol, times (s).

    Examples
    --------
    >>> Look("over_time", "A large sine", "sine-50hz", 0.0, 0.04).arguments
    ('sine-50hz', 0.0, 0.04)
    """

    def __init__(self, kind: str, title: str, *arguments: str | float) -> None:
        self.kind, self.title, self.arguments = kind, title, arguments


@dataclass(frozen=True)
class Picture:
    """The picture of an effect: parameters of a visible size and two halves.

    Parameters
    ----------
    values
        Parameters that are not at their defaults: an effect of a size that the eye sees.
    left, right
        Its two halves.
    """

    values: Mapping[str, float]
    left: Look
    right: Look


@dataclass(frozen=True)
class Effect(ABC):
    """A physical effect as a stage of the plant; one subclass a file.

    A subclass is a frozen dataclass whose fields are its parameters (floats, the defaults at a
    typical value) and that states the class attributes below.

    Attributes
    ----------
    name
        As on the command line.
    slot, order
        Where it stands in the chain, and its place among the effects of that slot.
    parameters
        One :class:`Parameter` a field; not stated where the fields declare them by :func:`parameter`.
        In a further form a field without a declaration has the one of that name in the simplest.
    form
        What tells a further form from the simplest, in words that read after the name ("hard
        rails"); empty for the simplest. See :func:`forms_of`.
    forms
        Of the simplest: its further forms, fewest parameters first.
    equation, source, signature, experiment
        The equation, where it is from, what it leaves in a residual, what shows it best.
    cause, hardware, magnitude, remedy
        For its page, in sentences: what causes it, where it is met, how large it usually is and says
        who, what to do about it. Empty unless stated.
    mistaken_for
        Names of effects that data may not tell apart from it.
    block
        The compiled kernel, as a ``staticmethod``.
    picture
        How its page shows it; None: as any effect is shown.
    kinked
        Parameter along which the error has a cusp, so that no gradient leads to its least value: a
        fit searches along it; None unless stated.
    stands_still
        Its output stands still at times while what enters moves, so that what a refit gains shows in
        no step from a start; False unless stated.
    clocked
        Row 0 of its state counts the samples since t = 0, so a stage that begins at the time t
        starts from t / Ts there; False unless stated.
    carried
        Parameters by which a row of its state is scaled, with that row: it holds a quantity times one
        over the parameter, which stays where the parameter changes on the way; none unless stated.
    weighs_plays
        It runs plays of its own with the weights of the plant's core, so a fit that steps one of
        them steps it there too; False unless stated.
    on_request
        It is found by its name alone: no list of the catalogue has it, so no search tries it unless
        it is asked for; False unless stated.

    Raises
    ------
    InputError
        A parameter outside its physical bounds.

    Examples
    --------
    >>> from rdpi_gym.plant.effects import CATALOGUE
    >>> CATALOGUE["delay"](delay_s=2.0)
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: delay delay_s is 2.0 s; physical values lie in 0 to 1
    """

    name: ClassVar[str]
    slot: ClassVar[Slot]
    order: ClassVar[int]
    parameters: ClassVar[tuple[Parameter, ...]]
    form: ClassVar[str] = ""
    forms: ClassVar[tuple[type[Effect], ...]] = ()
    simplest: ClassVar[type[Effect] | None] = None
    equation: ClassVar[str]
    source: ClassVar[str]
    signature: ClassVar[str]
    experiment: ClassVar[str]
    cause: ClassVar[str] = ""
    hardware: ClassVar[str] = ""
    magnitude: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    mistaken_for: ClassVar[tuple[str, ...]]
    block: ClassVar[Block]
    picture: ClassVar[Picture | None] = None
    kinked: ClassVar[str | None] = None
    stands_still: ClassVar[bool] = False
    clocked: ClassVar[bool] = False
    carried: ClassVar[Mapping[str, int]] = MappingProxyType({})
    weighs_plays: ClassVar[bool] = False
    on_request: ClassVar[bool] = False

    def __init_subclass__(cls, of: type[Effect] | None = None) -> None:
        """Make the class a further form of the effect `of`: what it does not state is as there.

        What the classes between it and :class:`Effect` state counts as its own. Forms are written
        below the simplest, fewest parameters first.
        """
        super().__init_subclass__()
        cls.simplest, cls.forms = of, ()
        if of is not None:
            of.forms += (cls,)
            stated = {
                key for each in cls.__mro__[: cls.__mro__.index(Effect)] for key in vars(each)
            }
            for key in _SHARED:
                if key not in stated and hasattr(of, key):
                    setattr(cls, key, getattr(of, key))
        if "parameters" not in vars(cls):
            cls._derive_parameters()

    @classmethod
    def _derive_parameters(cls) -> None:
        """Take the parameters from the fields, inherited ones first."""
        known = {p.name: p for p in cls.simplest.parameters} if cls.simplest else {}
        bases = reversed(cls.__mro__)
        found = {p.name: p for base in bases for p in vars(base).get("parameters", ())}
        for name in get_annotations(cls):
            value = vars(cls).get(name)
            if isinstance(value, Field) and "parameter" in value.metadata:
                found[name] = replace(value.metadata["parameter"], name=name)
            elif name in known and name not in found:
                found[name] = known[name]
        if found:
            cls.parameters = tuple(found.values())

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            self._check(parameter, getattr(self, parameter.name))

    def _check(self, parameter: Parameter, value: float) -> None:
        """Refuse a value outside the bounds of a parameter."""
        if not (is_finite(value) and parameter.low <= value <= parameter.high):
            raise InputError(
                f"{self.full_name()} {parameter.name} is {quoted(value)} {parameter.unit}; "
                f"physical values lie in {parameter.low:g} to {parameter.high:g}"
            )

    @classmethod
    def fits_in(cls, core: type[Core]) -> bool:
        """Whether the effect is defined for a core of this kind.

        What acts on the rate of the thresholds, or runs their plays again, needs the RDPI model's.

        Examples
        --------
        >>> from rdpi_gym.plant import CORES
        >>> from rdpi_gym.plant.effects import CATALOGUE
        >>> [CATALOGUE["rate_law"].fits_in(CORES[name]) for name in ("rdpi", "stop")]
        [True, False]
        """
        return issubclass(core, RDPI) or not (cls.weighs_plays or cls.slot == "rate")

    def coefficients(self, ts_s: float, hysteresis: Core) -> list[float]:
        """Return the column of ``p`` that the kernel reads; by default the parameters in order.

        Parameters
        ----------
        ts_s
            Sampling time (s).
        hysteresis
            The plant's core, for an effect that acts on a part of its displacement.
        """
        return list(self.values.values())

    @abstractmethod
    def state_rows(self, ts_s: float) -> int:
        """Return the number of state rows S at sampling time `ts_s` (s); 0 without memory."""

    def state_rows_with(self, ts_s: float, hysteresis: Core) -> int:
        """Return the same in a plant with a core, for an effect that runs plays of its own."""
        return self.state_rows(ts_s)

    def run(
        self,
        x: ArrayLike,
        ts_s: float,
        u: ArrayLike | None = None,
        hysteresis: Core | None = None,
    ) -> Array:
        """Run the effect alone over a record that begins at rest.

        Parameters
        ----------
        x
            What enters the stage, ``(T,)``.
        ts_s
            Sampling time (s).
        u
            Command (V) that the plays saw, ``(T,)``; zero by default.
        hysteresis
            The plant's core; a gain of 1 µm/V without plays by default.

        Returns
        -------
        float64[T]
            What leaves it.

        Examples
        --------
        >>> from rdpi_gym.plant.effects import CATALOGUE
        >>> CATALOGUE["delay"](delay_s=2e-3).run([0.0, 1.0, 2.0, 3.0], ts_s=1e-3).tolist()
        [0.0, 0.0, 0.0, 1.0]
        """
        column = np.array(x, dtype=np.float64)[:, None]
        command = np.zeros_like(column) if u is None else np.array(u, dtype=np.float64)[:, None]
        core = hysteresis or RDPI((1.0,), (), 0.0)
        p = np.array(self.coefficients(ts_s, core))[:, None]
        rows = self.state_rows_with(ts_s, core)
        state, y = np.full((rows, 1), np.nan), np.empty_like(column)
        type(self).block(column, command, p, state, ts_s, y)
        return y[:, 0]

    @classmethod
    def within_bounds(cls, **values: float) -> Self:
        """Return the effect with each of `values` moved to the nearest that is physical."""
        limits = {p.name: (p.low, p.high) for p in cls.parameters}
        return cls(**{k: min(max(v, limits[k][0]), limits[k][1]) for k, v in values.items()})

    @classmethod
    def bounded(cls, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return values of many plants, each moved to the nearest that is physical."""
        limits = {p.name: (p.low, p.high) for p in cls.parameters}
        return {name: np.clip(each, *limits[name]) for name, each in values.items()}

    @classmethod
    def columns(cls, values: Mapping[str, Array], ts_s: float) -> Array:
        """Return :meth:`coefficients` of m plants at values ``(m,)``, a column a plant.

        By default one plant after the other; an effect that does not read the core may have a form
        for all of them.
        """
        count = len(next(iter(values.values())))
        bare: Any = None
        made = [cls(**{k: float(v[i]) for k, v in values.items()}) for i in range(count)]
        return np.array([effect.coefficients(ts_s, bare) for effect in made]).T

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """Return where a fit to data of a size begins, one for each optimum that it may fall into.

        By default one: each parameter at the lower end of its typical range, a small effect.
        """
        return (cls(**{p.name: p.typical[0] for p in cls.parameters}),)

    @classmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """Return where a fit begins once a simpler form of the same effect has been fitted.

        By default its values are not used: the :meth:`starts`.
        """
        return cls.starts(scale)

    @property
    def slow_lag_s(self) -> float | None:
        """Lag behind a slow ramp of a stage that follows it with a gain of one (s); None of other stages."""
        return None

    def elements(self) -> tuple[Sequence[float], Sequence[float]]:
        """Return gains (1) and time constants (s) of first-order elements beside x, τ dz/dt + z = x."""
        return (), ()

    @classmethod
    def full_name(cls) -> str:
        """Return the name, and the form where it is not the simplest.

        Examples
        --------
        >>> from rdpi_gym.plant.effects import CATALOGUE
        >>> [kind.full_name() for kind in forms_of(CATALOGUE["saturation"])][:1]
        ['saturation']
        """
        return f"{cls.name}, {cls.form}" if cls.form else cls.name

    @classmethod
    def seen_in(cls, t_s: Array, left_um: Array) -> tuple[Self, ...]:
        """Return starts that the residual of a model shows by itself; by default none.

        Parameters
        ----------
        t_s
            Times on the clock of the experiment (s), ``(T,)``.
        left_um
            Residual there (µm).
        """
        return ()

    @classmethod
    def traces(cls, scale: DataScale) -> tuple[Effect, ...]:
        """Return effects of whose responses a sum comes near to that of any of the forms.

        A linear fit of them tells whether a form is worth its refit where the simplest shows
        nothing. Empty, by default: no such sum is known.
        """
        return ()

    @classmethod
    def bends(cls) -> Array | None:
        """Return combinations of the fitted parameters that are small where no record tells them.

        Returns
        -------
        float64[M, P] or None
            One in each row, over the parameters that are not fixed; a fit pays a little for their
            squares. None, by default: any values are alike.
        """
        return None

    def is_idle(self, scale: DataScale) -> bool:
        """Whether the effect is without consequence on data of this size; False by default."""
        return False

    def carry(self, state: Array, before: Effect) -> None:
        """Make what another of the same form remembers, ``float64[S]``, the memory of this one.

        By default it stays: displacements, and whatever does not go by the parameters.

        Parameters
        ----------
        state
            Of one lane, changed in place.
        before
            The effect with the parameters that it had.
        """
        for name, row in self.carried.items():
            state[row] *= before.values[name] / getattr(self, name)

    @classmethod
    def carry_columns(
        cls, state: Array, before: Mapping[str, Array], after: Mapping[str, Array]
    ) -> None:
        """Do as :meth:`carry` for many plants, ``float64[S, m]``, from their values to others."""
        for name, row in cls.carried.items():
            state[row] *= before[name] / after[name]

    def sampled_at(self, ts_s: float) -> Effect:
        """Return what it is on records of one sampling time (s): the same on any, by default."""
        return self

    def turns_from(self, first_V: float) -> tuple[float, ...]:
        """Return the commands (V) at which the plant turned before a record; of slot ``memory``.

        Parameters
        ----------
        first_V
            Command (V) at which the record begins, or at which the plant rests before it. Turns
            stand where they are or move with it, nothing between.

        Returns
        -------
        tuple of float
            In order; empty: it never moved.
        """
        return ()

    @property
    def values(self) -> dict[str, float]:
        """The parameters by name."""
        return {p.name: float(getattr(self, p.name)) for p in self.parameters}

    def to_dict(self) -> dict[str, Any]:
        """Return ``{"effect": name, parameter: value, ...}``, a further form with ``"form"``."""
        form = {"form": self.form} if self.form else {}
        return {"effect": self.name, **form, **self.values}

    def with_values(self, values: Mapping[str, float]) -> Effect:
        """Return the effect with some parameters changed.

        Raises
        ------
        InputError
            A parameter that the effect does not have, or a value outside its bounds.

        Examples
        --------
        >>> from rdpi_gym.plant.effects import CATALOGUE
        >>> CATALOGUE["resonance"]().with_values({"f0_hz": 700.0})
        Resonance(f0_hz=700.0, damping=0.02)
        """
        known = {p.name: p for p in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise InputError(
                    f"{self.full_name()} has no parameter {name!r}; "
                    f"its parameters are {', '.join(known)}"
                )
            self._check(known[name], value)
        return moved(self, Effect, **values)


class Stateless(Effect):
    """Effect without a state of its own."""

    state_rows = rows(0)


class Clocked(Effect):
    """Effect of the time since the experiment began; its only state by default is the clock."""

    clocked = True
    state_rows = rows(1)


class Extension(Effect):
    """Further form that holds the simplest: it starts from there even where that was not fitted."""

    @classmethod
    def starts(cls, scale: DataScale) -> tuple[Self, ...]:
        """From those of the simplest form."""
        simplest = forms_of(cls)[0]
        return tuple(
            start for one in simplest.starts(scale) for start in cls.from_simpler(one, scale)
        )

    @classmethod
    @abstractmethod
    def from_simpler(cls, simpler: Effect, scale: DataScale) -> tuple[Self, ...]:
        """Return where a fit begins; the default of :class:`Effect` would come back to `starts`."""


_SHARED = (
    "name", "slot", "order", "source", "signature", "experiment", "cause", "hardware", "magnitude",
    "remedy", "mistaken_for",
)  # fmt: skip
"""What a further form has from the simplest unless it or a class above it states its own."""


def forms_of(kind: type[Effect]) -> tuple[type[Effect], ...]:
    """Return all forms of an effect, the simplest first, then with ever more parameters.

    Parameters
    ----------
    kind
        Any of them.

    Examples
    --------
    >>> from rdpi_gym.plant.effects import CATALOGUE
    >>> [form.form for form in forms_of(CATALOGUE["saturation"])]
    ['', 'hard upper rail', 'hard lower rail', 'hard rails', 'soft unlike rails', 'rails with a knee']
    """
    simplest = kind.simplest or kind
    return (simplest, *simplest.forms)


def form_named(kind: type[Effect], form: object, source: str) -> type[Effect]:
    """Return the form of an effect of a name, empty for the simplest; `source` is named in errors."""
    forms = {each.form: each for each in forms_of(kind)}
    if not isinstance(form, str) or form not in forms:
        further = ", ".join(filter(None, forms)) or "none"
        raise InputError(
            f"{source}: no form is named {quoted(form)}; the simplest has no name, further forms are "
            f"{further}"
        )
    return forms[form]


def in_chain_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Sort effects as the chain runs them: by slot, then by their order in it."""
    return tuple(sorted(effects, key=lambda effect: (SLOTS.index(effect.slot), effect.order)))


def effect_from_dict(
    catalogue: Mapping[str, type[Effect]], document: Mapping[str, Any], source: str
) -> Effect:
    """Build an effect from the object that :meth:`Effect.to_dict` returns.

    Parameters
    ----------
    catalogue
        Effects by name.
    document
        The object.
    source
        Named in errors.

    Raises
    ------
    InputError
        No object, an unknown effect, form or parameter, a missing one, or a value that is no
        number in its bounds.

    Examples
    --------
    >>> from rdpi_gym.plant.effects import CATALOGUE
    >>> effect_from_dict(CATALOGUE, {"effect": "delay", "delay_s": 1e-4}, "model.json")
    Delay(delay_s=0.0001)
    >>> hard = {"effect": "saturation", "form": "hard rails", "low_V": -30.0, "high_V": 90.0}
    >>> effect_from_dict(CATALOGUE, hard, "model.json")
    HardRails(low_V=-30.0, high_V=90.0)
    """
    if not isinstance(document, Mapping):
        raise InputError(
            f'{source}: {quoted(document)} is no effect; expected {{"effect": name, parameter: value}}'
        )
    body = dict(document)
    name = body.pop("effect", None)
    if not isinstance(name, str) or name not in catalogue:
        raise InputError(
            f"{source}: no effect is named {quoted(name)}; known are {', '.join(catalogue)}"
        )
    kind = form_named(catalogue[name], body.pop("form", ""), f"{source}, {name}")
    known = [f.name for f in fields(kind)]
    for key, value in body.items():
        if key not in known:
            raise InputError(
                f"{source}, {name}: unknown parameter {quoted(key)}; known are {', '.join(known)}"
            )
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{source}, {name}, {key} is {quoted(value)}; expected a number")
    missing = [key for key in known if key not in body]
    if missing:
        raise InputError(f"{source}, {name}: parameter {missing[0]!r} is missing")
    try:
        return kind(**{key: float(value) for key, value in body.items()})
    except (InputError, OverflowError) as error:
        raise InputError(f"{source}: {error}") from None
