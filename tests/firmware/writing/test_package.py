"""The folder of an export: it builds, checks itself, says what it costs, and is whole or absent."""

import re
import shutil
import subprocess
from itertools import product

import pytest

from rdpi_gym.firmware.making import package_of
from rdpi_gym.firmware.writing import package as packages
from rdpi_gym.firmware.writing.package import DEVIATIONS, Package, state_bytes, write_package
from rdpi_gym.firmware.writing.source import Source
from rdpi_gym.plant import named_plant
from rdpi_gym.support.errors import InputError
from tests.firmware.programs import (
    COMPILERS,
    CONTROLLER,
    PLANT,
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
