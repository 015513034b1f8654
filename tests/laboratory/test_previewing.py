"""Beginnings of files: what is shown of them, and which column is taken for what."""

import math

import numpy as np
import pytest
from scipy.io import savemat

import rdpi_gym as rg
from rdpi_gym.laboratory import data_import
from rdpi_gym.laboratory.data_import import Column, Head, guess_columns, preview
from rdpi_gym.laboratory.session import Session
from tests.looping import over

HEADER = "Time [ms];Amplifier input [mV];Position [nm]"


def lines(separator=";", columns=3):
    rows = [(k, 1e3 * math.sin(k / 9), 8e3 * math.sin(k / 9 - 0.1)) for k in range(200)]
    return [separator.join(f"{x:.6g}" for x in row[-columns:]) for row in rows]


def head_of(session, *asked):
    return preview(session.data_folder, session.files, *asked)


@pytest.fixture
def session(tmp_path):
    return Session(tmp_path / "session")


@pytest.fixture
def brought(session):
    """Bring a text or bytes under a name, and read all files as the laboratory does."""

    def bring(**files):
        for name, content in files.items():
            ending = name.rpartition("_")[2]
            file = session.data_folder / f"{name.removesuffix(f'_{ending}')}.{ending}"
            file.write_bytes(content if isinstance(content, bytes) else content.encode())
        found = data_import.read(session.data_folder)
        for file in data_import.all_files(session.data_folder):
            problem = found.problems.get(file.name)
            entry = {"bytes": 1, "problem": problem and problem.line, "row": None, "column": None}
            session.write({"do": "file", "name": file.name, "entry": entry})
        return found

    return bring


def apply(session, shown):
    """Read a file as its preview proposes."""
    change = {key: shown[key] for key in ("units", "ts_s")} | {"columns": shown["chosen"]}
    data_import.write_settings(session.data_folder, {"records": {shown["record"]: change}}, [])
    return data_import.read(session.data_folder).data


@over(
    "names, found",
    [
        ("t u y", "t u y"),
        ("y t u", "t u y"),
        ("Zeit Spannung Weg", "Zeit Spannung Weg"),
        ("time_s,v_V,x_um", "time_s v_V x_um"),
        ("TimeStamp,SensorOutput,DriveVoltage", "TimeStamp DriveVoltage SensorOutput"),
        ("Position (µm),Command (V),Time (s)", "Time (s)|Command (V)|Position (µm)"),
        ("time,position command [um],position [um],voltage [V]", "time|voltage [V]|position [um]"),
        ("Sensor output [V],Drive voltage [V],ms", "|Drive voltage [V]|Sensor output [V]"),
        ("a,b,c", "a b c"),
        ("channel 1,channel 2", "|channel 1|channel 2"),
        ("t,u", "t u u"),
        ("index,voltage,displacement", "|voltage|displacement"),
    ],
)
def test_columns_are_guessed_by_words_then_units_then_order(names, found):
    columns = [Column(name, name) for name in names.split("," if "," in names else " ")]
    guessed = guess_columns(Head(columns, [["0"], ["1"]]), {})
    assert list(guessed.values()) == found.split("|" if "|" in found else " ")


def test_the_proposal_for_a_measurement_in_other_units_reads_it_rightly(session, brought):
    brought(rig_csv="\n".join([HEADER, *lines()]))
    shown = head_of(session, "rig.csv")
    assert shown["chosen"] == dict(zip("tuy", HEADER.split(";"), strict=True))
    assert shown["units"] == {"t": "ms", "u": "mV", "y": "nm"}
    assert shown["separator"] == {"chosen": "", "found": "semicolon"}
    assert len(shown["rows"]) == 8
    assert shown["rows"][1] == lines()[1].split(";")
    (record,) = apply(session, shown).records
    assert record.ts_s == pytest.approx(1e-3)
    assert (np.ptp(record.u_V), np.ptp(record.y_um)) == pytest.approx((2.0, 16.0), rel=1e-2)


def test_the_export_of_an_instrument_shows_its_header_and_says_what_is_left_out(session, brought):
    text = "\n".join(["Oszilloskop; Prüfling 3", "Werte;200;200", "", HEADER, *lines()])
    brought(rig_csv=text.encode("cp1252"))
    shown = head_of(session, "rig.csv")
    assert shown["chosen"] == dict(zip("tuy", HEADER.split(";"), strict=True))
    assert shown["rows"][0] == lines()[0].split(";")
    assert shown["taken"] == [
        "the header is line 4; 2 lines above it are left out",
        "the file is no UTF-8 and was read as Windows-1252",
    ]
    (record,) = apply(session, shown).records
    assert record.t_s.size == 200


def test_without_names_the_order_counts_and_without_time_its_sampling_time(session, brought):
    brought(rig_dat="\n".join(lines("\t")), bare_dat="\n".join(lines(" ", 2)))
    assert head_of(session, "rig.dat")["chosen"] == {
        "t": 0,
        "u": 1,
        "y": 2,
    }
    shown = head_of(session, "bare.dat")
    assert [column["name"] for column in shown["columns"]] == ["column 0", "column 1"]
    assert (shown["chosen"], shown["ts_s"]) == ({"t": "", "u": 0, "y": 1}, None)
    data = apply(session, shown | {"ts_s": 5e-3})
    assert [(r.name, r.ts_s) for r in data.records] == [("bare", 5e-3)]
    assert head_of(session, "bare.dat")["ts_s"] == 5e-3


def test_another_separator_shows_other_columns_and_is_kept(session, brought):
    text = "\n".join([HEADER, *lines()])
    brought(rig_csv=text)
    assert len(head_of(session, "rig.csv", "comma")["columns"]) == 1
    change = {"records": {"rig": {"separator": "tab"}}}
    data_import.write_settings(session.data_folder, change, [])
    assert head_of(session, "rig.csv")["separator"] == {
        "chosen": "tab",
        "found": "tab",
    }
    assert head_of(session, "rig.csv", "")["separator"] == {
        "chosen": "",
        "found": "semicolon",
    }
    with pytest.raises(rg.InputError, match=r"separator ';'; give comma, semicolon, tab, blanks"):
        head_of(session, "rig.csv", ";")


def test_columns_without_a_name_of_their_own_go_by_position(session, brought):
    brought(rig_csv="\n".join(["x;x;", *lines()]), off_csv="\n".join(["t;u", *lines()]))
    assert [c["source"] for c in head_of(session, "rig.csv")["columns"]] == [0, 1, 2]
    assert [c["source"] for c in head_of(session, "off.csv")["columns"]] == [0, 1, 2]
    (record,) = apply(session, head_of(session, "rig.csv")).records
    assert record.t_s.size == 200


def test_files_alike_are_those_of_the_same_columns_that_were_refused_too(session, brought):
    text = "\n".join([HEADER, *lines()])
    other = "\n".join(["when;" + HEADER, *lines()])
    good = "\n".join(["t;u;y", *lines()])
    brought(a_csv=text, b_csv=text, c_csv=other, d_csv=good, e_csv=good)
    assert head_of(session, "a.csv")["alike"] == ["b"]
    assert head_of(session, "d.csv")["alike"] == ["e"]


@pytest.mark.slow
def test_variables_are_offered_by_name(session, brought):
    t = np.arange(40.0)
    folder = session.data_folder
    np.savez(folder / "run.npz", zeit=t, volt=np.sin(t), weg=np.cos(t))
    savemat(folder / "rig.mat", {"zeit": t, "volt": np.sin(t), "weg": np.cos(t), "note": "x"})
    brought()
    for name in ("run.npz", "rig.mat"):
        shown = head_of(session, name)
        assert shown["chosen"] == {"t": "zeit", "u": "volt", "y": "weg"}
        assert (shown["separator"], shown["rows"]) == (None, [])
        data = apply(session, shown)
    assert [r.name for r in data.records] == ["rig", "run"]
    np.savez(folder / "mirror.npz", u_low=np.ones((40, 3)), y_low=np.ones((40, 3)))
    brought()
    shown = head_of(session, "mirror.npz")
    assert (shown["columns"], shown["chosen"]) == ([], {"t": ""})


def test_what_the_folder_says_is_proposed(session, brought):
    (session.data_folder / "dataset.toml").write_text(
        '[columns]\nu = 2\ny = 1\n[units]\nu = "kV"\n'
        '[quantities]\noutput = { name = "force", symbol = "F", unit = "kN" }\n'
    )
    brought(rig_csv="\n".join(lines()))
    shown = head_of(session, "rig.csv")
    assert shown["chosen"] == {"t": "", "u": 2, "y": 1}
    assert shown["units"] == {"t": "s", "u": "kV", "y": ""}  # in the quantity's own unit


def test_what_cannot_be_shown_is_one_line(session, brought, tmp_path):
    (tmp_path / "secret.csv").write_text("t,u,y\n1,2,3\n")
    brought(other_csv=b"L\x81nge;u\n1;2\n", empty_csv="", rig_npz=b"PK")
    (session.data_folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    entry = {"bytes": 1, "problem": None, "row": None, "column": None}
    for name in ("link.csv", "../../secret.csv"):
        session.write({"do": "file", "name": name, "entry": entry})
    for name, line in {
        "other.csv": "other.csv, line 1, column 2 (byte 1): not UTF-8 text; save the file as UTF-8",
        "empty.csv": "empty.csv, line 1: the file ends before its first value; give lines of numbers",
        "rig.npz": "rig.npz cannot be read as npz file",
        "link.csv": "there is no data file 'link.csv' in this session",
        "../../secret.csv": "there is no data file '../../secret.csv' in this session",
        "dataset.toml": "there is no data file 'dataset.toml' in this session",
    }.items():
        with pytest.raises(rg.InputError) as refused:
            head_of(session, name)
        assert str(refused.value).startswith(line)


def test_no_more_than_the_beginning_is_read(session, brought):
    brought(rig_csv="\n".join([HEADER, *lines(), "x" * 200_000]))
    assert len(head_of(session, "rig.csv")["rows"]) == 8
    data_import.read(session.data_folder)
    brought(wide_csv=";".join(["1"] * 30_000))
    shown = head_of(session, "wide.csv")
    assert (len(shown["columns"]), len(shown["rows"][0])) == (1000, 30)
