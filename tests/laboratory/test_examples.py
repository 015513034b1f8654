"""Every exercise can be simulated by the job of the laboratory, and opened as it opens files."""

import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory import jobs
from rdpi_gym.laboratory.examples import _EXERCISES


class Deaf:
    def progress(self, task, done, total):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("exercise", _EXERCISES, ids=lambda exercise: exercise.key)
def test_an_exercise_simulates_and_opens(exercise, tmp_path):
    coarse = {**exercise.simulated, "ts_factor": 4.0}
    data = jobs.simulate(Deaf(), **coarse)
    opened = rg.load(data.write(tmp_path / "data"))
    assert len(opened.records) == exercise.records
    samples = sum(record.t_s.size for record in opened.records)
    assert samples == exercise.samples * exercise.simulated["ts_factor"] / 4.0
    assert not opened.remarks
