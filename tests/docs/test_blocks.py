"""Every code block of README and documentation runs by itself, as it stands there.

A block runs in a process and a folder of its own. In the folder lie the files that the page shows
under a name, and the sample data that the block names. A block that is not run says why in a
comment above it; a recorded session (`console`) is made by the command that its page names.
"""

import importlib.util
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer

from rdpi_gym.cli import app
from tests.house import word_counts
from tests.looping import over

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "effects").glob("*.md")),
    *sorted((ROOT / "docs" / "sections").glob("*.md")),
    *sorted((ROOT / "examples").rglob("README.md")),
]
RUN = ("python", "bash")
# What a block may be besides: what was printed, the content of a file, a recorded session.
SHOWN = ("text", "toml", "yaml", "json", "console", "{toctree}", "{eval-rst}")

_FENCE = re.compile(
    r"(?:^<!-- (?P<mark>not run|run by): (?P<why>[^>]+) -->\n)?"
    r"^(?P<ticks>`{3,})(?P<language>\S*)(?: (?P<file>\S+))?\n(?P<code>.*?)^(?P=ticks)$"
    r"(?:\n\n?```text\n(?P<printed>.*?)^```$)?",
    re.M | re.S,
)
_MADE = re.compile(r"^<!-- console blocks: made by (?P<maker>.+) -->$", re.M)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    `mark` is ``not run`` or ``run by``, with `why`; `printed` the text block right below it.
    """

    page: Path
    line: int
    language: str
    file: str | None
    code: str
    mark: str | None
    why: str | None
    printed: str | None

    @property
    def name(self) -> str:
        return f"{self.page.relative_to(ROOT).as_posix()}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """Every fenced block of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page, text.count("\n", 0, found.start("ticks")) + 1, found["language"], found["file"],
            found["code"], found["mark"], found["why"], found["printed"],
        )
        for found in _FENCE.finditer(text)
    ]  # fmt: skip


def maker(page: Path) -> str | None:
    """The command that ran a page's console blocks and wrote down what they printed."""
    found = _MADE.search(page.read_text(encoding="utf-8"))
    return found["maker"] if found else None


def commands(page: Path) -> list[str]:
    """Commands that a reader would type: lines of bash blocks, and of consoles behind the ``$``."""
    lines = []
    for block in blocks(page):
        if block.language == "bash":
            lines += block.code.replace("\\\n", " ").splitlines()
        elif block.language == "console":
            lines += [each[2:] for each in block.code.splitlines() if each.startswith("$ ")]
    return [line.partition(" #")[0].strip() for line in lines if line.strip()]


BLOCKS = [block for page in PAGES for block in blocks(page)]
EXECUTED = [block for block in BLOCKS if block.language in RUN and block.mark is None]
POLICIES = ("results/agent/policy", "results/first-agent/policy", "results/scratch/policy")
ONNX, STEP = "results/scratch/policy.onnx", "results/stage.onnx"
LIMIT_S = 240


def write_model(folder):
    from rdpi_gym.plant import P5

    P5.save(folder / "results" / "fit" / "model.json")


def write_stage(folder):
    from baselines.learned.options import PLANTS

    PLANTS[0].save(folder / "results" / "stage.json")


def write_policy(folder):
    """A policy that was never trained: what runs it does not care."""
    pytest.importorskip("torch")
    from baselines.learned.options import PLANTS
    from baselines.learned.policy import Network, Policy
    from rdpi_gym.envs import ObservationLayout

    layout = ObservationLayout.for_plant(PLANTS[0], 1e-4, action="increment")
    actor = Network((layout.size, 1), "Tanh", "Hardtanh").build()
    for path in POLICIES:
        Policy(layout, 0, 100.0, 0.02, actor).save(folder / path)


def write_onnx(folder):
    pytest.importorskip("onnx")
    from baselines.learned.onnx_export import export_onnx
    from baselines.learned.policy import Policy

    write_policy(folder)
    export_onnx(Policy.load(folder / POLICIES[-1]), folder / ONNX)


def write_step(folder):
    pytest.importorskip("torch")
    from baselines.learned.imitation.policy import StudentPolicy
    from baselines.learned.onnx_export import export_student
    from rdpi_gym.envs.tasks import named_task

    stage = named_task("Stage")
    policy = StudentPolicy.untrained(stage.belief(), stage.layout(), 4, "adaptive-dual-loop")
    export_student(policy, folder / STEP, stage.belief())


# What lies in the folder of a block that names it.
SAMPLES = {
    "results/fit/model.json": write_model,
    "results/stage.json": write_stage,
    **dict.fromkeys(POLICIES, write_policy),
    ONNX: write_onnx,
    STEP: write_step,
}
EXTRAS = {
    "torch": "torch", "stable_baselines3": "stable_baselines3", "rdpi train": "stable_baselines3",
    "onnxruntime": "onnxruntime", "rdpi export onnx": "onnx", "learned:": "torch",
    "baselines.learned": "torch",
}  # fmt: skip


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """Sample data by name, each made once."""
    made = {}

    def find(name):
        write = SAMPLES[name]
        if write not in made:
            made[write] = tmp_path_factory.mktemp("samples")
            write(made[write])
        return made[write]

    return find


def prepare(block, folder, samples):
    for other in blocks(block.page):
        if other.file is not None:
            (folder / other.file).parent.mkdir(parents=True, exist_ok=True)
            (folder / other.file).write_text(other.code, encoding="utf-8")
    for name in SAMPLES:
        folder_of = name.removesuffix("/policy")
        written = re.search(rf"--out {re.escape(folder_of)}(?:\s|$)", block.code)
        if name in block.code and not written:
            shutil.copytree(samples(name), folder, dirs_exist_ok=True)


@pytest.mark.parametrize("block", EXECUTED, ids=[block.name for block in EXECUTED])
def test_block_runs_by_itself(block, tmp_path, samples):
    for word, module in EXTRAS.items():
        if word in block.code:
            pytest.importorskip(
                module, reason=f"{block.name} needs {module}, which an extra brings"
            )
    prepare(block, tmp_path, samples)
    python = Path(sys.executable)
    own = {
        "PATH": f"{python.parent}{os.pathsep}{os.environ.get('PATH', '')}",
        "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)]),
        "MPLBACKEND": "Agg", "COLUMNS": "100", "NO_COLOR": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1",
    }  # fmt: skip
    if block.language == "python":
        script = tmp_path / (block.file or "block.py")
        script.write_text(block.code, encoding="utf-8")
        command = [str(python), str(script)]
    else:
        command = ["bash", "-euc", block.code]
    # a process group of its own: where a block takes too long, what it started ends with it
    process = subprocess.Popen(
        command, cwd=tmp_path, env=os.environ | own, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip
    try:
        printed, said = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        pytest.fail(f"{block.name} took more than {LIMIT_S} s")
    assert process.returncode == 0, said[-3000:]
    if block.printed is not None:
        assert printed.rstrip() == block.printed.rstrip()


def test_a_block_is_of_a_known_kind_or_says_why_it_is_not_run():
    for block in BLOCKS:
        assert block.language in (*RUN, *SHOWN), f"{block.name}: {block.language or 'no language'}"
        if block.mark == "run by":
            other = ROOT / block.why
            assert block.page.name in other.read_text(encoding="utf-8"), block.name
        elif block.mark == "not run":
            assert len(block.why) > 20, f"{block.name}: {block.why!r} is no reason"
        if block.language == "console":
            assert maker(block.page) is not None, f"{block.name}: no command has recorded it"


def test_no_page_indents_commands_in_place_of_a_block():
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
        found = re.findall(r"^ {4}(?:rdpi|python|pip|make) .*$", text, re.M)
        assert not found, f"{page.name}: {found}"


@over("page", PAGES)
def test_commands_that_a_page_shows_or_mentions_exist(page):
    group = typer.main.get_command(app)
    context = group.make_context("rdpi", [], resilient_parsing=True)
    known = set(group.list_commands(context))
    for line in commands(page):
        words = shlex.split(line)
        if words[:1] == ["rdpi"] and words[1:2] and words[1] in known:
            understood(group, context, words[1:])
        if words[:2] == ["python", "-m"]:
            assert runnable(words[2]), line
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`rdpi ([a-z]+)\b", text):
        assert name in known, f"rdpi {name}"
    for module in re.findall(r"python -m ([\w.]+)", text):
        assert runnable(module.rstrip(".")), f"python -m {module}"


def understood(group, context, words):
    """Parse a command, and the command inside it where it is a group."""
    name, *rest = words
    made = group.get_command(context, name).make_context(name, rest, parent=context)
    if isinstance(made.command, typer.core.TyperGroup) and rest:
        understood(made.command, made, rest)


def runnable(module):
    """Whether ``python -m MODULE`` finds something to run."""
    if module.partition(".")[0] not in ("rdpi_gym", "baselines", "benchmarks", "studies", "tests"):
        return importlib.util.find_spec(module.partition(".")[0]) is not None
    path = ROOT.joinpath(*module.split("."))
    return path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()


@over("page", PAGES)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
        if link.startswith("gallery/"):  # made when the site is built
            name = Path(link).name
            assert name == "index" or (ROOT / "examples" / "gallery" / f"{name}.py").is_file(), link
        elif "://" not in link:
            assert (page.parent / link).exists(), link


def test_makers_of_recorded_sessions_exist():
    for page in PAGES:
        if (command := maker(page)) is not None:
            assert runnable(command.split()[2]), command


def pictures_without_text(markdown):
    """Pictures of a page, in Markdown or HTML, that a screen reader can only name by their file."""
    text = re.sub(r"^```.*?^```$", "", markdown, flags=re.M | re.S)
    found = [
        target for alt, target in re.findall(r"!\[(.*?)\]\(([^)\s]+)", text) if not alt.strip()
    ]
    tags = re.findall(r"<img\b[^>]*>", text)
    return found + [tag for tag in tags if not re.search(r"\balt=([\"'])\s*[^\s\"'].*?\1", tag)]


def test_every_picture_has_an_alternative_text():
    assert pictures_without_text('![](a.png) ![b](b.png) <img src="c.png" alt=""> <img alt="d">') == [
        "a.png", '<img src="c.png" alt="">',
    ]  # fmt: skip
    pages = {name: (ROOT / name).read_text(encoding="utf-8") for name in word_counts()}
    assert sum(text.count("](") for text in pages.values()) > 100
    assert {
        name: found for name, text in pages.items() if (found := pictures_without_text(text))
    } == {}
