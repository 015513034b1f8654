"""A discovery in the study of measured records."""

from dataclasses import replace

from rdpi_gym.diagnosis.results import Candidate, Errors, SearchResult, Step
from rdpi_gym.plant import P5
from studies.measured_effects import summary
from tests.looping import over

BASE, AFTER = Errors(0.3, 0.4, 2.0, {}), Errors(0.1, 0.2, 1.0, {})
CREEP = Candidate("creep", AFTER, {}, {}, 0.9, 0.5, (), "the holds creep")
FOUND = SearchResult(
    kind="discovery", title="", plant=P5, steps=(Step((CREEP,)),), rounds=((CREEP,),), removed=(),
    noise_floor_um=0.1, noise_origin="noise floor 0.1 µm rms, from a quiet record",
    numerical_floor_um=0.0, base=BASE, final=AFTER, given=None, verdict="unexplained",
    sampling=None, undecided=None, unexplained_rmse_um=0.17,
    remainder="What is left follows from the input.", next_experiment="Record steps.",
    indistinguishable=(), findings=(), limits=(), checks=(), views=(), seconds=1.0,
)  # fmt: skip


def test_errors_step_by_step():
    table, text = summary("stage", FOUND)
    assert table["model"].tolist() == ["base model", "+ creep"]
    assert table["validation_rmse_um"].tolist() == [0.4, 0.2]
    assert "**unexplained**; noise floor 0.1 µm rms" in text
    assert "- creep: confidence 90 %, no remark" in text


@over(
    "experiment, end",
    [
        ("Record steps.", "\n\nNext experiment: Record steps."),
        (None, "- creep: confidence 90 %, no remark"),
    ],
)
def test_next_experiment_is_named_where_there_is_one(experiment, end):
    _, text = summary("stage", replace(FOUND, next_experiment=experiment))
    assert text.endswith(end)
    assert "None" not in text
