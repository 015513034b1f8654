"""The page of the registered tasks is what its command writes today."""

from pathlib import Path

from rdpi_gym.envs.tasks import TASKS
from studies import tasks_page


def test_the_page_is_that_of_the_declarations(tmp_path):
    assert tasks_page.main(["--out", str(tmp_path)]) == 0
    written = (tmp_path / tasks_page.PAGE).read_text(encoding="utf-8")
    shown = Path(__file__).parents[2] / "docs" / tasks_page.PAGE
    assert shown.read_text(encoding="utf-8") == written, "run python -m studies.tasks_page"
    assert all(f"`{task.id}`" in written for task in TASKS.values())
