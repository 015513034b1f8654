"""Confinement of a process by the kernel (Linux): no file, no program, no memory of another process."""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

# prctl(2)
_GET_DUMPABLE, _SET_DUMPABLE, _SET_NO_NEW_PRIVILEGES = 3, 4, 38
# System calls of Landlock, the same on every architecture, and of capset on the two that are common.
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_CAPSET = {"x86_64": 126, "aarch64": 91}
_CAPABILITY_VERSION = 0x20080522
# Rights on files, by the version of the interface that brought them.
_RIGHTS = {1: 13, 2: 14, 3: 15, 5: 16}
_READ_FILE, _READ_FOLDER = 1 << 2, 1 << 3
_OF_FILES = 0b111 | 1 << 14 | 1 << 15  # rights that a rule on one file may name
_TCP_FROM, _SCOPES_FROM = 4, 6


@contextmanager
def kept_memory() -> Iterator[None]:
    """Refuse other processes of this user this one's memory, environment and descriptors while inside.

    Root with its capabilities is not refused; what is confined has none.
    """
    library = _library()
    before = 0 if library is None else library.prctl(_GET_DUMPABLE, 0, 0, 0, 0)
    if library is not None:
        library.prctl(_SET_DUMPABLE, 0, 0, 0, 0)
    try:
        yield
    finally:
        if library is not None and before == 1:
            library.prctl(_SET_DUMPABLE, before, 0, 0, 0)


def confine(readable: Sequence[Path], writable: Sequence[Path]) -> bool:
    """Leave this process folders and files to read and to write, and no more, for good.

    It gives up its capabilities, can start no program, trace no process outside, open no TCP
    connection, and send signals only to its own children. Returns False where the kernel, or
    another thread that runs already, leaves it as it was.
    """
    library = _library()
    if library is None or len(list(Path("/proc/self/task").iterdir())) > 1:
        return False
    version = library.syscall(_CREATE_RULESET, None, 0, 1)
    if version < 1 or library.prctl(_SET_NO_NEW_PRIVILEGES, 1, 0, 0, 0):
        return False
    count = max(bits for since, bits in _RIGHTS.items() if since <= version)
    every = (1 << count) - 1
    # read as files: everything, TCP to bind and to connect, sockets without a name and signals
    fields = [every, 0b11, 0b11][: 1 + (version >= _TCP_FROM) + (version >= _SCOPES_FROM)]
    attribute = struct.pack(f"={len(fields)}Q", *fields)
    rules = library.syscall(_CREATE_RULESET, attribute, len(attribute), 0)
    if rules < 0:
        return False
    try:
        for paths, rights in ((readable, _READ_FILE | _READ_FOLDER), (writable, every)):
            for path in paths:
                _allow(library, rules, path, rights)
        done: bool = library.syscall(_RESTRICT_SELF, rules, 0) == 0
    finally:
        os.close(rules)
    _give_up_capabilities(library)
    return done


def _allow(library: ctypes.CDLL, rules: int, path: Path, rights: int) -> None:
    """Allow rights beneath a folder, or on a file; what is not there is passed over."""
    with suppress(OSError):
        place = os.open(path, getattr(os, "O_PATH", 0))
        try:
            given = rights if path.is_dir() else rights & _OF_FILES
            library.syscall(_ADD_RULE, rules, 1, struct.pack("=Qi", given, place), 0)
        finally:
            os.close(place)


def _give_up_capabilities(library: ctypes.CDLL) -> None:
    number = _CAPSET.get(os.uname().machine)
    if number is not None:
        head = struct.pack("=Ii", _CAPABILITY_VERSION, 0)
        library.syscall(number, head, struct.pack("=6I", *[0] * 6))


def _library() -> ctypes.CDLL | None:
    """Return the C library of a Linux, None elsewhere."""
    if sys.platform != "linux":
        return None
    library = ctypes.CDLL(None, use_errno=True)
    library.prctl.argtypes = [ctypes.c_int, *[ctypes.c_ulong] * 4]
    return library
