"""Trainings of a minute on Stage, beside the best compensator there that is fixed.

    python -m studies.training_race --seeds 5

Trainings from scratch, each with several seeds, none longer than a minute of one core:

- ``native-ppo`` with increments of the command, for 4 and for 8 million steps: nothing is given;
- ``imitation``: a student corrects ``adaptive-dual-loop``, which adapts by itself, so it begins ahead.

``native-ppo`` draws its plants about the nominal one of Stage, as widely as the task does, and has the
hyper-parameters that ship; ``imitation`` is taught on the task's training draws, with fewer rounds,
lanes and units than ship. What comes out is scored on the public test draws as ``rdpi bench``
does it, beside the first controller of the committed ranking that neither learns nor adapts. Seconds
are those of the process, in one thread, from the call of the training to its end, with its
evaluations: on a machine that does nothing else the clock shows no more. Compiled kernels are there
before, but for the entrant that is the first training on a machine: a process of its own without any,
whose imports count too. Rows are kept in ``--runs``, and read from there.
"""

from __future__ import annotations

import os
import subprocess
import sys
from argparse import Namespace
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from baselines import GUARDED, LEARNED
from benchmarks.stages.ranking import ranking
from benchmarks.stages.run import Unit, run_unit
from rdpi_gym.envs.tasks import named_task
from rdpi_gym.envs.tasks.task import PUBLIC_SEED
from rdpi_gym.support.command import Options
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_json
from rdpi_gym.support.markdown import frame_table
from rdpi_gym.support.words import number
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "training_race"
TABLE = RESULTS.parent / "stages" / "tasks.csv"
"""The ranking of every task, as ``rdpi bench --full`` leaves it."""
RUNS = Path("results/training-race")
TASK, GOAL_S = "Stage", 60.0
ADAPTIVE = ("adaptive-", "hybrid", LEARNED, GUARDED)
"""Beginnings of the names of controllers that adapt or were learned."""
_FORMAT, _VERSION = "training-race", 1


def native_ppo(timesteps: int, out: Path, seed: int) -> Path:
    """Train the native PPO on the plants and references of the task; return its policy."""
    from baselines.learned.training import trainer

    Options, train = trainer("native-ppo")

    task = named_task(TASK)
    return train(
        Options(
            out=out,
            seed=seed,
            timesteps=timesteps,
            action="increment",
            plants=task.nominals,
            belief=task.belief(),
            reference=task.references,
            frequency_hz=task.frequency_hz,
            ts_s=task.ts_s,
            preview=task.preview,
            randomise=task.half_width,
            randomise_effects=task.effects_half_width,
        )
    )


_ALONE = """import sys
from pathlib import Path
from studies.training_race import native_ppo
print(native_ppo(int(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])))
"""


def native_ppo_first(timesteps: int, out: Path, seed: int) -> Path:
    """Train as :func:`native_ppo` on a machine that has compiled no kernel yet."""
    with TemporaryDirectory() as kernels:
        done = subprocess.run(
            [sys.executable, "-c", _ALONE, str(timesteps), str(out), str(seed)],
            env=os.environ | {"NUMBA_CACHE_DIR": kernels},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    return Path(done.stdout.splitlines()[-1])


CORRECTED = "adaptive-dual-loop"
"""Controller that the students of this race correct."""


def imitation(rounds: int, out: Path, seed: int) -> Path:
    """Teach a student for some rounds of eight plants; return its policy."""
    from baselines.learned.imitation.rounds import Options, train

    task = named_task(TASK)
    lanes = 8 * len(task.references)
    steps = rounds * lanes * (task.samples - 1)
    return train(
        Options(
            out=out,
            seed=seed,
            task=TASK,
            baseline=CORRECTED,
            lanes=lanes,
            timesteps=steps,
            every=steps,
            hidden=32,
            learning_rate=3e-3,
        )
    )


SHORT = "native-ppo, 4 M steps"
FIRST = f"{SHORT}, first on a machine"
ENTRANTS: Mapping[str, Callable[[Path, int], Path]] = {
    SHORT: partial(native_ppo, 4_000_000),
    FIRST: partial(native_ppo_first, 4_000_000),
    "native-ppo, 8 M steps": partial(native_ppo, 8_000_000),
    "imitation, 12 rounds": partial(imitation, 12),
}
"""Trainings, each ``train(out, seed)``."""


def read_rankings(path: Path = TABLE) -> pd.DataFrame:
    """Return the rivals of every task, by rank: those that see the preview alone, without the bound."""
    if not path.exists():
        raise InputError(f"{path} is missing; run rdpi bench --full")
    table = pd.read_csv(path)
    return table[(table["sees"] == "preview") & (table["rank"] != "bound")]


def best_fixed(rankings: pd.DataFrame) -> dict[str, Any]:
    """Return the first row of the task whose controller neither learns nor adapts."""
    rows = rankings[rankings["task"] == TASK]
    fixed = rows[~rows["controller"].str.startswith(ADAPTIVE)]
    first: dict[str, Any] = fixed.to_dict("records")[0]  # type: ignore[assignment]
    return first


def row_of(entrant: str, seed: int, folder: Path, plants: int) -> dict[str, Any]:
    """Train and score, or read what was kept."""
    kept = folder / "row.json"
    if kept.exists():
        row: dict[str, Any] = read_json(kept, _FORMAT, _VERSION)["row"]
        return row
    started = _seconds()
    policy = ENTRANTS[entrant](folder / "training", seed)
    seconds = _seconds() - started
    unit = Unit(
        f"{LEARNED}{policy}", TASK, PUBLIC_SEED, str(PUBLIC_SEED), tuple(range(plants)), "race"
    )
    (scored,) = ranking(run_unit(unit)).to_dict("records")
    row = {"entrant": entrant, "seed": seed, "seconds": seconds}
    row |= {name: float(scored[name]) for name in ("failed", "p90_percent", "iqm_percent")}
    write_json(kept, {"format": _FORMAT, "version": _VERSION, "row": row})
    return row


def _seconds() -> float:
    """Return the processor time (s) of this process and of those that it began."""
    return sum(os.times()[:4])


def medians(rows: pd.DataFrame, rival_percent: float) -> pd.DataFrame:
    """Return a line for each entrant: medians over its seeds, and how many are ahead of the rival."""
    lines = []
    for entrant, part in rows.groupby("entrant", sort=False):
        figures = part[["seconds", "failed", "p90_percent", "iqm_percent"]].median()
        lines.append(
            {
                "entrant": entrant,
                "seeds": len(part),
                **figures.to_dict(),
                "over_best_fixed": float(figures["iqm_percent"]) / rival_percent,
                "ahead": int((part["iqm_percent"] < rival_percent).sum()),
            }
        )
    return pd.DataFrame(lines)


def by_entrant(table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return the lines of :func:`medians` under the names of their entrants."""
    return {line["entrant"]: line for line in table.to_dict("records")}  # type: ignore[misc]


def is_reached(line: Mapping[Any, Any]) -> bool:
    """Say whether an entrant's medians are below the best fixed compensator's, within the minute."""
    return bool(line["over_best_fixed"] < 1.0 and line["seconds"] <= GOAL_S)


def as_markdown(table: pd.DataFrame, rows: pd.DataFrame, rival: Mapping[str, Any]) -> str:
    """Return the answer with its number first, then the tables."""
    lines = by_entrant(table)
    short = lines[SHORT]
    reached = "Reached" if is_reached(short) else "Not reached"
    return (
        "# A minute of training on Stage\n\n"
        f"{reached}: in {number(short['seconds'])} s of one core `native-ppo`, from scratch, leaves "
        f"{number(short['over_best_fixed'])} of the error of the best fixed compensator on Stage, "
        f"`{rival['controller']}`: an interquartile mean of {number(short['iqm_percent'])} % against "
        f"{number(rival['iqm_percent'])} %, medians of {short['seeds']} seeds. `imitation` is ahead before its "
        "first step, since it corrects a controller that adapts. The first training on a machine, "
        f"which compiles its kernels before, takes {number(lines[FIRST]['seconds'])} s.\n\n"
        f"{frame_table(table)}\n\n"
        "`seconds` are those of the process, one thread, evaluations included; `over_best_fixed` is the "
        "interquartile mean over that of the rival, `ahead` in how many seeds it is smaller. Scored on the "
        f"public test draws as `rdpi bench` does; the rival's p90 is {number(rival['p90_percent'])} %, and "
        f"it fails on {number(100.0 * rival['failed'])} % of the plants.\n\n"
        f"{frame_table(rows)}\n\n"
        f"Written by `python -m studies.training_race --seeds {short['seeds']}`.\n"
    )


def _race(chosen: Namespace) -> Files:
    try:  # the time of an import is not that of a training
        import_module("torch")
    except ImportError as error:
        raise InputError(f"trainings need {error.name}; install rdpi-gym[rl]") from error
    found = []
    for seed in range(chosen.seeds):
        for entrant in ENTRANTS:
            folder = chosen.runs / f"{entrant.replace(', ', '-').replace(' ', '-')}-{seed}"
            found.append(row_of(entrant, seed, folder, chosen.plants))
            print(found[-1], file=sys.stderr)
    rival = best_fixed(read_rankings())
    place = {entrant: i for i, entrant in enumerate(ENTRANTS)}
    rows = pd.DataFrame(found).sort_values(
        "entrant", key=lambda names: names.map(place), kind="stable"
    )
    table = medians(rows, float(rival["iqm_percent"]))
    return {"seeds.csv": rows, "race.csv": table, "race.md": as_markdown(table, rows, rival)}


def _more(options: Options) -> None:
    options.add_folder("--runs", RUNS, "folder of the trainings")


main = Study(
    "training_race", __doc__, _race, RESULTS,
    numbers=(("--seeds", 5, "of each training"), ("--plants", 100, "of the test draws")),
    more=_more, csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
