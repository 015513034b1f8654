"""S-functions compile with strict flags against a stand-in for Simulink, and answer as Python does."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rdpi_gym.firmware.making import controller_program, plant_program
from rdpi_gym.firmware.writing.package import sfunction_text
from rdpi_gym.plant import named_plant
from tests.firmware.programs import COMPILERS, STRICT, c_of

SIMULINK = Path(__file__).parent / "simulink"
TS = 1e-4
pytestmark = pytest.mark.skipif(not COMPILERS, reason="there is neither gcc nor clang")


@pytest.fixture(scope="module")
def programs():
    belief = named_plant("P10")
    return {
        "plant": plant_program(belief, TS),
        "controller": controller_program("pi-classical-reference-rate", belief, TS, preview=3),
    }


def built(folder, program, compiler=None, *flags):
    name = f"rdpi_{program.kind}"
    texts = c_of(program) | {f"{name}_sfunction.c": sfunction_text(program)}
    for file, text in texts.items():
        (folder / file).write_text(text)
    command = [compiler or COMPILERS[0], *STRICT, "-ffp-contract=off", *flags, f"-I{SIMULINK}"]
    command += [f"{name}_sfunction.c", f"{name}.c", "-o", "block", "-lm"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return folder / "block"


def answers(block, columns):
    text = "\n".join(" ".join(float(x).hex() for x in row) for row in zip(*columns, strict=True))
    run = subprocess.run([block], input=text, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    head, *rows = run.stdout.splitlines()
    return head, np.array([row.split() for row in rows], dtype=float)


def test_a_plant_answers_at_once_and_its_state_advances_once(programs, tmp_path):
    plant = programs["plant"]
    u = 15.0 * np.sin(0.1 * np.arange(400)) + np.random.default_rng(1).normal(size=400)
    head, rows = answers(built(tmp_path, plant), [u])
    assert head == f"{TS:.17g} 1"
    assert np.abs(rows[:, 0] - plant.twin(u[:, None])[:, 0]).max() <= 1e-12 * plant.scale_um
    assert not rows[:, 1:].any()


def test_a_controller_answers_at_the_next_sample(programs, tmp_path):
    controller, n = programs["controller"], 400
    rng = np.random.default_rng(2)
    shape = np.sin(0.1 * np.arange(n + controller.preview))
    r = controller.centre_um + controller.scale_um * shape
    y = r[:n] + 0.05 * rng.normal(size=n)
    ahead = [r[j : n + j] for j in range(1, controller.preview + 1)]
    u = controller.twin(r[:, None], y[:, None])[:, 0]
    low, high = controller.command_range_V
    for flags in ((), ("-fsanitize=address,undefined", "-fno-sanitize-recover")):
        head, rows = answers(built(tmp_path, controller, None, *flags), [r[:n], *ahead, y])
        assert head == f"{TS:.17g} 0"
        assert rows[0].tolist() == [controller.rest_V, 0.0, 0.0, 0.0]
        assert np.abs(rows[1:, 0] - u[:-1]).max() <= 1e-12 * (high - low)
        assert set(np.unique(rows[:, 1:])) <= {0.0, 1.0}


def test_inputs_that_are_no_numbers_are_flagged(programs, tmp_path):
    controller = programs["controller"]
    columns = [np.array([np.nan, 0.0, np.inf, 0.0]), *np.zeros((4, 4))]
    _, rows = answers(built(tmp_path, controller), columns)
    low, high = controller.command_range_V
    assert rows[:, 3].tolist() == [0.0, 1.0, 0.0, 1.0]
    assert ((low <= rows[:, 0]) & (rows[:, 0] <= high)).all()


def test_it_compiles_without_a_warning(programs, tmp_path):
    for compiler in COMPILERS:
        for program in programs.values():
            for precision in ("64", "32"):
                built(tmp_path, program, compiler, f"-DRDPI_PRECISION={precision}")


def test_names_of_users_end_no_comment(programs, tmp_path):
    for program in programs.values():
        odd = replace(program, model='*/ #error "x" /* ??/\n', title="@PREVIEW@ \\\n*/ int x; /*")
        assert "*/ #error" not in sfunction_text(odd)
        built(tmp_path, odd)
