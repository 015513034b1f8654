"""The truth behind a data set, and its records, simulated independently of the models that are fitted to them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.measurement import Dataset, Record, other_name, write_csv
from rdpi_gym.plant import RDPI, PlantModel, Sensor
from rdpi_gym.plant.cores.base import Core, empty_state, pack
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.effects import Effect
from rdpi_gym.signals.experiments import PAUSE_S, Experiment, standard_protocol
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.checks import is_finite
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic, write_json
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.words import quoted
from rdpi_gym.virtual_lab.independent.simulation import LARGEST_STEP_S, simulate_truth
from rdpi_gym.virtual_lab.independent.twin import Mechanism, carried

FORMAT, VERSION = "rdpi-truth", 1
TS_FACTORS = (0.1, 4.0)
"""Beyond the larger one the fastest lines of the protocol are not sampled."""

# Of the span, the smallest loops of the protocol where no threshold says how small they should be.
_SMALL = 0.05


@dataclass(frozen=True)
class Truth:
    """A plant, what is hidden in it, and the experiments that it goes through.

    Parameters
    ----------
    plant
        The plant that is known; effects of its own are no secret.
    hidden
        Effects besides those.
    noise_um
        White noise of the sensor (µm rms).
    seed
        Of the noise and of the random commands.
    ts_factor
        Factor on the sampling times of the standard protocol.

    Raises
    ------
    InputError
        Negative noise, a factor out of range, or a hidden effect that the plant has anyway.

    Examples
    --------
    >>> from rdpi_gym.plant import P10
    >>> truth = Truth(P10, (), noise_um=0.012, seed=0)
    >>> round(truth.span_V, 2), round(truth.stroke_um, 2), len(truth.experiments())
    (32.75, 40.0, 16)
    """

    plant: PlantModel
    hidden: tuple[Effect, ...]
    noise_um: float
    seed: int
    ts_factor: float = 1.0

    def __post_init__(self) -> None:
        if not (is_finite(self.noise_um) and self.noise_um >= 0):
            raise InputError(
                f"noise_um is {quoted(self.noise_um)}; give white noise of 0 µm rms or above, as in 0.012"
            )
        low, high = TS_FACTORS
        if not (is_finite(self.ts_factor) and low <= self.ts_factor <= high):
            raise InputError(
                f"ts_factor is {quoted(self.ts_factor)}; give a factor on the sampling times from {low} to {high}"
            )
        known = [effect.name for effect in self.plant.effects]
        for effect in self.hidden:
            if effect.name in known:
                raise InputError(
                    f"{self.plant.name} has {effect.name} already; hide another effect"
                )

    @property
    def centre_V(self) -> float:
        """Middle of the command's range (V)."""
        low, high = self.plant.command_range_V
        return 0.5 * (low + high)

    @property
    def span_V(self) -> float:
        """Largest excursion of the experiments from the centre (V).

        As much as the plant's reference amplitude needs, and as its range allows.
        """
        low, high = self.plant.command_range_V
        return min(0.5 * (high - low), self.plant.reference_um[1] / self.plant.hysteresis.A)

    @property
    def stroke_um(self) -> float:
        """Displacement of the span without hysteresis (µm)."""
        return self.span_V * self.plant.hysteresis.A

    def experiments(self) -> tuple[Experiment, ...]:
        """Return the standard protocol of this plant."""
        core: Core = self.plant.hysteresis
        thresholds = core.thresholds_V if isinstance(core, RDPI) else (_SMALL * self.span_V,)
        first_V = thresholds[0] if thresholds else self.span_V
        protocol = standard_protocol(self.centre_V, self.span_V, first_V, self.seed)
        return tuple(replace(e, ts_s=e.ts_s * self.ts_factor) for e in protocol)

    def with_hidden(self, hidden: Sequence[Effect]) -> Truth:
        """Return the same with other effects hidden."""
        return replace(self, hidden=tuple(hidden))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``truth.json``."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "hidden": [effect.to_dict() for effect in self.hidden],
            "plant": self.plant.to_dict(),
            "noise_um": self.noise_um,
            "seed": self.seed,
            "ts_factor": self.ts_factor,
            "centre_V": self.centre_V,
            "span_V": self.span_V,
            "simulated": f"by rdpi_gym.virtual_lab.independent on a grid of {LARGEST_STEP_S * 1e6:g} µs or finer",
        }

    def save(self, path: Path | str) -> Path:
        """Write ``truth.json``, whole or not at all."""
        return write_json(path, self.to_dict())


def core_deformation(core: Core, step_s: float, parts: int) -> Mechanism:
    """Displacement (µm) over the voltage of a core that has no formulation of its own: its kernel.

    The rate (Eq. 5) is taken over a sampling interval of `parts` steps of the fine grid (s).
    """
    parameters = pack([core], step_s, [0.0])
    last = np.empty(1)

    def start(u: Array) -> Array:
        state = empty_state(core.n, 1)
        state[2:, 0], last[0] = core.settled(()), u[0]
        state[2:] = core.resting(state[2:], u[:1])
        return state

    def deform(u: Array, state: Array) -> Array:
        command = np.ascontiguousarray(u[:, None])
        v, y = np.empty_like(command), np.empty_like(command)
        if core.rate_bandwidth_hz is not None:
            rate_block(command, parameters, state, step_s, v)
        else:
            begins = np.arange(0, len(u), parts)
            steps = np.minimum(begins + parts, len(u)) - begins
            ends = u[begins + steps - 1]
            v[:, 0] = np.repeat(np.diff(ends, prepend=last) / (steps * step_s), steps)
        type(core).block(command, v, parameters, state, y)
        last[0] = u[-1]
        return y[:, 0]

    return carried(start, deform)


SETTINGS = "dataset.toml"


def simulate_dataset(
    truth: Truth,
    displace: Callable[[Truth, Array, Array], Array] | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Take the standard protocol on a plant with hidden effects.

    The clock runs through all records, with a pause between them; every record begins with the
    plant at rest there, as :class:`rdpi_gym.plant.Plant` does after a reset.

    Parameters
    ----------
    truth
        The plant and its secret.
    displace
        Called with the truth, times (s) and commands (V), returns the displacement (µm) before the
        sensor; :func:`displacement` by default.
    progress
        Called as records are done.

    Returns
    -------
    Dataset
        Records named by their experiments, in the order in which they were taken.

    Raises
    ------
    InputError
        The plant has an effect that the independent formulation does not know.
    """
    experiments, records = truth.experiments(), []
    for number, (experiment, t) in enumerate(zip(experiments, clock(experiments), strict=True)):
        u = experiment.command_V()
        y = (displace or displacement)(truth, t, u)
        sensor = Sensor(truth.plant.sensor.resolution_um, truth.noise_um)
        # a stream of its own for each record: its noise does not depend on the others
        y = sensor.read(y, np.random.default_rng([truth.seed, number]))
        records.append(
            Record(
                experiment.name, t, u, y, ts_s=experiment.ts_s, role=experiment.role,
                note=experiment.purpose,
            )
        )  # fmt: skip
        if progress is not None:
            progress("simulating", number + 1, len(experiments))
    return Dataset(f"simulated records of {truth.plant.name}", tuple(records))


def clock(experiments: tuple[Experiment, ...]) -> list[Array]:
    """Times of the samples (s) on one clock, with a pause between the experiments."""
    times, start = [], 0.0
    for experiment in experiments:
        times.append(start + experiment.times_s())
        start += experiment.duration_s + PAUSE_S
    return times


def displacement(truth: Truth, t: Array, u: Array) -> Array:
    """Displacement (µm) of the plant with what is hidden, before the sensor."""
    effects = [*truth.plant.effects, *truth.hidden]
    return plant_displacement(truth.plant, effects, t, u)


def plant_displacement(
    plant: PlantModel,
    effects: list[Effect],
    t: Array,
    u: Array,
    largest_step_s: float = LARGEST_STEP_S,
) -> Array:
    """Displacement (µm) of a plant with these effects in place of its own, on a fine grid (s)."""
    hysteresis = (
        dataclasses.asdict(plant.hysteresis)
        if isinstance(plant.hysteresis, RDPI)
        else partial(core_deformation, plant.hysteresis)
    )
    hold = plant.converter.samples(float(t[1] - t[0]))
    index = np.arange(len(u))
    held = u[index - index % hold]
    documents = [effect.to_dict() for effect in effects]
    return plant.offset_um + simulate_truth(hysteresis, documents, t, held, largest_step_s)


def write_dataset(dataset: Dataset, folder: Path, note: str) -> list[Path]:
    """Write records as CSV and a ``dataset.toml`` beside them.

    Parameters
    ----------
    dataset
        The records.
    folder
        Where to.
    note
        A comment for the head of the ``dataset.toml``.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        The folder holds files of something else, or cannot be written.
    """
    names = [f"{record.name}.csv" for record in dataset.records]
    if folder.exists():
        if not folder.is_dir():
            raise InputError(f"{folder} is a file; give another folder for --out")
        others = sorted({file.name for file in folder.iterdir()} - {*names, SETTINGS})
        if others:
            raise InputError(
                f"{folder} holds {others[0]}, which is none of these records; give another folder for --out"
            )
    paths = [
        write_csv(record, folder / name)
        for record, name in zip(dataset.records, names, strict=True)
    ]
    lines = [f"# {note}", f'title = "{dataset.title}"', *_inputs(dataset), *_quantities(dataset)]
    for record in dataset.records:
        lines += ["", f"[records.{record.name}]", f'note = "{record.note}"']
    return [*paths, write_atomic(folder / SETTINGS, "\n".join(lines) + "\n")]


def _inputs(dataset: Dataset) -> list[str]:
    """Name the inputs that every record has beside u."""
    names = [list(map(other_name, record.others)) for record in dataset.records]
    if not names or not names[0] or any(each != names[0] for each in names):
        return []
    return ["", "[columns]", f"inputs = {json.dumps(['u', *names[0]], ensure_ascii=False)}"]


def _quantities(dataset: Dataset) -> list[str]:
    found = dataset.quantities
    if found.are_standard:
        return ["", "[units]", 'u = "V"', 'y = "um"']
    lines = ["", "[quantities]"]
    for side, quantity in (("input", found.input), ("output", found.output)):
        entry = ", ".join(
            f"{key} = {json.dumps(text, ensure_ascii=False)}"
            for key, text in vars(quantity).items()
        )
        lines.append(f"{side} = {{ {entry} }}")
    return lines
