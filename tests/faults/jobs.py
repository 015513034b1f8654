"""Every writer of the project on a small job, disturbed: `python -m tests.faults.jobs FOLDER`."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from rdpi_gym.support import files
from rdpi_gym.support.files import (
    read_json,
    replaced_folder,
    settled_folder,
    write_atomic,
    write_json,
)
from rdpi_gym.support.store import named_rows
from tests.faults.injection import Job, disturb, without_waiting

ROWS = [{"key": f"case {k}", "value": k / 3, "words": "a µm" * k} for k in range(6)]


def whole_file() -> Job:
    """A file that replaces an older one."""

    def write(folder: Path, value: str) -> None:
        write_json(folder / "a.json", {"format": "mine", "version": 1, "value": value})

    return Job(
        "file",
        lambda f: write(f, "old"),
        lambda f: write(f, "new" * 5000),
        lambda f: read_json(f / "a.json", "mine", 1)["value"],
    )


def new_file() -> Job:
    """A file in a folder that is not there yet."""
    path = Path("deep", "down", "a.txt")

    def read(folder: Path) -> Any:
        return (folder / path).read_text() if (folder / path).exists() else None

    return Job("new file", lambda f: None, lambda f: write_atomic(f / path, "new"), read)


def whole_folder(exchange: bool) -> Job:
    """A folder that replaces an older one: in one step, and by the two renames of other systems."""

    def write(folder: Path, value: str) -> None:
        with replaced_folder(folder / "set") as fresh:
            write_atomic(fresh / "a.txt", value)
            write_atomic(fresh / "b.txt", value)

    def read(folder: Path) -> Any:
        place = settled_folder(folder / "set")
        return {path.name: path.read_text() for path in place.iterdir()}

    def work(folder: Path) -> None:
        own = files._exchange if exchange else lambda one, other: False
        with patch.object(files, "_exchange", own):
            write(folder, "new")

    name = f"folder, {'one step' if exchange else 'two renames'}"
    return Job(name, lambda f: write(f, "old"), work, read)


def policy() -> Job:
    """A trained policy saved over an older one."""
    from torch import nn

    from baselines.learned.policy import Policy
    from rdpi_gym.envs.layout import ObservationLayout
    from rdpi_gym.plant import named_plant

    layout = ObservationLayout.for_plant(named_plant("P10"), ts_s=1e-4, action="increment")
    actor = nn.Sequential(nn.Linear(layout.size + 6, 4), nn.Tanh(), nn.Linear(4, 1), nn.Hardtanh())
    old, new = (Policy(layout, 2, hz, 0.02, actor) for hz in (100.0, 200.0))

    def read(folder: Path) -> Any:
        found = Policy.load(folder / "policy")
        return found.frequency_hz, found.network

    saves = [lambda f, each=each: each.save(f / "policy") for each in (old, new)]
    return Job("policy", *saves, read)


def rows(damage: Callable[[Path], None] | None = None, stale: bool = False) -> Job:
    """Rows appended one by one: to a whole file, to one with a damaged line, to one with old rows."""

    def prepare(folder: Path) -> None:
        named_rows(folder / "rows.jsonl").append([*ROWS[:2], {"key": "old", "value": 0}])
        if damage is not None:
            damage(folder / "rows.jsonl")

    def work(folder: Path) -> None:
        store = named_rows(folder / "rows.jsonl")
        if stale:
            store.set_aside(lambda row: row["key"] == "old")
        for row in ROWS:
            if row["key"] not in store.rows:
                store.append([row])

    def read(folder: Path) -> Any:
        found = dict(named_rows(folder / "rows.jsonl").rows)
        kept = [dict(named_rows(path).rows) for path in folder.glob("rows-stale-*.jsonl")]
        assert "old" in found or not stale or any("old" in each for each in kept), "a row is lost"
        return {key: row for key, row in found.items() if key != "old" or not stale}

    name = "rows" + (", a damaged line" if damage else "") + (", stale rows" if stale else "")
    return Job(name, prepare, work, read, _are_rows)


def candidates() -> Job:
    """Visited sets of a search, stage by stage, visited where they are missing."""
    from tests.faults.sets import evidence, made, read_stages

    found, here = made(), evidence()

    def work(folder: Path, most: int = 3) -> None:
        from rdpi_gym.diagnosis.beam.checkpoint import Checkpoint

        checkpoint = Checkpoint(folder / "candidates.jsonl", here)
        for name, one in list(found.items())[:most]:
            checkpoint.stage(name, {}, lambda one=one: [one])  # type: ignore[misc]

    def read(folder: Path) -> Any:
        return read_stages(folder / "candidates.jsonl", here)

    return Job("candidates of a search", lambda f: work(f, 1), work, read, _are_rows)


def benchmark() -> Job:
    """`rdpi bench` of two controllers on one reference, row by row and its table."""
    from benchmarks.rows import TRACKING
    from benchmarks.tracking.run import benchmark as run
    from benchmarks.tracking.selection import select

    selection = select(["none", "classical-static"], ["P5"], ["sine"], [1e-2], [0])
    columns = ("controller", "reference", "frequency_hz", "rmse_um", "status")

    def work(folder: Path) -> None:
        found = run(selection, folder / "out", jobs=1)
        lines = [[row[name] for name in columns] for row in found.rows]
        write_atomic(folder / "out" / "table.json", json.dumps(lines))

    def read(folder: Path) -> Any:
        scores = TRACKING.open(folder / "out").rows
        found = {key: [row[name] for name in columns] for key, row in scores.items()}
        table = folder / "out" / "table.json"
        return found | ({"table": json.loads(table.read_text())} if table.exists() else {})

    return Job("benchmark", lambda f: None, work, read, _are_rows)


def _are_rows(found: Any, old: Any, new: Any) -> bool:
    """Whether no row is lost that was there, and none is another than it should be."""
    return old.items() <= found.items() <= new.items()


def _tear(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content.replace(b'"value": 0.3', b'"value": 0.4') + b'{"key": "ca')


def main(folder: Path) -> None:
    """Disturb every job and print how often."""
    without_waiting()
    # what imports most comes last: a fork takes the longer, the more there is to it
    makers = (
        whole_file, new_file, partial(whole_folder, True), partial(whole_folder, False), rows,
        partial(rows, _tear), partial(rows, stale=True), candidates, benchmark, policy,
    )  # fmt: skip
    counts = {}
    for make in makers:
        began = time.perf_counter()
        try:
            job = make()
        except ModuleNotFoundError as error:
            print(f"{make}: not disturbed, {error.name} is not installed")
            continue
        done = disturb(job, folder / "disturbed")
        counts[job.name] = done
        modes = ", ".join(f"{count} {mode}" for mode, count in done.items())
        print(f"{job.name}: {done.total()} faults ({modes}), {time.perf_counter() - began:.1f} s")
    print(f"in all: {sum(done.total() for done in counts.values())} faults")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
