"""Visited sets of a search as its checkpoint keeps them, without a search."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from rdpi_gym.diagnosis.beam.checkpoint import Checkpoint
from rdpi_gym.diagnosis.beam.constants import FIT_SAMPLES
from rdpi_gym.diagnosis.beam.evidence import Evidence
from rdpi_gym.diagnosis.beam.models import Model, Visited
from rdpi_gym.identification.jacobian import Variant
from rdpi_gym.identification.joint import JointFit, kept_samples
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P5
from rdpi_gym.plant.effects import CATALOGUE

NAMES = ("creep", "delay", "sensor_lag")


def evidence() -> Evidence:
    """Records of a plain gain."""
    t = 1e-3 * np.arange(400)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(t.size)
    record = Record("run", t, np.sin(40.0 * t), 8.0 * np.sin(40.0 * t) + noise, ts_s=1e-3)
    return Evidence.of(Dataset("made", (record,)))


def made() -> dict[str, Visited]:
    """One set with an effect for each of a few."""
    found, here = {}, evidence()
    parts = (here.train, here.validation)
    sizes = [k.size for part in parts for k in kept_samples(part, FIT_SAMPLES)]
    lefts = tuple(np.arange(float(size)) / 3.0 for size in sizes)
    for name in NAMES:
        model = Model(P5.hysteresis, (CATALOGUE[name](),))
        variant = Variant(model.core, model.effects)
        fit = JointFit(variant, len(name) / 7, (), {"δ2": math.pi}, 3, True)
        found[name] = Visited(model, fit, lefts, ("rdpi",))
    return found


def read_stages(path: Path, of: Evidence) -> dict[str, object]:
    """Return what a file keeps of each stage that it has."""
    checkpoint, found = Checkpoint(path, of), {}

    def missing() -> list[Visited]:
        raise LookupError

    for name in NAMES:
        try:
            one, *_ = checkpoint.stage(name, {}, missing) or missing()
        except LookupError:
            continue
        lefts = [left.tolist() for left in one.lefts]
        found[name] = (one.model, one.fit, lefts, one.parent)
    return found
