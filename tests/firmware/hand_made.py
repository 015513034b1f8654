"""Programs written by hand, with a twin in numpy, and their code loaded into this process."""

import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from rdpi_gym.firmware.program import Memory, Program, Table
from rdpi_gym.firmware.writing.source import Source, header_text, source_text

STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]  # fmt: skip
COMPILERS = [
    pytest.param(name, marks=pytest.mark.skipif(not shutil.which(name), reason=f"no {name} here"))
    for name in ("gcc", "clang")
]
needs_compiler = pytest.mark.skipif(
    not (shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")), reason="no C compiler"
)
needs_gcc = pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc here")


class Integral:
    """u(k+1) = 0.5 r(k+1) + sum of 0.25 (r - y), between -25 and 25 V."""

    def controller(self, reference_um, measured_um):
        total = reference_um[0].copy()
        u = np.empty_like(measured_um)
        for k, measured in enumerate(measured_um):
            total = total + 0.25 * (reference_um[k] - measured)
            u[k] = np.clip(0.5 * reference_um[k + 1] + total, -25.0, 25.0)
        return u

    def plant(self, command_V):
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
    Integral(),
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
    Integral(),
)  # fmt: skip
# Asks for everything that the writer has.
GREEDY = replace(
    CONTROLLER,
    tables=[],
    memory=[],
    step="rdpi_real x = rdpi_copysign(rdpi_abs(RDPI_OVER(ahead_um[0], RDPI_C(3.0))), measured_um);\n"
    "const int32_t n = rdpi_min_int(rdpi_max_int(1, 2), 3);\n"
    "x += RDPI_EXP(RDPI_LOG(RDPI_C(1.5))) + RDPI_SIN(x) + RDPI_COS(x) + RDPI_TANH(x) + RDPI_POW(RDPI_C(2.0), x);\n"
    "x += RDPI_SQRT(RDPI_C(2.0)) + RDPI_EXPM1(x) + RDPI_LOG1P(RDPI_FABS(x)) + RDPI_FLOOR(x) + RDPI_CEIL(x);\n"
    "x += RDPI_FMOD(x, RDPI_C(2.0)) + RDPI_COPYSIGN(x, x) + RDPI_MIN(x, RDPI_INFINITY) + (rdpi_real)n + applied_V;\n"
    "return RDPI_ISNAN(x) ? RDPI_NAN : RDPI_MAX(RDPI_C(-25.0), RDPI_C(1e-300));",
)


def write(program, folder, **parts):
    """Write header and source, and return the source's path."""
    source = Source(program, **parts)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{source.name}.h").write_text(header_text(source), encoding="ascii")
    path = folder / f"{source.name}.c"
    path.write_text(source_text(source), encoding="ascii")
    return path


def compiles(compiler, path, precision, *flags):
    """Compile strictly, and return what the compiler says; nothing where all is well."""
    words = [compiler, *STRICT, *flags, f"-DRDPI_PRECISION={precision}", f"-I{path.parent}"]
    done = subprocess.run(
        [*words, "-c", str(path), "-o", str(path.with_suffix(".o"))],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stderr


class Running:
    """Code of this process: a controller, in double."""

    def __init__(self, path, first_um=0.0):
        library = path.with_suffix(".so")
        flags = ["-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
        subprocess.run(["gcc", *flags, str(path), "-o", str(library), "-lm"], check=True)
        self._code = ctypes.CDLL(str(library))
        self._code.rdpi_controller_step.restype = ctypes.c_double
        self._code.rdpi_controller_flags.restype = ctypes.c_uint8
        self._parameters = ctypes.addressof(
            ctypes.c_char.in_dll(self._code, "rdpi_controller_default")
        )
        self._state = ctypes.create_string_buffer(4096)
        self._code.rdpi_controller_init(
            self._state, ctypes.c_void_p(self._parameters), ctypes.c_double(first_um)
        )

    def step(self, reference_um, ahead_um, measured_um):
        ahead = (ctypes.c_double * len(ahead_um))(*ahead_um)
        return self._code.rdpi_controller_step(
            self._state, ctypes.c_void_p(self._parameters), ctypes.c_double(reference_um), ahead,
            ctypes.c_double(measured_um),
        )  # fmt: skip

    def acknowledge(self, written_V):
        self._code.rdpi_controller_acknowledge(self._state, ctypes.c_double(written_V))

    @property
    def flags(self):
        return self._code.rdpi_controller_flags(self._state)
