"""`rdpi collect`: episodes of a task driven by controllers, as a dataset that Minari loads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from baselines import HORIZON_BOUND, Controller, TrueHorizon, make_controller
from baselines.learned.options import check_same
from rdpi_gym.envs.tasks import StageTask, named_task
from rdpi_gym.envs.tasks.environment import TaskEnv
from rdpi_gym.envs.tasks.task import ChangingPlant
from rdpi_gym.support.checks import is_whole
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, replaced_folder, settled_folder, write_json
from rdpi_gym.support.progress import Progress, silent
from rdpi_gym.support.words import quoted

if TYPE_CHECKING:
    from minari.data_collector.episode_buffer import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

FORMAT, VERSION = "rdpi-collection", 1
RANDOM = "random"
"""Name of what draws actions evenly from the action space."""
CONTROLLERS = (HORIZON_BOUND, "pi-preview", "adaptive-feedforward", RANDOM)
"""From what knows the plant to what knows nothing."""
ActionReading = Literal["command", "increment"]

_DESCRIPTION, _DATA = "collection.json", "data"
_LANES = 32  # episodes that a controller drives side by side
_EPISODES, _ACTIONS = 1, 2  # begin the entropy of what is drawn
_INFOS = ("displacement_um", "reference_um", "error_um", "command_V", "saturated")


@dataclass(frozen=True)
class Collection:
    """A dataset of episodes, written."""

    root: Path  # folder that ``MINARI_DATASETS_PATH`` names for ``minari.load_dataset``
    dataset_id: str  # under which Minari loads it from there
    document: dict[str, Any]  # all that it depends on, and what came out: ``collection.json``

    @property
    def data(self) -> Path:
        """What ``minari.MinariDataset`` takes."""
        return self.root / self.dataset_id / _DATA

    def __str__(self) -> str:
        asked, found = self.document["asked"], self.document["found"]
        lines = [
            f"{asked['episodes']} episodes of {asked['task']}, {asked['steps']} steps each, actions "
            f"read as {asked['action']}"
        ]
        for name, row in found.items():
            lines.append(
                f"{name}: {row['episodes']} episodes, RMSE {row['rmse_um']:.3g} um, "
                f"reward {row['reward']:.3g} a step"
            )
        return "\n".join([*lines, f"written: {self.data}"])


def collect(
    task: str = "Stage",
    controllers: Sequence[str] = CONTROLLERS,
    episodes: int = 40,
    out: Path = Path("results/dataset"),
    *,
    steps: int | None = None,
    seed: int = 0,
    action: ActionReading = "command",
    progress: Progress | None = None,
) -> Collection:
    """Write episodes of a task's training draws; the same call again finds them written.

    Every controller drives an equal share of the episodes, each on a plant, a reference and noise of
    its own. The folder of the dataset is there when all is in it.
    """
    asked, names = named_task(task), list(dict.fromkeys(controllers))
    length = asked.samples if steps is None else steps
    _check(names, episodes, length, seed, action)
    try:
        from minari.dataset.minari_storage import MinariStorage
    except ImportError as error:
        raise InputError(f"a dataset needs Minari ({error}); install rdpi-gym[minari]") from error
    document = {
        "task": asked.name, "controllers": names, "episodes": episodes, "steps": length,
        "seed": seed, "action": action, "version": version("rdpi-gym"),
    }  # fmt: skip
    dataset_id = f"rdpi-{asked.name.lower()}-v0"
    folder = settled_folder(out / dataset_id)
    if folder.exists():
        return Collection(out, dataset_id, _kept(folder, document))
    lanes = [_environment(asked, length, action) for _ in range(min(_LANES, episodes))]
    for name in names:
        _driver(name, lanes[:1], seed)  # one that cannot be made is refused before any is run
    with replaced_folder(folder) as fresh:
        storage = MinariStorage.new(
            fresh / _DATA,
            observation_space=lanes[0].observation_space,
            action_space=lanes[0].action_space,
            env_spec=lanes[0].spec,
        )
        storage.update_metadata(
            {
                "dataset_id": dataset_id,
                "minari_version": version("minari"),
                "algorithm_name": ", ".join(names),
                "description": f"Training draws of {asked.id}. {asked.title}.",
                "requirements": [f"rdpi-gym=={version('rdpi-gym')}"],
            }
        )
        found = _write(storage, lanes, names, episodes, seed, progress or silent)
        whole = {"format": FORMAT, "version": VERSION, "asked": document, "found": found}
        write_json(fresh / _DESCRIPTION, whole)
    return Collection(out, dataset_id, whole)


class _Random:
    """Draws actions evenly from [-1, 1]."""

    def __init__(self, entropy: Sequence[int]) -> None:
        self._rng = np.random.default_rng(entropy)

    def predict(
        self, observation: NDArray[Any], state: Any = None, *_: Any, **__: Any
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action for each observation."""
        drawn = self._rng.uniform(-1.0, 1.0, (len(observation), 1))
        return drawn.astype(np.float32), state


def _check(names: Sequence[str], episodes: int, steps: int, seed: int, action: str) -> None:
    for what, value, least in (("episodes", episodes, 1), ("steps", steps, 1), ("seed", seed, 0)):
        if not is_whole(value, least):
            raise InputError(f"{what} is {quoted(value)}; give a whole number of {least} or more")
    if action not in get_args(ActionReading):
        raise InputError(
            f"action {quoted(action)} is unknown; choose {', '.join(get_args(ActionReading))}"
        )
    if not names:
        raise InputError("no controller is named; give at least one")
    if episodes < len(names):
        raise InputError(
            f"episodes is {episodes} for {len(names)} controllers; give at least one for each"
        )


def _kept(folder: Path, asked: dict[str, Any]) -> dict[str, Any]:
    """Return what a dataset that is there says of itself, if it is the one that is asked for."""
    path = folder / _DESCRIPTION
    if not path.exists():
        raise InputError(f"{folder} holds no dataset of `rdpi collect`; give another --out")
    document = read_json(path, FORMAT, VERSION)
    check_same(document["asked"], asked, folder, "dataset")
    return document


def _environment(task: StageTask, steps: int, action: ActionReading) -> gym.Env[Any, Any]:
    return gym.make(task.id, max_episode_steps=steps, disable_env_checker=True, action=action)


def _driver(name: str, lanes: Sequence[gym.Env[Any, Any]], seed: int) -> Controller:
    """Make what drives environments that were just reset, in all of them at once."""
    inner = [cast(TaskEnv, env.unwrapped) for env in lanes]
    belief, layout, task = inner[0].belief, inner[0].layout, inner[0].task
    if name == RANDOM:
        return _Random([_ACTIONS, seed])
    if name == HORIZON_BOUND:
        truths, later = [env.truth for env in inner], [env.later for env in inner]
        return TrueHorizon(ChangingPlant(truths, layout.ts_s, later, task.command_step_V), layout)
    controller = make_controller(name, belief, layout)
    if hasattr(controller, "plan"):
        raise InputError(f"{name} is given the whole reference, which no environment shows ahead")
    return controller


def _write(
    storage: MinariStorage,
    lanes: Sequence[gym.Env[Any, Any]],
    names: Sequence[str],
    episodes: int,
    seed: int,
    progress: Progress,
) -> dict[str, dict[str, float]]:
    """Run all episodes, write them, and return what became of each controller's."""
    found: dict[str, dict[str, float]] = {}
    for name, numbers in zip(names, np.array_split(np.arange(episodes), len(names)), strict=True):
        squares, rewards = [], []
        for first in range(0, len(numbers), len(lanes)):
            batch = [int(number) for number in numbers[first : first + len(lanes)]]
            progress("episodes", batch[0], episodes)
            seeds = [_seed(seed, number) for number in batch]
            buffers, plants = _drive(name, lanes[: len(batch)], seeds)
            storage.update_episodes(buffers)
            storage.update_episode_metadata(
                ({"controller": name, "plant": plant} for plant in plants), batch
            )
            errors = np.stack([each.infos["error_um"] for each in buffers], axis=1)
            squares.append(np.mean(errors**2, axis=0))
            rewards.append(np.stack([each.rewards for each in buffers], axis=1).mean(axis=0))
        found[name] = {
            "episodes": len(numbers),
            "rmse_um": float(np.mean(np.sqrt(np.concatenate(squares)))),
            "reward": float(np.mean(np.concatenate(rewards))),
        }
    progress("episodes", episodes, episodes)
    return found


def _seed(seed: int, number: int) -> int:
    """Return what an episode's environment is reset with."""
    words = np.random.SeedSequence([_EPISODES, seed, number]).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


def _drive(
    name: str, lanes: Sequence[gym.Env[Any, Any]], seeds: Sequence[int]
) -> tuple[list[EpisodeBuffer], list[str]]:
    """Return an episode of each environment, driven side by side, and its plant as JSON."""
    from minari.data_collector.episode_buffer import EpisodeBuffer

    began = [env.reset(seed=seed) for env, seed in zip(lanes, seeds, strict=True)]
    controller = _driver(name, lanes, seeds[0])
    inner = [cast(TaskEnv, env.unwrapped) for env in lanes]
    shown_size, count = inner[0].layout.size, len(lanes)
    observation = [np.stack([each for each, _ in began])]
    infos = [[info for _, info in began]]
    actions, rewards = [], []
    state, starts, over = None, np.ones(count, dtype=bool), False
    while not over:
        # the history is the environment's: a controller keeps its own
        answer, state = controller.predict(
            observation[-1][:, :shown_size], state, starts, deterministic=True
        )
        actions.append(np.reshape(answer, (count, 1)).astype(np.float32))
        steps = [env.step(action) for env, action in zip(lanes, actions[-1], strict=True)]
        observation.append(np.stack([step[0] for step in steps]))
        rewards.append([float(step[1]) for step in steps])
        infos.append([step[4] for step in steps])
        over, starts = bool(steps[0][3]), np.zeros(count, dtype=bool)
    observations, taken, rewarded = np.stack(observation), np.stack(actions), np.array(rewards)
    extras = {key: np.array([[info[key] for info in row] for row in infos]) for key in _INFOS}
    ends = np.arange(len(rewarded)) == len(rewarded) - 1
    buffers = [
        EpisodeBuffer(
            seed=seed,
            observations=observations[:, b],
            actions=taken[:, b],
            rewards=rewarded[:, b],
            terminations=np.zeros_like(ends),
            truncations=ends,
            infos={key: value[:, b] for key, value in extras.items()},
        )
        for b, seed in enumerate(seeds)
    ]
    return buffers, [json.dumps(env.truth.to_dict()) for env in inner]
