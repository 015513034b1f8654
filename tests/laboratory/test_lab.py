"""Effects of each action, the worker played by the test: it says when a refit is there."""

import asyncio
import math
from dataclasses import asdict, replace

import pytest

import rdpi_gym as rg
from rdpi_gym.laboratory import jobs
from rdpi_gym.laboratory.lab import Lab
from rdpi_gym.laboratory.session_jobs import Events
from tests.laboratory.served import BASE, refit, result

CREEP, DELAY = rg.effects["creep"](), rg.effects["delay"]()


class Played:
    """Workers of which the test says what they say."""

    def __init__(self, **_):
        self.begun, self.cancelled = [], 0

    def begin(self, task, arguments, listener, wanted):
        if not wanted():
            return
        self.begun.append((task, arguments))
        self.say = lambda *message: listener(message)

    def cancel(self):
        self.cancelled += 1

    def close(self):
        pass


async def told(lab, *message):
    """Let the worker say something, and the laboratory hear it."""
    lab.workers.say(*message)
    await asyncio.sleep(0.005)


async def begun(lab, count):
    """Wait until so many tasks were handed over, and return the last."""
    for _ in range(400):
        if len(lab.workers.begun) >= count:
            return lab.workers.begun[-1]
        await asyncio.sleep(0.005)
    raise AssertionError(lab.workers.begun)


@pytest.fixture
def play(tmp_path, monkeypatch):
    """Run a scene in a laboratory whose base model and creep are refitted."""
    monkeypatch.setattr("rdpi_gym.laboratory.session_jobs.Workers", Played)
    monkeypatch.setattr(Lab, "_describe", lambda self, step: None)

    def run(scene):
        async def played():
            lab = Lab(tmp_path, Events(), 1)
            lab.workers = lab._workers
            lab._loop = asyncio.get_running_loop()
            rows = ((0.01 * k, 10 * math.sin(k / 9) * (1 + k / 200)) for k in range(200))
            text = "".join(f"{t:g},{u:.6g},{u + 0.1 * abs(u):.6g}\n" for t, u in rows)
            (lab.session.data_folder / "run.csv").write_text("t,u,y\n" + text)
            await lab.open()
            await begun(lab, 1)
            await told(lab, "news", "refit", refit(BASE, 0.5))
            creep = refit(replace(BASE, effects=(CREEP,)), 0.2, "creep")
            await told(lab, "news", "refit", creep)
            await scene(lab)

        asyncio.run(played())

    return run


def test_a_click_makes_a_step_of_the_refit_and_ranks_on_from_it(play):
    async def scene(lab):
        state = await lab.add("creep")
        assert [state["steps"][s]["errors"]["validation_um"] for s in state["path"]] == [0.5, 0.2]
        assert lab.session.rankings["s1"].status == "cancelled"
        task, arguments = await begun(lab, 2)
        assert (task, arguments["model"].effects) == (jobs.rank, (CREEP,))
        # the search's own refit of the model takes its place where it leaves less
        await told(lab, "news", "refit", refit(arguments["model"], 0.3))
        assert lab.session.step("s2").validation_um == 0.2
        await told(lab, "news", "refit", refit(arguments["model"], 0.1))
        assert lab.session.step("s2").validation_um == 0.1
        with pytest.raises(rg.InputError, match="the model has creep already; choose another"):
            await lab.add("creep")
        assert (await lab.undo())["path"] == ["s1"]
        assert (await lab.redo())["path"] == ["s1", "s2"]
        assert (await lab.go("s1"))["redo"] == ["s2"]

    play(scene)


def test_what_was_not_tried_is_refitted_first(play):
    async def scene(lab):
        state = await lab.add("delay")
        assert (state["path"], state["job"]["what"]) == (["s1"], "refit")
        assert (await begun(lab, 2))[0] is jobs.add
        await told(lab, "done", refit(replace(BASE, effects=(DELAY,)), 0.4, "delay"))
        assert lab.session.path == ["s1", "s2"]
        assert (await begun(lab, 3))[0] is jobs.rank

    play(scene)


def test_a_worker_that_is_stopped_is_not_heard_and_one_that_dies_is(play):
    async def scene(lab):
        stale = lab.workers.say
        await lab.cancel()
        assert lab.session.rankings["s1"].status == "cancelled"
        stale("done", result())
        await asyncio.sleep(0.01)
        assert lab.session.rankings["s1"].status == "cancelled"
        await lab.rank()
        await begun(lab, 2)
        await told(lab, "died", "the process died; start it again")
        ranking = lab.state()["ranking"]
        assert (ranking["status"], ranking["problem"]) == (
            "failed",
            "the process died; start it again",
        )
        assert lab.state()["job"] is None

    play(scene)


def test_what_is_held_is_put_back_where_a_search_has_moved_it(play):
    async def scene(lab):
        await lab.hold("", "delta2_s", True)
        moved = replace(BASE, hysteresis=BASE.hysteresis.with_shape({"delta2_s": 0.01}))
        await told(lab, "news", "refit", refit(replace(moved, effects=(DELAY,)), 0.3, "delay"))
        state = await lab.add("delay")
        assert [state["steps"][s]["kind"] for s in state["path"]] == ["fit", "candidate", "set"]
        task, arguments = await begun(lab, 2)
        assert (task, arguments["held"]) == (jobs.refit, ["delta2_s"])
        assert arguments["model"].hysteresis.delta2_s == BASE.hysteresis.delta2_s
        await told(lab, "done", refit(arguments["model"], 0.35))
        assert lab.state()["steps"]["s4"]["model"]["core_parameters"][0]["held"]
        assert (await begun(lab, 3))[0] is jobs.rank

    play(scene)


def test_where_nothing_is_missing_the_model_in_few_numbers_can_be_taken(play):
    async def scene(lab):
        with pytest.raises(rg.InputError, match="there is no settled model: rank first"):
            await lab.settle()
        errors = asdict(rg.respond(BASE, lab.session.need_data()).errors)
        final = {"train_rmse": 0.4, "validation_rmse": 0.4, "by_record": errors["by_record_um"]}
        await told(lab, "done", result(settled=BASE.to_dict(), final=final))
        assert lab.state()["ranking"]["settled"] == {"train_um": 0.4, "validation_um": 0.4}
        state = await lab.settle()
        assert state["steps"]["s2"]["errors"]["validation_um"] == 0.4
        assert state["ranking"] is None

    play(scene)


def test_an_effect_is_taken_out_as_soon_as_the_model_without_it_is_refitted(play):
    async def scene(lab):
        await lab.add("creep")
        await begun(lab, 2)
        assert (await lab.remove("creep"))["path"] == ["s1", "s2"]
        _, arguments = await begun(lab, 3)
        assert arguments["model"].effects == ()
        await told(lab, "news", "refit", refit(BASE, 0.5))
        assert lab.state()["steps"]["s3"]["label"] == "Creep removed"
        with pytest.raises(rg.InputError, match="has no effect 'creep'; it has none"):
            await lab.remove("creep")

    play(scene)


def test_an_exercise_takes_the_place_of_the_files_once_it_is_there(play):
    async def scene(lab):
        await lab.take_example("nothing")
        assert list(lab.session.files) == ["run.csv"]
        task, arguments = await begun(lab, 2)
        assert (task, arguments["hide"]) == (jobs.simulate, [])
        before = lab.session.need_data()
        await told(lab, "done", replace(before, title="simulated"))
        await begun(lab, 3)
        assert (lab.state()["title"], lab.session.steps) == ("Perhaps nothing", {})
        with pytest.raises(rg.InputError, match="there is no example 'anything'; there are one-"):
            await lab.take_example("anything")

    play(scene)
