"""The portrait of what no effect of the catalogue is, on records of another formulation."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.effect_discovery.plants import Foreign
from benchmarks.effect_discovery.protocols import Drive
from rdpi_gym.diagnosis.portrait import Portrait, sentences_of
from rdpi_gym.diagnosis.portrait.drawing import draw
from rdpi_gym.diagnosis.portrait.trials import learn_forms
from rdpi_gym.diagnosis.search.setting import Setting
from rdpi_gym.diagnosis.words import in_words
from rdpi_gym.identification.joint import fit_joint
from rdpi_gym.identification.scale import data_scale
from rdpi_gym.measurement import Quantities, Record
from rdpi_gym.plant import RDPI
from rdpi_gym.plant.effects import CATALOGUE
from rdpi_gym.plant.effects.unknown import Unknown
from studies.portrait_plants import SORTS, World

TS_S, PARTS, NOISE_UM = 5e-3, 4, 0.01
PLANT = Foreign(1.0, np.linspace(2, 20, 8), np.full(8, 0.08), 0.0, 0.0, 30.0, 40.0, NOISE_UM, 0.0)


def records(name, size, samples=1200):
    """Three records of loops within loops, of a plant with an effect of a sort."""
    rng, found = np.random.default_rng(4), []
    t = TS_S / PARTS * np.arange((samples - 1) * PARTS + 1)
    for k, role in enumerate(("train", "train", "validation")):
        hz, phases = rng.uniform(0.15, 3.0, 5), rng.uniform(0.0, 6.0, 5)
        u = sum(np.sin(2 * np.pi * f * t + p) - np.sin(p) for f, p in zip(hz, phases, strict=True))
        drive = Drive(f"loops-{k}", role, TS_S, PARTS, 29.0 * u / np.abs(u).max())
        numbers = {"size": size, "sign": 1.0, "tau_s": 0.5}
        y = SORTS[name].displace(World(PLANT, drive, 10.0, numbers))[::PARTS]
        clock = 10.0 * k + t[::PARTS]
        y = y + rng.normal(0.0, NOISE_UM, samples)
        found.append(Record(drive.name, clock, drive.command_V, y, ts_s=TS_S, role=role))
    return found


def drawn(found):
    train, held = tuple(found[:2]), tuple(found[2:])
    setting = Setting(train, held, data_scale(found))
    core = fit_joint(train, RDPI.comb(setting.scale)).variant.hysteresis.pruned()
    kin = {"asymmetry": CATALOGUE["asymmetry"]()}
    forms = learn_forms(setting, core, (), Unknown, lambda *_: None)
    return in_words(draw(setting, core, (), forms, kin, 0, lambda *_: None), Quantities())


@pytest.fixture(scope="module")
def bent():
    return drawn(records("input bent by |u|^1.5", 0.01))


def test_the_power_of_a_bent_input_is_told(bent):
    assert (bent.place, bent.memory, bent.parity) == ("before", False, "even")
    assert abs(bent.power.value - 1.5) < 0.1
    assert bent.after_um < 0.25 * bent.before_um
    assert sum(bent.places.values()) == pytest.approx(1.0)
    assert bent.nearest[0].differs == "it stands behind the hysteresis"


def test_it_says_the_numbers_first_and_comes_back_from_its_file(bent):
    assert bent.sentences[0].startswith(
        f"From {bent.before_um:.3g} µm to {bent.after_um:.3g} µm: so far a free block takes"
    )
    assert bent.sentences[1] == (
        "Over 99 % of draws of the records place it before the hysteresis: there it changes the command that the plays see."
    )
    assert "to the power 1.5 ± " in str(bent)
    assert Portrait.from_dict(bent.to_dict()) == bent
    open_place = replace(bent, place=None, places={"behind": 0.43, "before": 0.55, "in": 0.02})
    assert sentences_of(open_place)[1].startswith(
        "Where in the chain it stands these records cannot tell: 55 % before the hysteresis and 43 % behind it, "
    )


def test_a_memory_is_told_with_its_time_constant():
    found = drawn(records("output follows past u^2", 0.01))
    assert (found.place, found.memory, found.parity) == ("behind", True, "even")
    assert found.time_constants_s[0].value == pytest.approx(0.5, rel=0.1)


def test_where_nothing_is_missing_nothing_is_drawn():
    assert drawn(records("input bent by u^3", 0.0, 400)) is None
