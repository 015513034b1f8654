"""FMUs pass FMPy's validation, answer as Python does there and in a program of C, and need nothing else."""

import re
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rdpi_gym.envs.tasks import named_task
from rdpi_gym.firmware.making import controller_program, plant_program
from rdpi_gym.firmware.writing.fmu import (
    binary_place,
    fmu_sources,
    model_description,
    model_identifier,
    variables,
    write_fmu,
)
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import COMPILERS, STRICT, c_of
from tests.looping import over

fmpy = pytest.importorskip("fmpy")

from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.model_description import read_model_description  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

HEADERS = Path(fmpy.__file__).parent / "c-code"
IMPORTER = Path(__file__).with_name("fmu_importer.c")
TS, N = 1e-4, 300
VERSIONS = ("2.0", "3.0")
KINDS = ("plant", "controller")
both_versions = over("fmi", VERSIONS)
both_kinds = over("kind", KINDS)
pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")


@pytest.fixture(scope="module", autouse=True)
def without_a_choice_of_compiler():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", "gcc")
        yield


@pytest.fixture(scope="module")
def programs():
    belief = named_task("Stage").nominal()
    return {
        "plant": plant_program(belief, TS),
        "controller": controller_program("pi-classical-reference-rate", belief, TS, preview=2),
    }


@pytest.fixture(scope="module")
def written(programs, tmp_path_factory):
    """Each FMU, and its files."""
    found = {}
    folder = tmp_path_factory.mktemp("fmus")
    for kind, program in programs.items():
        for fmi in VERSIONS:
            path = write_fmu(program, c_of(program), folder / f"{kind}-{fmi}.fmu", fmi)
            zipfile.ZipFile(path).extractall(folder / path.stem)
            library = next((folder / path.stem).glob("binaries/*/*"))
            found[kind, fmi] = SimpleNamespace(
                path=path, folder=folder / path.stem, library=library, program=program
            )
    return found


@pytest.fixture(scope="module")
def records(programs):
    """Columns of inputs of each kind, in the order of its value references, and Python's answers."""
    plant, controller = programs["plant"], programs["controller"]
    rng = np.random.default_rng(3)
    low, high = plant.command_range_V
    u = low + (high - low) * (0.5 + 0.45 * np.sin(0.13 * np.arange(N)) * rng.uniform(0.5, 1, N))
    steps = np.arange(N + controller.preview)
    r = controller.centre_um + controller.scale_um * np.sin(0.11 * steps)
    y = r[:N] + 0.05 * rng.normal(size=N)
    ahead = [r[j : N + j] for j in range(1, controller.preview + 1)]
    return {
        "plant": ([u], plant.twin(u[:, None])[:, 0], plant.scale_um),
        "controller": (
            [r[:N], y, *ahead],
            controller.twin(r[:, None], y[:, None])[:, 0],
            high - low,
        ),
    }


@pytest.fixture
def begun(written):
    """Begin an FMU in FMPy; it ends with the test."""
    running = []

    def begin(kind, fmi, **given):
        fmu = written[kind, fmi]
        description = read_model_description(fmu.folder)
        two = fmi == "2.0"
        made = (FMU2Slave if two else FMU3Slave)(
            guid=description.guid if two else description.instantiationToken,
            unzipDirectory=str(fmu.folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        made.instantiate(**given)
        made.set, made.get = (
            (made.setReal, made.getReal) if two else (made.setFloat64, made.getFloat64)
        )
        if two:
            made.setupExperiment(startTime=0.0)
        made.enterInitializationMode()
        made.exitInitializationMode()
        running.append(made)
        return made

    yield begin
    for made in running:
        made.terminate()
        made.freeInstance()


@both_versions
@both_kinds
def test_fmpy_simulates_what_python_computes(written, records, kind, fmi):
    fmu = written[kind, fmi]
    columns, expected, stroke = records[kind]
    inputs = [one.name for one in variables(fmu.program) if one.causality == "input"]
    signals = np.array(
        list(zip(TS * np.arange(N), *columns, strict=True)),
        dtype=[(name, float) for name in ("time", *inputs)],
    )
    found = fmpy.simulate_fmu(
        str(fmu.path), input=signals, stop_time=N * TS, output_interval=TS, validate=True
    )
    output = found[{"plant": "displacement_um", "controller": "command_V"}[kind]]
    assert validate_fmu(str(fmu.path)) == []
    assert len(output) == N + 1
    assert np.abs(output[1:] - expected).max() <= 1e-12 * stroke
    assert not found["out_of_range"].any()


SANITIZED = ["-g", "-fsanitize=address,undefined", "-DLINKED", "-fno-sanitize-recover"]


@both_versions
@both_kinds
def test_a_program_of_c_needs_no_python_and_sanitizers_find_nothing(
    written, records, kind, fmi, tmp_path
):
    fmu = written[kind, fmi]
    columns, expected, stroke = records[kind]
    own = sorted((fmu.folder / "sources").glob("*.c"))
    for flags, sources, off in (
        (["-Wall", "-Werror"], ["-ldl"], 1e-12),
        (SANITIZED, [*own, "-lm"], 1e-9),  # no -ffp-contract=off
    ):
        importer = tmp_path / "importer"
        build = ["gcc", "-std=gnu99", f"-DVERSION={fmi[0]}", f"-I{HEADERS}", *flags, IMPORTER]
        subprocess.run([*build, *sources, "-o", importer], check=True)
        found = imported(importer, fmu, columns)
        assert np.abs(found[1:] - expected).max() <= off * stroke, flags


def imported(importer, fmu, columns):
    token = re.search(r"\{[0-9a-f-]{36}\}", (fmu.folder / "modelDescription.xml").read_text())[0]
    text = "\n".join(" ".join(float(x).hex() for x in row) for row in zip(*columns, strict=True))
    run = subprocess.run(
        [importer, fmu.library, token, repr(TS), str(len(columns))], input=text, text=True,
        capture_output=True, env={"PATH": "/nonexistent"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    assert "whole multiple of the sampling time, 0.0001 s" in run.stderr
    return np.array(run.stdout.split(), dtype=float)


@both_versions
@both_kinds
@pytest.mark.skipif(not shutil.which("readelf"), reason="readelf is not installed")
def test_the_binary_shows_the_standards_functions_and_asks_for_libc(written, kind, fmi):
    library = written[kind, fmi].library
    dynamic = subprocess.run(["readelf", "-dW", library], capture_output=True, text=True).stdout
    assert set(re.findall(r"NEEDED.*\[(.*?)\]", dynamic)) <= {"libc.so.6", "libm.so.6"}
    table = subprocess.run(["readelf", "--dyn-syms", "-W", library], capture_output=True, text=True)
    lines = [line.split() for line in table.stdout.splitlines()[4:] if len(line.split()) > 7]
    shown = {line[7] for line in lines if line[6] != "UND"}
    asked = {line[7].partition("@")[0] for line in lines if line[6] == "UND"}
    header = (HEADERS / f"fmi{fmi[0]}Functions.h").read_text()
    standard = set(re.findall(rf"Export\s+fmi{fmi[0]}\w+TYPE\s+(\w+);", header))
    if fmi == "2.0":  # of model exchange none is asked for
        standard = {name for name in standard if name in shown}
        assert len(standard) == 34
    assert shown == standard
    assert not {name for name in asked if name.lower().startswith("py") or "python" in name}


@both_versions
def test_the_sources_compile_without_a_warning_and_are_the_standards(written, fmi):
    for compiler, kind in product(COMPILERS, KINDS):
        folder = written[kind, fmi].folder / "sources"
        # with the standard's own headers a prototype that differs is an error
        for headers in ([], ["-DRDPI_FMI_HEADERS", f"-I{HEADERS}"]):
            own = [f"rdpi_{kind}.c", f"rdpi_fmi{fmi[0]}.c"]
            subprocess.run(
                [compiler, *STRICT, "-fsyntax-only", *headers, *own], cwd=folder, check=True
            )


@pytest.mark.skipif(not shutil.which("cppcheck"), reason="cppcheck is not installed")
@both_versions
def test_cppcheck_finds_nothing(written, fmi):
    checks = ["--std=c99", "--enable=warning,performance,portability", "--error-exitcode=1", "-q"]
    for kind in KINDS:
        folder = written[kind, fmi].folder / "sources"
        own = [f"rdpi_{kind}.c", f"rdpi_fmi{fmi[0]}.c"]
        command = ["cppcheck", *checks, "--suppress=missingIncludeSystem", *own]
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr


@both_versions
@both_kinds
def test_another_machine_finds_all_sources_listed(written, kind, fmi):
    fmu = written[kind, fmi]
    path = "modelDescription.xml" if fmi == "2.0" else "sources/buildDescription.xml"
    root = ElementTree.parse(fmu.folder / path)
    listed = [one.get("name") for one in root.iter("File" if fmi == "2.0" else "SourceFile")]
    files = {path.name for path in (fmu.folder / "sources").iterdir()}
    assert sorted(listed) == sorted(name for name in files if name.endswith(".c"))
    included = {
        name
        for one in (fmu.folder / "sources").glob("*.[ch]")
        for name in re.findall(r'^#include "(rdpi_.*?)"', one.read_text(), re.MULTILINE)
    }
    assert included == {name for name in files if name.endswith(".h")}


@both_versions
def test_one_step_may_be_several_samples_and_nothing_else(written, records, begun, fmi):
    columns, *_ = records["controller"]
    fmu = written["controller", fmi]
    said = []

    def hear_2(environment, name, status, category, message):
        said.append(message)

    def hear_3(environment, status, category, message):
        said.append(message)

    if fmi == "2.0":
        callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(hear_2)
        given = {"callbacks": callbacks}
    else:
        given = {"logMessage": hear_3}
    one, three = (begun("controller", fmi, **given) for _ in range(2))
    row = [float(column[40]) for column in columns]
    places = list(range(10, 10 + len(row)))
    for made in (one, three):
        made.set(places, row)
    for k in range(3):
        one.doStep(k * TS, TS)
    with pytest.raises(Exception, match="failed"):
        three.doStep(0.0, 2.5 * TS)
    assert b"cannot step by 0.00025 s; give a whole multiple" in said[-1]
    three.doStep(0.0, 3 * TS)
    assert one.get([2]) == three.get([2])
    assert one.get([2]) != [fmu.program.rest_V]


@both_versions
def test_what_is_no_number_is_flagged_and_the_command_stays_in_its_range(written, begun, fmi):
    fmu = written["controller", fmi]
    low, high = fmu.program.command_range_V
    made = begun("controller", fmi)
    for k, value in enumerate((np.nan, 0.0, np.inf, -1e300, 0.0)):
        made.set([10], [value])
        made.doStep(k * TS, TS)
        assert low <= made.get([2])[0] <= high
        assert made.getBoolean([5])[0] == (value != 0.0)


@both_versions
def test_a_loop_of_two_is_the_loop_of_python(written, begun, fmi):
    """The plant first, then the controller with what it shows."""
    plant, controller = (begun(kind, fmi) for kind in KINDS)
    program = written["controller", fmi].program
    steps = np.arange(N + program.preview)
    r = program.centre_um + program.scale_um * np.sin(0.02 * steps)
    u, y = np.empty(N + 1), np.empty(N)
    u[:1] = controller.get([2])
    for k in range(N):
        plant.set([10], [u[k]])
        plant.doStep(k * TS, TS)
        y[k : k + 1] = plant.get([2])
        controller.set([10, 11, 12, 13], [r[k], y[k], r[k + 1], r[k + 2]])
        controller.doStep(k * TS, TS)
        u[k + 1 : k + 2] = controller.get([2])
    expected = program.twin(r[:, None], y[:, None])[:, 0]
    assert u[0] == program.rest_V
    assert np.abs(u[1:] - expected).max() <= 1e-12 * np.ptp(program.command_range_V)
    plant_twin = written["plant", fmi].program.twin
    assert np.abs(y - plant_twin(u[:N, None])[:, 0]).max() <= 1e-12 * program.scale_um
    assert np.abs(y[50:] - r[50:N]).max() < 0.2 * program.scale_um


def test_an_archive_is_the_same_each_time_and_its_token_is_its_codes(written, programs, tmp_path):
    plant = programs["plant"]
    again = write_fmu(plant, c_of(plant), tmp_path / "again.fmu")
    assert again.read_bytes() == written["plant", "3.0"].path.read_bytes()
    tokens = {
        fmu_sources(program, c_of(program), fmi)[1]
        for program in (plant, replace(plant, rest_V=1.0), programs["controller"])
        for fmi in VERSIONS
    }
    assert len(tokens) == 6
    names = zipfile.ZipFile(again).namelist()
    assert names[0] == "modelDescription.xml"
    assert not [name for name in names if "\\" in name or name.startswith("/")]


def test_what_cannot_be_compiled_is_one_line_and_leaves_nothing(programs, tmp_path, monkeypatch):
    plant = programs["plant"]
    out = tmp_path / "stage.fmu"
    broken = c_of(plant) | {"rdpi_plant.c": "#error not this one\n"}
    with pytest.raises(InputError, match=r"gcc refuses the code of the FMU: .*not this one"):
        write_fmu(plant, broken, out)
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="no C compiler is found; install gcc or clang"):
        write_fmu(plant, c_of(plant), out)
    assert list(tmp_path.iterdir()) == []


def test_folders_are_those_of_the_standards():
    assert binary_place("2.0", "win32", "AMD64", 64) == ("win64", ".dll")
    assert binary_place("2.0", "darwin", "arm64", 64) == ("darwin64", ".dylib")
    assert binary_place("2.0", "linux", "i686", 32) == ("linux32", ".so")
    assert binary_place("3.0", "linux", "i686", 32) == ("x86-linux", ".so")
    assert binary_place("3.0", "linux", "aarch64", 64) == ("aarch64-linux", ".so")
    with pytest.raises(InputError, match="FMI has no name for binaries of linux on riscv64"):
        binary_place("3.0", "linux", "riscv64", 64)
    if sys.platform == "linux":
        assert binary_place("3.0")[0] == fmpy.platform_tuple
        assert binary_place("2.0")[0] == fmpy.platform


@settings(max_examples=60)
@given(st.text(max_size=400), st.text(max_size=40))
def test_no_name_of_a_model_breaks_its_description(programs, model, title):
    for program in programs.values():
        odd = replace(program, model=model, title=title)
        identifier = model_identifier(odd)
        assert re.fullmatch("rdpi_[a-z]+(_[A-Za-z0-9]+)*", identifier)
        assert len(identifier) <= 48
        for fmi in VERSIONS:
            root = ElementTree.fromstring(model_description(odd, fmi, "{0}", ["a.c"], "rdpi-gym"))
            assert root.find("CoSimulation").get("modelIdentifier") == identifier
            assert len(root.get("modelName")) <= 200


@both_versions
def test_an_odd_name_is_carried_through(programs, tmp_path, fmi):
    odd = replace(programs["plant"], model="../../<\"&'>%s%n 25 µm\n\x00\ud800*/")
    path = write_fmu(odd, c_of(odd), tmp_path / "odd.fmu", fmi)
    assert validate_fmu(str(path)) == []
    assert model_identifier(odd) == "rdpi_plant_s_n_25_m"
    found = fmpy.simulate_fmu(str(path), stop_time=10 * TS)
    assert len(found) == 11
