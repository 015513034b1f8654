"""Knobs of controllers, and the settings that were found for them on training draws."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

from baselines.base import Baseline
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import is_finite, is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_json
from rdpi_gym.support.words import guess, quoted, short, some

FORMAT, VERSION = "rdpi-tuned", 1
TUNED = Path(__file__).parent / "tuned"
"""Folder of the committed settings, one file a controller."""

Settings: TypeAlias = Mapping[str, float]
"""Values of knobs by their names."""


@dataclass(frozen=True)
class Knob:
    """One number of a controller that is tuned.

    Parameters
    ----------
    name
        What settings call it, its unit at the end where it has one.
    low, high
        Range that it may be turned over.
    default
        Value where nothing is tuned.
    unit
        Unit; ``1``: none.
    logarithmic
        Whether it is searched evenly in its logarithm.

    Raises
    ------
    InputError
        The range is empty, does not hold the default, or is logarithmic and not above zero.

    Examples
    --------
    >>> Knob("cutoff_hz", 10.0, 2000.0, 200.0, "Hz", logarithmic=True).checked(3000.0)
    Traceback (most recent call last):
    ...
    rdpi_gym.support.errors.InputError: cutoff_hz is 3000.0; give 10 to 2000 Hz
    """

    name: str
    low: float
    high: float
    default: float
    unit: str = "1"
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not self.low < self.high or (self.logarithmic and self.low <= 0.0):
            raise InputError(
                f"knob {self.name} goes from {self.low} to {self.high}; give a lower end below the "
                "upper one, and above 0 where it is logarithmic"
            )
        self.checked(self.default)

    def checked(self, value: object) -> float:
        """Return a value as a float."""
        if not is_finite(value) or not self.low <= float(value) <= self.high:  # type: ignore[arg-type]
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise InputError(
                f"{self.name} is {quoted(value)}; give {self.low:g} to {self.high:g}{unit}"
            )
        return float(value)  # type: ignore[arg-type]

    def at(self, part: float) -> float:
        """Return the value that part of the range from the default, within the range."""
        value = self.default + part * (self.high - self.low)
        if self.logarithmic:
            value = self.default * math.pow(self.high / self.low, part)
        return min(max(value, self.low), self.high)


def checked_settings(name: str, knobs: Sequence[Knob], settings: Mapping[str, Any]) -> Settings:
    """Return settings for every knob of a controller: what is given, else the default."""
    known = {knob.name: knob for knob in knobs}
    for given in settings:
        if given not in known:
            close = guess(given, known) if isinstance(given, str) else ""
            has = some(known, 20) or "none"
            raise InputError(
                f"{name} has no setting {quoted(given)}; {close and close + ' '}It has {has}"
            )
    return {key: knob.checked(settings.get(key, knob.default)) for key, knob in known.items()}


@dataclass(frozen=True)
class Tuning:
    """Settings found for one task, and the search that found them."""

    settings: Settings
    effects: tuple[str, ...]  # names of those of the task's belief, sorted
    command: str  # that found the settings
    seed: int  # of the search and of its draws
    plant_samples: int  # lanes times steps that were simulated on the way
    score_percent: float  # minimum on the training draws


def read_tunings(path: Path, name: str, knobs: Sequence[Knob]) -> dict[str, Tuning]:
    """Read what was found for a controller, by task."""
    document = read_json(path, FORMAT, VERSION)
    if document.get("controller") != name:
        raise InputError(
            f"{path} holds settings of {quoted(document.get('controller'))}; give those of {name}"
        )
    tasks = document.get("tasks")
    if not isinstance(tasks, dict):
        raise InputError(f"{path}: tasks is {quoted(tasks)}; give one entry a task")
    return {
        task: _tuning(f"{path}, task {short(task)}", tasks[task], name, knobs) for task in tasks
    }


def write_tunings(path: Path, name: str, tunings: Mapping[str, Tuning]) -> Path:
    """Write what was found for a controller; :func:`read_tunings` reads it."""
    document = {"format": FORMAT, "version": VERSION, "controller": name}
    return write_json(path, document | {"tasks": {k: asdict(v) for k, v in tunings.items()}})


def _tuning(source: str, entry: object, name: str, knobs: Sequence[Knob]) -> Tuning:
    fields = {"settings", "effects", "command", "seed", "plant_samples", "score_percent"}
    if not isinstance(entry, dict) or set(entry) != fields:
        raise InputError(f"{source} is {quoted(entry)}; give {', '.join(sorted(fields))}")
    settings, effects = entry["settings"], entry["effects"]
    if not isinstance(settings, dict):
        raise InputError(f"{source}: settings is {quoted(settings)}; give numbers by name")
    if not isinstance(effects, list) or not all(isinstance(e, str) for e in effects):
        raise InputError(f"{source}: effects is {quoted(effects)}; give their names")
    for count in ("seed", "plant_samples"):
        if not is_whole(entry[count], 0):
            raise InputError(f"{source}: {count} is {quoted(entry[count])}; give a whole number")
    if not isinstance(entry["command"], str) or not is_finite(entry["score_percent"]):
        raise InputError(f"{source}: give its command as text and its score as a number")
    try:
        found = checked_settings(name, knobs, settings)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return Tuning(**entry | {"settings": found, "effects": tuple(effects)})


class Tunable(Baseline):
    """A controller that says what can be turned of it.

    A subclass states its `knobs` and reads ``self.settings[name]``.

    Parameters
    ----------
    belief, layout
        As :class:`baselines.base.Baseline`.
    settings
        Values of knobs; those left out have their default. None: the committed ones of the task
        whose belief differs in the fewest effects, the first of such; without a file the defaults.

    Raises
    ------
    InputError
        As there; a setting is none of the knobs or out of range.

    Attributes
    ----------
    knobs : tuple of Knob
        What can be turned of it.
    tuned_as : str or None
        Name of the controller whose committed settings it takes; None: its own.
    settings : mapping
        Value of every knob.
    plant_samples : int
        Samples of plants that were simulated to find them; 0: they are not the committed ones.

    Examples
    --------
    >>> from baselines.feedforward import StaticGain
    >>> from rdpi_gym.plant import named_plant
    >>> class Scaled(Tunable, StaticGain):
    ...     name = "scaled"
    ...     knobs = (Knob("share", 0.5, 1.5, 1.0),)
    >>> plant = named_plant("P5")
    >>> Scaled(plant, ObservationLayout.for_plant(plant, ts_s=1e-4), {"share": 0.9}).settings
    {'share': 0.9}
    """

    knobs: ClassVar[tuple[Knob, ...]] = ()
    tuned_as: ClassVar[str | None] = None

    def __init__(
        self, belief: PlantModel, layout: ObservationLayout, settings: Settings | None = None
    ) -> None:
        committed = committed_tuning(type(self), belief) if settings is None else None
        self.plant_samples = 0 if committed is None else committed.plant_samples
        given = (settings or {}) if committed is None else committed.settings
        self.settings = checked_settings(self.name, self.knobs, given)
        super().__init__(belief, layout)


def committed_tuning(kind: type[Tunable], belief: PlantModel) -> Tuning | None:
    """Return what is committed of a controller for the task whose belief differs in the fewest effects."""
    effects = {effect.name for effect in belief.effects}
    return min(
        _committed(kind).values(), key=lambda each: len(effects ^ set(each.effects)), default=None
    )


@cache
def _committed(kind: type[Tunable]) -> dict[str, Tuning]:
    name = kind.tuned_as or kind.name
    path = TUNED / f"{name}.json"
    return read_tunings(path, name, kind.knobs) if path.exists() else {}
