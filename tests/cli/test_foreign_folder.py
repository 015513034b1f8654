"""Commands in a folder from somebody else: nothing that lies in it is imported, by no process."""

import json
import os
import signal
import subprocess
import sys
import time
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

RDPI = Path(sys.executable).with_name("rdpi")
# imported by libraries where they are installed
OPTIONAL = (
    "bottleneck", "cupy", "dask", "distributed", "dotenv", "numexpr", "orjson", "pyarrow", "sitecustomize",
    "sklearn", "slycot", "tbb", "ujson", "usercustomize", "uvloop", "watchfiles", "websockets",
)  # fmt: skip
NAMES = {*sys.stdlib_module_names, *packages_distributions(), *OPTIONAL}
RUN = "import os; open(os.environ['CANARY'], 'a').write(__file__ + '\\n')\n"
CONTROLLER = """\
from baselines import make_controller
def make(belief, layout):
    return make_controller("none", belief, layout)
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with records, and a module of every name that a program may import."""
    made = tmp_path / "from-somebody"
    made.mkdir()
    for name in filter(str.isidentifier, NAMES):
        (made / f"{name}.py").write_text(RUN)
    t = 1e-3 * np.arange(2000)
    u = 10.0 * np.sin(4.0 * np.pi * t) * np.linspace(0.5, 1.0, t.size)
    columns = {"t": t, "u": u, "y": 1.1 * u + 0.1 * np.abs(u) + 0.01 * np.cos(777.0 * t)}
    np.savetxt(
        made / "run.csv",
        np.transpose(list(columns.values())),
        delimiter=",",
        header="t,u,y",
        comments="",
    )
    savemat(made / "run.mat", columns)
    # Matplotlib obeys it: LaTeX would be run, with a preamble of the folder
    (made / "matplotlibrc").write_text("text.usetex: True\n")
    return made


def begun(folder, *words, **options):
    environment = {**os.environ, "CANARY": str(folder.parent / "canary")}
    return subprocess.Popen(
        list(map(str, words)), cwd=folder, env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, start_new_session=True, **options,
    )  # fmt: skip


def loaded(folder):
    canary = folder.parent / "canary"
    return sorted(set(canary.read_text().splitlines())) if canary.exists() else []


@pytest.mark.parametrize(
    "words",
    [
        "bench --plants P5 --references sine --seeds 2 --jobs 2 --out out --controllers none",
        "discover run.csv --jobs 2 --out out",
        "fit run.mat --plays 3 --out out",
    ],
)
def test_a_command_that_starts_processes_imports_nothing_of_its_folder(folder, words):
    run = begun(folder, RDPI, *words.split())
    printed, _ = run.communicate(timeout=300)
    assert run.returncode == 0, printed
    assert loaded(folder) == []


def test_the_laboratory_and_its_workers_import_nothing_of_the_folder(folder):
    run = begun(folder, RDPI, "lab", "run.csv", "--no-browser", "--session", "session")
    journal = folder / "session" / "journal.jsonl"
    try:
        until = time.monotonic() + 120.0
        done = {"step"}
        while done:
            assert time.monotonic() < until
            time.sleep(0.1)
            text = journal.read_text() if journal.exists() else ""
            lines = text[: text.rfind("\n") + 1].splitlines()
            done = {"step"} - {json.loads(line)["do"] for line in lines}
    finally:
        os.killpg(run.pid, signal.SIGINT)
        run.communicate(timeout=30)
    assert loaded(folder) == []


def test_a_program_that_lies_elsewhere_starts_processes_that_import_nothing_of_the_folder(
    folder, tmp_path
):
    program = tmp_path / "elsewhere" / "program.py"
    program.parent.mkdir()
    program.write_text(
        "from rdpi_gym.support.parallel import run_cases\n"
        "from rdpi_gym.laboratory.work import Worker\n"
        "if __name__ == '__main__':\n"
        "    assert sorted(run_cases(abs, [-1, -2], jobs=2)) == [1, 2]\n"
        "    Worker(warm=False).stop()\n"
    )
    run = begun(folder, sys.executable, program)
    printed, _ = run.communicate(timeout=120)
    assert run.returncode == 0, printed
    assert loaded(folder) == []


def test_what_the_user_names_is_found_in_the_folder_by_every_process(folder):
    # last of all: a package that is installed, and not only as a namespace, is never one of the folder
    for file in folder.glob("*.py"):
        if file.stem not in (
            *sys.stdlib_module_names,
            "joblib",
            "numba",
            "numpy",
            "pandas",
            "scipy",
        ):
            file.unlink()
    (folder / "my_controllers.py").write_text(CONTROLLER + RUN)
    words = "submit my_controllers:make --task Bare --draws 2 --jobs 2 --out out"
    run = begun(folder, RDPI, *words.split())
    printed, _ = run.communicate(timeout=120)
    assert run.returncode == 0, printed
    assert loaded(folder) == [str(folder / "my_controllers.py")]


def test_a_configuration_of_the_compiler_is_refused(folder):
    # numba would load compiled code, which is pickled, from the folder that it names
    (folder / ".numba_config.yaml").write_text("cache_dir: cache\n")
    run = begun(folder, RDPI, "fit", "run.csv")
    printed, _ = run.communicate(timeout=60)
    assert run.returncode == 2
    assert printed.splitlines() == [
        "rdpi: .numba_config.yaml in this folder would configure the compiler; move it away, or start from "
        "another folder"
    ]
