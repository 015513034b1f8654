"""Plant models: hysteresis, effects, sensor and converter, saved as versioned JSON, and the named plants."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np

from rdpi_gym.plant.cores.base import CORES, Core
from rdpi_gym.plant.cores.rdpi import PAPER_III_B, PAPER_IV_B, RDPI
from rdpi_gym.plant.effects.base import Effect, effect_from_dict, in_chain_order
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.documents import Documents
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.files import read_json, write_json
from rdpi_gym.support.words import quoted

_LONGEST = 2**62
"""Samples of a period that no record ends; more are no machine's whole number."""


@dataclass(frozen=True)
class Sensor:
    """A displacement sensor: white noise, then rounding to its resolution.

    Parameters
    ----------
    resolution_um
        Smallest step of the reading (µm); 0 is a continuous reading.
    noise_um
        Standard deviation of the noise (µm).

    Raises
    ------
    InputError
        A value is negative or not finite.

    Examples
    --------
    >>> float(Sensor(resolution_um=0.01).read(np.array([1.2345]), np.random.default_rng(0))[0])
    1.23
    """

    resolution_um: float = 0.0
    noise_um: float = 0.0

    def __post_init__(self) -> None:
        for name in ("resolution_um", "noise_um"):
            value = getattr(self, name)
            if not (is_finite(value) and value >= 0):
                raise InputError(
                    f"sensor {name} is {quoted(value)}; give a finite value of 0 µm or above"
                )

    def read(self, y_um: Array, rng: np.random.Generator) -> Array:
        """Return what the sensor shows of displacements `y_um` (µm, any shape)."""
        shown = y_um + self.noise_um * rng.standard_normal(y_um.shape) if self.noise_um else y_um
        if self.resolution_um:
            shown = np.round(shown / self.resolution_um) * self.resolution_um
        return np.asarray(shown, dtype=np.float64)


@dataclass(frozen=True)
class Converter:
    """A digital-to-analogue converter that holds its output for a period.

    Parameters
    ----------
    period_s
        Refresh period (s); 0 is none. It shows where the plant runs at a shorter Ts.

    Raises
    ------
    InputError
        The period is negative or not finite.

    Examples
    --------
    >>> Converter(period_s=5e-5).samples(1e-5)
    5
    """

    period_s: float = 0.0

    def __post_init__(self) -> None:
        if not (is_finite(self.period_s) and self.period_s >= 0):
            raise InputError(f"converter period_s is {quoted(self.period_s)}; give 0 s or above")

    def samples(self, ts_s: float) -> int:
        """Samples of length `ts_s` (s) that one period holds: 1 where Ts is the period or longer.

        Raises
        ------
        InputError
            Ts is shorter than the period and does not divide it.
        """
        ratio = self.period_s / ts_s
        if ratio <= 1.0:
            return 1
        if abs(ratio - round(ratio)) > 1e-6 * ratio:
            raise InputError(
                f"ts_s = {ts_s} does not divide the converter period of {self.period_s} s; "
                f"take {self.period_s / math.ceil(ratio):.9g}"
            )
        return min(round(ratio), _LONGEST)


# KEYENCE LC2420: 10 nm resolution; its 100 nm precision is read as three standard deviations.
PAPER_SENSOR = Sensor(resolution_um=0.010, noise_um=0.1 / 3.0)
# dSPACE board: 50 µs refresh time.
PAPER_CONVERTER = Converter(period_s=5e-5)


FORMAT, VERSION = "rdpi-plant", 1

OtherCore = TypeVar("OtherCore", bound=Core)
if TYPE_CHECKING:
    from typing_extensions import TypeVar as TypeVarWithDefault

    AnyCore = TypeVarWithDefault("AnyCore", bound=Core, default=RDPI, covariant=True)
else:
    AnyCore = TypeVar("AnyCore")


@dataclass(frozen=True)
class PlantModel(Generic[AnyCore]):
    """Everything that is fixed about a plant; :class:`~rdpi_gym.plant.Plant` runs it.

    Parameters
    ----------
    hysteresis
        The RDPI parameters, or those of another core of :data:`rdpi_gym.plant.CORES`.
    name
        What tables call it.
    command_range_V
        Lowest and highest command (V) that the amplifier takes.
    reference_um
        Centre and amplitude (µm) of the references that suit its stroke.
    offset_um
        Displacement (µm) added to the model's output.
    effects
        Physical effects besides the hysteresis, each kind once; kept in the chain's order.
    sensor, converter
        The test bench; none by default.
    note
        Where the parameters come from.
    identification
        What a fit says of itself (standard errors, largest rate); not used by the physics.

    Raises
    ------
    InputError
        An empty or reversed range, a reference amplitude that is not above zero, a value that is
        not finite, an effect that runs plays which the core does not have.

    Examples
    --------
    >>> model = PlantModel(RDPI.from_law([1.0, 0.5], 2.0, 0.0), "demo", (-10.0, 10.0), (0.0, 5.0))
    >>> PlantModel.from_dict(model.to_dict()) == model
    True
    """

    hysteresis: AnyCore
    name: str
    command_range_V: tuple[float, float]
    reference_um: tuple[float, float]
    offset_um: float = 0.0
    effects: tuple[Effect, ...] = ()
    sensor: Sensor = field(default_factory=Sensor)
    converter: Converter = field(default_factory=Converter)
    note: str = ""
    identification: Mapping[str, Any] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        for name, kind in _PARTS.items():
            if not isinstance(getattr(self, name), kind):
                raise InputError(f"{name} is {quoted(getattr(self, name))}; give a {kind.__name__}")
        low, high = _pair("command_range_V", self.command_range_V)
        if not low < high:
            raise InputError(
                f"command_range_V is ({low}, {high}); give the lowest and the highest command, for example (0, 100)"
            )
        centre, amplitude = _pair("reference_um", self.reference_um)
        if not amplitude > 0:
            raise InputError(
                f"reference_um is ({centre}, {amplitude}); give a centre and an amplitude above 0 µm"
            )
        if not is_finite(self.offset_um):
            raise InputError(
                f"offset_um is {quoted(self.offset_um)}; give a finite displacement (µm)"
            )
        for name in ("name", "note"):
            text = getattr(self, name)
            if not isinstance(text, str) or printable(text) != text:
                raise InputError(f"{name} is {quoted(text)}; give one line of text")
        if not isinstance(self.identification, Mapping):
            raise InputError(f"identification is {quoted(self.identification)}; give a mapping")
        if not isinstance(self.effects, list | tuple) or not all(
            isinstance(effect, Effect) for effect in self.effects
        ):
            raise InputError(
                f"effects is {quoted(self.effects)}; give a tuple of effects, for example "
                '(CATALOGUE["creep"](),)'
            )
        names = [effect.name for effect in self.effects]
        if len(set(names)) != len(names):
            raise InputError(f"effects {', '.join(names)}; a plant has each effect once at most")
        for effect in self.effects:
            # it would read another core's numbers as weights and thresholds
            if effect.weighs_plays and not effect.fits_in(type(self.hysteresis)):
                raise InputError(
                    f"{effect.full_name()} runs plays that only the core {RDPI.name} has, and the core "
                    f"is {self.hysteresis.name}; take it out, or give the plant the core {RDPI.name}"
                )
        object.__setattr__(self, "effects", in_chain_order(self.effects))

    def turns_from(self, first_V: float) -> tuple[float, ...]:
        """Return the commands (V) at which the plant turned before a record that begins at `first_V` (V).

        In order; empty: it never moved.
        """
        return tuple(turn for e in self.effects for turn in e.turns_from(first_V))

    def with_hysteresis(
        self, hysteresis: OtherCore, name: str | None = None
    ) -> PlantModel[OtherCore]:
        """Return the same bench and ranges around another hysteresis, under `name` if given."""
        changed: Any = replace(
            cast(Any, self), hysteresis=hysteresis, name=self.name if name is None else name
        )
        return cast("PlantModel[OtherCore]", changed)

    def to_dict(self) -> dict[str, Any]:
        """Return the plant as a JSON object of format ``rdpi-plant``."""
        document = dataclasses.asdict(self)
        document["effects"] = [effect.to_dict() for effect in self.effects]
        document["hysteresis"] = core_to_dict(self.hysteresis)
        return {"format": FORMAT, "version": VERSION, **document}

    def save(self, path: Path | str) -> Path:
        """Write the plant as JSON to `path`, whole or not at all."""
        return write_json(path, self.to_dict())

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], source: str = "plant") -> PlantModel:
        """Build a plant from the JSON object that :meth:`to_dict` returns.

        Parameters
        ----------
        document
            The object.
        source
            Named in errors.

        Raises
        ------
        InputError
            A key is missing or unknown, or a value is not what the plant needs.
        """
        if not isinstance(document, Mapping):
            raise InputError(f"{source} is {quoted(document)}; expected a JSON object")
        body = {k: v for k, v in document.items() if k not in ("format", "version")}
        if not body.keys() >= {*_NEEDED}:
            raise InputError(f"{source} needs the keys {', '.join(_NEEDED)}")
        return cast("PlantModel", _DOCUMENTS.read_fields(cls, body, source))

    @classmethod
    def load(cls, path: Path | str) -> PlantModel:
        """Read a plant from a JSON file.

        Raises
        ------
        InputError
            The file is missing, cut off, foreign, or holds values that no plant has.
        """
        return cls.from_dict(read_json(path, FORMAT, VERSION), str(path))


_NEEDED = ("hysteresis", "name", "command_range_V", "reference_um")
_PARTS: dict[str, type] = {"hysteresis": Core, "sensor": Sensor, "converter": Converter}


class _PlantDocuments(Documents):
    """Reader of plants: a core and an effect are chosen by their names."""

    strict = True

    def read(self, hint: Any, document: Any, source: str) -> Any:
        """Return the value of an annotation that a document holds."""
        if isinstance(hint, TypeVar):
            return core_from_dict(document, source)
        if hint is Effect:
            from rdpi_gym.plant.effects import CATALOGUE

            return effect_from_dict(CATALOGUE, document, source)
        return super().read(hint, document, source)


_DOCUMENTS = _PlantDocuments()


def core_to_dict(core: Core) -> dict[str, Any]:
    """Return a core as the JSON of a plant holds it: named, unless it is the RDPI model."""
    document = dataclasses.asdict(cast(Any, core))
    return document if core.name == RDPI.name else {"core": core.name, **document}


def core_from_dict(document: Any, where: str) -> Core:
    """Build a core from what :func:`core_to_dict` returns."""
    if not isinstance(document, Mapping):
        raise InputError(f"{where} is {type(document).__name__}; expected a JSON object")
    body = dict(document)
    name = body.pop("core", RDPI.name)
    if not isinstance(name, str) or (name != RDPI.name and name not in CORES):
        raise InputError(f"{where}: no core is named {quoted(name)}; known are {', '.join(CORES)}")
    return _DOCUMENTS.read_fields(RDPI if name == RDPI.name else CORES[name], body, where)


def _pair(name: str, values: Any) -> tuple[float, float]:
    if isinstance(values, list | tuple) and len(values) == 2 and all(map(is_finite, values)):
        return values[0], values[1]
    raise InputError(f"{name} is {quoted(values)}; give two finite numbers")


P5 = PlantModel(PAPER_III_B, "P5", (-25.0, 25.0), (0.0, 10.0), note="the paper, Section III-B")
P10 = PlantModel(PAPER_IV_B, "P10", (-80.0, 80.0), (0.0, 40.0), note="the paper, Section IV-B")


def _bench(model: PlantModel) -> PlantModel:
    return PlantModel(
        model.hysteresis,
        f"{model.name}-bench",
        model.command_range_V,
        model.reference_um,
        sensor=PAPER_SENSOR,
        converter=PAPER_CONVERTER,
        note=f"{model.note}, on the test bench of Section IV-A",
    )


def _library() -> Path:
    return Path(str(files("rdpi_gym.plant") / "library"))


MEASURED: tuple[str, ...] = tuple(sorted(path.stem for path in _library().glob("*.json")))
"""Those of measured or published records; each file says which, and what was held out."""
PLANTS: tuple[str, ...] = (
    "P5", "P10", "P5-static", "P10-static", "P5-bench", "P10-bench", *MEASURED,
)  # fmt: skip


@cache
def named_plant(name: str) -> PlantModel:
    """Return one of the plants of :data:`PLANTS`, RDPI models with the literal rate of Eq. 5.

    Parameters
    ----------
    name
        ``P5`` and ``P10`` are the paper's sets; ``-static`` has δ2 = 0; ``-bench`` adds 50 µs
        converters, 10 nm resolution and noise. ``picma`` was identified from a measured stack, and
        ``picma-preisach`` and its like from the same with another core; ``friction_damper-stop``
        and its like from a damper (kN over mm); ``lugre-1995`` is published (N over µm).

    Raises
    ------
    InputError
        No plant has that name.

    Examples
    --------
    >>> round(named_plant("P10").hysteresis.A, 4)
    1.2213
    """
    if name not in PLANTS:
        raise InputError(f"no plant is named {quoted(name)}; known are {', '.join(PLANTS)}")
    if name in MEASURED:
        return PlantModel.load(_library() / f"{name}.json")
    base, _, form = name.partition("-")
    model = P5 if base == "P5" else P10
    if form == "static":
        return model.with_hysteresis(model.hysteresis.static(), name)
    return _bench(model) if form == "bench" else model


def find_plant(name_or_path: str) -> PlantModel:
    """Return a named plant, or load the JSON file at a path.

    Raises
    ------
    InputError
        Neither a name of :data:`PLANTS` nor a readable plant file.

    Examples
    --------
    >>> find_plant("P5").name
    'P5'
    """
    if name_or_path in PLANTS:
        return named_plant(name_or_path)
    try:
        found = Path(name_or_path).is_file()
    except OSError:  # a name longer than any file's
        found = False
    if not found:
        raise InputError(
            f"{quoted(name_or_path)} is neither a plant file nor one of {', '.join(PLANTS)}"
        )
    return PlantModel.load(name_or_path)
