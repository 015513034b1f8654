"""Pages open with the answer, its number and its unit; what users read is plain English."""

import re
from pathlib import Path

import numpy as np

from rdpi_gym.diagnosis import compare
from rdpi_gym.measurement import Dataset, Record
from rdpi_gym.plant import P5, Plant, named_plant
from rdpi_gym.report.comparison_page import write_compare_page
from rdpi_gym.report.discovery_page import write_discovery_page

ROOT = Path(__file__).parents[2]
ODD = (
    "to be told from", "told apart from", "earns its place", "earned its place", "No matter:",
    "is hidden stands in", "Nothing to remark", "is no noise: it", "ways to split", "What is left is",
)  # fmt: skip


def sine(name="sine", role="train"):
    t = np.arange(1200) * 1e-3
    u = 10.0 * np.sin(2 * np.pi * 5.0 * t)
    return Record(name, t, u, Plant(P5, 1e-3).simulate(u), ts_s=1e-3, role=role)


def opening(page):
    """The first paragraph of a page."""
    found = re.search(r"</h1>\s*<p>(.*?)</p>", page.read_text(encoding="utf-8"), re.DOTALL)
    return found.group(1)


def test_first_sentence_is_the_answer_with_its_unit(request, tmp_path_factory, subtests):
    for kind in ["discovery", "diagnosis", "comparison"]:
        with subtests.test(kind=kind):
            tmp_path = tmp_path_factory.mktemp("case")
            path = tmp_path / "report.html"
            if kind == "comparison":
                dataset = Dataset("two", (sine(), sine("held", role="validation")))
                page = write_compare_page(path, compare(dataset, named_plant("P5-static")))
            else:
                page = write_discovery_page(
                    path, "a stage", request.getfixturevalue(f"made_{kind}")()
                )
            first = opening(page).split(". ")[:2]
            assert re.search(r"\d [µn]m", ". ".join(first)), first


def test_odd_phrases_are_gone(subtests):
    for room in ["rdpi_gym", "benchmarks", "baselines"]:
        with subtests.test(room=room):
            found = [
                (path.relative_to(ROOT).as_posix(), phrase)
                for path in (ROOT / room).rglob("*.py")
                for phrase in ODD
                if phrase in path.read_text(encoding="utf-8")
            ]
            assert found == []
