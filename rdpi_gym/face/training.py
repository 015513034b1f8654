"""`train`, `sweep`, `export`: an agent trained in a folder, and its policy as a file that others read."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from baselines.learned.sweep import Sweep
from benchmarks.stages import offline, tuning
from benchmarks.stages.offline import CONTROLLERS, Collection
from benchmarks.stages.tuning import Tuned
from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.face.display import draw
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.progress import Progress

if TYPE_CHECKING:
    import pandas as pd

    from baselines.learned.training import Trainer

_INSTALL = "install rdpi-gym[rl]"


@dataclass(frozen=True, repr=False)
class Training:
    """A training, finished; as :func:`rdpi_gym.train` returns it. Its folder is its saved form.

    Parameters
    ----------
    folder
        Holds ``policy/``, ``training.csv``, ``curve.png``, ``training.html``, ``config.json`` and
        ``checkpoint/``.
    policy
        Folder of the policy that did best on held-out plants and references.
    compensator
        What it is compared with.
    """

    folder: Path
    policy: Path
    compensator: str

    @property
    def controller(self) -> str:
        """Name under which :func:`rdpi_gym.make_controller` and the benchmark know the policy."""
        return f"learned:{self.policy}"

    def __repr__(self) -> str:
        curve = self.to_dataframe()
        best = curve.iloc[int(curve["reward"].to_numpy().argmax())]
        variation = best["command_variation_V_s"] / best["compensator_command_variation_V_s"]
        return (
            f"after {best['timesteps']:.0f} steps, on held-out plants: RMSE {best['rmse_um']:.3g} um, "
            f"{self.compensator} {best['compensator_rmse_um']:.3g} um; command variation "
            f"{variation:.3g} of its"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return the learning curve, ``training.csv``: one row an evaluation."""
        import pandas as pd

        return pd.read_csv(self.folder / "training.csv")

    @property
    def kept_at(self) -> float | None:
        """Steps after which the policy was kept that is the result; None: it does not say."""
        told = json.loads((self.policy / "policy.json").read_text(encoding="utf-8"))["training"]
        return next((told[name] for name in ("at_timesteps", "timesteps") if name in told), None)

    def picture(self) -> bytes:
        """Return error, cost, command variation and time over the steps as a PNG file."""
        from rdpi_gym.report.result_pages import training_picture

        return training_picture(self.to_dataframe(), self.compensator, self.kept_at)

    def page(self, path: PathLike[str] | str) -> Path:
        """Write the same as a self-contained page, with every evaluation."""
        from rdpi_gym.report.result_pages import write_training_page

        said = repr(self).replace(" um", " µm")
        return write_training_page(
            Path(path), self.to_dataframe(), self.compensator, self.kept_at,
            f"Training {self.folder.name}", f"A{said[1:]}.",
        )  # fmt: skip

    def plot(self) -> Any:
        """Draw the error on held-out plants over the steps, beside the compensator's.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from rdpi_gym.report.result_pages import training_chart

        return draw(training_chart(self.to_dataframe(), self.compensator), (6.0, 3.6))


@checked
def train(
    algorithm: Literal["ppo", "sac", "td3", "native-ppo", "imitation"],
    out: PathLike[str] | str = "results/train",
    *,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> Training:
    """Train a policy; the same call goes on with an interrupted one.

    Parameters
    ----------
    algorithm
        ``ppo``, ``sac`` or ``td3`` of Stable-Baselines3, or ``native-ppo``: the same algorithm as
        ``ppo`` without wrappers between environment and network, several times as fast; or
        ``imitation``: a recurrent student of the true plants of one or several tasks, which corrects
        an adaptive controller.
    out
        Folder of the training.
    seed
        Of every random draw.
    progress
        Called as ``progress(stage, done, total)``.
    **options
        Those of :class:`baselines.learned.options.TrainingOptions`, such as ``timesteps``,
        ``plants``, ``reference``, ``action``; of ``imitation`` those of
        :class:`baselines.learned.imitation.rounds.Options`, such as ``task``.

    Returns
    -------
    Training
        It prints the error on held-out plants; `controller` is the policy's name.

    Raises
    ------
    InputError
        The packages of ``rdpi-gym[rl]`` are missing, an option is unknown or out of range, or the
        folder holds something else.
    """
    trainer = _trainer(algorithm)
    asked = _options(trainer, "train", out=Path(out), seed=seed, **options)
    training = Training(Path(out), trainer.train(asked, progress), asked.baseline)
    _draw(training)
    return training


@checked
def training_options(algorithm: str) -> frozenset[str]:
    """Return the names of the options that :func:`train` takes of an algorithm.

    Parameters
    ----------
    algorithm
        As :func:`train` takes it.

    Returns
    -------
    frozenset of str

    Raises
    ------
    InputError
        The packages of ``rdpi-gym[rl]`` are missing.
    """
    return frozenset(_trainer(algorithm).Options.__dataclass_fields__)


@checked
def sweep(
    algorithm: Literal["ppo", "sac", "td3", "native-ppo", "imitation"],
    out: PathLike[str] | str = "results/sweep",
    *,
    trials: int = 20,
    space: PathLike[str] | str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> Sweep:
    """Find hyper-parameters by trainings that Optuna chooses; the same call goes on with a sweep.

    Parameters
    ----------
    algorithm, seed, progress
        As :func:`train`, all but ``imitation``; every training has the same seed.
    out
        Folder of the sweep: a folder for each training, ``best.yml``, ``trials.csv``.
    trials
        Trainings in all, the first with the hyper-parameters of the file.
    space
        YAML of what is tried, in the form of ``baselines/learned/search_spaces``; by default the
        file there.
    **options
        As :func:`train`; `hyperparameters` is the file whose values are changed.

    Returns
    -------
    baselines.learned.sweep.Sweep
        It prints the best error; `hyperparameters` is a file that :func:`train` takes.

    Raises
    ------
    InputError
        The packages of ``rdpi-gym[rl,tune]`` are missing, the space is none, an option is unknown or
        out of range, the folder holds something else, or every training diverged.
    """
    if algorithm == "imitation":
        raise InputError("a sweep of imitation is not known; sweep ppo, sac, td3 or native-ppo")
    trainer = _trainer(algorithm)
    from baselines.learned import sweep as sweeps

    asked = _options(trainer, "sweep", out=Path(out), seed=seed, **options)
    chosen = None if space is None else Path(space)
    return sweeps.sweep(asked, algorithm, trainer.train, trials, chosen, progress)


@checked
def export(
    policy: PathLike[str] | str | Training,
    path: PathLike[str] | str = "policy.onnx",
    *,
    belief: PlantModel | HasPlant | PathLike[str] | str | None = None,
) -> Path:
    """Write a trained policy as an ONNX file.

    A network as stacked observation in, action out; a student with the controller that it corrects
    as a step: reference, measurement and state in, command and state out.

    Parameters
    ----------
    policy
        A training, the folder of a policy, or the name of one that ships.
    path
        File that is written.
    belief
        What a student's controller knows of the plant: a plant, a result that has one, the path of a
        plant file, or a name of :data:`rdpi_gym.plants`; by default what it was taught with.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The packages of ``rdpi-gym[rl,onnx]`` are missing, the policy cannot be read, or its
        controller cannot be made on the belief.
    """
    try:
        from baselines.learned.controller import find_learned
        from baselines.learned.onnx_export import export_onnx, export_student
        from baselines.learned.policy import Policy
    except ImportError as error:
        raise InputError(f"an export needs {error.name}; {_INSTALL}") from error
    folder = policy.policy if isinstance(policy, Training) else policy
    found = find_learned(str(folder))
    if not isinstance(found, Policy):
        return export_student(found, Path(path), None if belief is None else as_plant(belief))
    if belief is not None:
        raise InputError(f"belief is of students, and {folder} is a network alone; leave it out")
    return export_onnx(found, Path(path))


def _draw(training: Training) -> None:
    """Write what a finished training leaves to look at beside ``training.csv``."""
    write_atomic(training.folder / "curve.png", training.picture())
    training.page(training.folder / "training.html")


def _options(trainer: Trainer, function: str, **given: Any) -> Any:
    """Return the options of a training, or refuse a keyword that it does not take."""
    known = trainer.Options.__dataclass_fields__
    for name in given:
        if name not in known:
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}")
    return trainer.Options(**given)


def _trainer(algorithm: str) -> Trainer:
    try:
        from baselines.learned.training import trainer

        return trainer(algorithm)
    except ImportError as error:
        raise InputError(f"training needs {error.name}; {_INSTALL}") from error


@checked
def collect(
    task: str = "Stage",
    controllers: Sequence[str] = CONTROLLERS,
    episodes: int = 40,
    out: PathLike[str] | str = "results/dataset",
    *,
    steps: int | None = None,
    seed: int = 0,
    action: Literal["command", "increment"] = "command",
    progress: Progress | None = None,
) -> Collection:
    """Write episodes of a task, driven by controllers, in Minari's format, for offline learning.

    Plants, references and noise are training draws; no test draw is among them.

    Parameters
    ----------
    task
        Short name or id of a registered task.
    controllers
        Names, as :func:`make_controller` takes them, each for an equal share of the episodes;
        ``true-plant-horizon`` alone is given the true plant, ``random`` draws actions evenly.
    episodes
        How many in all.
    out
        Folder of datasets; this one is the folder ``rdpi-TASK-v0`` in it.
    steps
        Of an episode; by default the task's.
    seed
        Of all draws.
    action
        How the environment reads actions: places in the command's range, or increments.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    benchmarks.stages.offline.Collection
        It prints the error of each controller; ``minari.MinariDataset`` takes its `data`.

    Raises
    ------
    InputError
        There is no such task or controller, a number is out of range, ``rdpi-gym[minari]`` is not
        installed, or the folder holds a dataset of other options.
    """
    return offline.collect(
        task, controllers, episodes, Path(out), steps=steps, seed=seed, action=action,
        progress=progress,
    )  # fmt: skip


@checked
def tune(
    controller: str,
    task: str = "Stage",
    out: PathLike[str] | str = "results/tune",
    *,
    trials: int = 40,
    seed: int = 0,
    plants: int = 16,
    progress: Progress | None = None,
) -> Tuned:
    """Find settings of a controller with Optuna; the same call goes on with an interrupted search.

    Parameters
    ----------
    controller
        Name of one with knobs, such as ``dual-loop``.
    task
        Short name or id of a registered task; its training draws are used, and its validation draws
        to say what was found.
    out
        Folder of the search and of ``CONTROLLER.json``, the settings by task.
    trials
        Settings that are tried, the defaults among them.
    seed
        Of the draws and of the search.
    plants
        Training plants, each with every reference of the task.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    benchmarks.stages.tuning.Tuned
        It prints the error on validation plants with what was found and without.

    Raises
    ------
    InputError
        The controller has no knobs, there is no such task, a number is out of range, or
        ``rdpi-gym[tune]`` is not installed.
    """
    return tuning.tune(
        controller, task, Path(out), trials=trials, seed=seed, plants=plants, progress=progress
    )


@checked
def certificate(controller: str, task: str = "Stage") -> str:
    """Certify the stability of a controller's loop on the belief of a task, before it drives anything.

    Parameters
    ----------
    controller
        Name of one that ships.
    task
        Short name or id of a registered task.

    Returns
    -------
    str
        One line: small gain, passivity or poles where one of them holds, and the controller's
        warning where it has one.

    Raises
    ------
    InputError
        There is no such controller or task.

    Examples
    --------
    >>> certificate("dual-loop", "Bare").split(":")[0]
    'dual-loop on Bare, certificate'
    """
    return tuning.certified(controller, task)
