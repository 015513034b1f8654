"""The pages on agents: templates beside this file, filled from committed results alone."""

from __future__ import annotations

import tempfile
from pathlib import Path

from rdpi_gym.support.files import read_json, write_json
from studies.agents.facts import page_facts
from studies.agents.study import Study
from studies.agents.walk import FILE, FORMAT, STEPS, VERSION, Recorded, no_picture
from studies.tutorial.template import fill

FOLDER = Path(__file__).parent / "pages"
TEMPLATES = {path.stem: path for path in sorted(FOLDER.glob("*.md"))}
"""Templates by the name of their page."""
WALK = "train-an-agent"
"""The page whose commands are run."""


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
        for name, path in TEMPLATES.items():
            template = walk_template(study) if name == WALK else path.read_text(encoding="utf-8")
            texts[name], _ = fill(template, session, no_picture)
    return texts
