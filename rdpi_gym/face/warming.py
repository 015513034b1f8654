"""`warm`: every kernel that the commands use, compiled once per installation."""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_json
from rdpi_gym.support.fingerprint import fingerprint
from rdpi_gym.support.progress import Progress, silent

if TYPE_CHECKING:
    import pandas as pd

    from rdpi_gym.face.data import Dataset

# The measured records, cut to so many samples, compile what whole ones do; shorter ones need no thinning.
_SAMPLES = 1500
_TS_S, _TS_FACTOR = 1e-3, 4.0


def _example() -> Dataset:
    from rdpi_gym.face.data import example

    data = example()
    return replace(data, records=tuple(record.cut(slice(_SAMPLES)) for record in data.records))


def _fits() -> None:
    from rdpi_gym.face.comparison import compare
    from rdpi_gym.face.fitting import choose_kind, fit

    data = _example()
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
    from rdpi_gym.face.fitting import fit
    from rdpi_gym.face.search import diagnose
    from rdpi_gym.face.simulation import simulate

    simulate("P5", hide="creep", seed=1, ts_factor=_TS_FACTOR)
    measured = _example()
    diagnose(measured, fit(measured), jobs=1)  # what remains there is learned, and has a portrait


def _controllers() -> None:
    from rdpi_gym.face.benchmarking import benchmark

    benchmark(plants=["P5"], references=["sine"], ts_s=[_TS_S], seeds=1, jobs=1)


_PARTS = {
    "fit, compare": _fits,
    "effects": _effects,
    "environments": _environments,
    "simulate, discover": _discovery,
    "bench": _controllers,
}


def _stamp() -> Path:
    """File beside the compiled kernels that lists those of the last `warm`."""
    from rdpi_gym.plant.cores.play import rdpi_block

    return Path(rdpi_block.stats.cache_path) / "warm.json"


def _sources() -> str:
    """Fingerprint of what kernels are compiled from and for: sources, plug-ins, versions, processor."""
    import numba
    from llvmlite import binding

    from rdpi_gym.envs.controller import GROUP
    from rdpi_gym.plant.effects import ENTRY_POINTS

    folder = Path(__file__).parents[2]
    parts = [sys.version, numba.__version__, binding.get_host_cpu_name(), *_PARTS]
    for room in ("rdpi_gym", "baselines", "benchmarks"):
        for file in sorted((folder / room).rglob("*.py")):
            found = file.stat()
            parts.append(f"{file.relative_to(folder)} {found.st_mtime_ns} {found.st_size}")
    for group in (GROUP, ENTRY_POINTS):
        parts += sorted(str(entry) for entry in entry_points(group=group))
    return fingerprint(part.encode() for part in parts)


def _is_warm() -> bool:
    """True if the last `warm` compiled the present sources, and all its kernels are still there."""
    try:
        stamp = json.loads(_stamp().read_text(encoding="utf-8"))
        kept = all(Path(f).is_file() for f in stamp["kernels"])
        return kept and bool(stamp["sources"] == _sources())
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _kernels() -> Iterator[str]:
    """Files of compiled kernels in the folders that this process reads."""
    from numba.core.registry import CPUDispatcher

    # by type: to ask an object for its class runs code of whatever package made it
    kernels = [each for each in gc.get_objects() if issubclass(type(each), CPUDispatcher)]
    for folder in {each.stats.cache_path for each in kernels} - {None}:
        yield from (str(file) for file in sorted(Path(folder).glob("*.nb[ic]")))


def warm(*, progress: Progress | None = None) -> pd.DataFrame:
    """Compile what the commands use, so that their first answers come as fast as later ones.

    For images of containers and for CI; an installation that is used compiles as it goes. Kernels are
    kept beside the package, or in the folder that the variable ``NUMBA_CACHE_DIR`` names. Where all
    are kept already, nothing is done.

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
    done = _is_warm()
    for k, (part, job) in enumerate(_PARTS.items()):
        show(part, k, len(_PARTS))
        with compilations() as found:
            if not done:
                job()
        rows.append((part, found.kernels, found.seconds))
    if not done:
        with suppress(InputError):  # nor can kernels be kept there
            write_json(_stamp(), {"sources": _sources(), "kernels": sorted(_kernels())})
    return pd.DataFrame(rows, columns=["part", "kernels", "compiled_s"])
