"""What policies of every kind share: how one is kept, and where it may run."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rdpi_gym.envs.layout import ObservationLayout
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic, write_json
from rdpi_gym.support.folders import replaced_folder
from rdpi_gym.support.words import quoted

DESCRIPTION = "policy.json"
"""Name of the file that says what a policy is."""


class Trained:
    """What was trained in a loop of one layout.

    Attributes
    ----------
    layout : ObservationLayout
        What the observations of its training showed.
    seen : Mapping
        How far the loops of its training went.
    """

    layout: ObservationLayout
    seen: Mapping[str, float]

    def runs_at(self, ts_s: float) -> bool:
        """Whether a sampling time (s) is that of its training: it means nothing at another."""
        return abs(ts_s - self.layout.ts_s) <= 1e-9 * self.layout.ts_s

    def check_runs(self, layout: ObservationLayout) -> None:
        """Refuse a loop of another sampling time."""
        if not self.runs_at(layout.ts_s):
            raise InputError(
                f"a policy trained at Ts = {self.layout.ts_s:g} s belongs to another observation layout than "
                f"one of Ts = {layout.ts_s:g} s; run it at its own"
            )


def check_preview(layout: ObservationLayout, needed: int) -> None:
    """Refuse observations that show less of the reference ahead than a policy was shown."""
    if layout.preview < needed:
        raise InputError(
            f"the policy was shown {needed} samples of the reference ahead and belongs "
            f"to another observation layout than one of preview {layout.preview}"
        )


def write_policy(folder: Path, file: str, weights: bytes, document: Mapping[str, Any]) -> Path:
    """Write a policy's weights and description; what was in the folder is replaced as a whole."""
    if folder.exists() and not (folder / DESCRIPTION).is_file():
        raise InputError(f"{folder} exists and holds no policy; give another folder")
    with replaced_folder(folder) as fresh:
        write_atomic(fresh / file, weights)
        digest = hashlib.sha256(weights).hexdigest()
        write_json(fresh / DESCRIPTION, {**document, "weights_sha256": digest})
    return folder


@contextmanager
def read_as(what: str, source: Path) -> Iterator[None]:
    """Say of whatever a description trips over where it stands, and that it describes no such thing."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{source} does not describe a {what} ({quoted(error)})") from error


def check_whole(content: bytes, sha256: str, name: str) -> None:
    """Refuse the content of a file that was not written with its description."""
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(
            f"{name} is not the file that was saved with it; perhaps one of them was cut off"
        )
