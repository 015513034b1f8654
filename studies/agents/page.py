"""The pages on agents from their templates, and the walk of the page on training: its commands and what they print."""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import read_json, write_json
from studies.agents.facts import FILE, FORMAT, VERSION, page_facts
from studies.agents.training import Study
from studies.pages import FENCE, TEMPLATES, Session, fill

STEPS = 1_500_000
"""The training that the page begins with."""
RUN = "results/first-agent"
"""Its folder."""
_BLOCK = re.compile(rf"^{FENCE}\w.*?^{FENCE}$", re.M | re.S)


class _Timed(Session):
    """Runs commands, and keeps what each printed and took (s)."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, {})
        self.taken: list[dict[str, Any]] = []

    def run(self, command: str) -> list[str]:
        began = time.perf_counter()
        printed = super().run(command)
        seconds = round(time.perf_counter() - began, 1)
        self.taken.append({"command": command, "seconds": seconds, "printed": printed})
        return printed


class Recorded(Session):
    """Says what commands printed when they were run.

    Parameters
    ----------
    folder
        Where results are looked up.
    walk
        As :func:`take_walk` returns it.
    """

    def __init__(self, folder: Path, walk: Mapping[str, Any]) -> None:
        super().__init__(folder, {})
        self._printed = {each["command"]: each["printed"] for each in walk["commands"]}

    def run(self, command: str) -> list[str]:
        """Return what the command printed."""
        if command not in self._printed:
            raise InputError(f"{FILE} has no {command!r}; run --stage walk again")
        return list(self._printed[command])


def take_walk(template: str) -> dict[str, Any]:
    """Run the commands of a template in an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        session = _Timed(Path(folder))
        fill("\n\n".join(_BLOCK.findall(template)), session, no_picture)
        curve = pd.read_csv(session.folder / RUN / "training.csv")
    return {
        "format": FORMAT,
        "version": VERSION,
        "cores": os.cpu_count(),
        "seconds": round(sum(each["seconds"] for each in session.taken), 1),
        "commands": session.taken,
        "curve": curve.drop(columns="training_reward").to_dict("records"),
    }


def no_picture(page: Path, section: str, choice: str) -> bytes:
    """Refuse to draw: these pages show committed pictures alone."""
    raise InputError(f"{page}, {section}: the pages of agents take no picture from a page")


WALK = "train-an-agent"
"""The page whose commands are run."""
PAGES = ("agents", WALK)


def walk_template(study: Study) -> str:
    """Return the template of the walk, its training as long as those of the study where that says so."""
    text = TEMPLATES[WALK].read_text(encoding="utf-8")
    return text if study.timesteps is None else text.replace(str(STEPS), str(study.timesteps))


def page_texts(study: Study, results: Path) -> dict[str, str]:
    """Return the pages by their names."""
    walk = read_json(results / FILE, FORMAT, VERSION)
    texts = {}
    with tempfile.TemporaryDirectory() as folder:
        session = Recorded(Path(folder), walk)
        write_json(session.folder / "agents.json", page_facts(results))
        for name in PAGES:
            text = TEMPLATES[name].read_text(encoding="utf-8")
            template = walk_template(study) if name == WALK else text
            texts[name], _ = fill(template, session, no_picture)
    return texts
