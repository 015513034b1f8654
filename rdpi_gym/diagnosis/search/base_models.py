"""The base model of a search, of any core: where it begins, and where it is whole again."""

from __future__ import annotations

from collections.abc import Sequence

from rdpi_gym.identification.cores import fitted_core
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.support.progress import silent


def begun(kind: type[Core], records: Sequence[Record]) -> Core:
    """Return the core of a kind that a search begins with, to be refitted with effects beside it.

    A kind that is convex in its weights begins on its comb. One with several optima begins where a
    fit of it alone ends, or every refit of the search would have to try them all.

    Parameters
    ----------
    kind
        The core.
    records
        Records to fit.

    Raises
    ------
    InputError
        More gains than samples.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.plant import CORES
    >>> t = np.arange(4000) * 1e-3
    >>> u = t * np.sin(2 * np.pi * t)
    >>> records = [Record("growing", t, u, u, ts_s=1e-3)]
    >>> begun(CORES["rdpi"], records).n, begun(CORES["stop"], records).n
    (60, 60)
    """
    scale = data_scale(records)
    if len(kind.starts(scale)) == 1:
        return kind.comb(scale)
    core: Core = fitted_core(kind, records, kind.name, silent).plant.hysteresis
    return core


def on_comb(core: Core, records: Sequence[Record]) -> Core:
    """Return a core on the whole comb of its kind again, with weights where it has them.

    Parameters
    ----------
    core
        As a round of candidates left it.
    records
        Records to fit.

    Examples
    --------
    >>> import numpy as np
    >>> from rdpi_gym.plant import RDPI
    >>> t = np.arange(4000) * 1e-3
    >>> record = Record("growing", t, t * np.sin(2 * np.pi * t), t, ts_s=1e-3)
    >>> whole = begun(RDPI, [record])
    >>> on_comb(whole.pruned(), [record]) == whole
    True
    """
    return core.on(type(core).comb(data_scale(records)))
