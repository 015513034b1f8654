"""A session: what was done is there again, whatever happened to the server."""

import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory.session import JOURNAL, Session, Step


def made(session, parent=None, **changes):
    """Write a step and return its name."""
    name = session.next_id()
    step = Step(name, parent, name, {"kind": "fit"}, rg.plants["P5"], 1.0, 2.0, {"run": 1.5})
    session.write({"do": "step", "step": {**step.to_dict(), **changes}})
    return name


def refit(effect, form, validation_um, plant="P5"):
    document = None if plant is None else rg.plants[plant].to_dict()
    return {"effect": effect, "form": form, "validation_um": validation_um, "plant": document}


def test_what_was_written_is_there_after_a_death_in_the_middle_of_a_line(tmp_path):
    before = Session(tmp_path)
    first = made(before)
    second = made(before, first)
    before.write({"do": "refit", "step": second, "refit": refit("creep", "", 0.5)})
    with (tmp_path / JOURNAL).open("ab") as stream:
        stream.write(b'{"do": "step", "st')
    after = Session(tmp_path)
    assert (after.path, after.steps) == ([first, second], before.steps)
    assert after.rankings[second].refits == before.rankings[second].refits
    third = made(after, second)  # and it goes on behind the torn line
    assert Session(tmp_path).path == [first, second, third]


def test_a_ranking_that_the_server_took_with_it_is_not_running_any_more(tmp_path):
    session = Session(tmp_path)
    step = made(session)
    session.write({"do": "ranking", "step": step, "status": "running"})
    assert session.rankings[step].status == "running"
    assert Session(tmp_path).rankings[step].status == "cancelled"


def test_damage_within_the_journal_is_said_with_its_line(tmp_path_factory, subtests):
    for line in [
        "{}}",
        "3",
        "[1]",
        "{}",
        '{"do": "step"}',
        '{"do": "step", "step": {"id": "s1"}}',
        '{"do": "go", "path": 3}',
        '{"do": "file", "name": [], "entry": {}}',
    ]:
        with subtests.test(line=line):
            tmp_path = tmp_path_factory.mktemp("case")
            made(Session(tmp_path))
            (tmp_path / JOURNAL).write_bytes(
                line.encode() + b"\n" + (tmp_path / JOURNAL).read_bytes()
            )
            with pytest.raises(rg.InputError, match=r"journal\.jsonl, line 1 is damaged"):
                Session(tmp_path)


def test_a_step_made_after_an_undo_ends_what_could_be_redone(tmp_path):
    session = Session(tmp_path)
    first = made(session)
    second = made(session, first)
    session.write({"do": "go", "path": [first], "redo": [second]})
    other = made(session, first)
    assert (session.path, session.redo) == ([first, other], [])
    assert session.chain(second) == [first, second]  # still there to go to


def test_data_read_anew_begin_a_new_history(tmp_path):
    session = Session(tmp_path)
    made(session)
    session.write({"do": "read"})
    assert (session.steps, session.path) == ({}, [])
    assert made(session) == "s2"  # no name twice


def test_a_click_takes_the_form_of_the_ranking_or_the_best_so_far(tmp_path):
    session = Session(tmp_path)
    step = made(session)
    for each in (refit("creep", "", 0.5), refit("creep", "spectrum", 0.4, "P10")):
        session.write({"do": "refit", "step": step, "refit": each})
    session.write({"do": "refit", "step": step, "refit": refit("delay", "", None, None)})
    ranking = session.rankings.get(step)
    assert ranking.plant_with("creep") == rg.plants["P10"]
    assert ranking.plant_with("delay") is None
    result = {"candidates": [{"effect": "creep", "form": ""}]}
    session.write({"do": "ranking", "step": step, "status": "done", "result": result})
    assert session.rankings[step].plant_with("creep") == rg.plants["P5"]
