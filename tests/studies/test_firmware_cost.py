import pytest

from studies.bare_metal.boards import missing
from studies.firmware_cost import main

needs_tools = pytest.mark.skipif(
    missing() is not None, reason=f"{missing()} is not installed: nothing runs on emulated boards"
)


@needs_tools
def test_the_table_is_written(tmp_path, capsys):
    assert (
        main(["--only", "classical-reference-rate", "--samples", "50", "--out", str(tmp_path)]) == 0
    )
    assert "-O2" in (tmp_path / "firmware_cost.md").read_text()
    rows = (tmp_path / "firmware_cost.csv").read_text().splitlines()
    assert len(rows) == 1 + 2 * 3 * 2  # cores, precisions, options


def test_an_unknown_row_is_named(capsys):
    assert main(["--only", "nothing"]) == 2
    assert "--only nothing is no row; known are none," in capsys.readouterr().err
