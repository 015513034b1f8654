"""What is read of a file: regular ones only, of a bounded size, JSON without traps."""

from __future__ import annotations

import json
import os
import socket

import pytest

from rdpi_gym.support.errors import InputError, printable
from rdpi_gym.support.files import open_regular, parse_json, read_bytes, read_json, read_utf8
from tests.looping import over


def line_of(call, *arguments) -> str:
    with pytest.raises(InputError) as caught:
        call(*arguments)
    line = str(caught.value)
    assert len(line) < 400
    assert line == printable(line)
    return line


def test_a_fifo_is_refused_and_not_waited_for(tmp_path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "is no regular file" in line_of(open_regular, tmp_path / "pipe")


def test_links_to_devices_sockets_and_folders_are_refused(tmp_path) -> None:
    (tmp_path / "zero").symlink_to("/dev/zero")
    assert "is no regular file" in line_of(read_bytes, tmp_path / "zero", 100)
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        assert "cannot be read" in line_of(read_bytes, tmp_path / "socket", 100)
    assert "is no regular file" in line_of(read_bytes, tmp_path, 100)
    assert "cannot be read" in line_of(read_bytes, tmp_path / "absent", 100)


def test_a_link_to_a_regular_file_is_one(tmp_path) -> None:
    (tmp_path / "a").write_bytes(b"data")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    assert read_bytes(tmp_path / "b", 4) == b"data"


def test_a_file_that_is_too_large_is_not_read(tmp_path) -> None:
    with (tmp_path / "a").open("wb") as stream:
        stream.truncate(2**40)  # a hole: no byte of it is on the disk
    assert "1048576 MiB; a file of this kind has 1 MiB" in line_of(
        read_bytes, tmp_path / "a", 2**20
    )


def test_a_file_of_the_largest_size_is_read_and_a_byte_more_is_not(tmp_path) -> None:
    (tmp_path / "a").write_bytes(bytes(1000))
    assert len(read_bytes(tmp_path / "a", 1000)) == 1000
    assert "a file of this kind has 0 MiB at most" in line_of(read_bytes, tmp_path / "a", 999)


def test_text_that_is_no_utf8(tmp_path) -> None:
    (tmp_path / "a").write_bytes(b"25 \xb5m")
    assert "byte 3" in line_of(read_utf8, tmp_path / "a", 100)


@over(
    "text, said",
    [
        ("[" * 100_000, "nested deeper than 50 levels"),
        ("[" * 60 + "]" * 60, "nested deeper than 50 levels"),
        ("9" * 5000, "too large for a whole number"),
        (str(10**400), "too large for a whole number"),
        ("[1e400]", "1e400 is no finite number"),
        ('{"a": -Infinity}', "-Infinity is no finite number"),
        ('{"a": NaN}', "NaN is no finite number"),
        (r'["\u001b[2J"]', "control characters"),
        (r'{"\u009b1m": 1}', "control characters"),
        (r'["\ud800"]', "control characters"),
        ('["\u202egnp.exe"]', "control characters"),
        ('{"a": ', "line 1, column 7: not whole JSON"),
    ],
)
def test_json_that_is_refused(text, said) -> None:
    assert said in line_of(parse_json, text, "a.json")


@over("value", [2**63 - 1, -(2**63), 1.5e308, "two\nlines of µ", [[[{"a": None}]]], True])
def test_json_that_is_read(value) -> None:
    assert parse_json(json.dumps(value), "a.json") == value


def test_a_format_that_is_no_text_is_quoted_short(tmp_path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"format": list(range(10_000)), "version": 1}))
    assert '"format" is [0, 1, 2, 3, 4, 5, ...]' in line_of(read_json, path, "rdpi-plant", 1)


def test_an_error_is_one_line_whatever_stands_in_it() -> None:
    line = str(InputError("a\nb\x1b]0;title\x07\u2028" + "x" * 10_000))
    assert line == printable(line)
    assert line.startswith(r"a\nb\x1b]0;title\x07")
    assert len(line) < 1100
