"""The page of the kinds of hysteresis is what its command writes today."""

from __future__ import annotations

from pathlib import Path

from rdpi_gym.plant import CORES
from studies import kinds_page

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_that_of_the_declarations():
    text = (DOCS / kinds_page.PAGE).read_text(encoding="utf-8")
    assert text == kinds_page.page_text(), "run python -m studies.kinds_page"
    assert (DOCS / kinds_page.PICTURE).stat().st_size < 100_000


def test_every_kind_has_a_section_with_its_bounds():
    text = kinds_page.page_text()
    for name, kind in CORES.items():
        assert f"\n## {name}\n" in text
        for parameter in kind.shape:
            assert f"| `{parameter.name}` | {parameter.unit} |" in text


def test_the_command_writes_page_and_picture(tmp_path):
    assert kinds_page.main(["--out", str(tmp_path)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [kinds_page.PAGE, kinds_page.PICTURE]
