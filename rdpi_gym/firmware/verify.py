"""An exported folder against Python: its vectors, random records, and inputs that are no numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from rdpi_gym.firmware.compiling import build, compiler, run
from rdpi_gym.firmware.making import package_again
from rdpi_gym.firmware.writing.package import DESCRIPTION, FORMAT, VERSION, Package
from rdpi_gym.firmware.writing.source import Source, header_text, source_text
from rdpi_gym.firmware.writing.templating import template
from rdpi_gym.firmware.writing.vectors import Roundings, Vectors, unit_of, vectors
from rdpi_gym.support.arrays import Array
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_bytes, read_json
from rdpi_gym.support.progress import Progress, silent

_NAMES = {64: "double", 32: "float", 31: "Q31"}
_NUMBER = r"(-?(?:\d+(?:\.\d*)?(?:e[-+]\d+)?|nan|inf))"  # as printf writes one
_AT_ONCE = 1000  # lanes
_LARGEST = 2**26  # bytes of a file of code
_DECIDED = 0.01
"""Share of the records that may part from Python in a precision that is not Python's own."""


@dataclass(frozen=True)
class Row:
    """One comparison.

    Parameters
    ----------
    what
        ``vectors``, ``records`` or ``wild inputs``.
    precision
        ``double``, ``float`` or ``Q31``.
    samples
        How many were compared.
    largest, allowed
        Difference from Python, in strokes (plant) or ranges of the command (controller); of wild
        inputs, how far the answer left the range.
    passed
        Whether the difference is allowed.
    usual
        What is allowed of a program that makes little of roundings.
    parted
        Share of the records in which the difference is larger than allowed.
    """

    what: str
    precision: str
    samples: int
    largest: float
    allowed: float
    passed: bool
    usual: float
    parted: float = 0.0

    @property
    def verdict(self) -> str:
        """The difference in a word.

        ``ok``; ``roundings`` where no more than roundings is seen, but they grow; ``decisions`` where
        a few records part from Python, as a decision hangs on the last bit; ``FAILED``.
        """
        if not self.passed:
            return "FAILED"
        if self.parted:
            return "decisions"
        return "ok" if self.largest <= self.usual else "roundings"


@dataclass(frozen=True)
class Verification:
    """Result of :func:`verify`; it prints as a table.

    Parameters
    ----------
    title
        Of the program that was verified.
    rows
        The comparisons.
    remarks
        Further findings, a sentence each.
    """

    title: str
    rows: tuple[Row, ...]
    remarks: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every comparison did."""
        return all(row.passed for row in self.rows)

    def __str__(self) -> str:
        head = ("", "precision", "samples", "largest difference", "allowed", "")
        cells = [head] + [
            (
                row.what,
                row.precision,
                f"{row.samples:,}",
                f"{row.largest:.2g}",
                f"{row.allowed:.0e}" if row.allowed else "0",
                row.verdict,
            )
            for row in self.rows
        ]
        widths = [max(len(line[k]) for line in cells) for k in range(len(head))]
        lines = [
            "  ".join(
                cell.rjust(width) if k in (2, 3, 4) else cell.ljust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in cells
        ]
        return "\n".join([self.title, *lines, *self.remarks])

    def __repr__(self) -> str:
        return str(self)


def verify(
    folder: Path,
    records: int = 1000,
    samples: int = 1000,
    seed: int = 0,
    progress: Progress | None = None,
) -> Verification:
    """Compile an exported folder's code, run it, and compare with Python.

    The code is run: verify only what you exported, or trust.
    """
    for name, value in {"records": records, "samples": samples}.items():
        if value < 1:
            raise InputError(f"{name} is {value}; give 1 or more")
    if seed < 0:
        raise InputError(f"seed is {seed}; give 0 or above")
    folder = Path(folder).absolute()
    package = package_again(
        read_json(folder / DESCRIPTION, FORMAT, VERSION), str(folder / DESCRIPTION)
    )
    return compare(package, folder, records, samples, seed, progress)


def compare(
    package: Package,
    folder: Path,
    records: int,
    samples: int,
    seed: int,
    progress: Progress | None = None,
) -> Verification:
    """Compare an exported folder's code with what it was made of; see :func:`verify`."""
    say, source = progress or silent, package.source
    needed = (f"{source.name}.h", f"{source.name}.c", "main.c", "rdpi_vectors.h")
    for missing in (name for name in needed if not (folder / name).is_file()):
        raise InputError(f"{folder} has no {missing}; export it anew")
    compiler()
    rows: list[Row] = []
    with TemporaryDirectory(prefix="rdpi-verify-") as made:
        place = Path(made)
        programs = {}
        for done, precision in enumerate(source.precisions):
            say("compiling", done, len(source.precisions))
            programs[precision] = _Program(folder, place, source, precision)
        rows += [each.vectors() for each in programs.values()]
        differences: dict[int, list[Array]] = {precision: [] for precision in programs}
        at, roundings = 0, Roundings(single=source.is_single)
        while at < records:
            say("comparing", at, records)
            lanes = min(_AT_ONCE, records - at)
            expected = vectors(source, samples, lanes, seed * 1000 + at // _AT_ONCE + 1)
            roundings |= Roundings.of(source, expected)
            for precision, program in programs.items():
                differences[precision].append(program.differences(expected))
            at += lanes
        for precision, parts in differences.items():
            each_record = np.concatenate(parts)
            difference = float(each_record.max())
            exact = precision == 64 and source.program.exact
            limit = 0.0 if exact else roundings.allowed[precision]
            name, count = _NAMES[precision], records * samples
            usual = 0.0 if exact else roundings.usual[precision]
            parted = float(np.mean(each_record > limit))
            passed = parted == 0.0 or (precision != 64 and parted <= _DECIDED)
            rows.append(Row("records", name, count, difference, limit, passed, usual, parted))
        say("comparing", records, records)
        rows += [each.wild(min(records, _AT_ONCE), samples, seed) for each in programs.values()]
    remarks = *_parted(rows, records), *_remarks(package, folder, roundings)
    return Verification(_title(source), tuple(rows), remarks)


def _title(source: Source) -> str:
    program = source.program
    unit = "strokes" if program.kind == "plant" else "ranges of the command"
    return f"{program.kind} {program.title}, every {program.ts_s:g} s, against Python, in {unit}"


def _parted(rows: list[Row], records: int) -> Iterator[str]:
    for row in rows:
        if row.verdict == "decisions":
            yield (
                f"In {row.precision} {round(row.parted * records)} of {records:,} records part from Python by more than "
                "allowed: where a decision hangs on the last bit (a command just at its limit, ringing just "
                "heard), it may fall otherwise."
            )


def _remarks(package: Package, folder: Path, roundings: Roundings) -> Iterator[str]:
    source = package.source
    if not source.program.exact:
        yield f"Not bit by bit: {source.program.inexact_because.rstrip('.')}."
    if roundings.warning is not None:
        yield roundings.warning
    for name, text in (
        (f"{source.name}.h", header_text(source)),
        (f"{source.name}.c", source_text(source)),
    ):
        if read_bytes(folder / name, _LARGEST).decode(errors="replace") != text:
            yield f"{name} is not what this release would write: it was changed, or is of another release."


class _Program:
    """The folder's code in one precision, compiled."""

    def __init__(self, folder: Path, place: Path, source: Source, precision: int) -> None:
        self._place, self._source, self._precision = place, source, precision
        code = place / f"{source.name}.c"
        for name in (f"{source.name}.c", f"{source.name}.h", "main.c", "rdpi_vectors.h"):
            (place / name).write_bytes(read_bytes(folder / name, _LARGEST))
        driver = place / "batch.c"
        driver.write_text(
            source.named(template(f"batch_{source.program.kind}.c")), encoding="utf-8"
        )
        self._main = build([code, place / "main.c"], place / f"main_{precision}", precision, place)
        self._batch = build([code, driver], place / f"batch_{precision}", precision, place)

    def vectors(self) -> Row:
        """Run the vectors of the folder."""
        done = run([str(self._main)], self._place)
        pattern = (
            rf"(\d{{1,9}}) vectors: largest difference {_NUMBER} of the \w+ \(allowed {_NUMBER}\)"
        )
        found = re.search(pattern, done.stdout)
        if found is None:
            raise InputError(f"main.c ends with status {done.returncode} and says no result")
        largest, limit = float(found[2]), float(found[3])
        passed = done.returncode == 0 and largest <= limit
        name = _NAMES[self._precision]
        usual = Roundings(single=self._source.is_single).usual[self._precision]
        return Row("vectors", name, int(found[1]), largest, limit, passed, usual)

    def differences(self, expected: Vectors) -> Array:
        """Return the largest difference from Python in each lane, as a fraction, float64[B]."""
        found = self._answers(list(expected.inputs.values()), len(expected.expected), wild=False)
        apart = np.abs(found - expected.expected).max(axis=0) / unit_of(self._source, expected)
        lanes: Array = np.where(np.isfinite(apart), apart, np.inf)
        return lanes

    def wild(self, lanes: int, samples: int, seed: int) -> Row:
        """Let anything come in, and see whether what goes out stays in the range."""
        rng = np.random.default_rng([seed, 7])
        program = self._source.program
        low, high = program.command_range_V
        if program.kind == "plant":
            inputs = [_wild(rng, (samples, lanes), 0.5 * (low + high), high - low, 1)]
        else:
            inputs = [
                _wild(
                    rng,
                    (samples + ahead, lanes),
                    program.centre_um,
                    program.scale_um,
                    program.preview + 2,
                )
                for ahead in (program.preview, 0)
            ]
        found = self._answers(inputs, samples, wild=True)
        what, name = "wild inputs", _NAMES[self._precision]
        if program.kind == "plant":
            out = 0.0 if np.isfinite(found).all() else float("inf")
            return Row(what, name, found.size, out, 0.0, out == 0.0, 0.0)
        if self._precision == 32:  # the ends themselves are rounded
            low, high = float(np.float32(low)), float(np.float32(high))
        if self._precision == 31 and self._source.fixed is not None:
            low, high = self._source.fixed.commands_V(
                [self._source.fixed.low, self._source.fixed.high]
            ).tolist()
        inside = (found >= low) & (found <= high)
        beyond = np.where(np.isfinite(found), np.maximum(low - found, found - high), np.inf)
        out = 0.0 if inside.all() else float(beyond.max() / (high - low))
        return Row(what, name, found.size, out, 0.0, bool(inside.all()), 0.0)

    def _answers(self, inputs: list[Array], samples: int, *, wild: bool) -> Array:
        lanes = inputs[0].shape[1]
        block = np.concatenate(inputs).T  # one lane after the other
        given, taken = self._place / "in", self._place / "out"
        given.write_bytes(np.ascontiguousarray(block).tobytes())
        words = [str(self._batch), str(given), str(taken), str(lanes), str(samples), str(int(wild))]
        done = run(words, self._place)
        if done.returncode:
            raise InputError(
                f"{self._source.name}.c ends with status {done.returncode} in {_NAMES[self._precision]}"
            )
        return np.fromfile(taken).reshape(lanes, samples).T


_STRANGE = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e30, -1e30, 1e7, 5e-324, -0.0)


def _wild(
    rng: np.random.Generator, shape: tuple[int, int], centre: float, scale: float, window: int
) -> Array:
    """Return signals (µm or V), most of them far beyond what is reached, some of them no numbers.

    So few of them that about half of all steps, which look at a window of samples, are computed.
    """
    found = centre + scale * rng.standard_normal(shape) * 10.0 ** rng.integers(-3, 3, shape)
    return np.where(rng.random(shape) < 0.5 / window, rng.choice(_STRANGE, shape), found)
