"""Loading of DATA: a file is one record, a folder of files a data set; published measurements."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from os import PathLike
from pathlib import Path

from rdpi_gym.measurement.binary import read_matlab, read_npz, read_stacked, stacked_tags
from rdpi_gym.measurement.checking import make_record, mask_out
from rdpi_gym.measurement.matlab import MatlabReader
from rdpi_gym.measurement.options import OTHER, UNITS, DataOptions
from rdpi_gym.measurement.quantities import SIDES, Quantities, quantities_of
from rdpi_gym.measurement.record import Dataset, Record, Role
from rdpi_gym.measurement.settings import SETTINGS_FILE, RecordSettings, Settings, read_settings
from rdpi_gym.measurement.table import ENDINGS, READ, TEXTS, Table, ending_of, stem_of
from rdpi_gym.measurement.text import read_text
from rdpi_gym.measurement.units import plain_unit
from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.files import exists
from rdpi_gym.support.words import quoted, some

_ABOUT = ("readme", "license", "licence", "copying", "changelog", "notes")


_SLOW_S, _MANY = 0.05, 1000  # sampling time (s) and samples from which on times may be in ms


def load(path: Path | str | Sequence[Path | str], options: DataOptions | None = None) -> Dataset:
    r"""Read a measurement: one file, or a folder in which every data file is a record.

    Text (``.csv``, ``.txt``, ``.dat``, ``.tsv``, each also ``.gz``), MATLAB (``.mat``, v5 and v7.3) and NumPy
    (``.npz``) files hold ``t`` (s), ``u`` (V), ``y`` (µm) and optionally ``reference`` (µm),
    ``temperature`` (°C) and ``period``. A ``dataset.toml`` in the folder says more; it also holds
    for one file of the folder that is read alone. Validation records are those that it names,
    or whose name begins with ``validation``; with none, those that ``options.validate`` matches;
    else a quarter of each record, in blocks.

    Parameters
    ----------
    path
        File or folder, or several of them, whose records make one data set.
    options
        What the user says; it overrides the ``dataset.toml``.

    Raises
    ------
    InputError
        Whatever is wrong, with file, line and column.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "run.csv"
    ...     _ = path.write_text("u,y\n" + "".join(f"{k},{8 * k}\n" for k in range(40)))
    ...     data = load(path, DataOptions(sampling_time_s=5e-3))
    >>> print(data.describe())
    run.csv
      run (train): 40 samples, 0.005 s apart, t = 0 to 0.195 s
      no validation record: a quarter of each record, in blocks, is held out for validation
      no unit is given for u, y: taken as V, µm; --units u=UNIT,y=UNIT gives others
    """
    options = options or DataOptions()
    paths = [path] if isinstance(path, str | PathLike) else list(path)
    if not paths:
        raise InputError("no path of data is given; give a data file or a folder of data files")
    remarks: list[str] = []
    parts = [_part(each, options, remarks) for each in paths]
    quantities, assumed = _quantities(parts, options)
    records = [record for part in parts for record in part.records(options, quantities)]
    if any(part.has_doubtful_times(options, records) for part in parts):
        assumed = ("t", *assumed)
    names = [record.name for record in records]
    if doubled := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two of the files are record {doubled[0]!r}; rename one")
    if all(record.is_quiet for record in records):
        rest = f" (and in {len(records) - 1} more records)" if len(records) > 1 else ""
        raise InputError(
            f"{parts[0].tables[0].where('u', 0)}: u stays at {records[0].u_V[0]:g} V in all samples{rest}, "
            "so nothing moves the actuator; give a record in which u changes"
        )
    moving = [record.name for record in records if not record.is_quiet]
    said = {name: own for part in parts for name, own in part.settings.records.items()}
    roles = _roles(moving, said, options.validate, remarks)
    return Dataset(
        title=", ".join(dict.fromkeys(part.title for part in parts)),
        records=tuple(replace(r, role=roles.get(r.name, r.role)) for r in records),
        remarks=tuple(remarks),
        quantities=quantities,
        assumed=assumed,
    )


def _quantities(parts: Sequence[_Part], options: DataOptions) -> tuple[Quantities, tuple[str, ...]]:
    """Settle what was measured from all that is said of it, the first file's header the last.

    Returned too are the columns whose unit is said nowhere.
    """
    first = parts[0].tables[0]
    said: dict[str, Mapping[str, str]] = {}
    for part in parts:
        said = {**part.settings.quantities, **said}
    units = parts[0].units(first, options)
    where = str(parts[0].toml) if said else first.at(0)
    unsaid = (c for side, c in SIDES.items() if c not in units and "unit" not in said.get(side, {}))
    return quantities_of(said, units, first.names, where), tuple(unsaid)


@dataclass(frozen=True)
class _Part:
    """Content of one path: tables, settings of its folder, title."""

    tables: list[Table]
    settings: Settings
    title: str
    toml: Path

    def units(self, table: Table, options: DataOptions) -> dict[str, str]:
        """Unit of each column: of the header, the folder, the record, the user, the last that speaks."""
        header = {key: unit for key, unit in table.units.items() if not key.startswith(OTHER)}
        return {**header, **self._stated_units(table, options)}

    def _stated_units(self, table: Table, options: DataOptions) -> dict[str, str]:
        own = self.settings.of(table.stem)
        return {**self.settings.units, **own.units, **options.units}

    def has_doubtful_times(self, options: DataOptions, records: Sequence[Record]) -> bool:
        """True if times without a unit, read as seconds, make a long record of slow samples."""
        slow = {r.name for r in records if r.ts_s >= _SLOW_S and r.t_s.size >= _MANY}
        return any(
            (table.name or table.stem) in slow
            and "t" in table.columns
            and "t" not in self.units(table, options)
            and _sampling_time(table.stem, self.settings, options) is None
            for table in self.tables
        )

    def records(self, options: DataOptions, quantities: Quantities) -> list[Record]:
        """Make records of the tables."""
        return [self._record(table, options, quantities) for table in self.tables]

    def _record(self, table: Table, options: DataOptions, quantities: Quantities) -> Record:
        stem = table.stem
        name, own = table.name or stem, self.settings.of(stem)
        said = self.settings.skip_s if own.skip_s is None else own.skip_s
        record = make_record(
            replace(table, remarks=(*table.remarks, *self._remarks(table, options))),
            name,
            units=self.units(table, options),
            sampling_time_s=_sampling_time(stem, self.settings, options),
            sampling_said=(
                "--sampling-time"
                if options.sampling_time_s is not None
                else f"{self.toml.name}, records.{stem}.ts_s"
            ),
            skip_s=said if options.skip_s is None else options.skip_s,
            note=own.note,
            quantities=quantities,
        )
        if table.settles and record.period is not None:
            record = replace(
                record,
                error_mask=record.error_mask & (record.period > 0),
                remarks=(
                    *record.remarks,
                    "left out of the error, still simulated: the first period",
                ),
            )
        return mask_out(record, own.mask_s, f"{self.toml}: records.{stem}.mask_s")

    def _remarks(self, table: Table, options: DataOptions) -> list[str]:
        said = self._stated_units(table, options)
        found = [
            f"{table.labels[key]} is in {unit}, as its name says"
            for key, unit in table.units.items()
            if key in UNITS and key not in said and UNITS[key].get(plain_unit(unit)) != 1.0
        ]
        others = [key.removeprefix(OTHER) for key in table.columns if key.startswith(OTHER)]
        if others:
            found.append(
                f"the input is {table.labels['u']}; kept beside it: {some(others)} (--input chooses)"
            )
        return found


def _part(path: Path | str, options: DataOptions, remarks: list[str]) -> _Part:
    if not str(path):
        raise InputError(
            "the path of the data is empty; give a data file or a folder of data files"
        )
    source = Path(path)
    if not exists(source):
        raise InputError(f"{source} does not exist; give a data file or a folder of data files")
    if source.is_dir():
        folder, files = source, _data_files(source, remarks)
    else:
        _ending(source)
        folder, files = source.parent, [source]
    settings = Settings()
    toml = folder / SETTINGS_FILE
    if toml.exists():
        siblings = files if source.is_dir() else _data_files(folder, [])
        settings = read_settings(toml, [stem_of(file) for file in siblings])
        if files != siblings:
            remarks.append(f"{toml} holds for this file too")
    with MatlabReader() as matlab:
        tables = [t for file in files for t in _read(file, settings, options, matlab)]
    return _Part(tables, settings, settings.title or printable(source.resolve().name), toml)


def _ending(file: Path) -> str:
    ending = ending_of(file)
    if ending not in ENDINGS:
        raise InputError(
            f"{file}: files that end in {ending or 'nothing'!r} are not read; "
            f"give a folder or one of {READ}"
        )
    if printable(file.name) != file.name:
        raise InputError(f"{file}: the name holds control characters; rename the file")
    return ending


def _data_files(folder: Path, remarks: list[str]) -> list[Path]:
    try:
        listed = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder} cannot be read ({error.strerror})") from error
    files: dict[str, Path] = {}
    for file in listed:
        ending, stem = ending_of(file), stem_of(file)
        if ending not in ENDINGS or file.name.startswith(".") or file.is_dir():
            continue
        if ending.startswith(".txt") and stem.lower().startswith(_ABOUT):
            remarks.append(f"left out: {file.name}, by its name no record")
        elif stem in files:
            raise InputError(f"{file} and {files[stem].name} are both record {stem!r}; rename one")
        else:
            files[stem] = file
    if not files:
        raise InputError(f"{folder}: no data file in this folder; give {READ}")
    return list(files.values())


def _read(
    file: Path, settings: Settings, options: DataOptions, matlab: MatlabReader
) -> list[Table]:
    stem = stem_of(file)
    columns = _columns(stem, settings, options)
    time_s = _sampling_time(stem, settings, options)
    time_needed = columns["t"] != "" if "t" in columns else time_s is None
    ending, separator = _ending(file), settings.of(stem).separator
    if ending in TEXTS:
        return [read_text(file, columns, time_needed=time_needed, separator=separator)]
    if separator:
        raise InputError(
            f"{file.with_name(SETTINGS_FILE)}: records.{stem}.separator is {separator!r}; "
            f"leave it out, {file.name} is no text"
        )
    if ending == ".mat":
        return [read_matlab(file, columns, time_needed=time_needed, reader=matlab)]
    if ending == ".npz" and (tags := stacked_tags(file)):
        return read_stacked(file, tags, columns)
    return [read_npz(file, columns, time_needed=time_needed)]


def _sampling_time(record: str, settings: Settings, options: DataOptions) -> float | None:
    """Sampling time (s) that the user says, or else the folder of this record."""
    if options.sampling_time_s is not None:
        return options.sampling_time_s
    return settings.of(record).ts_s


def _columns(record: str, settings: Settings, options: DataOptions) -> dict[str, str | int]:
    """Return what each column is read from; inputs that are not u keep their names."""
    columns = {**settings.columns, **settings.of(record).columns, **options.columns}
    if options.input is not None:
        columns["u"] = options.input
    elif settings.inputs:
        columns.setdefault("u", settings.inputs[0])
    others = [name for name in settings.inputs if name != columns.get("u")]
    return columns | {OTHER + name: name for name in others}


def _roles(
    names: Sequence[str],
    settings: Mapping[str, RecordSettings],
    pattern: str | None,
    remarks: list[str],
) -> dict[str, Role]:
    """Give every record that moves its role: its name, then PATTERN, then what the folder says."""
    said = {name: own.role for name in names if (own := settings.get(name)) and own.role}
    by_name: dict[str, Role] = {
        name: "validation" if name.lower().startswith("validation") else "train" for name in names
    }
    roles = {**by_name, **said}
    if pattern is None:
        return roles
    named = [name for name in names if by_name[name] == roles[name] == "validation"]
    if named:
        remarks.append(f"--validate {pattern!r} was not needed: {some(named)} is named so")
        return roles
    matched = {name for name in names if fnmatchcase(name, pattern)}
    if not matched:
        raise InputError(
            f"--validate {pattern!r} matches no record with changing u; they are {some(names)}"
        )
    for name in names:
        if name in matched:
            roles[name] = "validation"
        elif roles[name] == "validation":
            roles[name] = "train"
    if changed := [name for name in said if said[name] != roles[name]]:
        remarks.append(f"--validate {pattern!r} overrides {SETTINGS_FILE} for {', '.join(changed)}")
    return roles


DATA_HINT = (
    "The measured data are published: FSM in the GitHub repository merijnfloren/fsm-benchmark-data and "
    "at nonlinearbenchmark.org, the friction damper in ARTS-Laboratory/"
    "Dataset-Friction-Damper-with-Backlash; put a copy into a folder with subfolders fsm and "
    "friction_damper and let the environment variable RDPI_DATA name it"
)
"""Source of the measurements that do not ship, and the variable that names a copy of them."""
_EXAMPLES = Path(__file__).with_name("examples")
EXAMPLES = tuple(sorted(folder.name for folder in _EXAMPLES.iterdir()))
"""Names of the measurements that ship."""


def example_folder(name: str) -> Path:
    """Find the folder of a measurement that ships with the package.

    Parameters
    ----------
    name
        ``picma``: a PICMA P-885.91 stack in a flexure, 1 Hz sines and nested loops, sampled at 200 Hz
        (Y. N. Aye, W. T. Ang, ICSTSD 2018; MIT licence, in the folder).

    Raises
    ------
    InputError
        No measurement of that name ships.

    Examples
    --------
    >>> load(example_folder("picma")).title
    'PICMA P-885.91 stack, 1 Hz, 200 Hz sampling'
    """
    if name not in EXAMPLES:
        raise InputError(f"no example is named {quoted(name)}; there is {', '.join(EXAMPLES)}")
    return _EXAMPLES / name


def measured_data(name: str) -> Path | None:
    """Find the folder of a published measurement.

    Parameters
    ----------
    name
        ``picma``, which ships; ``fsm``, ``friction_damper`` or another folder put beside them.

    Returns
    -------
    Path or None
        The folder of that name in the package, else below the one that the environment variable
        ``RDPI_DATA`` names; None where it is absent (say `DATA_HINT`).

    Examples
    --------
    >>> measured_data("no such measurement") is None
    True
    """
    data = os.environ.get("RDPI_DATA")
    folders = [_EXAMPLES / name, *([Path(data) / name] if data else [])]
    return next((folder for folder in folders if folder.is_dir()), None)
