"""Files that are whole or absent: written to a temporary name and renamed; versioned JSON."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

from rdpi_gym.support.errors import InputError


def write_atomic(path: Path | str, content: str | bytes) -> Path:
    """Write `content` so that a reader sees the old file or the new one, never a part.

    Parameters
    ----------
    path
        Where to write; missing folders are made.
    content
        Text (stored as UTF-8) or bytes.

    Returns
    -------
    Path
        The path written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_atomic(Path(folder) / "a.txt", "done").read_text()
    'done'
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise InputError(
            f"{target} cannot be written ({error.strerror}); give a folder that you may write to"
        ) from error
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        temporary.chmod(0o644)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return target


def write_json(path: Path | str, document: dict[str, Any]) -> Path:
    """Write a JSON object, indented, atomically; NaN and infinity are refused.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_json(Path(folder) / "a.json", {"format": "x", "version": 1}).name
    'a.json'
    """
    return write_atomic(
        path, json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    )


def read_json(path: Path | str, document_format: str, version: int) -> dict[str, Any]:
    """Read a JSON object that states its format and version.

    Parameters
    ----------
    path
        The file.
    document_format
        What its key ``format`` must say, for example ``rdpi-plant``.
    version
        The newest version that the caller understands; 1 to this are accepted.

    Raises
    ------
    InputError
        The file is missing, truncated, not an object, of another format or of a newer version.
    """
    source = Path(path)
    try:
        text = source.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(
            f"{source} does not exist; give the path of a {document_format} file"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{source} cannot be read as UTF-8 text ({error})") from error
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{source}, line {error.lineno}, column {error.colno}: not whole JSON ({error.msg}); "
            f"expected a {document_format} file, perhaps this one was cut off"
        ) from error
    if not isinstance(document, dict) or document.get("format") != document_format:
        found = document.get("format") if isinstance(document, dict) else type(document).__name__
        raise InputError(f'{source} is not a {document_format} file: "format" is {found!r}')
    found_version = document.get("version")
    if type(found_version) is not int or not 1 <= found_version <= version:
        raise InputError(
            f"{source} has version {found_version!r} of {document_format}; "
            f"this release reads versions 1 to {version}"
        )
    return document
