"""Held-out plants, and tracking scores of agents and compensators on them, all with the same belief."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from baselines import FEEDFORWARDS, LEARNED, make_controller
from baselines.learned.options import PLANTS, TrainingOptions
from benchmarks.tracking.case import Case
from benchmarks.tracking.controllers import code_fingerprint, task_fingerprint
from benchmarks.tracking.episode import ERROR, Score, one_line, record, score_lane, words
from benchmarks.tracking.stages import NOISE_UM, Stage, cases, largest_rate_V_s, make_stage
from rdpi_gym.envs import ObservationLayout
from rdpi_gym.envs.controller import warning_of
from rdpi_gym.envs.truth import randomise_effects, randomise_plant
from rdpi_gym.plant import P10, PlantModel, Sensor, find_plant
from rdpi_gym.plant.effects import Effect
from rdpi_gym.support.parallel import run_cases
from rdpi_gym.support.progress import Progress
from rdpi_gym.support.store import Row, named_rows
from studies.agents.training import Training

TS_S = TrainingOptions.ts_s
"""Sampling time (s) of trainings and scores."""
LITERAL = ", literal"
"""Ending of the name of a world with a literal rate."""
HELD_OUT = 2**34
"""Begins the entropy of every plant that is drawn here. Trainings draw from single numbers below
2^32, their evaluations from 2^33."""

_LAG, _CREEP, _MODE = PLANTS[0].effects


@dataclass(frozen=True)
class World:
    """Plants that are drawn about a nominal one.

    Examples
    --------
    >>> world = GROUPS[0]
    >>> world.truth(3) == world.truth(3), world.truth(3) == world.truth(4)
    (True, False)
    >>> world.belief.effects
    ()
    """

    name: str  # in tables
    nominal: PlantModel  # the plant with its effects
    # whether its rate is left as the paper writes it, in place of low-passed; beliefs and agents are the same
    literal: bool = False
    # lowest frequency (Hz) of its references; the highest is five times as high
    base_hz: float = 20.0

    @property
    def stage(self) -> Stage:
        """The nominal plant as the benchmark scores it, its rate low-passed and its sensor noisy."""
        return make_stage(self.nominal, [TS_S])

    @property
    def belief(self) -> PlantModel:
        """Belief of all controllers: the nominal hysteresis without effects."""
        return replace(self.stage.plant, effects=(), name=f"{self.nominal.name} without effects")

    def truth(self, seed: int) -> PlantModel:
        """Draw a plant about the nominal one, as widely as trainings do.

        A literal plant is the low-passed one of the same seed, its rate's low-pass aside.
        """
        rng = np.random.default_rng([HELD_OUT, zlib.crc32(self.nominal.name.encode()), seed])
        drawn = randomise_plant(self.stage.plant, TrainingOptions.randomise, rng)
        drawn = randomise_effects(drawn, TrainingOptions.randomise_effects, rng)
        if not self.literal:
            return drawn
        return drawn.with_hysteresis(replace(drawn.hysteresis, rate_bandwidth_hz=None))


def _group(name: str, *effects: Effect) -> World:
    sensor = Sensor(noise_um=NOISE_UM)
    return World(name, replace(P10, name=f"P10, {name}", effects=effects, sensor=sensor))


GROUPS = (
    _group("all", _LAG, _CREEP, _MODE),
    _group("lag", _LAG),
    _group("resonance", _MODE),
    _group("creep", _CREEP),
    _group("bare"),
)
"""Groups of plants by their effects: a lag, creep and a mode, one of them alone, or none;
all have a noisy sensor."""

GAP = {
    "bare": World("bare", GROUPS[4].nominal),
    "with effects": World("with effects", GROUPS[0].nominal),
    "picma": World("picma", find_plant("picma")),
    "picma at 1 Hz": World("picma at 1 Hz", find_plant("picma"), base_hz=1.0),
}
"""The domains of the gap. The record behind ``picma`` has 1 Hz: it is extrapolated at 20 to 100 Hz."""


def with_literal(world: World) -> tuple[World, World]:
    """Return a domain and its twin with a literal rate."""
    return world, replace(world, name=f"{world.name}{LITERAL}", literal=True)


COLUMNS = (
    "contestant", "kind", "training_seed", "world", "plant_seed", "ts_s", "rmse_um", "rmse_percent",
    "worst_percent", "command_variation_V_s", "status",
)  # fmt: skip
"""Columns of a table of scores: a row is one controller on one drawn plant, its numbers means over the
references; ``worst_percent`` is the RMSE of the worst of them. An RMSE in percent is relative to the
reference's peak to peak. ``training_seed`` is missing where nothing was trained."""
ROWS_FILE = "rows.jsonl"
PREVIEW_INVERSION = "preview-inversion"
"""Inverts the same belief with the whole reference at hand: what causal controllers cannot do."""


@dataclass(frozen=True)
class Contestant:
    """A controller that is scored, and the seed of its training."""

    name: str  # in tables
    kind: str  # ``agent``, ``feedforward``, ``feedback``, or ``preview``: the only one that is not causal
    controller: str  # name for ``make_controller``
    seed: int | None = None  # of its training


@dataclass(frozen=True)
class Run:
    """One contestant in one world: all plants and references side by side."""

    contestant: Contestant
    world: World
    plants: int  # number of plants; their seeds are 0, 1 and so on
    references: tuple[str, ...]  # names in the benchmark's suite

    def key(self, plant_seed: int) -> str:
        """Name of a row in the store."""
        one = self.contestant
        return f"{one.name}/{one.seed}/{self.world.name}/{plant_seed}/{','.join(self.references)}"

    @property
    def code(self) -> str:
        """A hash of all that its rows depend on."""
        parts = [
            code_fingerprint(self.contestant.controller),
            task_fingerprint(self.contestant.controller, self.world.nominal),
        ]
        parts.append(Path(__file__).read_text(encoding="utf-8"))
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def contestants(rivals: Sequence[str], trainings: Sequence[Training]) -> list[Contestant]:
    """Return the compensators and the policies of some trainings."""
    made = []
    for name in rivals:
        kind = "feedforward" if name in FEEDFORWARDS else "feedback"
        if name == PREVIEW_INVERSION:
            kind = "preview"
        made.append(Contestant(name, kind, name))
    for each in trainings:
        made.append(Contestant(each.agent.name, "agent", f"{LEARNED}{each.policy}", each.seed))
    return made


def score_all(
    runs: Sequence[Run],
    out: Path,
    jobs: int = 1,
    progress: Progress | None = None,
    ray_address: str | None = None,
    note: Callable[[str], None] | None = None,
) -> pd.DataFrame:
    """Score what is not finished, and return all of it; an interrupted run goes on."""
    store = named_rows(out / ROWS_FILE)
    remark = store.remark()
    if remark is not None and note is not None:
        note(remark)
    code: dict[str, str] = {}
    for run in runs:
        code |= dict.fromkeys([run.key(seed) for seed in range(run.plants)], run.code)
    store.set_aside(lambda row: code.get(row["key"], row.get("code")) != row.get("code"))
    left = [r for r in runs if any(r.key(seed) not in store.rows for seed in range(r.plants))]
    for done, rows in enumerate(run_cases(score_run, left, jobs, ray_address), start=1):
        store.append(rows)
        if progress is not None:
            progress("scoring", done, len(left))
    return pd.DataFrame([store.rows[key] for key in code], columns=list(COLUMNS))


def study_cases(
    references: Sequence[str], amplitude_um: float, base_hz: float = 20.0
) -> list[Case]:
    """Return the references between a frequency (Hz) and five times as much."""
    every = cases(references, amplitude_um, base_hz)
    return [case for case in every if base_hz <= case.frequency_hz <= 5.0 * base_hz]


def score_run(run: Run) -> list[Row]:
    """Score one contestant on every plant of a world; one that fails leaves rows that say so."""
    one, code = run.contestant, run.code
    rows = [
        {
            "key": run.key(seed), "code": code, "contestant": one.name, "kind": one.kind,
            "training_seed": one.seed, "world": run.world.name, "plant_seed": seed, "ts_s": TS_S,
        }
        for seed in range(run.plants)
    ]  # fmt: skip
    try:
        found = _run(run)
    except Exception as error:  # a controller may fail on some plant; the others go on
        reason = one_line(f"{type(error).__name__}: {error}")
        return [row | {"status": f"{ERROR}: {reason}"} for row in rows]
    return [row | scores for row, scores in zip(rows, found, strict=True)]


def _run(run: Run) -> list[Row]:
    stage, belief = run.world.stage, run.world.belief
    wanted = study_cases(run.references, stage.plant.reference_um[1], run.world.base_hz)
    usual = ObservationLayout.for_plant(stage.plant, TS_S)
    needed = getattr(make_controller(run.contestant.controller, belief, usual), "needed_preview", 1)
    layout = replace(usual, preview=max(usual.preview, needed))
    controller = make_controller(run.contestant.controller, belief, layout)
    lanes = [(seed, case) for seed in range(run.plants) for case in wanted]
    truths = [run.world.truth(seed) for seed in range(run.plants)]
    ordered = [(case, seed) for seed, case in lanes]
    references = stage.references(ordered, TS_S, layout.preview)
    rngs = [np.random.default_rng([seed, i]) for i, (seed, _) in enumerate(lanes)]
    taken = record(controller, [truths[seed] for seed, _ in lanes], layout, references, rngs)
    warning, limit = warning_of(controller), largest_rate_V_s(stage.plant)
    scores: list[list[Score]] = [[] for _ in truths]
    said: list[list[str]] = [[] for _ in truths]
    for lane, (seed, case) in enumerate(lanes):
        if not np.isfinite(taken.action[: case.window(TS_S)[1], lane]).all():
            raise ValueError(f"an action on plant {seed}, {case.name} is not finite")
        scored, text = score_lane(
            case, TS_S, references, taken, lane, warning=warning, identified_V_s=limit
        )
        scores[seed].append(scored)
        said[seed].append(text)
    return [_mean(each, lines) for each, lines in zip(scores, said, strict=True)]


def _mean(scores: Sequence[Score], said: Sequence[str]) -> Row:
    percent = [each.rmse_percent for each in scores]
    return {
        "rmse_um": float(np.mean([each.rmse_um for each in scores])),
        "rmse_percent": float(np.mean(percent)),
        "worst_percent": float(np.max(percent)),
        "command_variation_V_s": float(np.mean([each.command_variation_V_s for each in scores])),
        "status": ", ".join(sorted(words(said))) or "ok",
    }
