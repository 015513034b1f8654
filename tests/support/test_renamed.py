"""Former names of modules import what is there now, with a warning."""

import importlib
import sys

import pytest

from rdpi_gym.support.renamed import _TABLE, FormerNames


def test_a_former_name_imports_the_module_of_today_with_a_warning(monkeypatch):
    table = "rdpi_gym.former rdpi_gym.support.words\nrdpi_gym.room.old rdpi_gym.support.words"
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, FormerNames(table)])
    words = importlib.import_module("rdpi_gym.support.words")
    for former in ("rdpi_gym.former", "rdpi_gym.room.old"):
        with pytest.warns(DeprecationWarning, match=f"{former} is now rdpi_gym.support.words"):
            found = importlib.import_module(former)
        assert found.digits is words.digits, former
    for name in ("rdpi_gym.former", "rdpi_gym.room.old", "rdpi_gym.room"):
        sys.modules.pop(name, None)
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("rdpi_gym.never")


# What a user imports from each former name: its class, or a function where it had none.
PUBLIC = {
    "baselines.adaptive_dual_loop": "AdaptiveDualLoop",
    "baselines.adaptive_inverse": "AdaptiveInverse",
    "baselines.believed": "hysteresis_inverse",
    "baselines.h_infinity": "HInfinity",
    "baselines.horizon": "TrueHorizon",
    "baselines.inverses.catalogue": "inverse_of",
    "baselines.inverses.lags": "SensorLagInverse",
    "baselines.inverses.memory": "CreepInverse",
    "baselines.inverses.static": "SaturationInverse",
    "baselines.inverses.turns": "turns",
    "baselines.inverses.unknown": "UnknownInverse",
    "baselines.iterative_learning": "IterativeLearning",
    "baselines.lanes": "Rows",
    "baselines.learned.envelope": "Watch",
    "baselines.learned.guard": "Guarded",
    "baselines.learned.imitation.student": "Student",
    "baselines.learned.network": "Network",
    "baselines.learned.seen": "Watch",
    "baselines.limits": "Limits",
    "baselines.linear_feedback": "LinearFeedback",
    "baselines.lqg": "LQGPreview",
    "baselines.memory": "Rows",
    "baselines.pi_preview": "PIPreview",
    "baselines.products": "lane_products",
    "baselines.ringing": "RingingMonitor",
    "baselines.smith_predictor": "SmithPredictor",
    "baselines.stability": "spectral_radius",
    "baselines.static_gain": "StaticGain",
    "rdpi_gym.envs.correction": "Correction",
    "rdpi_gym.envs.references": "ReferenceSource",
    "rdpi_gym.envs.tasks.changing": "ColouredNoise",
    "rdpi_gym.envs.tasks.noise": "ColouredNoise",
    "rdpi_gym.envs.tasks.one_effect": "stage",
    "rdpi_gym.envs.tasks.page": "page_of",
    "rdpi_gym.envs.tasks.structure": "structure_truth",
    "rdpi_gym.envs.tasks.whole_stage": "PiezoStageEnv",
    "rdpi_gym.envs.vector.references": "References",
    "rdpi_gym.envs.vector.space": "UnitBoxes",
    "rdpi_gym.identification.result": "FitResult",
    "rdpi_gym.measurement.published": "measured_data",
    "rdpi_gym.plant.cores.asymmetric_bouc_wen": "AsymmetricBoucWen",
    "rdpi_gym.plant.cores.checks": "check_thresholds",
    "rdpi_gym.plant.cores.inner_variable": "InnerVariable",
    "rdpi_gym.plant.cores.thresholds": "ThresholdCore",
    "rdpi_gym.plant.effects.catalogue": "load_effect",
    "rdpi_gym.plant.effects.unknown_drives": "WithMemory",
    "rdpi_gym.plant.effects.unknown_kernel": "unknown_block",
    "rdpi_gym.plant.effects.unknown_places": "Behind",
    "rdpi_gym.plant.instruments": "Sensor",
    "rdpi_gym.plant.named": "named_plant",
    "rdpi_gym.plant.packing": "pack",
    "rdpi_gym.plant.stages": "Stage",
    "rdpi_gym.signals.checks": "set_positive",
    "rdpi_gym.signals.loops": "NestedLoops",
    "rdpi_gym.signals.processes": "WienerProcess",
    "rdpi_gym.signals.raster": "Raster",
    "rdpi_gym.signals.registry": "make_signal",
    "rdpi_gym.signals.sweeps": "Chirp",
    "rdpi_gym.virtual_lab.truth": "Truth",
}


def test_every_former_name_of_the_table_has_what_it_had():
    table = dict(line.split() for line in _TABLE.strip().splitlines())
    assert set(PUBLIC) == set(table)
    for former, present in table.items():
        if former.startswith("baselines.learned."):
            pytest.importorskip("torch")
        with pytest.warns(DeprecationWarning, match=f"{former} is now {present};"):
            found = importlib.import_module(former)
        sys.modules.pop(former)
        here = getattr(found, PUBLIC[former])
        assert here is getattr(importlib.import_module(present), PUBLIC[former]), former
        assert here.__module__ == present, former


def test_a_function_that_moved_from_a_module_that_stayed_imports_from_there():
    from rdpi_gym.plant import settled_memory
    from rdpi_gym.plant.cores import rdpi

    assert rdpi.settled_memory is settled_memory
