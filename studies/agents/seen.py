"""How far the loops of a shipped policy's own evaluation go, kept beside the policy for its monitor.

What a training keeps of a policy that it finds; those that were trained before it did are driven
once more on draws of their own training.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

from baselines.learned.controller import LearnedController, find_learned
from baselines.learned.environments import HeldOut
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.imitation.rounds import Options, witnessed
from baselines.learned.options import TrainingOptions
from baselines.learned.policy import DESCRIPTION
from rdpi_gym.support.files import parse_json, read_utf8, write_json
from studies.agents.study import Study

_LARGEST = 2**20  # bytes of a description


def see(folder: Path, study: Study) -> dict[str, float]:
    """Drive a policy on draws of its own training, and keep how far its loops went."""
    policy = find_learned(str(folder))
    if isinstance(policy, StudentPolicy):
        told = {name: policy.training[name] for name in ("task", "seed", "lanes")}
        seen = dict(witnessed(policy, Options(**told)))
    else:
        agent = next(each for each in study.agents if each.name == folder.name)
        options = study.options(agent, policy.training["seed"], folder)
        held_out = HeldOut(TrainingOptions(**options))
        witness = held_out.witness()
        held_out.evaluate(partial(LearnedController, policy), witness)
        seen = witness.largest
    path = folder / DESCRIPTION
    document = parse_json(read_utf8(path, _LARGEST), str(path))
    write_json(path, document | {"seen": seen})
    return seen
