"""`python -m studies NAME`: every study by its name, options read and refused as everywhere."""

from importlib import import_module
from pathlib import Path

import pytest

from studies.__main__ import main, studies
from tests.looping import over

HERE = Path(__file__).parents[2] / "studies"


def test_every_study_is_listed_with_a_line(capsys):
    assert main([]) == 0
    listed = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines())
    assert listed == studies()
    assert {"agents", "effect_pages", "kinds_page", "tutorial"} <= set(listed)
    assert all(line for line in listed.values())


@over("name", studies())
def test_bad_options_are_one_line_before_anything_is_measured(name, tmp_path, capsys):
    (tmp_path / "taken").write_text("kept")
    for words, said in (
        (["--out", str(tmp_path / "taken")], "is a file; give a folder"),
        (["--nonsense"], "--nonsense"),
    ):
        assert main([name, *words]) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith(f"{name}: ")
        assert said in printed.err
        assert printed.err.count("\n") == 1
    assert (tmp_path / "taken").read_text() == "kept"


def test_an_unknown_study_is_named(capsys):
    assert main(["velocity"]) == 2
    assert "no study is named 'velocity'; known are " in capsys.readouterr().err


NUMBERS = {
    "advised_experiment": ["--plants"],
    "discovery_cost": ["--repeats", "--oversampled"],
    "effects_on_cores": ["--per"],
    "firmware_truth": ["--records"],
    "identification": ["--draws", "--rounds"],
    "kind_choice": ["--per"],
    "one_law": ["--plants"],
    "portraits": ["--plants"],
    "rank_order": ["--draws"],
    "search_constants": ["--plants"],
    "speed": ["--rounds"],
    "student_seeds": ["--seeds", "--plants"],
    "training_race": ["--seeds", "--plants"],
}


def test_numbers_below_their_least_are_refused(capsys):
    pytest.importorskip("torch")
    declared = {}
    for name in studies():
        place = f"studies.{name}.__main__" if (HERE / name).is_dir() else f"studies.{name}"
        numbers = getattr(import_module(place).main, "numbers", ())
        declared[name] = [option for option, *_ in numbers]
    assert {name: options for name, options in declared.items() if options} == NUMBERS
    for name, options in NUMBERS.items():
        for option in options:
            assert main([name, option, "0"]) == 2, (name, option)
            assert capsys.readouterr().err == f"{name}: {option} is 0; give 1 or more\n"


def test_help_is_text_and_status_0(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["rank_order", "--help"])
    assert ended.value.code == 0
    assert "--draws" in capsys.readouterr().out
