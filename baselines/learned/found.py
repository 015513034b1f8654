"""A trained policy by its name, of whichever kind it is, and the controller that it makes."""

from __future__ import annotations

from baselines.base import Baseline
from baselines.learned import policy as networks
from baselines.learned.controller import LearnedController
from baselines.learned.imitation import policy as students
from baselines.learned.imitation.controller import StudentController
from baselines.learned.imitation.policy import StudentPolicy
from baselines.learned.kept import DESCRIPTION
from baselines.learned.policy import Policy, policy_folder
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.files import read_json
from rdpi_gym.support.folders import settled_folder


def find_learned(name: str) -> Policy | StudentPolicy:
    """Return the policy in a folder, or a shipped one by its name: a network, or a student."""
    folder = policy_folder(name)
    formats = (networks.FORMAT, students.FORMAT)
    newest = max(networks.VERSION, students.VERSION)
    document = read_json(settled_folder(folder) / DESCRIPTION, formats, newest)
    kind = StudentPolicy if document["format"] == students.FORMAT else Policy
    return kind.load(folder)


def controller_of(
    policy: Policy | StudentPolicy, belief: PlantModel, layout: ObservationLayout
) -> Baseline:
    """Make the controller of a policy."""
    if isinstance(policy, StudentPolicy):
        return StudentController(policy, belief, layout)
    return LearnedController(policy, belief, layout)
