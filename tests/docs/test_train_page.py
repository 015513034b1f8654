"""The pages on agents: filled from committed tables alone, in words that these bear out."""

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("torch")

from baselines.learned.options import PLANTS, REFERENCES, TrainingOptions
from benchmarks.effect_discovery.__main__ import options
from benchmarks.tracking.stages import NOISE_UM
from rdpi_gym.cli import main as rdpi
from rdpi_gym.envs import PiezoTrackingEnv
from rdpi_gym.envs.truth import RATE_BANDWIDTH_HZ
from rdpi_gym.plant import P10
from rdpi_gym.support.errors import InputError
from rdpi_gym.support.files import write_atomic, write_json
from studies.agents.__main__ import DOCS, OUT, STAGES
from studies.agents.__main__ import main as agents
from studies.agents.page import (
    FILE,
    HYPERPARAMETERS,
    PAGES,
    RUN,
    STEPS,
    WALK,
    Recorded,
    page_facts,
    page_texts,
    take_walk,
    walk_template,
)
from studies.agents.scores import GROUPS, LITERAL, TS_S
from studies.agents.tables import gap_summary, summarise
from studies.agents.training import FULL, QUICK
from studies.pages import TEMPLATES
from tests.looping import over

ROOT = Path(__file__).parents[2]
TRAIN, AGENTS = (TEMPLATES[name].read_text(encoding="utf-8") for name in (WALK, "agents"))
# RMSE (%) by group: the feedforward, PI, and an agent that is ahead where PI is unstable.
ERRORS = {
    "all": (2.2, 280.0, 0.5),
    "lag": (1.6, 0.5, 0.45),
    "resonance": (1.0, 300.0, 0.6),
    "creep": (1.4, 0.1, 0.4),
    "bare": (1.2, 0.09, 0.4),
}


def scores(worlds):
    """Scores of three contestants, the agent trained twice, on plants that are much alike."""
    rows = []
    for world, errors in worlds.items():
        lanes = [("feed", "feedforward", None), ("pi", "feedback", None)]
        lanes += [("ppo-increment", "agent", seed) for seed in range(2)]
        for plant in range(4):
            for name, kind, seed in lanes:
                error = errors[("feedforward", "feedback", "agent").index(kind)]
                rows.append(
                    {
                        "contestant": name, "kind": kind, "training_seed": seed, "world": world,
                        "plant_seed": plant, "rmse_percent": error * (1 + 0.01 * plant),
                        "command_variation_V_s": 1.2 if kind == "agent" else 1.0,
                    }
                )  # fmt: skip
    return pd.DataFrame(rows)


def curve(agent, seed):
    steps = np.arange(0, 21) * 75_000
    frame = pd.DataFrame({"agent": agent, "seed": seed, "timesteps": steps})
    return frame.assign(
        seconds=5.0 + steps / 15_000, rmse_um=40.0 / (1 + steps / 20_000), rmse_percent=1.0,
        command_variation_V_s=6000.0, reward=-1.0 / (1 + steps), compensator_rmse_um=1.0,
        compensator_rmse_percent=1.25, compensator_command_variation_V_s=5000.0,
    )  # fmt: skip


def commands(text, program="rdpi"):
    """Commands that a reader would type, from blocks that show them."""
    lines = "\n".join(re.findall(r"^```(?:console|bash)\n(.*?)^```$", text, re.M | re.S))
    found = [line.removeprefix("$ ").partition(" #")[0] for line in lines.splitlines()]
    return [line for line in found if line.startswith(f"{program} ")]


def write_results(folder, errors=ERRORS, study=FULL):
    table = scores(errors)
    summarise(table, 50).to_csv(folder / "summary.csv", index=False)
    domains = {"with effects": (2.2, 280.0, 0.5), "bare": (1.2, 0.09, 0.4)}
    both = domains | {f"{name}{LITERAL}": each for name, each in domains.items()}
    gap_summary(scores(both), 50).to_csv(folder / "gap.csv", index=False)
    curves = pd.concat([curve("ppo-increment", seed) for seed in range(2)])
    curves.to_csv(folder / "curves.csv", index=False)
    shipped = {
        "agent": "ppo-increment", "seed": 1, "rmse_percent": 0.5, "trainings": 2,
        "best_percent": 0.4, "worst_percent": 0.5, "policy_bytes": 35_000,
    }  # fmt: skip
    pd.DataFrame([shipped]).to_csv(folder / "shipped.csv", index=False)
    shown = re.findall(r"^\$ (.*)$", walk_template(study), re.M)
    walk = {
        "format": "walk", "version": 1, "cores": 2, "seconds": 200.0,
        "commands": [{"command": c, "seconds": 50.0, "printed": [f"said {i}"]} for i, c in enumerate(shown)],
        "curve": curve("x", 0).drop(columns=["agent", "seed"]).to_dict("records"),
    }  # fmt: skip
    write_json(folder / FILE, walk)
    return folder


def test_committed_pages_are_what_the_command_makes():
    for name, text in page_texts(FULL, OUT).items():
        committed = (DOCS / f"{name}.md").read_text(encoding="utf-8")
        assert committed == text, "run python -m studies.agents --stage page"


def test_pages_are_filled_and_say_what_the_tables_say(tmp_path):
    pages = page_texts(FULL, write_results(tmp_path))
    assert set(pages) == {WALK, "agents"}
    for text in pages.values():
        assert "{{" not in text
        assert "<!-- claim" not in text
    walk, standing = pages[WALK], pages["agents"]
    assert "took 3.3 minutes on 2 cores" in walk
    assert "$ python use_agent.py\nsaid 3\n```" in walk
    assert "| 1,500,000 | 105 |" in walk
    # 40 µm / (1 + steps / 20,000) passes 1 µm between 750,000 and 825,000 steps.
    assert "After 825,000 steps the error is below" in walk
    assert "| all | feed: 2.23 | pi: 284 | 1 of 1 | 0.508 |" in standing
    assert "- **all**: ahead of every causal compensator. `ppo-increment` has 0.227 (" in standing
    assert "- **creep**: behind the best compensator. `ppo-increment` has 4 (" in standing
    assert "- **lag**: ahead" in standing
    assert "| Stage | `imitation-stage`: " in standing
    assert "| ppo-increment | 1 | 0.5 | 2 | 0.4 to 0.5 | 35,000 bytes |" in standing


def test_the_stage_writes_both_pages_and_a_quick_one_not_over_the_published(tmp_path, capsys):
    asked = ["--quick", "--stage", "page", "--out", str(write_results(tmp_path, study=QUICK))]
    assert agents(asked) == 0
    written = {path.stem: path.read_text() for path in (tmp_path / "docs").iterdir()}
    assert written == page_texts(QUICK, tmp_path)
    assert str(DOCS) not in capsys.readouterr().out


def test_what_cannot_be_told_apart_is_said_so(tmp_path):
    write_results(tmp_path)
    table = scores(ERRORS)
    # Plants of half and of twice the error: the interval of the ratio holds 1.
    own = (table["world"] == "lag") & (table["kind"] == "agent")
    table.loc[own, "rmse_percent"] = 0.5 * table.loc[own, "plant_seed"].map(
        {0: 0.4, 1: 0.5, 2: 2.0, 3: 2.5}
    )
    summarise(table, 200).to_csv(tmp_path / "summary.csv", index=False)
    facts = page_facts(tmp_path)
    assert facts["verdicts"]["lag"] == "level"
    assert "**lag**: not to be told from the best" in facts["findings"]["standing"]


@over(
    "group, errors, said",
    [
        ("bare", (1.2, 0.5, 0.4), "verdicts.bare is ahead, the prose says = behind"),
        ("all", (2.2, 1.5, 0.5), "best_kinds.all is feedback"),
        ("resonance", (1.0, 30.0, 0.6), "unstable.resonance is 0"),
    ],
)
def test_tables_that_contradict_the_prose_are_refused(tmp_path, group, errors, said):
    with pytest.raises(InputError, match=re.escape(said)):
        page_texts(FULL, write_results(tmp_path, ERRORS | {group: errors}))


@over("name", ["summary.csv", "gap.csv", "curves.csv", "shipped.csv", FILE])
def test_a_missing_result_is_named(tmp_path, name):
    (write_results(tmp_path) / name).unlink()
    with pytest.raises(InputError, match=re.escape(name)):
        page_texts(FULL, tmp_path)


def test_a_walk_is_taken_command_by_command(tmp_path):
    template = (
        "Prose with {{agents.json:nothing}}.\n\n```python train.py\nfrom pathlib import Path\n"
        f"out = Path('{RUN}')\nout.mkdir(parents=True)\n"
        "(out / 'training.csv').write_text('timesteps,training_reward,rmse_um\\n0,,3.5\\n')\n"
        "print('done')\n```\n\n```bash\nrm -r nothing\n```\n\n```console\n$ python train.py\n```\n"
    )
    walk = take_walk(template)
    (command,) = walk["commands"]
    assert (command["command"], command["printed"]) == ("python train.py", ["done"])
    assert command["seconds"] == walk["seconds"]
    assert walk["curve"] == [{"timesteps": 0, "rmse_um": 3.5}]
    assert Recorded(tmp_path, walk).run("python train.py") == ["done"]
    with pytest.raises(InputError, match="run --stage walk again"):
        Recorded(tmp_path, walk).run("python other.py")


def test_a_quick_walk_trains_for_a_few_steps():
    assert f"--timesteps {STEPS} --out {RUN}\n" in walk_template(FULL)
    assert f"--timesteps {QUICK.timesteps} --out {RUN}\n" in walk_template(QUICK)


def test_commands_on_other_machines_are_understood():
    studies = [line for line in commands(TRAIN, "python") if " -m " in line]
    hidden, trained = (shlex.split(line)[2:] for line in studies)
    assert hidden[0] == "benchmarks.hidden_effects"
    assert options().read(hidden[1:]).ray == "HOST:6379"
    assert trained[:3] == ["studies.agents", "--stage", STAGES[0]]


def test_it_trains_on_a_discovered_model(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    from baselines.learned import environments

    for name, value in {"LANES": 4, "SAMPLES": 30, "FIRST": 5}.items():
        monkeypatch.setattr(environments, name, value)
    monkeypatch.chdir(tmp_path)
    write_atomic(
        "small.yml", "default: {n_envs: 4, n_timesteps: 64, n_steps: 16, batch_size: 32}\n"
    )
    found = ROOT / "benchmarks" / "payoff" / "beliefs" / "p10-creep-discovered.json"
    (line,) = [line for line in commands(TRAIN) if "results/own-agent" in line and "train" in line]
    line = line.replace("results/found/model.json", str(found)).replace(str(STEPS), "64")
    assert rdpi([*shlex.split(line)[1:], "--hyperparameters", "small.yml"]) == 0
    assert (tmp_path / "results" / "own-agent" / "policy" / "policy.json").is_file()


def test_numbers_of_the_prose_are_those_of_the_code():
    options = TrainingOptions(Path("unused"))
    for said in (
        f"{options.episode} samples of {1e3 * options.ts_s:g} ms",
        f"{options.frequency_hz[0]:g} to {options.frequency_hz[1]:g} Hz",
        f"and {options.preview} samples ahead",
        f"({'`--command-cost`'}, {options.command_cost:g} in a training)",
        f"low-passed at {RATE_BANDWIDTH_HZ:g} Hz",
        f"mode at {PLANTS[0].effects[2].f0_hz:g} Hz",
        "`correction`, the default,",
    ):
        assert said in TRAIN, said
    assert options.action == "correction"
    assert REFERENCES[:2] == ("sine", "triangle")
    assert "steps" not in FULL.references
    low, high = P10.command_range_V
    layout = PiezoTrackingEnv(plant=P10, action="increment").layout
    assert layout.action_scale_V == pytest.approx(0.05 * (high - low))
    for said in (
        f"within {100 * options.randomise:g} % of\nnominal",
        f"those of the effects within {100 * options.randomise_effects:g} %",
        f"the sensor has {1e3 * NOISE_UM:g} nm of noise",
        f"Ts is {1e3 * TS_S:g} ms",
        f"mode at {GROUPS[0].nominal.effects[2].f0_hz:g} Hz",
        f"shown {options.preview} samples",
    ):
        assert said in AGENTS, said


def test_evaluations_are_as_many_as_the_prose_says():
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO

    from baselines.learned import environments
    from baselines.learned.options import Run

    assert f"evaluated on {environments.LANES} plants" in TRAIN
    run = Run.open(TrainingOptions(Path("unused"), timesteps=STEPS), "ppo", PPO)
    assert "Twenty times in a training" in TRAIN
    assert run.every * 20 == STEPS
    assert run.settings.history == page_history() == 16
    assert "from 16 samples of history" in AGENTS
    assert f"{run.settings.history} samples, {1e3 * run.settings.history * TS_S:g} ms" in AGENTS


def page_history():
    text = (HYPERPARAMETERS / "sac.yml").read_text(encoding="utf-8")
    return int(re.findall(r"history: (\d+)", text)[0])


def test_links_within_the_pages_lead_to_headings():
    pages = {
        f"{name}.md": path.read_text(encoding="utf-8")
        for name, path in TEMPLATES.items()
        if name in PAGES
    }
    headings = {
        name: {re.sub(r"[^\w -]", "", line).strip().lower().replace(" ", "-") for line in re.findall(r"^##+ (.*)$", text, re.M)}
        for name, text in pages.items()
    }  # fmt: skip
    links = [link for text in pages.values() for link in re.findall(r"\]\(([^)\s]+)\)", text)]
    anchored = [link.split("#") for link in links if "#" in link]
    assert len(anchored) >= 4
    for page, anchor in anchored:
        assert anchor in headings[page], anchor
    for link in (link.partition("#")[0] for link in links):
        made = link in pages or "results/agents/" in link
        assert made or (DOCS / link).exists(), link
