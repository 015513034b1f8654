"""A controller in a process of its own: the same actions, and nothing of the plant to be seen."""

import os
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from baselines import make_controller
from benchmarks.stages import isolation
from benchmarks.stages.isolation import ControllerFailed, ControllerProcess, own_code
from benchmarks.tracking.episode import microseconds_per_sample, play
from rdpi_gym.envs.tasks import TASKS

SECRET = "98765432109876543210"
RIVALS = """
import ctypes, gc, os, sys
from contextlib import suppress
from pathlib import Path
from baselines import make_controller

JUDGE, FOLDER, SECRET = {judge}, Path({folder!r}), {secret!r}
PLANTS = ("ChangingPlant", "Draw", "Lanes", "TrackingTask")

def frames(found):
    frame = sys._getframe()
    while frame is not None:
        found += [name for name, value in frame.f_locals.items() if type(value).__name__ in PLANTS]
        frame = frame.f_back

def garbage(found):
    found += [type(each).__name__ for each in gc.get_objects() if type(each).__name__ in PLANTS]

def files(found):
    found += [path.read_text() for path in [FOLDER / "seed", *FOLDER.glob("*.py")]]

def environment(found):
    found += [name for name, value in os.environ.items() if SECRET in value]

def descriptors(found):
    for number in range(3, 200):
        with suppress(OSError):
            found += [number] * (SECRET.encode() in os.pread(number, 100, 0))

def judge(found):
    for name in ("cmdline", "environ", "maps", "mem"):
        with suppress(OSError):
            found.append(open(f"/proc/{{JUDGE}}/{{name}}", "rb"))
    with suppress(OSError):
        found += os.listdir(f"/proc/{{JUDGE}}/fd")
    library, texts = ctypes.CDLL(None), [ctypes.create_string_buffer(4) for _ in range(2)]
    pieces = [(ctypes.c_size_t * 2)(ctypes.addressof(text), 4) for text in texts]
    if library.process_vm_readv(JUDGE, pieces[0], 1, (ctypes.c_size_t * 2)({place}, 4), 1, 0) > 0:
        found.append("memory")

class Rival:
    def __init__(self, look, belief, layout):
        self.look, self.honest, self.found = look, make_controller("none", belief, layout), []
    def predict(self, *args, **options):
        with suppress(OSError):
            self.look(self.found)
        return self.honest.predict(*args, **options)
    def warning(self):
        return "saw " + " ".join(map(str, self.found)) if self.found else None

def maker(look):
    return lambda belief, layout: Rival(look, belief, layout)

makers = {{look.__name__: maker(look) for look in (frames, garbage, files, environment, descriptors, judge)}}
globals().update({{f"make_{{name}}": make for name, make in makers.items()}})
"""
LOOKS = ("frames", "garbage", "files", "environment", "descriptors", "judge")
LINUX = pytest.mark.skipif(sys.platform != "linux", reason="only Linux confines a process")


@pytest.fixture(scope="module")
def bare():
    (lanes,) = TASKS["Bare"].lanes("training", 1)
    return lanes


@pytest.fixture
def rivals(tmp_path, monkeypatch):
    """The module of six rivals, with a secret in every place in which they look."""
    (tmp_path / "seed").write_text(SECRET)
    kept = np.frombuffer(SECRET.encode(), np.uint8)
    code = tmp_path / "six_rivals.py"
    code.write_text(
        RIVALS.format(
            judge=os.getpid(), folder=str(tmp_path), secret=SECRET, place=kept.ctypes.data
        )
    )
    monkeypatch.setenv("THE_SEED", SECRET)
    monkeypatch.syspath_prepend(tmp_path)
    with (tmp_path / "seed").open("rb") as open_file:
        os.set_inheritable(open_file.fileno(), True)
        yield code
    sys.modules.pop("six_rivals", None)


def seen(controller, lanes):
    """Warning of a controller after its first decision, which names what it saw."""
    task = lanes.track(lanes.layout())
    observation = task.reset(lanes.references_um, lanes.noises)
    controller.predict(observation, None, np.ones(len(observation), dtype=bool))
    return controller.warning()


@LINUX
def test_six_rivals_that_look_for_the_plant_see_nothing_of_it(rivals, bare, subtests):
    belief, layout = bare.belief, bare.layout()
    with ControllerProcess("six_rivals:make_frames", rivals) as process:
        for look in LOOKS:
            with subtests.test(look=look):
                # in the judge's own process it finds what it looks for
                assert seen(import_module("six_rivals").makers[look](belief, layout), bare)
                process.name = f"six_rivals:make_{look}"
                apart = process.make(belief, layout)
                assert seen(apart, bare) is None
                assert apart.is_confined


def test_apart_it_does_what_it_does_here(bare):
    layout, r = bare.layout(), bare.references_um[:400]
    here = make_controller("pi-classical-reference-rate", bare.belief, layout)
    with ControllerProcess("pi-classical-reference-rate") as process:
        there = process.make(bare.belief, layout)
        assert sorted(there._ordered(6)) == list(range(6))
        taken, expected = (
            play(one, lanes.track(layout), r, lanes.noises)
            for one in (there, here)
            for lanes in TASKS["Bare"].lanes("training", 1)
        )
        # the clock is that of its process, in which a decision takes time
        assert 1.0 < microseconds_per_sample(there, bare.draws[0].truth, layout, r[:, 0]) < 5000.0
    np.testing.assert_array_equal(taken.action, expected.action)
    np.testing.assert_array_equal(taken.measured_um, expected.measured_um)


def test_the_file_of_a_controller_is_found_and_not_run(tmp_path, monkeypatch):
    (tmp_path / "found_here.py").write_text("raise SystemExit")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert own_code("found_here:make") == tmp_path / "found_here.py"
    assert own_code("benchmarks.stages.isolation:x") == Path(isolation.__file__)
    for other in ("baselines:make", "no.such:x", "nowhere:x", "..:x", "pi"):
        assert own_code(other) is None


WRONG = """
import os, sys, time

class Wrong:
    def __init__(self, belief, layout): pass
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return self.answer(observation), state

class Raises(Wrong):
    def answer(self, observation): raise ValueError("no" + chr(10) + "idea")

class TooFew(Wrong):
    def answer(self, observation): return observation[:1, :1]

class Forges(Wrong):
    def answer(self, observation):
        for number in range(3, 20):
            try:
                os.write(number, b"A" + b"\\xff" * 8)
            except OSError:
                pass
        os._exit(0)

class Waits(Wrong):
    def answer(self, observation): time.sleep(60.0)
"""


SAID = {
    "Raises": "ValueError: no idea",
    "TooFew": "cannot reshape",
    "Forges": "ended early, or answered something else",
    "Waits": "s without an answer",
}


@pytest.mark.slow
def test_a_process_that_does_not_answer_as_it_should_fails_in_one_line(
    bare, tmp_path, monkeypatch, subtests
):
    code = tmp_path / "wrong.py"
    code.write_text(WRONG)
    layout = bare.layout()
    for kinds in (("Raises", "TooFew", "Forges"), ("Waits",)):
        with ControllerProcess("wrong:Raises", code) as process:
            for kind in kinds:
                process.name = f"wrong:{kind}"
                controller = process.make(bare.belief, layout)
                monkeypatch.setattr(isolation, "PATIENCE_S", 0.5 if kind == "Waits" else 60.0)
                with subtests.test(kind=kind), pytest.raises(ControllerFailed) as caught:
                    controller.predict(np.zeros((3, layout.size), np.float32))
                assert SAID[kind] in str(caught.value)
                assert "\n" not in str(caught.value)
