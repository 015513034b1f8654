"""Former names of public modules: each imports for one release, with a DeprecationWarning.

A former name is only looked up where Python has found no module of that name.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

# One line a module: its former name, and the name it has now.
_TABLE = """
baselines.adaptive_dual_loop baselines.damping
baselines.adaptive_inverse baselines.adaptive_feedforward
baselines.believed baselines.core_inverse
baselines.h_infinity baselines.linear_designs
baselines.horizon baselines.model_predictive
baselines.inverses.catalogue baselines.inverses.base
baselines.inverses.lags baselines.inverses.linear
baselines.inverses.memory baselines.inverses.samplewise
baselines.inverses.static baselines.inverses.samplewise
baselines.inverses.turns baselines.inverses.base
baselines.inverses.unknown baselines.inverses.samplewise
baselines.iterative_learning baselines.repetitive
baselines.lanes baselines.base
baselines.learned.envelope baselines.monitors
baselines.learned.guard baselines.learned.controller
baselines.learned.imitation.student baselines.learned.imitation.policy
baselines.learned.network baselines.learned.policy
baselines.learned.seen baselines.monitors
baselines.limits baselines.base
baselines.linear_feedback baselines.linear_designs
baselines.lqg baselines.linear_designs
baselines.memory baselines.base
baselines.pi_preview baselines.linear_designs
baselines.products baselines.base
baselines.ringing baselines.monitors
baselines.smith_predictor baselines.linear_designs
baselines.stability baselines.feedforward
baselines.static_gain baselines.feedforward
rdpi_gym.envs.correction rdpi_gym.envs.controller
rdpi_gym.envs.references rdpi_gym.envs.truth
rdpi_gym.envs.tasks.changing rdpi_gym.envs.draw_laws
rdpi_gym.envs.tasks.noise rdpi_gym.envs.draw_laws
rdpi_gym.envs.tasks.one_effect rdpi_gym.envs.tasks.stages
rdpi_gym.envs.tasks.page rdpi_gym.envs.tasks.environment
rdpi_gym.envs.tasks.structure rdpi_gym.envs.tasks.stages
rdpi_gym.envs.tasks.whole_stage rdpi_gym.envs.tasks.stages
rdpi_gym.envs.vector.references rdpi_gym.envs.vector.task
rdpi_gym.envs.vector.space rdpi_gym.envs.unit_box
rdpi_gym.identification.result rdpi_gym.identification.fitting
rdpi_gym.measurement.published rdpi_gym.measurement.loading
rdpi_gym.plant.cores.asymmetric_bouc_wen rdpi_gym.plant.cores.bouc_wen
rdpi_gym.plant.cores.checks rdpi_gym.plant.cores.families
rdpi_gym.plant.cores.inner_variable rdpi_gym.plant.cores.families
rdpi_gym.plant.cores.thresholds rdpi_gym.plant.cores.families
rdpi_gym.plant.effects.catalogue rdpi_gym.plant.effects
rdpi_gym.plant.effects.unknown_drives rdpi_gym.plant.effects.unknown
rdpi_gym.plant.effects.unknown_kernel rdpi_gym.plant.effects.unknown
rdpi_gym.plant.effects.unknown_places rdpi_gym.plant.effects.unknown
rdpi_gym.plant.instruments rdpi_gym.plant.model
rdpi_gym.plant.named rdpi_gym.plant.model
rdpi_gym.plant.packing rdpi_gym.plant.cores.base
rdpi_gym.plant.stages rdpi_gym.plant.plant
rdpi_gym.signals.checks rdpi_gym.signals.base
rdpi_gym.signals.loops rdpi_gym.signals.periodic
rdpi_gym.signals.processes rdpi_gym.signals.broadband
rdpi_gym.signals.raster rdpi_gym.signals.periodic
rdpi_gym.signals.registry rdpi_gym.signals
rdpi_gym.signals.sweeps rdpi_gym.signals.broadband
rdpi_gym.virtual_lab.truth rdpi_gym.virtual_lab.dataset
"""


class FormerNames(MetaPathFinder, Loader):
    """Finder of modules by their former names.

    Parameters
    ----------
    table
        Lines of a former and a present name.
    """

    def __init__(self, table: str = _TABLE) -> None:
        self._present = dict(line.split() for line in table.strip().splitlines())

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a former name, or a package that former names are in."""
        within = any(name.startswith(f"{fullname}.") for name in self._present)
        if not within and fullname not in self._present:
            return None
        return ModuleSpec(fullname, self, is_package=within)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return a module whose attributes are those of the module of today."""
        module = ModuleType(spec.name)
        if spec.name in self._present:
            present = self._present[spec.name]
            warnings.warn(
                f"{spec.name} is now {present}; the former name goes with the next release",
                DeprecationWarning,
                stacklevel=2,
            )
            source = import_module(present)
            vars(module).update(
                {name: value for name, value in vars(source).items() if name[:2] != "__"}
            )
            module.__doc__ = source.__doc__
            module.__getattr__ = lambda name: getattr(source, name)  # type: ignore[method-assign]
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Run nothing: the module of today has run."""


def accept_former_names() -> None:
    """Let former names import, after every other way of finding a module."""
    if not any(isinstance(finder, FormerNames) for finder in sys.meta_path):
        sys.meta_path.append(FormerNames())
