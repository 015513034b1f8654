"""Policies that ship: the median training of each agent, and students."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.learned.imitation.rounds import Options, train
from baselines.learned.policy import DESCRIPTION, WEIGHTS, Policy
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import replaced_folder, write_atomic
from rdpi_gym.support.progress import Progress
from studies.agents.tables import interquartile_mean
from studies.agents.training import Taught, Training

LIMIT_BYTES = 2**20
"""Most bytes of all shipped policies together."""


def seed_scores(scores: pd.DataFrame) -> pd.DataFrame:
    """Return one score a training: the interquartile mean over all plants of all groups."""
    lines = []
    for (agent, seed), own in scores[scores["kind"] == "agent"].groupby(
        ["contestant", scores["training_seed"].astype("Int64")], sort=False
    ):
        errors = own["rmse_percent"].fillna(np.inf).to_numpy()
        score = float(interquartile_mean(errors))
        lines.append({"agent": agent, "seed": seed, "rmse_percent": score})
    found = pd.DataFrame(lines, columns=["agent", "seed", "rmse_percent"])
    place = found["agent"].map({name: i for i, name in enumerate(found["agent"].unique())})
    ranked = found.assign(place=place).sort_values(["place", "rmse_percent", "seed"])
    return ranked.drop(columns="place").reset_index(drop=True)


def median_trainings(scores: pd.DataFrame) -> pd.DataFrame:
    """Return of each agent the training with the median score.

    Of an even number it is the worse of the two in the middle.
    """
    lines = []
    for agent, own in seed_scores(scores).groupby("agent", sort=False):
        middle = own.iloc[len(own) // 2]
        lines.append(
            {
                "agent": agent,
                "seed": middle["seed"],
                "rmse_percent": middle["rmse_percent"],
                "trainings": len(own),
                "best_percent": own["rmse_percent"].iloc[0],
                "worst_percent": own["rmse_percent"].iloc[-1],
            }
        )
    found = pd.DataFrame(lines)
    least = found.groupby(found["agent"].map(_action))["rmse_percent"].transform("min")
    return found.assign(ships=found["rmse_percent"] == least)


def _action(agent: str) -> str:
    return agent.partition("-")[2]


def ship(scores: pd.DataFrame, trainings: Sequence[Training], target: Path) -> pd.DataFrame:
    """Copy the policy of each agent's median training to a folder of the agent's name."""
    by_name = {(each.agent.name, each.seed): each for each in trainings}
    scored = {(str(agent), int(seed)) for agent, seed, _ in seed_scores(scores).to_numpy()}
    if scored != set(by_name):
        other = sorted(scored ^ set(by_name))[0]
        raise InputError(
            f"{other[0]} with seed {other[1]} is either not trained or not scored; run --stage score again"
        )
    chosen = median_trainings(scores)
    shipping = chosen[chosen["ships"]]
    sources = [by_name[name, seed].policy for name, seed in shipping[["agent", "seed"]].to_numpy()]
    for source in sources:
        Policy.load(source)
    names = list(shipping["agent"])
    taken = dict(zip(names, map(folder_bytes, sources), strict=True))
    chosen["policy_bytes"] = [taken.get(name, 0) for name in chosen["agent"]]
    kept = [
        path.parent for path in target.glob(f"*/{DESCRIPTION}") if path.parent.name not in names
    ]
    total = int(chosen["policy_bytes"].sum()) + sum(map(folder_bytes, kept))
    if total > LIMIT_BYTES:
        raise InputError(
            f"the policies would take {total} bytes in {target}, more than {LIMIT_BYTES}; "
            "train smaller networks or remove others"
        )
    for folder in (target / name for name in names):
        if folder.exists() and not (folder / DESCRIPTION).is_file():
            raise InputError(f"{folder} exists and holds no policy; remove it")
    for name, source in zip(names, sources, strict=True):
        with replaced_folder(target / name) as fresh:
            for file in (DESCRIPTION, WEIGHTS):
                write_atomic(fresh / file, (source / file).read_bytes())
    return chosen


def folder_bytes(folder: Path) -> int:
    """Return what the files of a policy take (bytes)."""
    return sum(file.stat().st_size for file in folder.iterdir())


def teach(taught: Taught, runs: Path, target: Path, progress: Progress | None = None) -> Path:
    """Teach a student, from where an earlier run stopped, and put it among what ships."""
    name = f"imitation-{taught.name}"
    options = Options(
        out=runs / name, task=taught.task, timesteps=taught.timesteps, lanes=taught.lanes,
        passes=taught.passes,
    )  # fmt: skip
    policy = train(options, progress)
    with replaced_folder(target / name) as fresh:
        for file in sorted(policy.iterdir()):
            shutil.copyfile(file, fresh / file.name)
    return target / name
