"""The base model of a search, of any core: where it begins, and where it is whole again."""

from __future__ import annotations

from collections.abc import Sequence

from rdpi_gym.diagnosis.search.candidates import Setting
from rdpi_gym.identification.cores import first_fit
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect


def begun(setting: Setting, kind: type[Core], effects: Sequence[Effect] = ()) -> Core:
    """Return the core of a kind that a search begins with, to be refitted.

    A kind of one start is convex in its weights: it begins on its comb. Any other begins where a
    first fit ends, or every refit of the search would have to try all of its starts.
    """
    if len(kind.starts(setting.scale)) == 1:
        return kind.comb(setting.scale)
    found = first_fit(setting.train, kind, effects, setting.scale, setting.smoothness)
    assert found is not None
    return found.variant.hysteresis


def on_comb(core: Core, records: Sequence[Record]) -> Core:
    """Return a core on the whole comb of its kind again, with weights where it has them."""
    return core.on(type(core).comb(data_scale(records)))
