"""Files that are brought: names, what is refused and where, what is said of them."""

import math
import tomllib

import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory import data_import
from tests.looping import over


def csv(slope=8.0, bad=None, still=False):
    rows = [f"{k * 0.01:g},{0 if still else 10 * math.sin(k / 9):.6g}" for k in range(200)]
    lines = [f"{row},{slope * float(row.split(',')[1]):.6g}" for row in rows]
    if bad is not None:
        lines[bad - 2] = "0.1,volts,3"
    return "\n".join(["t,u,y", *lines]) + "\n"


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "data"
    made.mkdir()
    return made


@over(
    "sent, kept",
    [
        ("../../etc/run.csv", "run.csv"),
        ("C:\\lab\\run 1.MAT", "run 1.MAT"),
        (".run.npz", "run.npz"),
        ("a\x00b\n.csv", "ab.csv"),
        ("dataset.toml", "dataset.toml"),
    ],
)
def test_of_a_name_that_is_sent_a_plain_one_is_left(sent, kept):
    assert data_import.safe_name(sent) == kept


@over("sent", ["", "run", "run.csv/", "report.pdf", "x.csv.exe"])
def test_what_is_no_data_file_is_refused_in_a_line(sent):
    with pytest.raises(rg.InputError, match=r"are not read; give \.csv, "):
        data_import.safe_name(sent)


def test_a_bad_file_is_named_with_line_and_column_and_spoils_no_other(folder):
    (folder / "good.csv").write_text(csv())
    (folder / "rest.csv").write_text(csv(still=True))  # alone it is refused: nothing moves
    (folder / "bad.csv").write_text(csv(bad=7))
    found = data_import.read(folder)
    assert {r.name for r in found.data.records} == {"good", "rest"}
    problem = found.problems["bad.csv"]
    assert (problem.row, problem.column) == (7, "u")
    assert problem.line.startswith("bad.csv, line 7, column u: ")
    (folder / "bad.csv").write_text(csv())  # sent again, and right
    data_import.refused_file(folder, "bad.csv").unlink()
    assert {r.name for r in data_import.read(folder).data.records} == {"good", "rest", "bad"}


def test_a_file_that_was_refused_is_tried_again_with_other_settings(folder):
    (folder / "run.csv").write_text(csv())
    (folder / "kilo.csv").write_text(csv().replace("t,u,y", "t,volts,y"))
    assert list(data_import.read(folder).problems) == ["kilo.csv"]
    change = {"columns": {"u": "volts"}, "units": {"u": "kV"}}
    data_import.write_settings(folder, {"records": {"kilo": change}}, ["run"])
    kilo, run = data_import.read(folder).data.records
    assert kilo.u_V.max() == pytest.approx(1e3 * run.u_V.max())


def test_what_is_said_of_a_refused_file_goes_with_it(folder):
    (folder / "run.csv").write_text(csv())
    (folder / "late.csv").write_text(csv(bad=7))
    said = {"run": {"role": "test"}, "late": {"note": "lid open", "units": {"y": "nm"}}}
    data_import.write_settings(folder, {"records": said}, ["run", "late"])
    assert [r.role for r in data_import.read(folder).data.records] == ["test"]
    assert rg.load(folder).records[0].name == "run"  # its settings name no record that is absent
    assert data_import.record_settings(folder, "late") == said["late"]
    data_import.write_settings(
        folder, {"records": {"late": {"units": {"t": "ms", "y": None}}}}, ["run"]
    )
    assert data_import.record_settings(folder, "late")["units"] == {"t": "ms"}
    assert list(data_import.read(folder).problems) == ["late.csv"]
    data_import.refused_file(folder, "late.csv").write_text(csv())  # mended
    assert {r.note for r in data_import.read(folder).data.records} == {"", "lid open"}
    (folder / "late.csv").write_text(csv(bad=7))
    data_import.read(folder)
    data_import.refused_file(folder, "late.csv").unlink()  # discarded
    assert data_import.read(folder).problems == {}
    assert data_import.record_settings(folder, "late") == {}


def test_settings_of_the_page_are_those_of_dataset_toml(folder):
    (folder / "run.csv").write_text(csv())
    (folder / "late run.csv").write_text(csv(7.9))
    changes = {
        "records": {"late run": {"role": "validation", "masked_s": [[0.5, 0.7]]}, "run": {"skip_s": 0.2, "units": {"y": "nm"}}},
    }  # fmt: skip
    data_import.write_settings(folder, changes, ["run", "late run"])
    data = data_import.read(folder).data
    late, run = sorted(data.records, key=lambda r: r.name)
    assert (late.role, run.role) == ("validation", "train")
    assert (late.error_mask.sum(), run.error_mask.sum()) == (179, 180)
    assert run.y_um.max() == pytest.approx(0.08, rel=1e-2)
    data_import.write_settings(
        folder, {"records": {"run": {"role": "unused"}}}, ["run", "late run"]
    )
    said = tomllib.loads((folder / "dataset.toml").read_text())
    assert said["records"]["run"] == {"skip_s": 0.2, "role": "test", "units": {"y": "nm"}}


@over(
    "changes, line",
    [
        ({"records": {"rum": {}}}, "records: 'rum' is unknown (did you mean 'run'?)"),
        (
            {"records": {"run": {"role": "judge"}}},
            "role is 'judge'; expected one of 'train', 'validation', 'test'",
        ),
        ({"records": {"run": {"colour": 1}}}, "records.run: 'colour' is unknown (did you mean"),
        ({"records": {"run": {"units": {"t": "fortnights"}}}}, "unit 'fortnights' of t is unknown"),
        ({"records": {"run": {"columns": {"u": 1, "y": 1}}}}, "u and y both name column 1"),
        ({"records": {"run": {"columns": {"u": "a\x7f"}}}}, "not TOML"),
        (
            {"records": {"run": {"separator": ";"}}},
            "separator is ';'; expected one of '', 'comma', 'semicolon'",
        ),
        ({"records": {"run": {"ts_s": -1}}}, "ts_s is -1; give seconds above 0"),
        ({"records": [1]}, "records is [1]; give an object"),
        ({"colour": 1}, "'colour' is unknown; give records"),
    ],
)
def test_a_setting_that_there_is_not_is_refused_and_nothing_written(folder, changes, line):
    with pytest.raises(rg.InputError) as refused:
        data_import.write_settings(folder, changes, ["run"])
    assert line in str(refused.value)
    assert not (folder / "dataset.toml").exists()


def test_of_a_file_that_is_copied_alone_only_its_own_settings_come_along(folder, tmp_path):
    source = tmp_path / "rig"
    source.mkdir()
    for name in ("run", "other"):
        (source / f"{name}.csv").write_text(csv())
    (source / "dataset.toml").write_text('title = "rig"\n[records.other]\nrole = "validation"\n')
    assert data_import.copy_in(source / "run.csv", folder) == ["run.csv"]
    assert data_import.read(folder).data.title == "rig"
    assert sorted(f.name for f in folder.iterdir()) == ["dataset.toml", "run.csv"]


def test_a_refused_file_is_not_told_of_options_that_the_laboratory_lacks(folder):
    rows = csv().splitlines()[1:]
    (folder / "named.csv").write_text("\n".join(["when,volts,x", *rows]))
    (folder / "bare.csv").write_text("\n".join(rows))
    (folder / "twice.csv").write_text("\n".join(["u,y", *(row.partition(",")[2] for row in rows)]))
    problems = data_import.read(folder).problems
    assert set(problems) == {"named.csv", "bare.csv", "twice.csv"}
    for name, problem in problems.items():
        with pytest.raises(rg.InputError) as refused:  # a command has them
            rg.load(folder / name)
        assert "--columns" in str(refused.value)
        assert "--" not in problem.line
        assert str(refused.value).startswith(f"{folder / problem.line}; ")


def test_settings_of_refused_files_survive_another_that_is_discarded(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    rows = "".join(f"{k},{k % 9},{k}\n" for k in range(40))
    (folder / "good.csv").write_text("t,u,y\n" + rows)
    for name in ("one", "other"):
        (folder / f"{name}.csv").write_text("a,b,c\n" + rows)
    separators = {name: {"separator": "comma"} for name in ("one", "other")}
    data_import.write_settings(folder, {"records": separators}, ["good", "one", "other"])
    assert set(data_import.read(folder).problems) == {"one.csv", "other.csv"}
    data_import.refused_file(folder, "one.csv").unlink()
    assert data_import.record_settings(folder, "other") == {"separator": "comma"}
    assert set(data_import.read(folder).problems) == {"other.csv"}
    assert data_import.record_settings(folder, "other") == {"separator": "comma"}
