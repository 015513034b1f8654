"""Files and folders written whole: rights, remains, refusals."""

import errno
import os
import stat
import subprocess
import sys
import threading

import pytest

from rdpi_gym.support import files
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import replaced_folder, settled_folder, write_atomic
from rdpi_gym.support.temporaries import temporary
from tests.looping import over

posix = pytest.mark.skipif(os.name == "nt", reason="rights and locks of POSIX")


@posix
@over("umask, mode", [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_rights_are_what_the_umask_leaves(umask, mode, tmp_path):
    before = os.umask(umask)
    try:
        path = write_atomic(tmp_path / "a.txt", "x")
        with replaced_folder(tmp_path / "set") as fresh:
            write_atomic(fresh / "b.txt", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == mode
    assert stat.S_IMODE((tmp_path / "set").stat().st_mode) == 0o777 & ~umask


def test_the_content_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    calls = []
    for name in ("write", "fsync", "replace"):
        known = getattr(os, name)
        monkeypatch.setattr(
            os, name, lambda *words, n=name, known=known: (calls.append(n), known(*words))[1]
        )
    write_atomic(tmp_path / "a.txt", "x")
    assert calls == ["write", "fsync", "replace", "fsync"]  # the last is the folder's


@over("number", [errno.ENOSPC, errno.EDQUOT])
@over("call", ["write", "fsync", "replace"])
def test_a_full_disk_is_one_line_and_keeps_the_old_file(call, number, tmp_path, monkeypatch):
    path = write_atomic(tmp_path / "a.txt", "old")

    def refuse(*words):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, call, refuse)
    with pytest.raises(InputError, match="the disk is full") as error:
        write_atomic(path, "new")
    monkeypatch.undo()
    assert "\n" not in str(error.value)
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_text() == "old"


@posix
def test_what_a_killed_writer_left_is_cleared_and_what_a_live_one_holds_is_not(tmp_path):
    dead = tmp_path / ".a.txt.0123456789ab.tmp"
    code = f"import os; open({str(dead)!r}, 'w').write('half'); os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", code], check=False)
    other = tmp_path / ".b.txt.0123456789ab.tmp"
    other.write_text("of another file")
    dead.write_text("half")
    with temporary(tmp_path / "a.txt") as held:
        assert not dead.exists()
        write_atomic(tmp_path / "a.txt", "new")
        assert held.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == [other.name, "a.txt"]


def test_writers_at_the_same_time_leave_one_of_their_files(tmp_path):
    def write(text):
        for _ in range(20):
            write_atomic(tmp_path / "a.txt", text * 1000)

    writers = [threading.Thread(target=write, args=(letter,)) for letter in "abcd"]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert len(set((tmp_path / "a.txt").read_text())) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


@over("exchange", [True, False])
def test_a_folder_that_could_not_be_filled_is_the_old_one(exchange, tmp_path, monkeypatch):
    if not exchange:
        monkeypatch.setattr(files, "_exchange", lambda one, other: False)
    target = tmp_path / "set"
    for text in ("old", "new"):
        with replaced_folder(target) as fresh:
            write_atomic(fresh / "a.txt", text)

    def fill_in_vain():
        with replaced_folder(target) as fresh:
            write_atomic(fresh / "a.txt", "newer")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill_in_vain()
    assert (target / "a.txt").read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_a_kill_between_two_renames_is_made_good_by_the_next_reader(tmp_path):
    between = tmp_path / ".set.0123456789ab.tmp"
    for name in ("old", "new"):
        (between / name).mkdir(parents=True)
        (between / name / "a.txt").write_text(name)
    assert (settled_folder(tmp_path / "set") / "a.txt").read_text() == "new"
    with replaced_folder(tmp_path / "set") as fresh:
        write_atomic(fresh / "a.txt", "newer")
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_a_folder_that_was_removed_does_not_come_back(tmp_path):
    left = tmp_path / ".set.0123456789ab.tmp" / "old"
    left.mkdir(parents=True)
    assert not settled_folder(tmp_path / "set").exists()
