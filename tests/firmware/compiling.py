"""A program of C, compiled bare and called from Python: what the package writes is tested elsewhere."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rdpi_gym.firmware.program import Program

GCC = shutil.which("gcc")
needs_gcc = pytest.mark.skipif(GCC is None, reason="gcc is not installed")
WARNINGS = [
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Werror",
    # what the package writes only where it is called
    "-Wno-unused-function",
]

_HEAD = """
#include <math.h>
#include <stdint.h>
typedef {real} rdpi_real;
#define RDPI_C(x) {literal}
#define RDPI_OVER(x, d) ((x) / (d))
#define RDPI_INFINITY ((rdpi_real)INFINITY)
#define RDPI_NAN ((rdpi_real)NAN)
#define RDPI_WIDE(x, y) {wide}
{macros}
static inline rdpi_real rdpi_abs(rdpi_real x) {{ return x < RDPI_C(0.0) ? -x : x; }}
static inline int32_t rdpi_is_nan(rdpi_real x) {{ return x != x; }}
static inline rdpi_real rdpi_min(rdpi_real a, rdpi_real b) {{ return b < a ? b : a; }}
static inline rdpi_real rdpi_max(rdpi_real a, rdpi_real b) {{ return b > a ? b : a; }}
static inline int32_t rdpi_min_int(int32_t a, int32_t b) {{ return b < a ? b : a; }}
static inline int32_t rdpi_max_int(int32_t a, int32_t b) {{ return b > a ? b : a; }}
static inline rdpi_real rdpi_copysign(rdpi_real x, rdpi_real s) {{
    return ((x < RDPI_C(0.0)) != (s < RDPI_C(0.0))) ? -x : x;
}}
"""
_FUNCTIONS = "EXP LOG SIN COS TANH POW SQRT EXPM1 LOG1P FLOOR CEIL FMOD ATAN2 ATAN TAN HYPOT ASIN ACOS SINH COSH"


def head(single: bool = False) -> str:
    """Return what the package writer puts before every program, all of it."""
    end = "f" if single else ""
    macros = "\n".join(f"#define RDPI_{each} {each.lower()}{end}" for each in _FUNCTIONS.split())
    macros += f"\n#define RDPI_FABS fabs{end}\n#define RDPI_COPYSIGN copysign{end}"
    return _HEAD.format(
        real="float" if single else "double",
        literal="x##f" if single else "x",
        wide="y" if single else "x",
        macros=macros,
    )


def source(program: Program, single: bool = False) -> str:
    """Return all of the C of one program, with a function ``run_all`` over records."""
    fields = [f"rdpi_real {t.name}[{len(t.values)}];" for t in program.tables] or ["char none;"]
    memory = [f"rdpi_real {m.name}[{len(m.rest)}];" for m in program.memory] or ["char none;"]
    values = (
        ", ".join(
            "{"
            + ", ".join(
                f"RDPI_C({float(x)!r})"
                if np.isfinite(x)
                else ("RDPI_INFINITY" if x > 0 else "-RDPI_INFINITY")
                for x in t.values
            )
            + "}"
            for t in program.tables
        )
        or "0"
    )
    unused = (
        "(void)p; (void)m; (void)reference_um; (void)ahead_um; (void)measured_um; (void)applied_V;"
    )
    begin = getattr(program, "begin", "")
    begins = ""
    if begin:
        begins = (
            "static void rdpi_begin(const rdpi_parameters *p, rdpi_memory *m, rdpi_real reference_um) {\n"
            f"(void)p; (void)m; (void)reference_um;\n{begin}\n}}\n"
        )
    return f"""{head(single)}
typedef struct {{ {" ".join(fields)} }} rdpi_parameters;
typedef struct {{ {" ".join(memory)} }} rdpi_memory;
static const rdpi_parameters own = {{ {values} }};
{program.functions}
static rdpi_real rdpi_run(const rdpi_parameters *p, rdpi_memory *m, rdpi_real reference_um,
                          const rdpi_real *ahead_um, rdpi_real measured_um, rdpi_real applied_V) {{
{unused}
{program.step}
}}
{begins}
void run_all(int32_t samples, const double *reference, const double *measured, double *memory, double rest_V, double *u);
void run_all(int32_t samples, const double *reference, const double *measured, double *memory, double rest_V, double *u) {{
    rdpi_memory m;
    rdpi_real *field = (rdpi_real *)&m, ahead[{max(program.preview, 1)}], last = (rdpi_real)rest_V;
    for (int32_t i = 0; i < {program.memory_numbers}; ++i) field[i] = (rdpi_real)memory[i];
    (void)field;
    {"rdpi_begin(&own, &m, (rdpi_real)reference[0]);" if begin else ""}
    for (int32_t k = 0; k < samples; ++k) {{
        for (int32_t j = 0; j < {program.preview}; ++j) ahead[j] = (rdpi_real)reference[k + 1 + j];
        last = rdpi_run(&own, &m, (rdpi_real)reference[k], ahead, (rdpi_real)measured[k], last);
        u[k] = (double)last;
    }}
}}
"""


def compiled(program: Program, folder: Path, single: bool = False) -> ctypes.CDLL:
    """Return the compiled library of a program."""
    return library(source(program, single), folder, f"program{int(single)}")


def library(text: str, folder: Path, name: str = "text") -> ctypes.CDLL:
    """Return the compiled library of a text of C."""
    assert GCC is not None
    path, made = folder / f"{name}.c", folder / f"{name}.so"
    path.write_text(text)
    command = [GCC, "-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", *WARNINGS]
    done = subprocess.run(
        [*command, str(path), "-o", str(made), "-lm"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[:4000]
    return ctypes.CDLL(str(made))


def answers(
    program: Program,
    reference_um: np.ndarray,
    measured_um: np.ndarray,
    folder: Path,
    single: bool = False,
) -> np.ndarray:
    """Return the commands of the compiled program, lane by lane, ``(T, B)``."""
    found = compiled(program, folder, single)
    numbers = ctypes.POINTER(ctypes.c_double)
    found.run_all.argtypes = [ctypes.c_int32, numbers, numbers, numbers, ctypes.c_double, numbers]
    u = np.empty_like(measured_um)
    for lane in range(measured_um.shape[1]):
        first = reference_um[0, lane]
        memory = np.concatenate(
            [np.zeros(0), *(part.rest + part.by_reference * first for part in program.memory)]
        )
        own, r, y = np.empty(len(u)), reference_um[:, lane].copy(), measured_um[:, lane].copy()
        arrays = [each.ctypes.data_as(numbers) for each in (r, y, memory, own)]
        found.run_all(len(u), *arrays[:3], program.rest_V, arrays[3])
        u[:, lane] = own
    return u
