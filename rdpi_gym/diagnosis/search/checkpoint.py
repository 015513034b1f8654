"""Finished candidates in a file, so that an interrupted search goes on from them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit
from rdpi_gym.measurement import Record
from rdpi_gym.plant.cores.base import Core
from rdpi_gym.plant.effects.base import Effect
from rdpi_gym.plant.model import core_from_dict, core_to_dict
from rdpi_gym.support.documents import PLAIN, at
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fingerprint import code_of, fingerprint, source_of
from rdpi_gym.support.store import named_rows

FORMAT = "rdpi-candidates"


class Checkpoint:
    """Finished refits by what they depend on: data, start, effects, code.

    Parameters
    ----------
    path
        The file; None keeps nothing.
    records
        The data, to fit and to validate.

    Attributes
    ----------
    remark : str or None
        What of the file was damaged, in one sentence.

    Raises
    ------
    InputError
        The file is something else, or cannot be read.
    """

    def __init__(self, path: Path | None, records: Iterable[Record]) -> None:
        if path is not None and path.parent.exists() and not path.parent.is_dir():
            raise InputError(f"{path.parent} is a file; give a folder for the results")
        self._store = None if path is None else named_rows(path, FORMAT)
        self.remark = None if self._store is None else self._store.remark()
        parts = [code_of("plant", "identification", "diagnosis/search")]
        for record in records:
            parts.append(record.name.encode(errors="backslashreplace"))
            columns = (record.t_s, record.u_V, record.y_um, record.error_mask)
            parts += [np.ascontiguousarray(column).tobytes() for column in columns]
        self._data = fingerprint(parts)

    def get(
        self,
        hysteresis: Core,
        present: Sequence[Effect],
        kind: type[Effect],
        starts: Sequence[Effect] | None = None,
        smoothness: float = 0.0,
    ) -> JointFit | None:
        """Return a finished refit, or None."""
        if self._store is None:
            return None
        row = self._store.rows.get(self._key(hysteresis, present, kind, starts, smoothness))
        if row is None:
            return None
        kinds = {e.name: type(e) for e in present} | {kind.name: kind}
        try:
            return _fit_of(row, kinds)
        except InputError:  # its check sum is right, but no search wrote it: it is fitted again
            return None

    def put(
        self,
        hysteresis: Core,
        present: Sequence[Effect],
        kind: type[Effect],
        starts: Sequence[Effect] | None,
        fit: JointFit,
    ) -> None:
        """Keep a finished refit."""
        if self._store is None:
            return
        row = {
            "key": self._key(hysteresis, present, kind, starts, fit.smoothness),
            "hysteresis": core_to_dict(fit.variant.hysteresis),
            "effects": [effect.to_dict() for effect in fit.variant.effects],
            "train_rmse_um": fit.train_rmse_um,
            "at_bound": fit.at_bound,
            "standard_errors": dict(fit.standard_errors),
            "passes": fit.passes,
            "converged": fit.converged,
            "smoothness": fit.smoothness,
        }
        self._store.append([row])

    def _key(
        self,
        hysteresis: Core,
        present: Sequence[Effect],
        kind: type[Effect],
        starts: Sequence[Effect] | None,
        smoothness: float,
    ) -> str:
        start = [core_to_dict(hysteresis), smoothness]
        effects = [effect.to_dict() for effect in (*present, *(starts or ()))]
        numbers = json.dumps(_rounded([*start, *effects]))
        sources = [source_of(each) for each in (*map(type, present), kind)]
        names = "+".join(effect.name for effect in present)
        own = f"{kind.name} {kind.form}".strip()
        return f"{self._data} {fingerprint([numbers.encode(), *sources])} {names} {own}"


def _rounded(value: Any) -> Any:
    """Leave out digits that another number of threads may change."""
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _fit_of(row: Mapping[str, Any], kinds: Mapping[str, type[Effect]]) -> JointFit:
    source = "a finished candidate"
    effects = []
    for effect in PLAIN.read(list[dict[str, Any]], row.get("effects"), at(source, "effects")):
        values = {k: v for k, v in effect.items() if k not in ("form", "effect")}
        try:
            effects.append(kinds[effect["effect"]](**values))
        except (KeyError, TypeError) as error:
            raise InputError(f"{source}: no effect of this search ({error})") from error
    if type(error_um := row.get("train_rmse_um")) is not float:  # infinite where it failed
        raise InputError(f"{source}: its error is no number")
    variant = Variant(core_from_dict(row.get("hysteresis"), source), tuple(effects))
    return PLAIN.read_fields(JointFit, row, source, {"variant": variant, "train_rmse_um": error_um})
