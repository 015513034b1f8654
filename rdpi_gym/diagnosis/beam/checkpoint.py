"""Visited sets in a file, so that an interrupted search goes on from the last stage that it finished."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from rdpi_gym.diagnosis.beam.constants import FIT_SAMPLES
from rdpi_gym.diagnosis.beam.evidence import Clock, Evidence
from rdpi_gym.diagnosis.beam.models import Linear, Model, Visited
from rdpi_gym.diagnosis.beam.search import Sets, visited_now
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit, kept_samples
from rdpi_gym.plant.effects import CATALOGUE, Effect
from rdpi_gym.plant.effects.base import forms_of
from rdpi_gym.plant.effects.unknown import Unknown
from rdpi_gym.plant.model import core_from_dict, core_to_dict
from rdpi_gym.support.documents import PLAIN, at
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.fingerprint import code_of, fingerprint, source_of
from rdpi_gym.support.store import named_rows

FORMAT = "rdpi-candidates"


class Checkpoint:
    """Visited sets of the stages of a search, by what they depend on: data, moves, code.

    Parameters
    ----------
    path
        The file; None keeps nothing.
    evidence
        The data, and the moves that are offered.
    seed
        Of the bootstrap.

    Attributes
    ----------
    remarks : tuple of str
        What of the file was damaged, in a sentence.

    Raises
    ------
    InputError
        The file is something else, or cannot be read.
    """

    def __init__(self, path: Path | None, evidence: Evidence, seed: int = 0) -> None:
        if path is not None and path.parent.exists() and not path.parent.is_dir():
            raise InputError(f"{path.parent} is a file; give a folder for the results")
        self._store = None if path is None else named_rows(path, FORMAT)
        remark = None if self._store is None else self._store.remark()
        self.remarks: tuple[str, ...] = () if remark is None else (remark,)
        self._evidence, offer = evidence, evidence.offer
        every: list[type[Effect]] = [Unknown, *CATALOGUE.values(), *offer.effects.values()]
        self._kinds = {(f.name, f.form): f for kind in every for f in forms_of(kind)}
        self._kinds |= {(effect.name, effect.form): type(effect) for effect in offer.kept}
        parts = (evidence.train, evidence.validation)
        self._sizes = [k.size for part in parts for k in kept_samples(part, FIT_SAMPLES)]
        self._own = "" if path is None else self._depends_on(seed)

    def stage(self, name: str, sets: Sets, make: Callable[[], list[Visited]]) -> list[Visited]:
        """Return the sets that a stage visited, of the file or by visiting them.

        Parameters
        ----------
        name
            Of the stage.
        sets
            Those that were visited before, by key.
        make
            Visits them.
        """
        if self._store is None:
            return visited_now(name, sets, make)
        key = f"{self._own} {name}"
        row = self._store.rows.get(key)
        if row is not None:
            try:
                return self._read(row, sets)
            except (InputError, KeyError, TypeError, ValueError):
                pass  # its check sum is right, but no search wrote it: it is visited again
        found = make()
        if row is None:
            self._store.append([{"key": key, "sets": [_row(one) for one in found]}])
        return found

    def _depends_on(self, seed: int) -> str:
        evidence, offer = self._evidence, self._evidence.offer
        parts = [code_of("plant", "identification", "diagnosis/beam")]
        for record in (*evidence.train, *evidence.validation):
            parts.append(record.name.encode(errors="backslashreplace"))
            columns = (record.t_s, record.u_V, record.y_um, record.error_mask, record.before_V)
            parts += [np.ascontiguousarray(column).tobytes() for column in columns]
        core = None if offer.core is None else offer.core.name
        cores = [kind.name for kind in offer.cores]
        asked = [seed, core, offer.begins_with_all, cores, [e.to_dict() for e in offer.kept]]
        parts.append(json.dumps([asked, list(offer.effects)]).encode())
        parts += [source_of(kind) for kind in (*offer.effects.values(), *map(type, offer.kept))]
        return fingerprint(parts)

    def _read(self, row: Mapping[str, Any], sets: Sets) -> list[Visited]:
        linear: dict[tuple[str, ...], Linear] = {}
        return [self._set_of(each, sets, linear) for each in row["sets"]]

    def _set_of(
        self, row: Mapping[str, Any], sets: Sets, linear: dict[tuple[str, ...], Linear]
    ) -> Visited:
        source = "a visited set"
        effects = []
        for document in PLAIN.read(list[dict[str, Any]], row["effects"], at(source, "effects")):
            values = {k: v for k, v in document.items() if k not in ("form", "effect")}
            kind = self._kinds[document["effect"], document.get("form", "")]
            effects.append(kind(**values))
        variant = Variant(core_from_dict(row["hysteresis"], source), tuple(effects))
        clocks = tuple(Clock(**each) for each in row["clocks"])
        given = {"variant": variant, "train_rmse_um": float(row["train_rmse_um"])}
        fit = PLAIN.read_fields(JointFit, row, source, given)
        lefts = [np.frombuffer(base64.b64decode(each), dtype=np.float64) for each in row["lefts"]]
        sizes = [left.size for left in lefts if np.isfinite(left).all()]
        if sizes != self._sizes:
            raise InputError(f"{source}: what it leaves is of other records")
        parent = None if row["parent"] is None else tuple(row["parent"])
        model = Model(variant.hysteresis, variant.effects, clocks)
        one = Visited(model, fit, tuple(lefts), parent)
        return (
            one
            if not row["new"]
            else replace(one, ghosts=self._ghosts(one, row["new"], sets, linear))
        )

    def _ghosts(
        self, one: Visited, new: Sequence[str], sets: Sets, linear: dict[tuple[str, ...], Linear]
    ) -> tuple[Any, ...]:
        """Phantoms of a move, of which the file says the names alone."""
        assert one.parent is not None
        of = sets[one.parent].model
        if one.parent not in linear:
            variant = Variant(of.core, of.effects)
            linear[one.parent] = Linear(self._evidence.mended(of.clocks), variant)
        return linear[one.parent].with_phantoms(one.model, new)


def _row(one: Visited) -> dict[str, Any]:
    fit = one.fit
    return {
        "hysteresis": core_to_dict(one.model.core),
        "effects": [effect.to_dict() for effect in one.model.effects],
        "clocks": [asdict(clock) for clock in one.model.clocks],
        "train_rmse_um": fit.train_rmse_um,
        "at_bound": fit.at_bound,
        "standard_errors": dict(fit.standard_errors),
        "passes": fit.passes,
        "converged": fit.converged,
        "parent": one.parent,
        "new": one.new,
        "lefts": [
            base64.b64encode(left.astype(np.float64).tobytes()).decode() for left in one.lefts
        ],
    }
