"""JAX on the environment's arrays: the sentence of the table, and one line where JAX is not installed."""

import pandas as pd

from studies import jax_copies


def test_without_jax_it_is_one_line(monkeypatch, tmp_path, capsys):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(jax_copies, "import_module", missing)
    assert jax_copies.main(["--out", str(tmp_path)]) == 2
    assert "needs jax, which is not installed" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_sentence_is_the_tables(monkeypatch):
    monkeypatch.setattr(jax_copies, "version", lambda name: "0.1")
    columns = ["lanes", "actions_shared_percent", "observations_shared_percent"]
    table = pd.DataFrame([(1, 100.0, 44.5), (64, 90.0, 100.0)], columns=columns)
    said = jax_copies.as_markdown(table, 3)
    assert "44 % of the observations at least, and the environment that of 90 % of" in said
