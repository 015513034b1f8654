"""Every controller's C, traced from its own Python, gives the commands of the Python."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher

from baselines.extended import ExtendedInverse
from baselines.inverses.base import inverse_of
from baselines.learned.imitation.policy import StudentPolicy
from baselines.lookup import make_controller
from baselines.registry import CONTROLLERS
from benchmarks.tracking.controllers import shipped_policies
from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.envs.tasks.stages import MEASURED
from rdpi_gym.firmware.making import PhysicalLayout, controller_program, traced_program
from rdpi_gym.firmware.program import Program
from rdpi_gym.plant import CORES, P5, P10, PlantModel
from rdpi_gym.plant.effects import CATALOGUE, Effect, load_effect
from rdpi_gym.plant.parameters import DataScale
from rdpi_gym.support.errors import InputError
from studies.firmware_truth import Case, as_scored
from tests.firmware.programs import answers, needs_gcc

TS_S, SAMPLES, LANES = 1e-4, 300, 2
MANY = 334  # lanes: 100,000 samples
# A search ends where the order of a sum decides its last step.
ROUNDINGS = {"core-inverse": 1e-9, "pi-core-inverse": 1e-9}
PLANS = ("iterative-learning", "preview-inversion", "repetitive")
BANK = "adaptive-core-bank"
EFFECTS = (
    load_effect("creep")(),
    load_effect("resonance")(f0_hz=700.0, damping=0.02),
    load_effect("delay")(delay_s=2.5e-4),
)
RESONANT = replace(P10, effects=EFFECTS)


def records(program: Program, lanes: int = LANES) -> tuple[np.ndarray, np.ndarray]:
    """References that swing, rest and jump, and a measurement that is off by noise and a step."""
    rng = np.random.default_rng(0)
    rows = SAMPLES + program.preview
    t = program.ts_s * np.arange(rows)[:, None]
    swing = np.sin(2 * np.pi * rng.uniform(5.0, 80.0, lanes) * t + rng.uniform(0.0, 6.0, lanes))
    reference = program.centre_um + program.scale_um * rng.uniform(0.3, 1.0, lanes) * swing
    reference[120:160] = reference[120]
    reference[200:] += 0.2 * program.scale_um
    measured = reference[:SAMPLES] + 0.01 * program.scale_um * rng.normal(size=(SAMPLES, lanes))
    measured[150:] += 0.05 * program.scale_um
    return reference, measured


def off_by(program: Program, folder: Path, single: bool = False, lanes: int = LANES) -> float:
    """Largest difference of the C from Python, as share of the command range."""
    reference, measured = records(program, lanes)
    commands = answers(program, folder, reference, measured, single=single)
    expected = program.twin(reference, measured)
    return float(np.max(np.abs(commands - expected)) / np.ptp(program.command_range_V))


def allowed(program: Program) -> float:
    return 0.0 if program.exact else 1e-13


@needs_gcc
def test_every_controller_gives_the_commands_of_the_one_that_scores(tmp_path: Path) -> None:
    left_out = (*PLANS, BANK, *(() if find_spec("slycot") else ("h-infinity",)))
    for name in (each for each in CONTROLLERS if each not in left_out):
        exported = controller_program(name, RESONANT, TS_S)
        program = as_scored(exported, Case("", name, RESONANT, name))
        found = off_by(program, tmp_path, lanes=MANY)
        assert found <= (0.0 if program.exact else ROUNDINGS.get(name, 1e-13)), name
        assert program.exact or program.inexact_because, name


@needs_gcc
@pytest.mark.slow
def test_a_bank_of_cores_is_off_by_roundings_that_do_not_grow(tmp_path: Path) -> None:
    """Its cores are summed in another order in C: a jump makes more of it for a while, no sample after keeps it."""
    program = as_scored(controller_program(BANK, P10, TS_S), Case("", BANK, P10, BANK))
    reference, measured = records(program, MANY)
    commands = answers(program, tmp_path, reference, measured, single=False)
    off = np.abs(commands - program.twin(reference, measured)) / np.ptp(program.command_range_V)
    assert np.median(np.max(off, axis=0)) <= 1e-11
    assert np.max(off) <= 1e-5
    assert np.max(off[-1]) <= 1e-9


@needs_gcc
def test_a_student_of_the_bank_of_cores_has_its_c(tmp_path: Path) -> None:
    policy = StudentPolicy.untrained(
        P10, ObservationLayout.for_plant(P10, TS_S, preview=8), 4, BANK
    )
    commands = []
    for size in (0.0, 0.05):
        head = size * np.random.default_rng(0).normal(size=policy.student.arrays["head_bias"].shape)
        arrays = dict(policy.student.arrays) | {"head_bias": head.astype(np.float32)}
        student = replace(policy, student=replace(policy.student, arrays=arrays))
        program = controller_program(f"learned:{student.save(tmp_path / str(size))}", P10, TS_S)
        commands.append(program.twin(*records(program)))
    assert np.max(np.abs(np.diff(commands, axis=0))) > 0.01 * np.ptp(program.command_range_V)
    assert off_by(program, tmp_path) <= 1e-5


def test_beliefs_with_effects_are_used() -> None:
    for name in ("extended-inverse", "pi-extended-inverse", "dual-loop", "model-predictive",
                 "adaptive-inverse"):  # fmt: skip
        assert controller_program(name, RESONANT, TS_S).preview > 1, name


def _one_form_of_each_inverse() -> Iterator[Effect]:
    found: dict[object, Effect] = {}
    for kind in (*CATALOGUE.values(), load_effect("unknown")):
        for form in kind.forms:
            own = kind.name if kind.name in ("rate_law", "congruency") else None
            key = inverse_of(form) or own
            if key is not None:
                found.setdefault((key, kind.name), form())
    yield from found.values()


@pytest.mark.slow
@needs_gcc
def test_every_kind_of_inverse_has_its_c(tmp_path: Path) -> None:
    for effect in _one_form_of_each_inverse():
        program = controller_program("extended-inverse", replace(P10, effects=(effect,)), TS_S)
        assert off_by(program, tmp_path) <= 1e-13, effect.full_name()
    bent = replace(P10, effects=(load_effect("asymmetry")(coefficient=0.05, span_um=40.0),))
    program = controller_program("extended-inverse", bent, TS_S)
    assert "m->state" in program.begin  # its memory at rest is no line in the reference
    assert off_by(program, tmp_path) <= 1e-13
    assert controller_program("extended-inverse", P10, TS_S).begin == ""


@pytest.mark.slow
@needs_gcc
def test_any_core_is_inverted_by_the_same_search(tmp_path: Path) -> None:
    scale = DataScale(0.0, 30.0, 20.0, fastest_V_s=400.0, shortest_s=1e-3, longest_s=4.0)
    for name, kind in CORES.items():
        own = kind.comb(scale)
        plant: PlantModel[Any] = PlantModel(own, "own", (-30.0, 30.0), (0.0, 5.0), offset_um=2.0)
        program = controller_program("core-inverse", plant, 1e-3)
        assert off_by(program, tmp_path) <= 1e-13, name
        assert program.step.count("n < 9") == 2, name


@needs_gcc
def test_single_precision_is_as_near_as_floats(tmp_path: Path) -> None:
    for name in ("pi-classical-reference-rate", "core-inverse", "pi-preview"):
        assert off_by(controller_program(name, P10, TS_S), tmp_path, single=True) <= 1e-5, name


class InDouble:
    """NumPy, but that nothing is rounded to single precision."""

    float32 = np.float64

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)


@pytest.mark.slow
@needs_gcc
def test_learned_policies_are_as_near_as_floats_and_nearer_in_double(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("torch", reason="torch is not installed")
    for name in (*shipped_policies()[0], "guarded:ppo-increment"):
        slow = name.endswith("measured")
        own = (MEASURED.belief(), MEASURED.ts_s) if slow else (P10, TS_S)
        program = controller_program(name, *own)
        assert "float32" in program.inexact_because, name
        # the bank of cores that a student corrects makes more of roundings where a record jumps
        near, nearest = (1e-3, 1e-5) if "imitation" in name else (1e-5, 1e-9)
        if "imitation" not in name or name.endswith("stage"):  # of one kind
            assert off_by(program, tmp_path) <= near, name
        with monkeypatch.context() as patch:
            for module in list(sys.modules.values()):
                if module.__name__.startswith(("baselines.learned", "rdpi_gym.envs.wrappers")):
                    patch.setattr(module, "np", InDouble(), raising=False)
            made = program.twin.made
            policy = getattr(getattr(made, "policy", None), "policy", None) or made.policy
            if hasattr(policy, "actor"):
                policy.actor.double()
            assert off_by(program, tmp_path, lanes=20) <= nearest, name
            if hasattr(policy, "actor"):
                policy.actor.float()


def test_unknown_and_planning_controllers_are_refused() -> None:
    for name in PLANS:
        with pytest.raises(InputError, match=f"^{name} plans over the whole reference"):
            controller_program(name, P10, TS_S)
    with pytest.raises(InputError, match="is no controller of this package"):
        controller_program("os:system", P10, TS_S)


@needs_gcc
def test_fields_in_another_order_are_the_same_sample(tmp_path: Path) -> None:
    fields = ("command", "measured", "reference")
    for kind in (PhysicalLayout, ObservationLayout):
        wanted, found = (
            traced_program(make_controller("pi-preview", P10, layout), "own")  # type: ignore[arg-type]
            for layout in (kind.for_plant(P10, TS_S), kind.for_plant(P10, TS_S, fields=fields))
        )
        assert off_by(found, tmp_path) <= allowed(found), kind
        given = records(found)
        np.testing.assert_array_equal(
            answers(found, tmp_path, *given), answers(wanted, tmp_path, *given)
        )


def test_a_given_preview_is_that_of_the_steps_and_the_memory_is_counted() -> None:
    assert controller_program("adaptive-feedforward", P10, TS_S, preview=9).preview == 9
    program = controller_program("classical-static", P10, TS_S)
    assert program.preview == 1
    assert (program.kind, program.title, program.model) == ("controller", "classical-static", "P10")
    assert sum(len(part.rest) for part in program.memory) == P10.hysteresis.n + 3


def _seen() -> list[tuple[int, str, int]]:
    return [
        (id(module), name, id(value))
        for module in list(sys.modules.values())
        if module.__name__.split(".")[0] in ("baselines", "rdpi_gym")
        for name, value in vars(module).items()
        if value is np or isinstance(value, CPUDispatcher)
    ]


class Odd(ExtendedInverse):
    """A controller that decides as nothing in C can."""

    def next_command(self, observation: Any, reference_um: Any, state: Any) -> Any:
        return np.fft.fft(reference_um[0])


def test_modules_are_restored_after_a_trace_even_a_failed_one() -> None:
    controller_program("pi-classical-static", P10, TS_S)
    before = _seen()
    controller_program("extended-inverse", RESONANT, TS_S)
    made = Odd(P10, PhysicalLayout.for_plant(P10, TS_S, preview=1))
    with pytest.raises(InputError, match=r"^firmware/test_controllers\.py:\d+: np\.fft has no C"):
        traced_program(made, "odd")
    assert _seen() == before
    assert isinstance(P10.hysteresis.block, CPUDispatcher)


def test_another_thread_runs_controllers_while_one_is_traced() -> None:
    layout = PhysicalLayout.for_plant(P5, TS_S, preview=1)
    made = ExtendedInverse(P5, layout)
    reference = 10.0 * np.sin(np.arange(50.0) / 9.0)[:, None]
    wanted = made.command_block(reference)
    found: list[np.ndarray] = []

    class Halfway(ExtendedInverse):
        def next_command(self, observation: Any, reference_um: Any, state: Any) -> Any:
            other = threading.Thread(target=lambda: found.append(made.command_block(reference)))
            other.start()
            other.join()
            return super().next_command(observation, reference_um, state)

    traced_program(Halfway(P5, layout), "halfway")
    assert found
    assert all(np.array_equal(each, wanted) for each in found)
