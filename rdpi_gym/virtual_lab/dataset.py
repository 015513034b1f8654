"""Records of a truth, simulated independently of the models that are fitted to them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from rdpi_gym.measurement import Dataset, Record, other_name, write_csv
from rdpi_gym.plant import RDPI, PlantModel, Sensor
from rdpi_gym.plant.cores.base import Core, empty_state, pack
from rdpi_gym.plant.cores.play import rate_block
from rdpi_gym.plant.effects import Effect
from rdpi_gym.signals.experiments import PAUSE_S, Experiment
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import Progress
from rdpi_gym.virtual_lab.independent.simulation import LARGEST_STEP_S, simulate_truth
from rdpi_gym.virtual_lab.independent.twin import Mechanism, carried
from rdpi_gym.virtual_lab.truth import Truth


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
