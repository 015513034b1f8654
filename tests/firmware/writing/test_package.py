"""The folder of an export: it builds, checks itself, says what it costs, and is whole or absent."""

import re
import shutil
import subprocess
from dataclasses import replace
from itertools import product

import pytest

from rdpi_gym.firmware.making import package_of
from rdpi_gym.firmware.program import Table
from rdpi_gym.firmware.verify import verify
from rdpi_gym.firmware.writing import package as packages
from rdpi_gym.firmware.writing.package import DEVIATIONS, Package, state_bytes, write_package
from rdpi_gym.firmware.writing.source import Source, header_text, source_text
from rdpi_gym.plant import P10, named_plant
from rdpi_gym.plant.effects import load_effect
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import (
    COMPILERS,
    CONTROLLER,
    PLANT,
    STRICT,
    compiles,
    needs_gcc,
    needs_gcc_or_clang,
)

NAMES = ["pi-classical-reference-rate", None]
# What cppcheck is told to leave: it wants `const` for the struct of memory where a body happens not to
# write it, and every instance of a program has the same signatures; and the translation of a kernel
# keeps its statements, some of which are empty for the numbers at hand.
SUPPRESSED = ("constParameterPointer", "constParameter", "missingIncludeSystem", "constVariablePointer",
              "knownConditionTrueFalse", "redundantAssignment")  # fmt: skip


@pytest.fixture(scope="module", params=NAMES, ids=lambda name: name or "plant")
def exported(request, tmp_path_factory):
    package = package_of(named_plant("P5"), 1e-4, request.param)
    out = tmp_path_factory.mktemp("export") / "firmware"
    return package, write_package(package, out)


@needs_gcc_or_clang
def test_every_file_compiles_strictly_in_every_precision(exported):
    package, folder = exported
    for compiler, precision in product(COMPILERS, package.source.precisions):
        for path in (*folder.glob("rdpi_*.c"), folder / "main.c", *folder.glob("examples/*.c")):
            if "sfunction" not in path.name:
                assert compiles(compiler, path, precision, f"-I{folder}") == "", path.name
                path.with_suffix(".o").unlink()


@needs_gcc_or_clang
def test_its_own_check_passes_with_sanitizers(exported, subtests):
    if not shutil.which("make"):
        pytest.skip("no make here")
    package, folder = exported
    flags = "-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all"
    for compiler in COMPILERS:
        with subtests.test(compiler=compiler):
            done = subprocess.run(
                ["make", "-C", str(folder), "check", f"CC={compiler}", f"CFLAGS={flags}"],
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            shutil.rmtree(folder / "build", ignore_errors=True)
            if "cannot find" in done.stderr:
                pytest.skip(f"{compiler} has no sanitizers here")
            assert done.returncode == 0, done.stderr
            vectors = done.stdout.count("2000 vectors: largest difference")
            assert vectors == len(package.source.precisions)


def test_cppcheck_finds_nothing(exported):
    if not shutil.which("cppcheck"):
        pytest.skip("no cppcheck here")
    package, folder = exported
    files = [str(p) for p in (*folder.glob("rdpi_*.c"), folder / "main.c", *folder.glob("examples/*.c"))
             if "sfunction" not in p.name]  # fmt: skip
    words = ["cppcheck", "-q", "--enable=warning,style,performance,portability", "--error-exitcode=1",
             "--std=c99", f"-I{folder}", *(f"--suppress={each}" for each in SUPPRESSED)]  # fmt: skip
    for precision in package.source.precisions:
        done = subprocess.run(
            [*words, f"-DRDPI_PRECISION={precision}", *files], capture_output=True, text=True, check=False
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")


def test_misra_rules_are_kept_but_for_those_that_the_page_lists(exported):
    if not shutil.which("cppcheck"):
        pytest.skip("no cppcheck here")
    package, folder = exported
    name = package.source.name
    words = ["cppcheck", "-q", "--addon=misra", "--enable=style", "--std=c99", f"-I{folder}"]
    for precision in package.source.precisions:
        done = subprocess.run(
            [*words, f"-DRDPI_PRECISION={precision}", str(folder / f"{name}.c")],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if "addon" in done.stderr and "misra-c2012" not in done.stderr:
            pytest.skip("this cppcheck has no MISRA addon")
        found = set(re.findall(r"misra-c2012-([\d.]+)", done.stderr))
        assert "2.5" in found  # it looked
        assert found <= set(DEVIATIONS)
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert all(f"{rule}, " in page for rule in DEVIATIONS)


@needs_gcc
def test_the_page_says_the_bytes_that_a_compiler_says(exported, tmp_path):
    package, folder = exported
    name = package.source.name
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert "Not counted" not in page
    for precision in package.source.precisions:
        asks = tmp_path / "asks.c"
        asks.write_text(
            f'#include <stdio.h>\n#include "{name}.h"\nint main(void)\n{{\n    printf("%d %d", '
            f"(int)sizeof({name}_state), (int)sizeof({name}_parameters));\n    return 0;\n}}\n"
        )
        words = ["gcc", "-std=c99", f"-DRDPI_PRECISION={precision}", f"-I{folder}"]
        subprocess.run([*words, str(asks), "-o", str(tmp_path / "asks")], check=True)
        said = subprocess.run([str(tmp_path / "asks")], capture_output=True, text=True, check=True)
        assert tuple(map(int, said.stdout.split())) == state_bytes(package.source, precision)


def test_no_division_in_float_and_none_without_a_constant(exported):
    _, folder = exported
    page = (folder / "README.md").read_text(encoding="utf-8")
    row = next(
        line for line in page.splitlines() if line.startswith("| float") and line.count("|") > 5
    )
    cells = [int(cell.replace(",", "")) for cell in re.findall(r"[\d,]+", row)]
    assert cells[3:] == [0, 0]


def test_both_in_one_program(tmp_path):
    """A controller on its plant: the two headers in one file."""
    if not shutil.which("gcc"):
        pytest.skip("no gcc here")
    for program in (CONTROLLER, PLANT):
        for name, text in Package(Source(program)).files().items():
            if name.startswith("rdpi_") and "sfunction" not in name:
                (tmp_path / name).write_text(text)
    loop = tmp_path / "loop.c"
    loop.write_text(
        '#include "rdpi_controller.h"\n#include "rdpi_plant.h"\nint x = RDPI_CLAMPED;\n'
    )
    assert compiles("gcc", loop, 64) == ""


def test_an_empty_folder_and_an_earlier_export_are_taken(tmp_path):
    out = tmp_path / "firmware"
    out.mkdir()
    package = Package(Source(CONTROLLER))
    write_package(package, out)
    (out / "build").mkdir()
    (out / "build" / "vectors_64").write_text("x")
    write_package(Package(Source(PLANT)), out)
    names = {path.name for path in out.iterdir()}
    assert {"rdpi_plant.c", "program.json", "README.md", "examples"} <= names
    assert not {"rdpi_controller.c", "build"} & names


def test_what_no_export_wrote_is_kept(tmp_path):
    package = Package(Source(CONTROLLER))
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match="holds files and no export"):
        write_package(package, tmp_path / "a")
    out = write_package(package, tmp_path / "b")
    (out / "examples" / "mine.c").write_text("x")
    with pytest.raises(InputError, match=r"mine\.c beside an export"):
        write_package(package, out)
    assert (out / "examples" / "mine.c").exists()
    with pytest.raises(InputError, match="is a file"):
        write_package(package, out / "main.c")


def test_nothing_is_half_written(tmp_path, monkeypatch):
    def fail(path, document):
        raise InputError("the disk is full")

    monkeypatch.setattr(packages, "write_json", fail)
    with pytest.raises(InputError, match="disk is full"):
        write_package(Package(Source(CONTROLLER)), tmp_path / "firmware")
    assert list(tmp_path.iterdir()) == []


def test_cmake_builds_it(exported):
    if not shutil.which("cmake"):
        pytest.skip("no cmake here")
    package, folder = exported
    build = folder / "build"
    for words in (["cmake", "-S", str(folder), "-B", str(build)], ["cmake", "--build", str(build)],
                  ["ctest", "--test-dir", str(build)]):  # fmt: skip
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    shutil.rmtree(build)
    assert f"out of {len(package.source.precisions)}" in done.stdout


@needs_gcc_or_clang
def test_two_exports_with_prefixes_are_one_program_and_verified(tmp_path):
    sources, calls, heads = [], [], []
    for prefix, controller in (("x_axis", "classical-static"), ("Y2", "pi"), ("stage", None)):
        package = package_of(named_plant("P5"), 1e-4, controller, prefix=prefix)
        folder = write_package(package, tmp_path / prefix)
        assert all(row.passed for row in verify(folder, 2, 20).rows)
        assert not re.search(r"rdpi_(controller|plant)", "".join(package.files().values()))
        sources.append(folder / f"{prefix}.c")
        heads.append(f'#include "{sources[-1].with_suffix(".h")}"')
        first = "" if controller is None else ", 0.0"
        calls.append(
            f"{prefix}_state s_{prefix}; {prefix}_init(&s_{prefix}, &{prefix}_default{first});"
        )
    program = tmp_path / "both.c"
    program.write_text("\n".join([*heads, "int main(void)", "{", *calls, "return 0;", "}", ""]))
    for compiler in COMPILERS:
        words = [
            compiler,
            *STRICT,
            str(program),
            *map(str, sources),
            "-o",
            str(tmp_path / "both"),
            "-lm",
        ]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert subprocess.run([str(tmp_path / "both")], check=False).returncode == 0


def test_an_export_of_another_prefix_is_replaced(tmp_path):
    out = tmp_path / "out"
    for prefix in ("one", "two", None):
        write_package(package_of(named_plant("P5"), 1e-4, prefix=prefix), out)
    assert sorted(path.stem for path in out.glob("*.c")) == [
        "main",
        "rdpi_plant",
        "rdpi_plant_sfunction",
    ]


def test_numbers_of_the_structs_have_names_and_units():
    belief = replace(P10, effects=(load_effect("creep")(), load_effect("resonance")()))
    programs = [package_of(belief, 1e-4, name).source for name in ("pi-classical-static", None)]
    shown = [header_text(source) for source in programs]
    assert "#define RDPI_CONTROLLER_PARAMETERS_DELTA2_S 21\n" in shown[0]
    assert "#define RDPI_CONTROLLER_MEMORY_STATE_INTEGRAL_V 1\n" in shown[0]
    assert "#define RDPI_PLANT_PARAMETERS_CORE_DELTA2_S 21 /* s */\n" in shown[1]
    assert programs[1].program.tables[0].values[21] == P10.hysteresis.delta2_s
    assert re.search(r"rdpi_real resonance\[\d+\]; /\* f0_hz = \d+, damping = [\d.]+ \*/", shown[1])
    for source in programs:
        for field in (*source.program.tables, *source.program.memory):
            count = len(field.values if isinstance(field, Table) else field.rest)
            assert not field.parts or sum(part.count for part in field.parts) == count
    text = source_text(programs[0])
    assert re.search(r"#define STEP_FEED_BACK_INTEGRAL_V_UM RDPI_C\(\S+\)\n", text)
    assert "STEP_FEED_BACK_INTEGRAL_V_UM * error[0]" in text
