"""The page of the registered tasks, from what their files declare: `python -m studies.tasks_page`."""

from __future__ import annotations

import csv
import re
import sys
from argparse import Namespace
from pathlib import Path

from baselines import HORIZON_BOUND
from benchmarks.stages.entries import INFORMATION, NEUTRAL, RIGHT_KIND
from benchmarks.stages.isolation import KEPT_VARIABLES, PATIENCE_S
from benchmarks.stages.run import FEWEST_DIGITS
from rdpi_gym.envs.tasks import PUBLIC_SEED, TASKS, StageTask
from rdpi_gym.envs.tasks.environment import page_of
from rdpi_gym.support.markdown import table
from rdpi_gym.support.words import joined
from studies.runner import Files, Study

OUT = Path(__file__).parents[1] / "docs"
PAGE = "tasks.md"

PREVIEW = next(iter(TASKS.values())).preview
KEPT = ", ".join(f"`{name}`" for name in KEPT_VARIABLES)

BOUNDED = Path(__file__).parent / "results" / "stages" / "information" / "tasks.csv"


def _nearest() -> str:
    """Return the first of each task of the table with the information bound, and its IQM over that."""
    with BOUNDED.open(encoding="utf-8") as file:
        first = [row for row in csv.DictReader(file) if row["rank"].rstrip("=") == "1"]
    ratios = (f"{float(row['iqm_information']):.3g} on {row['task']}" for row in first)
    return joined(list(ratios))


_HEAD = f"""\
# The registered tasks

**{len(TASKS)} stages, each with references, belief and protocol of a score.** Most are the paper's plant
with what a stage in a laboratory has besides; four have the hysteresis of a measured stack. Each is an environment of Gymnasium
and a column of the ranking; a rank on one says little about another.

<!-- written by `python -m studies.tasks_page` -->

"""

_USE = f"""
## Train and tune

`gymnasium.make(id)` draws a training plant, reference and noise at every reset. To tune a controller, draw plants as lanes:

```python
from rdpi_gym.envs.tasks import TASKS

(lanes,) = TASKS["Stage"].lanes("training", plants=2)
layout = lanes.layout()  # what is shown, with the task's preview
task = lanes.track(layout)  # reset it with lanes.references_um and lanes.noises, then step
print(lanes.belief.name, lanes.references_um.shape)
```

```text
P10 stage (2500, 12)
```

Training, validation and test plants have random words of their own: no seed makes one the other. A controller is told `lanes.belief`, the nominal plant with its nominal effects: the truth is up to 5 % off in every number of the
hysteresis and up to 40 % in every parameter of an effect.

`gymnasium.make_vec(id, num_envs=4096)` runs thousands of a task's plants [in one kernel](vector-environment.md). Options of both:

- `limits`: those of the task unless given. `info["cost"]` sums `cost_saturation`, `cost_rate`, `cost_ringing`, `cost_stroke`, each 0 or 1, as in Safety-Gymnasium.
- `privileged=True`: `info["privileged"]`, latent parameters for a critic, named by `env.unwrapped.latents`.
- `max_episode_steps=10000`, or `lanes(..., samples=10000)` above: longer episodes, which begin alike.

## Score a controller

<!-- not run: takes minutes on two cores -->
```bash
rdpi bench --task Stage,Load --draws 20 --out results/tasks
rdpi bench --full --out results/full
```

The first ranks the controllers that ship on 20 test plants of two tasks, the second on 100 plants of every task; both go on where they were interrupted, and
`--ray HOST:PORT` runs them on a cluster. `--controller my_controller:make` adds your own.

[The ranking](../studies/results/stages/tasks.md) of 100 plants a task says [what figures mean](../studies/results/stages/tasks.md#what-the-figures-mean).
Beside the ranking stand `{HORIZON_BOUND}`, the bound with everybody's preview, and where others believe another kind `{RIGHT_KIND}`; `--no-bound` leaves both out. The bound of `rdpi bench` without tasks is
another one.

<!-- not run: takes minutes on two cores -->
```bash
rdpi bench --task Duhem --draws 10 --controllers hybrid,{INFORMATION} --out results/information
rdpi bench --task Stage --draws 5 --controllers hybrid --no-bound --against results/tasks/task-rows.csv.gz
rdpi bench --full --controllers hybrid --no-bound --among results/full
```

The first divides errors by the [information bound](../studies/results/stages/information/tasks.md): at best {_nearest()}.
The second says how many rows come out the same, the third scores one controller anew.

## What a controller may know

1. The observation: the reference now and {PREVIEW} samples ahead, the reading, the command; and their units, ranges and sampling time.
2. The numbers of its belief: hysteresis, effects, sensor. Every belief is named `{NEUTRAL}` and carries neither origin nor notes.

Nothing else: not the task, the kind or number of a plant, the seed, which episodes share a plant, nor an earlier run. A controller that looks up in its belief's numbers which task it is on
knows more. What knows more is listed beside the ranking, without a rank: `{RIGHT_KIND}`, `adaptive-dual-loop` told the nominal plant of the right kind; `{INFORMATION}`, which knows the plants'
distribution; `{HORIZON_BOUND}`, which knows the plant.

## Enter a leaderboard

<!-- not run: takes minutes on two cores -->
```bash
rdpi submit my_controller:make --task Stage,Load --draws 20 --out results/entry
rdpi score results/entry --seed-file secret.txt --out results/judged
```

1. Write your controller as one module: a callable `(belief, layout)` that returns something with `predict` ([how](commands.md#score-a-controller)). It may import this
   package and what is installed; other files of yours are not taken along. A trained policy is `learned:FOLDER`, or `guarded:FOLDER` with [its monitor](train-an-agent.md#a-monitor-beside-it).
2. `rdpi submit` scores it on public plants (seed {PUBLIC_SEED}) and leaves a folder: `submission.json` with the command, the tasks and a hash; the code; the rows. Send
   the folder.
3. Whoever runs the leaderboard keeps a file with one random number of {FEWEST_DIGITS} digits or more outside the repository. `rdpi score` sees that the folder is whole, that the code is what was
   hashed and that the tasks are those of this release, then draws plants from that number, which nobody has tuned on. Every table says whether its seed was public or private, with
   a hash that tells two private ones apart. Without `--seed-file` it repeats the public score and says whether the submitted rows are reproduced.

### What is guarded

Every `rdpi score`, and every score with a private seed, runs the controller in a process of its own: a name, numbers of the belief, layout and observations come through a pipe, actions go back, as arrays and
JSON. It has no argument, no environment variable beyond {KEPT}, no open file and none of the judge's frames; its folder holds the submitted code alone.

| a submission tries | Linux, Landlock on | elsewhere |
|---|---|---|
| frames, garbage collector, arguments, environment, descriptors | nothing of the plant is there | likewise |
| files: seed, rows, folders | refused, Python and its packages aside | not guarded: what the judge's user may read |
| memory and `/proc` of the judge | refused; the judge is closed (`PR_SET_DUMPABLE`), capabilities are dropped | Linux: closed unless the judge is root; else not guarded |
| programs, TCP | refused (TCP from Linux 6.7) | not guarded |
| other sockets, load | not guarded; ended after {PATIENCE_S:g} s without an answer | likewise |

Tables say where the kernel confined nothing. A public score is a claim: its plants follow from the seed. A score within 5 % of `{HORIZON_BOUND}` is marked †: read its code. A sandbox guards the score, not the machine:
score where you would run any stranger's code. Decisions are timed by that process's processor time on a training plant, the first few left out.
"""


def _files(options: Namespace) -> Files:
    return {PAGE: page_text()}


def page_text() -> str:
    """Return the page."""
    rows = [
        [
            f"[{task.name}](#{task.name.lower()})",
            task.title,
            f"{1e3 * task.ts_s:g}",
            str(len(task.references)),
            str(task.history),
        ]
        for task in TASKS.values()
    ]
    head = ["task", "what it is", "Ts (ms)", "references", "history (samples)"]
    return (
        _HEAD
        + table(head, rows, right=(2, 3, 4))
        + "\n"
        + _USE
        + f"\nEach of the other tasks says in what it differs from {next(iter(TASKS))}.\n"
        + "".join(map(_section, TASKS.values()))
    )


def _section(task: StageTask) -> str:
    """Return the section of a task: of all but the first, the sentences in which it differs from that."""
    first = next(iter(TASKS.values()))
    (_, title), *parts = _parts(task)
    known: set[str] = set()
    if task is not first:
        known.update(each.strip() for _, text in _parts(first) for each in _sentences(text))
    lines = [f"\n## {task.name}", f"**{title}** `{task.id}`"]
    for heading, text in parts:
        kept = "".join(each for each in _sentences(text) if each.strip() not in known)
        if kept.strip():
            lines += [heading, kept.strip()]
    return "\n\n".join(lines) + "\n"


def _parts(task: StageTask) -> list[tuple[str, str]]:
    """Return title and sections of a task's own page, each with its heading."""
    title, *sections = page_of(task).partition("\n```python")[0].split("\n## ")
    apart = (section.partition("\n") for section in sections)
    return [("", title.strip()), *((f"### {head}", text.strip()) for head, _, text in apart)]


def _sentences(text: str) -> list[str]:
    return re.split(r"(?<=\. )|(?<=\n\n)", text)


main = Study("tasks_page", __doc__, _files, OUT)

if __name__ == "__main__":
    sys.exit(main())
