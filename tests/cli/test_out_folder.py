"""A folder that cannot be written to is refused before anything is read or computed."""

from pathlib import Path

import pytest

from rdpi_gym.cli import main
from rdpi_gym.support.command import check_folder
from rdpi_gym.support.errors import InputError
from tests.looping import over

COMMANDS = (
    ["bench"],
    ["reproduce"],
    ["fit", "nowhere"],
    ["compare", "nowhere", "--model", "P5"],
    ["diagnose", "nowhere"],
    ["add", "creep", "nowhere", "--model", "P5"],
    ["discover", "nowhere"],
    ["simulate"],
    ["effects"],
    ["train", "ppo"],
    ["tune", "dual-loop"],
)


@pytest.fixture
def taken(tmp_path):
    path = tmp_path / "taken"
    path.write_text("kept")
    return path


@over("below", ["", "sub", "sub/further"])
@over("words", COMMANDS)
def test_file_in_the_way_is_one_line(words, below, taken, capsys):
    out = taken / below
    assert main([*words, "--out", str(out)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == (
        f"rdpi: --out {out} cannot be written: {taken} is a file; give a folder\n"
    )
    assert [path.name for path in taken.parent.iterdir()] == ["taken"]
    assert taken.read_text() == "kept"


def test_new_folder_is_accepted_and_not_made(tmp_path):
    new = tmp_path / "new" / "further"
    assert check_folder(new) == new
    assert list(tmp_path.iterdir()) == []
    assert check_folder(Path("here")) == Path("here")


def test_folder_that_the_system_keeps_is_refused(tmp_path, monkeypatch):
    def refuse(dir):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("rdpi_gym.support.command.TemporaryFile", refuse)
    with pytest.raises(InputError, match=r"new cannot be written \(Permission denied\)"):
        check_folder(tmp_path / "new")
