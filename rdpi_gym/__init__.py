"""Piezo micro- and nano-positioning under hysteresis.

``import rdpi_gym as rg``, then::

    data = rg.load("measurement.csv")      # prints itself: records, samples, rates, roles
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

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

from rdpi_gym.support.plugins import provide

if TYPE_CHECKING:
    from rdpi_gym import signals
    from rdpi_gym.face import environments
    from rdpi_gym.face.benchmarking import Evaluation, benchmark, make_controller
    from rdpi_gym.face.catalogues import controllers, effects, plants
    from rdpi_gym.face.collecting import collect
    from rdpi_gym.face.comparison import Comparison, ModelComparison, compare
    from rdpi_gym.face.data import Dataset, load
    from rdpi_gym.face.experiment import PlannedExperiment, plan_experiment
    from rdpi_gym.face.firmware import Exported, export_c, export_fmu, verify
    from rdpi_gym.face.fitting import FitResult, fit
    from rdpi_gym.face.fitting_core import CoreFit, KindChoice, choose_kind, fit_core
    from rdpi_gym.face.inspection import Inspection, Refit, Response, inspect, respond
    from rdpi_gym.face.laboratory import OpenLab, lab
    from rdpi_gym.face.paper import PaperResults, reproduce
    from rdpi_gym.face.result import Result
    from rdpi_gym.face.results import load_result
    from rdpi_gym.face.search import SearchResult, add, diagnose, discover, portrait
    from rdpi_gym.face.simulation import Simulation, simulate
    from rdpi_gym.face.tasks import TaskScores, score_submission, score_tasks, submit
    from rdpi_gym.face.tracking import Tracking, track
    from rdpi_gym.face.training import Training, export, sweep, train, training_options
    from rdpi_gym.face.tuning import certificate, tune
    from rdpi_gym.support.errors import InputError

    __version__: str

# Where each name stands; the statements above say the same to type checkers.
_HOME = {
    "benchmarking": ("Evaluation", "benchmark", "make_controller"),
    "catalogues": ("controllers", "effects", "plants"),
    "collecting": ("collect",),
    "comparison": ("Comparison", "ModelComparison", "compare"),
    "data": ("Dataset", "load"),
    "experiment": ("PlannedExperiment", "plan_experiment"),
    "firmware": ("Exported", "export_c", "export_fmu", "verify"),
    "fitting": ("FitResult", "fit"),
    "fitting_core": ("CoreFit", "KindChoice", "choose_kind", "fit_core"),
    "inspection": ("Inspection", "Refit", "Response", "inspect", "respond"),
    "laboratory": ("OpenLab", "lab"),
    "paper": ("PaperResults", "reproduce"),
    "result": ("Result",),
    "results": ("load_result",),
    "search": ("SearchResult", "add", "diagnose", "discover", "portrait"),
    "simulation": ("Simulation", "simulate"),
    "tasks": ("TaskScores", "score_submission", "score_tasks", "submit"),
    "tracking": ("Tracking", "track"),
    "training": ("Training", "export", "sweep", "train", "training_options"),
    "tuning": ("certificate", "tune"),
}
_MODULES = {name: f"{__name__}.face.{module}" for module, names in _HOME.items() for name in names}
_MODULES["InputError"] = f"{__name__}.support.errors"
_ROOMS = {"environments": f"{__name__}.face.environments", "signals": f"{__name__}.signals"}

__all__ = [
    "Comparison",
    "CoreFit",
    "Dataset",
    "Evaluation",
    "Exported",
    "FitResult",
    "InputError",
    "Inspection",
    "KindChoice",
    "ModelComparison",
    "OpenLab",
    "PaperResults",
    "PlannedExperiment",
    "Refit",
    "Response",
    "Result",
    "SearchResult",
    "Simulation",
    "TaskScores",
    "Tracking",
    "Training",
    "__version__",
    "add",
    "benchmark",
    "certificate",
    "choose_kind",
    "collect",
    "compare",
    "controllers",
    "diagnose",
    "discover",
    "effects",
    "environments",
    "export",
    "export_c",
    "export_fmu",
    "fit",
    "fit_core",
    "inspect",
    "lab",
    "load",
    "load_result",
    "make_controller",
    "plan_experiment",
    "plants",
    "portrait",
    "reproduce",
    "respond",
    "score_submission",
    "score_tasks",
    "signals",
    "simulate",
    "submit",
    "sweep",
    "track",
    "train",
    "training_options",
    "tune",
    "verify",
]

register(
    id="rdpi_gym/PiezoTracking-v0",
    entry_point="rdpi_gym.envs.piezo_tracking:PiezoTrackingEnv",
    vector_entry_point="rdpi_gym.envs.vector:PiezoTrackingVectorEnv",
    max_episode_steps=2000,
)

# The tasks, by the files of `rdpi_gym.envs.tasks` that state them; a name is looked up when one is made.
_TASKS = {
    "one_effect": ("Bare", "Creep", "Lag", "Resonance"),
    "whole_stage": ("Stage", "Load", "Ageing", "Rough", "Raster", "Steps"),
    "structure": ("Measured", "Preisach", "BoucWen", "Duhem"),
}
# Those whose plants are numbers about one nominal plant: all lanes of one kernel.
_VECTORED = ("Bare", "Creep", "Lag", "Resonance", "Stage", "Raster", "Steps")
for _file, _names in _TASKS.items():
    for _name in _names:
        _module = f"rdpi_gym.envs.tasks.{_file}"
        register(
            id=f"rdpi_gym/Piezo{_name}-v0",
            entry_point=f"{_module}:Piezo{_name}Env",
            vector_entry_point=f"{_module}:{_name.lower()}_vector" if _name in _VECTORED else None,
            max_episode_steps=2500,
        )

# Environments whose actions correct a controller take it by name.
provide("rdpi_gym.controllers", "baselines:make_controller")


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("rdpi-gym")
    if name in _MODULES:
        found = getattr(import_module(_MODULES[name]), name)
    elif name in _ROOMS:
        found = import_module(_ROOMS[name])
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
