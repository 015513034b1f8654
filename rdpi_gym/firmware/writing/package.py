"""The folder that an export writes: code, vectors that test it, examples, a page to read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rdpi_gym.firmware.program import Program
from rdpi_gym.firmware.writing.manual import manual_text
from rdpi_gym.firmware.writing.source import Source, header_text, safe, source_text
from rdpi_gym.firmware.writing.templating import filled, template
from rdpi_gym.firmware.writing.vectors import SAMPLES, Roundings, vectors, vectors_text
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, replaced_folder, write_atomic, write_json
from rdpi_gym.support.words import some


def sfunction_text(program: Program) -> str:
    """Return ``rdpi_controller_sfunction.c`` or ``rdpi_plant_sfunction.c``, to be compiled with ``mex``."""
    if program.kind == "plant":
        return filled(template("sfunction_plant.c"), WHAT=f"Plant {safe(program.model)}")
    what = f"Controller {safe(program.title)} for plant {safe(program.model)}"
    return filled(template("sfunction_controller.c"), WHAT=what, PREVIEW=str(program.preview))


FORMAT, VERSION = "rdpi-firmware", 1
DESCRIPTION = "program.json"
BUILD, EXAMPLES = "build", "examples"
"""Folders: of what the Makefile makes, which an export that replaces another takes away; of loops."""


@dataclass(frozen=True)
class Package:
    """All that a folder is written from."""

    source: Source
    recipe: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def files(self) -> dict[str, str]:
        """Return the texts by their names in the folder, ``program.json`` left out."""
        source = self.source
        made = vectors(source)
        roundings = Roundings.of(source, made)
        name, kind = source.name, source.program.kind
        values = {
            "NAME": name,
            "KIND": kind,
            "UPPER": name.upper(),
            "TITLE": safe(source.program.title),
            "PRECISIONS": " ".join(map(str, source.precisions)),
            "MATH": " -lm" if source.has_mathematics else "",
            "MATH_LIBRARY": "m" if source.has_mathematics else "",
            "SAMPLES": str(SAMPLES),
            **{f"ALLOWED_{_WORDS[p]}": f"{each:.0e}" for p, each in roundings.allowed.items()},
            "CENTRE": repr(float(source.program.centre_um)),
            "THIRD": repr(float(source.program.scale_um / 3.0)),
        }
        parts = frozenset({"FIXED"} if source.fixed is not None else set())
        c_files = {"main.c": f"main_{kind}.c", f"{EXAMPLES}/timer_interrupt.c": f"timer_{kind}.c",
                   f"{EXAMPLES}/desktop.c": f"desktop_{kind}.c", "Makefile": "Makefile",
                   "CMakeLists.txt": "CMakeLists.txt"}  # fmt: skip
        texts = {
            f"{name}.h": header_text(source),
            f"{name}.c": source_text(source),
            f"{name}_sfunction.c": sfunction_text(source.program),
            "rdpi_vectors.h": vectors_text(source, made),
            **{
                to: filled(template(f"package/{of}"), parts, **values) for to, of in c_files.items()
            },
        }
        code = texts[f"{name}.h"] + texts[f"{name}.c"]
        texts["README.md"] = manual_text(source, code, (*self.warnings, *self.notes), roundings)
        return texts


def write_package(package: Package, out: Path) -> Path:
    """Write the folder, whole or not at all."""
    texts = package.files()
    known = {DESCRIPTION, BUILD, *texts, *_OTHER}
    check_out(out, known)
    with replaced_folder(out) as fresh:
        for name, text in texts.items():
            write_atomic(fresh / name, text)
        write_json(fresh / DESCRIPTION, {"format": FORMAT, "version": VERSION, **package.recipe})
    return out


_WORDS = {64: "DOUBLE", 32: "FLOAT", 31: "WHOLE"}
_OTHER = tuple(
    f"rdpi_{kind}{end}" for kind in ("controller", "plant") for end in (".h", ".c", "_sfunction.c")
)


def check_out(out: Path, known: set[str] | None = None) -> None:
    """Refuse a folder that an export may not replace, before anything is computed."""
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out} is a file; name a folder for the export")
    if not any(out.iterdir()):
        return
    try:
        read_json(out / DESCRIPTION, FORMAT, VERSION)
    except InputError:
        raise InputError(
            f"{out} holds files and no export of C; name a new folder, or an empty one"
        ) from None
    if known is not None:
        places = (path.relative_to(out) for path in sorted(out.rglob("*")) if not path.is_dir())
        others = [str(p) for p in places if p.as_posix() not in known and p.parts[0] != BUILD]
        if others:
            raise InputError(
                f"{out} holds {some(others)} beside an export, which would be lost; name another folder"
            )
