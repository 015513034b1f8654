"""Piezo micro- and nano-positioning under hysteresis.

``import rdpi_gym as rg``, then::

    data = rg.example("picma")             # or rg.load("run.csv"); prints itself: records, rates, roles
    model = rg.fit(data)                   # model.plant is the identified plant
    rg.compare(data, model).plot()         # .page("out.html"), .to_dataframe(), .save("out.npz")
    found = rg.discover(data)              # which effects are missing; found.plant has them
    found.add("creep")                     # and on from here: each a new result
    rg.benchmark(["pi", "extended-inverse"], plants=[found.plant])
    rg.score_tasks(["pi", "extended-inverse"], ["Stage"])

The import also registers the environments with Gymnasium. Each name is loaded when it is first used.
"""

from rdpi_gym.support.guard import guard, is_command

if is_command():  # and no program that uses the package: before the imports that take their time
    guard()

import re
from pathlib import Path
from typing import Any

from gymnasium.envs.registration import register

from rdpi_gym.support.plugins import attach, provide
from rdpi_gym.support.renamed import accept_former_names

accept_former_names()

_NAMES, _load = attach(__name__, Path(__file__).with_suffix(".pyi"))
__all__ = sorted(["__version__", *_NAMES])

register(
    id="rdpi_gym/PiezoTracking-v0",
    entry_point="rdpi_gym.envs.piezo_tracking:PiezoTrackingEnv",
    vector_entry_point="rdpi_gym.envs.vector:PiezoTrackingVectorEnv",
    max_episode_steps=2000,
)

# Files of tasks say in lines as `PiezoBareEnv, bare_vector = ...` which environments they have; they are
# read here, and imported when one is made.
_ENVS = re.compile(r"^Piezo(\w+)Env, (\w+) = ", re.MULTILINE)
for _file in sorted((Path(__file__).parent / "envs" / "tasks").glob("*.py")):
    for _task, _vector in _ENVS.findall(_file.read_text("utf-8")):
        register(
            id=f"rdpi_gym/Piezo{_task}-v0",
            entry_point=f"rdpi_gym.envs.tasks.{_file.stem}:Piezo{_task}Env",
            vector_entry_point=f"rdpi_gym.envs.tasks.{_file.stem}:{_vector}",
            max_episode_steps=2500,
        )

# Environments whose actions correct a controller take it by name.
provide("rdpi_gym.controllers", "baselines:make_controller")


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("rdpi-gym")
    return _load(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
