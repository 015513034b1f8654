"""Programs written by hand with a twin in NumPy, and generated code compiled and called from Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
import pytest

from rdpi_gym.firmware.program import Memory, Program, Table
from rdpi_gym.firmware.writing.source import Source, header_text, source_text

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]  # fmt: skip
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
needs_compiler = pytest.mark.skipif(not (COMPILERS or shutil.which("cc")), reason="no C compiler")
needs_gcc_or_clang = pytest.mark.skipif(not COMPILERS, reason="neither gcc nor clang here")
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc here")


def integral(reference_um: Any, measured_um: Any) -> Any:
    """u(k+1) = 0.5 r(k+1) + sum of 0.25 (r - y), between -25 and 25 V."""
    total = reference_um[0].copy()
    u = np.empty_like(measured_um)
    for k, measured in enumerate(measured_um):
        total = total + 0.25 * (reference_um[k] - measured)
        u[k] = np.clip(0.5 * reference_um[k + 1] + total, -25.0, 25.0)
    return u


def one_play(command_V: Any) -> Any:
    """y = 0.7 u + 0.3 of a play of 2 V."""
    xi = np.zeros(command_V.shape[1])
    y = np.empty_like(command_V)
    for k, u in enumerate(command_V):
        xi = np.maximum(u - 2.0, np.minimum(u + 2.0, xi))
        y[k] = 0.7 * u + 0.3 * xi
    return y


CONTROLLER = Program(
    "controller", "integral", "hand-made", 1e-4, 1, (-25.0, 25.0), 0.0, 0.0, 10.0,
    [Table("gain", np.array([0.5, 0.25]))],
    [Memory("total", np.zeros(1), np.ones(1))],
    "",
    "m->total[0] = m->total[0] + p->gain[1] * (reference_um - measured_um);\n"
    "return rdpi_min(rdpi_max(p->gain[0] * ahead_um[0] + m->total[0], RDPI_C(-25.0)), RDPI_C(25.0));",
    frozenset(),
    integral,
)  # fmt: skip
PLANT = Program(
    "plant", "one play", "hand-made", 1e-4, 0, (-25.0, 25.0), 0.0, 0.0, 10.0,
    [Table("a", np.array([0.7, 0.3])), Table("r", np.array([2.0]))],
    [Memory("xi", np.zeros(1), np.zeros(1))],
    "",
    "for (int32_t i = 0; i < 1; ++i) {\n"
    "    m->xi[i] = rdpi_max(command_V - p->r[i], rdpi_min(command_V + p->r[i], m->xi[i]));\n"
    "}\n"
    "return p->a[0] * command_V + p->a[1] * m->xi[0];",
    frozenset(),
    one_play,
)  # fmt: skip
# Calls everything that the writer has.
GREEDY = replace(
    CONTROLLER,
    title="greedy",
    tables=[],
    memory=[],
    step="rdpi_real x = rdpi_copysign(rdpi_abs(RDPI_OVER(ahead_um[0], RDPI_C(3.0))), measured_um);\n"
    "const int32_t n = rdpi_min_int(rdpi_max_int(1, 2), 3);\n"
    "x += RDPI_EXP(RDPI_LOG(RDPI_C(1.5))) + RDPI_SIN(x) + RDPI_COS(x) + RDPI_TANH(x) + RDPI_POW(RDPI_C(2.0), x);\n"
    "x += RDPI_SQRT(RDPI_C(2.0)) + RDPI_EXPM1(x) + RDPI_LOG1P(RDPI_FABS(x)) + RDPI_FLOOR(x) + RDPI_CEIL(x);\n"
    "x += RDPI_FMOD(x, RDPI_C(2.0)) + RDPI_COPYSIGN(x, x) + RDPI_MIN(x, RDPI_INFINITY) + (rdpi_real)n + applied_V;\n"
    "return RDPI_ISNAN(x) ? RDPI_NAN : RDPI_MAX(RDPI_C(-25.0), RDPI_C(1e-300));",
)


def c_of(program: Program, **parts: Any) -> dict[str, str]:
    """Return header and source by their names."""
    source = Source(program, **parts)
    return {f"{source.name}.h": header_text(source), f"{source.name}.c": source_text(source)}


def write(program: Program, folder: Path, **parts: Any) -> Path:
    """Write header and source, and return the source's path."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in c_of(program, **parts).items():
        (folder / name).write_text(text, encoding="ascii")
    return folder / f"rdpi_{program.kind}.c"


def compiles(compiler: str, path: Path, precision: int, *flags: str) -> str:
    """Compile strictly, and return the messages of the compiler."""
    words = [compiler, *STRICT, *flags, f"-DRDPI_PRECISION={precision}", f"-I{path.parent}"]
    out = str(path.with_suffix(".o"))
    done = subprocess.run([*words, "-c", str(path), "-o", out], capture_output=True, text=True)
    return done.stderr


def library(sources: str | list[Path], folder: Path, name: str = "text", *flags: str) -> Any:
    """Return a compiled text of C, or files."""
    if isinstance(sources, str):
        path = folder / f"{name}.c"
        path.write_text(sources)
        sources = [path]
    made = folder / f"{name}.so"
    words = ["gcc", *STRICT, *flags, "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
    words += ["-Wno-unused-function", *map(str, sources), "-o", str(made), "-lm"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:4000]
    return ctypes.CDLL(str(made))


def head(folder: Path) -> str:
    """Return types, macros and helpers as every source has them."""
    text = c_of(GREEDY)
    (folder / "rdpi_controller.h").write_text(text["rdpi_controller.h"])
    source = text["rdpi_controller.c"]
    return source[: source.index("const rdpi_controller_parameters")]


_DRIVER = {
    "controller": """#include "rdpi_controller.h"
void run_all(int32_t samples, const double *r, const double *y, double *u);
void run_all(int32_t samples, const double *r, const double *y, double *u) {
    rdpi_controller_state s;
    rdpi_real ahead[RDPI_CONTROLLER_PREVIEW];
    rdpi_controller_init(&s, &rdpi_controller_default, (rdpi_real)r[0]);
    for (int32_t k = 0; k < samples; ++k) {
        for (int32_t j = 0; j < RDPI_CONTROLLER_PREVIEW; ++j) ahead[j] = (rdpi_real)r[k + 1 + j];
        const rdpi_real next = rdpi_controller_step(&s, &rdpi_controller_default, (rdpi_real)r[k], ahead, (rdpi_real)y[k]);
        rdpi_controller_acknowledge(&s, next);
        u[k] = (double)next;
    }
}
""",
    "plant": """#include "rdpi_plant.h"
void run_all(int32_t samples, const double *u, double *y);
void run_all(int32_t samples, const double *u, double *y) {
    rdpi_plant_state s;
    rdpi_plant_init(&s, &rdpi_plant_default);
    for (int32_t k = 0; k < samples; ++k) y[k] = (double)rdpi_plant_step(&s, &rdpi_plant_default, (rdpi_real)u[k]);
}
""",
}


def answers(program: Program, folder: Path, *inputs: Any, single: bool = False) -> Any:
    """Return the answers of the compiled program, lane by lane, float64[T, B]."""
    folder = Path(mkdtemp(dir=folder))  # a library is loaded once for each path
    path = write(program, folder)
    driver = folder / "driver.c"
    driver.write_text(_DRIVER[program.kind])
    flag = f"-DRDPI_PRECISION={32 if single else 64}"
    made = library([path, driver], folder, "program", flag)
    found = np.empty_like(inputs[-1])
    for lane in range(found.shape[1]):
        own = np.empty(len(found))
        columns = [each[:, lane].copy() for each in inputs]
        made.run_all(len(own), *(each.ctypes.data_as(ctypes.c_void_p) for each in (*columns, own)))
        found[:, lane] = own
    return found


class Running:
    """A controller's code in this process, in double."""

    def __init__(self, path: Path, first_um: float = 0.0) -> None:
        self._code = library([path], path.parent, "running")
        self._code.rdpi_controller_step.restype = ctypes.c_double
        self._code.rdpi_controller_flags.restype = ctypes.c_uint8
        self._parameters = ctypes.c_void_p(
            ctypes.addressof(ctypes.c_char.in_dll(self._code, "rdpi_controller_default"))
        )
        self._state = ctypes.create_string_buffer(4096)
        self._code.rdpi_controller_init(self._state, self._parameters, ctypes.c_double(first_um))

    def step(self, reference_um: float, ahead_um: list[float], measured_um: float) -> float:
        ahead = (ctypes.c_double * len(ahead_um))(*ahead_um)
        now, measured = ctypes.c_double(reference_um), ctypes.c_double(measured_um)
        found: float = self._code.rdpi_controller_step(
            self._state, self._parameters, now, ahead, measured
        )
        return found

    def acknowledge(self, written_V: float) -> None:
        self._code.rdpi_controller_acknowledge(self._state, ctypes.c_double(written_V))

    @property
    def flags(self) -> int:
        return int(self._code.rdpi_controller_flags(self._state))
