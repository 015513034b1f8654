"""What the teacher of students says of other corrections, beside what the true plants make of them.

    python -m studies.teacher_truth

The shipped student of each task drives validation plants, and so it does with its answers turned up.
The teacher says from the first run alone what the second leaves: whole, with the belief's inverse
taken for exact, and with an estimate that does not answer.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from baselines.learned.controller import find_learned
from baselines.learned.imitation.fitting import Loop
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.imitation.student import UNIT_UM, Float32
from baselines.learned.imitation.teacher import LoopModel, Rollout, Systems, roll_out, student_lanes
from rdpi_gym.envs.tasks import named_task
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.markdown import frame_table
from studies.agents.training import FULL
from studies.runner import Files, Study

RESULTS = Path(__file__).parent / "results" / "agents"
CHANGES = ((0.0, 0.1), (1.0, 1.2))
"""Factors of what the student adds, in the first run and in the second."""


def measure(task: str, plants: int) -> pd.DataFrame:
    """Hold what is said of a task's student against what happens."""
    policy = find_learned(f"imitation-{task.lower()}")
    assert isinstance(policy, StudentPolicy)
    rows = []
    for factors in CHANGES:
        first, second = (
            replace(policy, student=policy.student.amplified(factor)) for factor in factors
        )
        drove, then = (
            roll_out(
                student_lanes(named_task(task), "validation", range(100, 100 + plants), 0), each
            )
            for each in (first, second)
        )
        found = (then.left - drove.left)[drove.first :].astype(np.float64)
        around = drove.loop_model
        pictures = {
            "whole": around,
            "inverse_exact": inverse_exact(around),
            "estimate_at_rest": estimate_at_rest(around),
        }
        said = {
            name: 100.0 * _share(_left(second, replace(drove, loop_model=picture)), drove, found)
            for name, picture in pictures.items()
        }
        change_nm = 1e3 * UNIT_UM * float(np.sqrt(np.mean(found**2)))
        change = "{:g} to {:g}".format(*factors)
        rows.append({"task": task, "student": change, "change_nm": change_nm, **said})
    return pd.DataFrame(rows)


def _share(left: Array, drove: Rollout, found: Array) -> float:
    said = (left - drove.left)[drove.first :]
    return float(np.median(1.0 - ((said - found) ** 2).sum(axis=0) / (found**2).sum(axis=0)))


def inverse_exact(around: LoopModel) -> LoopModel:
    """Return a loop model whose plays give what is wanted of them, but for the lag before them."""
    lanes = around.wanted_um.shape[1]
    inverse = replace(around.inverse, gain=1.0, weights=np.zeros_like(around.inverse.weights))
    plays = replace(
        around.plays,
        gain=np.ones(lanes, dtype=np.float32),
        weights=np.zeros_like(around.plays.weights),
    )
    given = _passed(around.before, around.wanted_um)
    return replace(around, inverse=inverse, plays=plays, given_um=given)


def estimate_at_rest(around: LoopModel) -> LoopModel:
    """Return a loop model whose estimate does not answer."""
    covariance = np.zeros_like(around.estimate.covariance)
    return replace(around, estimate=replace(around.estimate, covariance=covariance))


def _passed(systems: Systems, given: Float32) -> Float32:
    x, found = np.zeros_like(systems.b), np.empty_like(given)
    for k, value in enumerate(given):
        found[k] = (systems.c * x).sum(axis=1) + systems.d * value
        x = np.einsum("bij,bj->bi", systems.a, x) + systems.b * value[:, None]
    return found


def _left(policy: StudentPolicy, visited: Rollout) -> Array:
    tensors = {name: torch.from_numpy(each) for name, each in policy.student.arrays.items()}
    with torch.no_grad():
        left = Loop(tensors, policy.student.weighted, visited).run(0, len(visited.left))
    return np.asarray(left.numpy(), dtype=np.float64)


def as_markdown(table: pd.DataFrame, plants: int) -> str:
    """Return the table, with what it says first."""
    said = "; ".join(
        f"of a student turned from {change}, {own['whole'].min():.0f} to {own['whole'].max():.0f} % "
        f"({own['inverse_exact'].min():.0f} to {own['inverse_exact'].max():.0f} % with the belief's inverse taken for exact)"
        for change, own in table.groupby("student", sort=False)
    )
    return (
        "# What the teacher says, and what the true plants make of it\n\n"
        f"Share of the variance of what changes that is said, least and most of the tasks: {said}.\n\n"
        f"Written by `python -m studies.teacher_truth --plants {plants}`: the shipped student of each task drives validation plants with a share of its "
        "answers, then with another on the same noise; the second run is told from the first. Median over the lanes, in percent; below zero, nothing said "
        f"were better.\n\n{frame_table(table)}\n"
    )


def _measure_all(chosen: Namespace) -> Files:
    torch.set_num_threads(1)
    table = pd.concat([measure(task, chosen.plants) for task, _ in FULL.taught])
    return {"teacher_truth.csv": table, "teacher_truth.md": as_markdown(table, chosen.plants)}


main = Study(
    "teacher_truth", __doc__, _measure_all, RESULTS,
    numbers=(("--plants", 4, "validation draws of a task"),), csv="%.4g",
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
