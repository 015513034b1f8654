"""A program as an FMU for co-simulation: its C, compiled and as sources, in one deterministic archive."""

from __future__ import annotations

import hashlib
import platform
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import get_args

from rdpi_gym.firmware.compiling import STRICT, compiler, run
from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.writing.fmu_description import (
    FmiVersion,
    build_description,
    model_description,
    model_identifier,
    variables,
)
from rdpi_gym.firmware.writing.templating import filled, template
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic
from rdpi_gym.support.words import quoted

# Of a zip archive: the date of every file in it, so that archives are equal.
_EARLIEST = (1980, 1, 1, 0, 0, 0)


def write_fmu(
    program: Program, sources: Mapping[str, str], out: Path, fmi: FmiVersion = "3.0"
) -> Path:
    """Write an FMU for co-simulation, compiled for this machine, with the sources for others.

    Every communication step is a whole multiple of the sampling time; inputs are held for it, and the
    outputs after it are those of its last sample. Two archives of one program are equal byte by byte
    where the compiler is the same.
    """
    if fmi not in get_args(FmiVersion):
        raise InputError(f"FMI {quoted(fmi)} is not written; choose 2.0 or 3.0")
    texts, token = fmu_sources(program, sources, fmi)
    units = [name for name in texts if name.endswith(".c")]
    folder, suffix = binary_place(fmi)
    tool = f"rdpi-gym {version('rdpi-gym')}"
    files = {
        "modelDescription.xml": model_description(program, fmi, token, units, tool),
        f"binaries/{folder}/{model_identifier(program)}{suffix}": _compiled(texts, units, suffix),
        **{f"sources/{name}": text.encode() for name, text in texts.items()},
    }
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = build_description(program, units)
    return write_atomic(out, _archive(files))


def fmu_sources(
    program: Program, sources: Mapping[str, str], fmi: FmiVersion = "3.0"
) -> tuple[dict[str, str], str]:
    """Return the files that an FMU is compiled from, by name, and the token that stands for them."""
    kind = program.kind
    texts = {name: sources[name] for name in (f"rdpi_{kind}.c", f"rdpi_{kind}.h")}
    own = f"rdpi_fmi{fmi[0]}"
    for name in (f"{own}.c", f"{own}.h", "rdpi_fmu.h", f"rdpi_fmu_{kind}.h"):
        texts[name] = template(f"fmu/{name}")
    inputs = [one for one in variables(program) if one.causality == "input"]
    values = {
        "KIND": kind,
        "INPUTS": str(len(inputs)),
        "TS": repr(float(program.ts_s)),
        "REST": repr(float(program.rest_V)),
        "START": repr(inputs[0].start),
    }
    model = template("fmu/rdpi_fmu_model.h")
    content = [*texts.items(), ("", filled(model, frozenset(), TOKEN="", **values))]
    digest = hashlib.sha256(repr(content).encode()).digest()
    token = f"{{{uuid.UUID(bytes=digest[:16])}}}"
    texts["rdpi_fmu_model.h"] = filled(model, frozenset(), TOKEN=token, **values)
    return texts, token


def binary_place(
    fmi: FmiVersion, system: str = sys.platform, machine: str | None = None, bits: int | None = None
) -> tuple[str, str]:
    """Return the folder of a machine's binaries, in ``binaries/``, and the ending of their names."""
    name = (platform.machine() if machine is None else machine).lower()
    wide = sys.maxsize > 2**32 if bits is None else bits == 64
    systems = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}
    intel = {"amd64", "x86_64", "x86", "i386", "i586", "i686"}
    if system not in systems or name not in {*intel, "arm64", "aarch64"}:
        raise InputError(f"FMI has no name for binaries of {system} on {name}; use the C instead")
    short, suffix = systems[system]
    if fmi == "2.0":
        return f"{short}{64 if wide else 32}", suffix
    architecture = ("x86_64" if wide else "x86") if name in intel else "aarch64"
    return f"{architecture}-{'windows' if short == 'win' else short}", suffix


def _compiled(texts: Mapping[str, str], units: Sequence[str], suffix: str) -> bytes:
    """Return the shared library of some files of C."""
    words = compiler()
    with tempfile.TemporaryDirectory(prefix="rdpi-fmu-") as name:
        folder = Path(name)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8", newline="\n")
        library = f"model{suffix}"
        own = {
            ".so": [
                "-fPIC",
                "-Wl,-z,defs",
            ],  # a name that nothing defines is an error here, not later
            ".dylib": ["-fPIC"],
            ".dll": ["-static-libgcc"],  # the compiler's own library is on no other machine
        }[suffix]
        done = run(
            [*words, *STRICT, *own, "-fvisibility=hidden", "-shared", *units, "-o", library, "-lm"],
            folder,
        )
        if done.returncode:
            lines = [x for x in done.stderr.splitlines() if "error" in x or "undefined" in x]
            said = lines[0].strip() if lines else f"exit status {done.returncode}"
            raise InputError(f"{words[0]} refuses the code of the FMU: {said}")
        return (folder / library).read_bytes()


def _archive(files: Mapping[str, bytes]) -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, _EARLIEST)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = (
                3  # of Unix, whose rights are the next line's, wherever it is written
            )
            entry.external_attr = (0o100755 if name.startswith("binaries/") else 0o100644) << 16
            archive.writestr(entry, content)
    return stream.getvalue()
