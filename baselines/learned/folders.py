"""Folders that are whole or absent: filled under a temporary name and renamed."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rdpi_gym.support.errors import InputError


@contextmanager
def replaced_folder(target: Path) -> Iterator[Path]:
    """Give an empty folder to fill, which takes the target's place when nothing went wrong.

    Parameters
    ----------
    target
        The folder; what it held is deleted then.

    Raises
    ------
    InputError
        Its parent cannot be written.

    Examples
    --------
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     with replaced_folder(Path(parent) / "a") as fresh:
    ...         _ = (fresh / "b.txt").write_text("done")
    ...     (Path(parent) / "a" / "b.txt").read_text()
    'done'
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
    except OSError as error:
        raise InputError(
            f"{target} cannot be written ({error.strerror}); give a folder that you may write to"
        ) from error
    fresh, old = temporary / "new", temporary / "old"
    try:
        fresh.mkdir()
        yield fresh
        if target.exists():
            target.rename(old)
        fresh.rename(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
