"""`dataset.toml`: what it says holds, what it says wrongly is named."""

from __future__ import annotations

import numpy as np
import pytest

from rdpi_gym.measurement import DataOptions, load
from tests.looping import over


@pytest.fixture
def folder(tmp_path, write, sine_lines):
    for name, start_s in (("one", 0.0), ("two", 10.0), ("validation", 20.0)):
        write(f"{name}.csv", "\n".join(sine_lines(start_s=start_s)))
    return tmp_path


def test_everything_that_it_may_say(folder, write) -> None:
    text = (folder / "one.csv").read_text().replace("t,u,y", "time,u,y")
    write("one.csv", text)
    for name in ("two", "validation"):
        write(f"{name}.csv", (folder / f"{name}.csv").read_text().replace("t,u,y", "time,u,y"))
    write(
        "dataset.toml",
        """\
        title = "three runs"
        skip_s = 0.1
        [columns]
        t = "time"
        [units]
        y = "nm"
        [records.one]
        role = "test"
        skip_s = 0.2
        note = "door was open"
        [records.two]
        role = "validation"
        mask_s = [[10.2, 10.3], [10.5, 10.52]]
        """,
    )
    data = load(folder)
    one, two, validation = data.records
    assert data.title == "three runs"
    assert [r.role for r in data.records] == ["test", "validation", "validation"]
    assert [r.name for r in data.test] == ["one"]
    assert (one.note, two.note) == ("door was open", "")
    np.testing.assert_allclose([one.t_s[0], two.t_s[0], validation.t_s[0]], [0.2, 10.1, 20.1])
    np.testing.assert_allclose(one.y_um, 8e-3 * one.u_V, atol=1e-8)
    # both ends of a stretch are masked: 10.20 to 10.30 s and 10.50 to 10.52 s at 50 Hz
    left_out = two.t_s[~two.error_mask]
    np.testing.assert_allclose(left_out, [*np.arange(10.2, 10.31, 0.02), 10.5, 10.52])
    assert one.error_mask.all()
    told = data.describe()
    for sentence in (
        "three runs",
        "one (test): 30 samples, 0.02 s apart, t = 0.2 to 0.78 s",
        "left out: the first 0.2 s (10 samples)",
        "left out: the first 0.1 s (5 samples)",
        "left out of the error, still simulated: 10.2 to 10.3 s (6 samples)",
        "left out of the error, still simulated: 10.5 to 10.52 s (2 samples)",
        "note: door was open",
    ):
        assert sentence in told


def test_the_command_line_overrides_it(folder, write) -> None:
    write(
        "dataset.toml",
        'skip_s = 0.1\n[units]\ny = "nm"\n[columns]\ny = "u"\n[records.one]\nskip_s = 0.3\n',
    )
    data = load(folder, DataOptions(columns={"y": "y"}, units={"y": "mm"}, skip_s=0.0))
    assert [r.t_s.size for r in data.records] == [40, 40, 40]
    np.testing.assert_allclose(data.records[0].y_um, 8e3 * data.records[0].u_V, atol=1e-2)


def test_it_holds_for_one_file_of_its_folder(folder, write) -> None:
    write(
        "dataset.toml",
        'skip_s = 0.1\n[units]\ny = "nm"\n[records.two]\nrole = "test"\nmask_s = [[10.2, 10.3]]\n',
    )
    data = load(folder / "two.csv")
    (two,) = data.records
    assert (two.role, two.t_s.size, int(two.error_mask.sum())) == ("test", 35, 29)
    assert f"{folder / 'dataset.toml'} holds for this file too" in data.describe()


def test_a_mask_before_what_was_kept_is_no_mistake(folder, write) -> None:
    write("dataset.toml", "[records.one]\nmask_s = [[0.0, 0.1]]\n")
    one = load(folder, DataOptions(skip_s=0.2)).records[0]
    assert one.error_mask.all()
    assert one.remarks[-1].endswith("0 to 0.1 s (0 samples)")


@over(
    "text, message",
    [
        ("titel = 'x'", "'titel' is unknown (did you mean 'title'?); known are title, skip_s"),
        ("sampling_time_s = 1", "'sampling_time_s' is unknown; known are"),
        ("inputs = ['u']", "'inputs' is unknown"),
        ("[unit]\ny = 'm'", "'unit' is unknown (did you mean 'units'?)"),
        ("[columns]\nv = 'u'", "columns: 'v' is unknown"),
        ("[columns]\nu = ''", "columns: u = ''; give a header name or a position"),
        ("[columns]\nu = -1", "columns: u = -1; give a header name or a position"),
        ("[columns]\nu = true", "columns.u is True; expected text or a whole number"),
        ("[columns]\nu = 'a'\ny = 'a'", "columns: u and y both name column a"),
        ("[units]\nz = 'm'", "units: 'z' is unknown"),
        ("[units]\ny = 'inch'", "units: unit 'inch' of y is unknown; known are m, mm, um, nm"),
        ("[units]\ny = 3", "units.y is 3; expected text"),
        (
            "[records.tow]",
            "records: 'tow' is unknown (did you mean 'two'?); known are one, two, validation",
        ),
        ("[records.one]\nroles = 'test'", "records.one: 'roles' is unknown (did you mean"),
        (
            "[records.one]\nrole = 'learn'",
            "records.one.role is 'learn'; expected one of 'train', 'v",
        ),
        ("[records.one]\nskip_s = -1", "records.one: skip_s is -1.0; give seconds, 0 or above"),
        ("[records.one]\nskip_s = '1'", "records.one.skip_s is '1'; expected a number"),
        ("[records.one]\nts_s = 0", "records.one: ts_s is 0; give seconds above 0, as in"),
        ("[records.one]\nts_s = inf", "records.one: ts_s is inf; give seconds above 0, as in"),
        ("[records.one]\nts_s = 'x'", "records.one.ts_s is 'x'; expected a number"),
        ("[records.one]\nnote = 1", "records.one.note is 1; expected text"),
        (
            "[records.one]\nseparator = ';'",
            "records.one.separator is ';'; expected one of '', 'comm",
        ),
        ("[records.one]\nseparator = [1]", "records.one.separator is [1]; expected one of"),
        ("[records.one.columns]\nv = 'u'", "records.one: columns: 'v' is unknown"),
        ("[records.one.columns]\nt = ['u']", "records.one.columns.t is ['u']; expected text or"),
        ("[records.one]\ncolumns = 'u'", "records.one.columns is 'u'; expected an object"),
        ("[records.one.units]\ny = 'inch'", "records.one: units: unit 'inch' of y is unknown"),
        ("[records.one]\nmask_s = [1, 2]", "records.one.mask_s[0] is 1; expected a list of 2"),
        ("[records.one]\nmask_s = 3", "records.one.mask_s is 3; expected a list"),
        ("[records.one]\nmask_s = [[2, 1]]", "records.one: mask_s has the stretch 2 to 1 s; give"),
        (
            "[records.one]\nmask_s = [[7, 8]]",
            "records.one.mask_s: 7 to 8 s holds no sample of reco",
        ),
        ("[records.one]\nmask_s = [[0, 0.6]]", "records.one.mask_s: 9 samples of record one are l"),
        ("records.one = 1", "records.one is 1; expected an object"),
        ("units = 'm'", "units is 'm'; expected an object"),
        ("title = 3", "title is 3; expected text"),
        ("skip_s = nan", "skip_s is nan; expected a number"),
        ("skip_s = [1]", "skip_s is [1]; expected a number"),
        ("title = 'x'\nskip_s 1.0", "not TOML: "),
        ("title = 'x'\nskip_s 1.0\n", "(at line 2, column 8)"),
    ],
)
def test_what_it_says_wrongly(folder, write, refusal, text, message) -> None:
    line = refusal(write("dataset.toml", text).parent)
    assert (message if message.startswith("(") else f"dataset.toml: {message}") in line


def test_a_stretch_may_be_open(folder, write) -> None:
    write("dataset.toml", "[records.one]\nmask_s = [[0.69, inf]]\n")
    one = load(folder).records[0]
    assert (one.error_mask == (one.t_s < 0.69)).all()


def test_a_header_name_is_taken_as_it_stands_and_a_note_on_one_line(folder, write) -> None:
    write("tab.csv", "t,a\tb,y\n" + "".join(f"{0.02 * k:.2f},{k},{2 * k}\n" for k in range(40)))
    write(
        "dataset.toml", '[records.tab]\nnote = "on\\tMonday"\n[records.tab.columns]\nu = "a\\tb"\n'
    )
    (tab,) = [record for record in load(folder).records if record.name == "tab"]
    assert tab.u_V[-1] == 39.0
    assert "on Monday" in load(folder).describe()


def test_wrong_encoding_of_it(folder, refusal) -> None:
    (folder / "dataset.toml").write_bytes("title = 'Länge'".encode("latin-1"))
    assert "dataset.toml, line 1, column 11 (byte 10): not UTF-8 text" in refusal(folder)


def test_files_that_are_no_records(folder, write) -> None:
    write("README.txt", "one and two were measured on Monday")
    write("truth.json", "{}")
    write(".hidden.csv", "")
    (folder / "raw.csv").mkdir()
    data = load(folder)
    assert [r.name for r in data.records] == ["one", "two", "validation"]
    assert "left out: README.txt, by its name no record" in data.describe()


def test_two_files_of_one_name(folder, write, refusal) -> None:
    write("one.dat", "")
    assert "one.dat and one.csv are both record 'one'; rename one" in refusal(folder)


def test_one_file_does_not_care_for_its_neighbours(folder, write) -> None:
    write("one.dat", "")
    assert [r.name for r in load(folder / "two.csv").records] == ["two"]


def test_each_record_may_have_a_sampling_time_of_its_own(tmp_path, write, sine_lines) -> None:
    without = [line.partition(",")[2] for line in sine_lines()]
    for name in ("slow", "fast"):
        write(f"{name}.csv", "\n".join(without))
    write("dataset.toml", "[records.slow]\nts_s = 0.5\n[records.fast]\nts_s = 0.01\n")
    data = load(tmp_path)
    assert {r.name: r.ts_s for r in data.records} == {"slow": 0.5, "fast": 0.01}
    assert {r.ts_s for r in load(tmp_path, DataOptions(sampling_time_s=0.2)).records} == {0.2}


def test_a_sampling_time_that_the_times_contradict(folder, write, refusal) -> None:
    write("dataset.toml", "[records.one]\nts_s = 0.1\n")
    line = refusal(folder)
    assert (
        "one.csv, line 2, column t: time steps by 0.02 s on average where dataset.toml, re" in line
    )


def test_each_record_may_be_written_in_a_way_of_its_own(tmp_path, write, sine_lines) -> None:
    write("plain.csv", "\n".join(line.replace("t,u,y", "time,u,y") for line in sine_lines()))
    rows = [line.split(",") for line in sine_lines()[1:]]
    other = [f"{1e3 * float(t):.3f};{u};{1e3 * float(y):.3f}" for t, u, y in rows]
    write("other.csv", "\n".join(["when;volt;disp", *other]))
    # stamps that are no numbers, under the very name of the time
    stamped = [f"10:{k:02d}\t{u}\t{y}" for k, (_, u, y) in enumerate(rows)]
    write("stamped.csv", "\n".join(["t\tu\ty", *stamped]))
    write(
        "dataset.toml",
        """\
        columns = { t = "time" }
        [records.other]
        separator = "semicolon"
        columns = { t = "when", u = 1, y = "disp" }
        units = { t = "ms", y = "nm" }
        [records.stamped]
        columns = { t = "" }
        ts_s = 0.02
        """,
    )
    plain, other, stamped = sorted(load(tmp_path).records, key=lambda r: "pos".index(r.name[0]))
    for record in (other, stamped):
        np.testing.assert_allclose(record.t_s, plain.t_s, atol=1e-9)
        np.testing.assert_allclose(record.y_um, plain.y_um, atol=1e-5)


def test_a_separator_is_taken_at_its_word(tmp_path, write, sine_lines, refusal) -> None:
    path = write("run.csv", "\n".join(sine_lines()).replace(",", "; "))
    write("dataset.toml", '[records.run]\nseparator = "tab"\n')
    assert "run.csv, line 1, column t: missing (time in s); the file has t; u; y" in refusal(path)
    write("dataset.toml", '[records.run]\nseparator = "semicolon"\n')
    assert load(path).records[0].t_s.size == 40


def test_no_text_has_no_separator(tmp_path, write, refusal) -> None:
    np.savez(tmp_path / "run.npz", t=np.arange(20.0), u=np.arange(20.0), y=np.arange(20.0))
    write("dataset.toml", '[records.run]\nseparator = "tab"\n')
    line = refusal(tmp_path)
    assert "records.run.separator is 'tab'; leave it out, run.npz is no text" in line


def test_a_stacked_archive_may_be_told_its_sampling_time(tmp_path, write) -> None:
    u = np.sin(np.arange(120.0)).reshape(40, 3)
    np.savez(tmp_path / "mirror.npz", u_low=u, y_low=2.0 * u)
    write("dataset.toml", "[records.mirror]\nts_s = 0.01\n")
    assert [(r.name, r.ts_s) for r in load(tmp_path).records] == [("low-1", 0.01)]
