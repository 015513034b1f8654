"""`export_c`, `export_fmu`, `verify`: plants and controllers as C, and whether it does what Python does."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

from rdpi_gym.face.catalogues import HasPlant, as_plant
from rdpi_gym.firmware import verify as verifying
from rdpi_gym.firmware.making import package_of
from rdpi_gym.firmware.verify import Verification
from rdpi_gym.firmware.writing.fmu import write_fmu
from rdpi_gym.firmware.writing.package import check_out, write_package
from rdpi_gym.firmware.writing.source import header_text, source_text
from rdpi_gym.plant import PlantModel
from rdpi_gym.support.checks import checked
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.progress import Progress

TS_S = 5e-5
"""Sampling time (s) where none is asked for."""


@dataclass(frozen=True)
class Exported:
    """Files of an export.

    Parameters
    ----------
    path
        The folder of C, or the FMU.
    what
        What it is, in words.
    warnings
        What to beware of, a sentence each.
    """

    path: Path
    what: str
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join([f"{self.what}: {self.path}", *self.warnings])


@checked
def export_c(
    model: PlantModel | HasPlant | PathLike[str] | str,
    out: PathLike[str] | str = "firmware",
    *,
    controller: str | None = None,
    ts_s: float = TS_S,
    preview: int | None = None,
    prefix: str | None = None,
) -> Exported:
    """Write a controller, or a plant, as a folder of C99: no allocation, no libraries, tested by vectors.

    Parameters
    ----------
    model
        A plant, a result that has one, the path of a plant file, or a name of
        :data:`rdpi_gym.plants`.
    out
        Folder that is written; one that an earlier export wrote is replaced.
    controller
        A name of :data:`rdpi_gym.controllers` that believes in the plant, or ``learned:`` and a
        policy; None: the plant itself, for hardware in the loop. As in :func:`track`, the rate of
        the belief has a cut-off of 800 Hz at most.
    ts_s
        Sampling time (s).
    preview
        Samples of the reference after r(k) that a step is given; by default as many as the
        controller makes use of.
    prefix
        Of files and identifiers, so that several exports link into one program; by default
        ``rdpi_controller`` or ``rdpi_plant``.

    Returns
    -------
    Exported
        It prints the folder, and what to beware of.

    Raises
    ------
    InputError
        No such plant or controller, a controller that is not causal, an effect without C, a prefix
        that is no identifier of C, a folder that holds something else. Nothing is written then.

    Examples
    --------
    >>> import tempfile
    >>> import rdpi_gym as rg
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = rg.export_c("P5", folder, controller="classical-static", ts_s=1e-4)
    ...     (done.path / "rdpi_controller.c").exists()
    True
    """
    folder = Path(out)
    check_out(folder)
    package = package_of(as_plant(model), ts_s, controller, preview, prefix)
    program = package.source.program
    written = write_package(package, folder)
    return Exported(written, f"{program.kind} {program.title} as C", package.warnings)


@checked
def export_fmu(
    model: PlantModel | HasPlant | PathLike[str] | str,
    out: PathLike[str] | str = "stage.fmu",
    *,
    controller: str | None = None,
    ts_s: float = TS_S,
    preview: int | None = None,
    fmi: Literal["2", "3"] = "3",
) -> Exported:
    """Write a plant, or a controller, as an FMU for co-simulation, compiled from the same C.

    Parameters
    ----------
    model, controller, ts_s, preview
        As :func:`export_c`.
    out
        File that is written, ``.fmu``.
    fmi
        Version of the standard.

    Returns
    -------
    Exported
        It prints the file, and what to beware of.

    Raises
    ------
    InputError
        As :func:`export_c`; there is no C compiler, or the file has another ending.
    """
    path = Path(out)
    if path.suffix != ".fmu" or path.is_dir():
        raise InputError(f"{path} is no file to export to; give one that ends in .fmu")
    package = package_of(as_plant(model), ts_s, controller, preview)
    source = package.source
    texts = {f"{source.name}.h": header_text(source), f"{source.name}.c": source_text(source)}
    written = write_fmu(source.program, texts, path, "2.0" if fmi == "2" else "3.0")
    what = f"{source.program.kind} {source.program.title} as an FMU"
    return Exported(written, what, package.warnings)


@checked
def verify(
    folder: PathLike[str] | str,
    *,
    records: int = 1000,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Verification:
    """Compile what :func:`export_c` wrote, run it, and compare it with Python.

    The folder's code is run on this machine: verify what you exported yourself, or trust.

    Parameters
    ----------
    folder
        The folder.
    records, samples
        Random records, and samples of each.
    seed
        Of the records.
    progress
        Called as ``progress(stage, done, total)``.

    Returns
    -------
    rdpi_gym.firmware.verify.Verification
        It prints a table; ``passed`` says whether all is well.

    Raises
    ------
    InputError
        No export, no C compiler, code that does not compile or does not run.
    """
    return verifying.verify(Path(folder), records, samples, seed, progress)
