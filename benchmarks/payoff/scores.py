"""Plants with hidden effects, beliefs about them, and the tracking scores of compensators by belief."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from baselines import make_controller
from benchmarks.effect_discovery.cases import study_fingerprint
from benchmarks.rows import complete, print_note
from benchmarks.tracking.case import Case
from benchmarks.tracking.controllers import code_fingerprint
from benchmarks.tracking.episode import score_lane, timed_recording
from benchmarks.tracking.evaluation import COLUMNS as SCORES
from benchmarks.tracking.stages import make_stage
from rdpi_gym.diagnosis.search.discover import discover
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.truth import limit_band
from rdpi_gym.identification import fit
from rdpi_gym.measurement import Dataset
from rdpi_gym.plant import P10, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row, named_rows
from rdpi_gym.virtual_lab import Truth, simulate_dataset

NOISE_UM = 0.012
"""White noise (µm rms) of the records in which the effects are looked for."""


@dataclass(frozen=True)
class HiddenPlant:
    """A plant and the effects that a bare belief does not know."""

    hidden: tuple[Effect, ...]  # the effects
    base: PlantModel = P10  # the plant without them

    @property
    def plant(self) -> PlantModel:
        """The plant with its effects, literal rate as in :data:`~rdpi_gym.plant.P10`."""
        return replace(self.base, name=self.name, effects=self.hidden)

    @property
    def name(self) -> str:
        """Name in tables."""
        return f"{self.base.name} with {' and '.join(effect.full_name() for effect in self.hidden)}"

    @property
    def slug(self) -> str:
        """Stem of its files' names."""
        words = [self.base.name.lower(), *(effect.full_name() for effect in self.hidden)]
        return "-".join(words).replace(", ", "-").replace(" ", "-")

    def stamp(self, seed: int) -> str:
        """Return a hash of all that its records depend on, the code aside."""
        content = json.dumps([self.plant.to_dict(), NOISE_UM, seed], sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()[:16]


def _hidden(**effects: dict[str, float]) -> HiddenPlant:
    return HiddenPlant(tuple(CATALOGUE[name](**values) for name, values in effects.items()))


HIDDEN_PLANTS: tuple[HiddenPlant, ...] = (
    _hidden(creep={"gain_per_decade": 0.015}),
    # The mode of the stage that the effect's file cites.
    _hidden(resonance={"f0_hz": 739.0, "damping": 0.03}),
    _hidden(creep={"gain_per_decade": 0.015}, sensor_lag={"time_constant_s": 2e-4}),
    # The pair that a diagnosis finds on the measured PICMA stack: an asymmetry of -8.6 % of the
    # stroke there, and creep whose amount those records do not fix.
    _hidden(
        asymmetry={"coefficient": -0.086, "span_um": 40.0}, creep={"gain_per_decade": 0.02}
    ),
    _hidden(resonance={"f0_hz": 739.0, "damping": 0.03}, delay={"delay_s": 2.2e-4}),
)  # fmt: skip
"""One effect or two that a laboratory meets, each at a common size."""


MEASURED = ("fitted", "discovered")
BELIEFS = ("bare", *MEASURED, "true")
"""``bare``: the true hysteresis without the effects, which no data show; ``fitted``: the RDPI model
fitted to records of the plant; ``discovered``: what ``rdpi discover`` makes of the same records;
``true``: the plant itself."""


FOLDER = Path(__file__).parent / "beliefs"
"""Folder of the beliefs of this release."""


def make_beliefs(hidden: HiddenPlant, folder: Path, seed: int = 0) -> dict[str, PlantModel]:
    """Return every belief about a plant, from files where they hold."""
    code = study_fingerprint()
    found = _stored(hidden, folder, seed, code)
    if len(found) < len(MEASURED):
        truth = Truth(hidden.base, hidden.hidden, noise_um=NOISE_UM, seed=seed)
        for name, model in _measured(simulate_dataset(truth), hidden.base, seed).items():
            marks = {"records": hidden.stamp(seed), "code": code}
            found[name] = replace(model, identification={**model.identification, **marks})
            found[name].save(_path(hidden, name, folder))
    return _all(hidden, found)


def stored_beliefs(
    hidden: HiddenPlant, folder: Path = FOLDER, seed: int = 0
) -> dict[str, PlantModel]:
    """Return every belief about a plant without a search for any; older code's files count."""
    found = _stored(hidden, folder, seed)
    for name in MEASURED:
        if name not in found:
            raise InputError(
                f"{_path(hidden, name, folder)} holds no belief about {hidden.name}; run python -m benchmarks.payoff"
            )
    return _all(hidden, found)


def _stored(
    hidden: HiddenPlant, folder: Path, seed: int, code: str | None = None
) -> dict[str, PlantModel]:
    """Return the measured beliefs in a folder, of the same records and, where it is given, code."""
    paths = {name: _path(hidden, name, folder) for name in MEASURED}
    models = {name: PlantModel.load(path) for name, path in paths.items() if path.exists()}
    marks = {"records": hidden.stamp(seed)} | ({} if code is None else {"code": code})
    return {n: m for n, m in models.items() if marks.items() <= m.identification.items()}


def _measured(dataset: Dataset, base: PlantModel, seed: int) -> Mapping[str, PlantModel]:
    """Identify and discover: all that is asked of the laboratory."""
    fitted = fit(dataset, n=base.hysteresis.n, name="fitted").plant
    return {"fitted": fitted, "discovered": discover(dataset, seed=seed).plant}


def _all(hidden: HiddenPlant, measured: Mapping[str, PlantModel]) -> dict[str, PlantModel]:
    base = hidden.base
    every = {"bare": base, **measured, "true": hidden.plant}
    return {
        name: replace(
            every[name],
            name=name,
            command_range_V=base.command_range_V,
            reference_um=base.reference_um,
        )
        for name in BELIEFS
    }


def _path(hidden: HiddenPlant, name: str, folder: Path) -> Path:
    return folder / f"{hidden.slug}-{name}.json"


PREVIEW_INVERSION = "preview-inversion"
"""With the true belief it is the bound that optimality gaps and command effort are measured against."""
CONTROLLERS = ("extended-inverse", "pi-extended-inverse", PREVIEW_INVERSION)
TS_S = 5e-5
PREVIEW = 16
"""Samples of the reference that an observation shows ahead: 0.8 ms."""
COLUMNS = (*SCORES, "fall")
ROWS_FILE = "payoff-rows.jsonl"
_WANTED = (
    ("sine", 10.0), ("sine", 50.0), ("sine", 100.0), ("triangle", 10.0), ("steps", 40.0),
    ("multisine", 50.0),
)  # fmt: skip
_CASE = ("plant", "reference", "frequency_hz", "seed")


@dataclass(frozen=True)
class Task:
    """One compensator on one plant with one belief, on all references side by side."""

    hidden: HiddenPlant  # the plant
    controller: str  # name of the compensator
    # what it believes of the plant, and what that is called
    name: str
    belief: PlantModel
    seed: int  # of the sensor's noise and of random references
    stamped: bool = (
        True  # whether its rows are stored, so that they carry a hash of what they depend on
    )

    @cached_property
    def code(self) -> str:
        """A hash of all that its rows depend on."""
        if not self.stamped:
            return ""
        own = [Path(__file__).read_text(encoding="utf-8"), code_fingerprint(self.controller)]
        plants = [self.hidden.plant.to_dict(), self.belief.to_dict()]
        return hashlib.sha256(json.dumps([*own, *plants]).encode()).hexdigest()[:16]

    def key(self, case: Case) -> str:
        """Name of a row in a store."""
        return f"{self.hidden.slug}/{self.controller}/{self.name}/{case.name}/{self.seed}"


def payoff_table(
    beliefs: Mapping[HiddenPlant, Mapping[str, PlantModel]],
    out: Path,
    seed: int = 0,
    jobs: int = 1,
    progress: Progress | None = None,
    ray_address: str | None = None,
    note: Callable[[str], None] = print_note,
    stamped: bool = True,
) -> pd.DataFrame:
    """Score every compensator with every belief on every plant; an interrupted run goes on."""
    cases = payoff_cases()
    tasks = [
        Task(hidden, controller, name, own[name], seed, stamped)
        for hidden, own in beliefs.items()
        for controller in CONTROLLERS
        for name in BELIEFS
    ]
    store = named_rows(out / ROWS_FILE)
    code = {task.key(case): task.code for task in tasks for case in cases}
    complete(
        store, tasks, run_task, lambda task: [task.key(case) for case in cases],
        lambda row: code.get(row["key"], row.get("code")) != row.get("code"),
        name=lambda row: row["key"], note=note,
        stale="rows of code that has changed since were set aside in {}", stage="hidden effects",
        jobs=jobs, progress=progress, ray_address=ray_address,
    )  # fmt: skip
    return _related([store.rows[key] for key in code])


def _related(rows: Sequence[Row]) -> pd.DataFrame:
    def find(row: Row, **other: str) -> Row:
        wanted = {k: row[k] for k in (*_CASE, "controller", "belief")} | other
        return by_key[tuple(wanted.values())]

    by_key = {tuple(row[k] for k in (*_CASE, "controller", "belief")): row for row in rows}
    related = []
    for row in rows:
        best, bare = (
            find(row, controller=PREVIEW_INVERSION, belief="true"),
            find(row, belief="bare"),
        )
        related.append(
            row
            | {
                "optimality_gap": row["rmse_um"] / best["rmse_um"],
                "command_total_variation": row["command_variation_V_s"]
                / best["command_variation_V_s"],
                "fall": bare["rmse_um"] / row["rmse_um"],
            }
        )
    return pd.DataFrame(related, columns=list(COLUMNS))


def payoff_cases() -> list[Case]:
    """Return the references of the payoff: smooth ones, and two with corners and jumps."""
    names = list(dict.fromkeys(name for name, _ in _WANTED))
    every = {(c.reference, c.frequency_hz): c for c in make_stage(P10).cases(names, TS_S)}
    return [every[key] for key in _WANTED]


def run_task(task: Task) -> list[Row]:
    """Score one compensator with one belief on one plant."""
    stage, cases = make_stage(task.hidden.plant, [TS_S]), payoff_cases()
    layout = ObservationLayout.for_plant(stage.plant, TS_S, preview=PREVIEW)
    references = stage.references([(case, task.seed) for case in cases], TS_S, PREVIEW)
    belief = limit_band(task.belief)
    rngs = [np.random.default_rng([task.seed, lane]) for lane in range(len(cases))]
    recording, warning, timed = timed_recording(
        lambda _: make_controller(task.controller, belief, layout),
        [stage.plant] * len(cases), layout, references, rngs,
    )  # fmt: skip
    common = {
        "code": task.code,
        "controller": task.controller,
        "plant": task.hidden.name,
        "belief": task.name,
        "ts_s": TS_S,
        "seed": task.seed,
        "microseconds_per_sample": timed,
    }
    rows = []
    for lane, case in enumerate(cases):
        named = {"reference": case.reference, "frequency_hz": case.frequency_hz}
        scored, text = score_lane(
            case, TS_S, references, recording, lane, warning=warning, identified_V_s=None
        )
        scores = {**asdict(scored), "status": text}
        rows.append({"key": task.key(case), **common, **named, **scores})
    return rows
