"""`warm`: every kernel that the commands use, compiled once per installation."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np

from rdpi_gym.support.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

# A record of a few hundred samples compiles what one of a million does.
_TS_S, _TS_FACTOR = 1e-3, 4.0
_RECORDS = ("stairs", "sine-50hz", "validation-stairs", "quiet")


def _fits() -> None:
    from rdpi_gym.face.comparison import compare
    from rdpi_gym.face.data import example
    from rdpi_gym.face.fitting import choose_kind, fit

    data = example()
    compare(data, fit(data))
    fit(data, free_memory=True)
    choose_kind(data)


def _effects() -> None:
    from rdpi_gym.plant import P5, Plant
    from rdpi_gym.plant.effects import CATALOGUE

    u = np.linspace(0.0, 1.0, 50)
    for kind in CATALOGUE.values():
        for form in (kind, *kind.forms):
            Plant(replace(P5, effects=(form(),)), _TS_S).simulate(u)


def _environments() -> None:
    for name, spec in gym.registry.items():
        if not name.startswith("rdpi_gym/"):
            continue
        single = gym.make(name)
        single.reset(seed=0)
        single.step(single.action_space.sample())
        if spec.vector_entry_point:
            lanes = gym.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point")
            lanes.reset(seed=0)
            lanes.step(lanes.action_space.sample())


def _discovery() -> None:
    from rdpi_gym.face.data import example
    from rdpi_gym.face.fitting import fit
    from rdpi_gym.face.search import diagnose, discover
    from rdpi_gym.face.simulation import simulate

    data = simulate("P5", hide="creep", seed=1, ts_factor=_TS_FACTOR).select(*_RECORDS)
    discover(data, jobs=1)
    diagnose(data, "P5", jobs=1)
    measured = example()
    diagnose(measured, fit(measured), jobs=1)  # what remains there is learned, and has a portrait


def _controllers() -> None:
    from rdpi_gym.face.benchmarking import benchmark

    benchmark(plants=["P5"], references=["sine"], ts_s=[_TS_S], seeds=1, jobs=1)


_PARTS = {
    "fit, compare": _fits,
    "effects": _effects,
    "environments": _environments,
    "diagnose, discover": _discovery,
    "bench": _controllers,
}


def warm(*, progress: Progress | None = None) -> pd.DataFrame:
    """Compile what the commands use, so that their first answers come as fast as later ones.

    For images of containers and for CI; an installation that is used compiles as it goes. Kernels are
    kept beside the package, or in the folder that the variable ``NUMBA_CACHE_DIR`` names. What is
    compiled already is loaded.

    Parameters
    ----------
    progress
        Called as parts are done.

    Returns
    -------
    pandas.DataFrame
        ``part``, the number of ``kernels`` compiled for it, and the time (s) that they took.

    Examples
    --------
    >>> import rdpi_gym as rg
    >>> table = rg.warm()  # doctest: +SKIP
    """
    import pandas as pd

    from rdpi_gym.support.compiling import compilations

    show, rows = progress or silent, []
    for k, (part, job) in enumerate(_PARTS.items()):
        show(part, k, len(_PARTS))
        with compilations() as found:
            job()
        rows.append((part, found.kernels, found.seconds))
    return pd.DataFrame(rows, columns=["part", "kernels", "compiled_s"])
