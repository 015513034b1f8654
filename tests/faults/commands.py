"""Commands that write, killed at random times and given again: `python -m tests.faults.commands FOLDER [SEED]`.

After a kill every file is one that an undisturbed run writes, whole; the same command then ends as
that run did, and nothing is left beside.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

CHEAP = ("fit", "export c")
"""Commands of every test run."""
_TIMED = ("tasks.md", "tasks.csv", "leaderboard.md", "leaderboard.csv")
"""Files with times of a machine, which two runs may round alike and a third may not."""
_DATA = ("data/stairs.csv", "data/validation-stairs.csv")


def commands() -> dict[str, list[str]]:
    """Words of each command; `data` is a folder of records, `model.json` a model of them."""
    found = {
        "simulate": ["simulate", "--model", "P5", "--hide", "creep", "--ts-factor", "4"],
        "fit": ["fit", "data", "--plays", "3"],
        "fit a core": ["fit", "data", "--core", "stop"],
        "compare": ["compare", "data", "--model", "model.json"],
        "diagnose": ["diagnose", "data", "--model", "model.json", "--jobs", "1"],
        "discover": ["discover", "data", "--jobs", "1"],
        "add": ["add", "creep", "data", "--model", "model.json", "--jobs", "1"],
        "bench": [
            *("bench", "--controllers", "none,classical-static", "--plants", "P5"),
            *("--references", "sine", "--ts", "0.01", "--seeds", "2", "--jobs", "1"),
        ],
        "bench a task": [
            *("bench", "--task", "Bare", "--controllers", "none,pi", "--draws", "1", "--jobs", "1")
        ],
        "submit": ["submit", "pi", "--task", "Bare", "--draws", "1", "--jobs", "1"],
        "export c": ["export", "c", "model.json"],
        "export fmu": ["export", "fmu", "model.json", "--out", "out/a.fmu"],
        "export onnx": ["export", "onnx", "ppo-increment", "--out", "out/a.onnx"],
    }
    return {
        name: words if "--out" in words else [*words, "--out", "out"]
        for name, words in found.items()
    }


def run(words: Sequence[str], folder: Path, kill_s: float | None = None) -> int:
    """Give a command in a forked process, and perhaps kill it after a time."""
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        os.chdir(folder)
        silent = os.open("log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        status = 70
        try:
            from rdpi_gym.cli import main

            status = main(list(words))
        finally:
            os._exit(status)
    if kill_s is not None:
        time.sleep(kill_s)
        os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def seen(folder: Path) -> dict[str, bytes]:
    """Return the files that a command left by their names, its temporaries (files and folders) among them."""
    beside = [path for path in folder.glob(".*") if path.name.endswith(".tmp")]
    files = [
        path
        for root in (folder / "out", *beside)
        for path in (root, *sorted(root.rglob("*")))
        if path.is_file()
    ]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def disturb(name: str, words: Sequence[str], folder: Path, rng: random.Random, kills: int) -> str:
    """Kill a command some times, give it again each time, and describe the runs.

    Raises AssertionError where a file is a part, or a rerun ended otherwise, or left something beside.
    """
    prepared(folder)
    undisturbed: list[Mapping[str, bytes]] = []
    took_s = 0.0
    for _ in range(2):  # the first may compile; what differs between the two holds times
        _emptied(folder)
        began = time.perf_counter()
        status = run(words, folder)
        took_s = time.perf_counter() - began
        assert status == 0, f"{name}: {(folder / 'log.txt').read_text()[-1000:]}"
        undisturbed.append(seen(folder))
    whole = undisturbed[1]
    same = {
        path
        for path, content in whole.items()
        if undisturbed[0].get(path) == content and Path(path).name not in _TIMED
    }
    killed = 0
    for _ in range(kills):
        _emptied(folder)
        kill_s = rng.uniform(0.1, 1.05) * took_s
        killed += run(words, folder, kill_s) == -signal.SIGKILL
        where = f"{name}, killed after {kill_s:.3f} of {took_s:.3f} s"
        for path, content in seen(folder).items():
            is_hidden = any(part.startswith(".") for part in Path(path).parts)
            is_part = path in same and content != whole[path] and not path.endswith(".jsonl")
            assert is_hidden or not is_part, f"{where}: {path} is a part"
        status = run(words, folder)
        assert status == 0, f"{where}: {(folder / 'log.txt').read_text()[-1000:]}"
        again = seen(folder)
        assert sorted(again) == sorted(whole), f"{where}: {sorted(again)}, not {sorted(whole)}"
        others = [path for path in same if again[path] != whole[path]]
        assert not others, f"{where}: a rerun wrote others, {others}"
    return f"{name}: {kills} runs, {killed} killed in {took_s:.2f} s, {len(whole)} files, {len(same)} the same in all"


def prepared(folder: Path) -> None:
    if (folder / "model.json").exists():
        return
    from rdpi_gym.plant import named_plant

    folder.mkdir(parents=True, exist_ok=True)
    assert run([*commands()["simulate"][:-1], "made"], folder) == 0
    (folder / "data").mkdir()
    for name in _DATA:
        shutil.copyfile(folder / "made" / name, folder / name)
    named_plant("P5").save(folder / "model.json")


def _emptied(folder: Path) -> None:
    out = folder / "out"
    if out.is_file():
        out.unlink()
    shutil.rmtree(out, ignore_errors=True)


def main(folder: Path, seed: int) -> None:
    """Disturb every command, and say what cannot be disturbed here."""
    import rdpi_gym.cli  # forked children need not import it

    print(f"seed {seed}, {rdpi_gym.cli.__name__}")
    rng, wrong = random.Random(seed), 0
    for name, words in commands().items():
        began = time.perf_counter()
        try:
            said = disturb(name, words, folder, rng, 4)
            print(said, f"{time.perf_counter() - began:.1f} s", flush=True)
        except AssertionError as error:
            wrong += 1
            print(f"WRONG {error}", flush=True)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int((sys.argv[2:] or ["0"])[0]))
